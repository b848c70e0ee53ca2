import numpy as np
import pytest

from ohmward.traction.calibration.parameters import regress

NOTHING = np.full(2, np.inf)


def sample(rng, drives=20, rows=30, together=0.0):
    A = np.column_stack([np.ones(drives * rows), np.repeat(rng.normal(size=drives), rows)])
    drive = np.repeat(np.arange(drives), rows)
    noise = rng.normal(0.0, 0.1, drives * rows) + together * rng.normal(size=drives)[drive]
    return A, A @ [0.3, 1.2] + noise, drive


def test_without_a_prior_it_is_least_squares():
    A, y, drive = sample(np.random.default_rng(1))
    fit = regress(A, y, drive, np.zeros(2), NOTHING)
    np.testing.assert_allclose(fit.beta, np.linalg.lstsq(A, y, rcond=None)[0], rtol=1e-9)


def test_a_column_that_says_nothing_keeps_its_prior():
    A, y, drive = sample(np.random.default_rng(2))
    A[:, 1] = 0.0
    fit = regress(A, y, drive, np.array([0.0, 0.7]), np.array([np.inf, 0.2]))
    assert fit.beta[1] == pytest.approx(0.7)
    assert np.sqrt(fit.cov[1, 1]) == pytest.approx(0.2)


@pytest.mark.parametrize(("together", "drives"), [(0.0, 20), (0.3, 20), (0.3, 1)])
def test_the_covariance_is_that_of_repetitions_even_when_rows_of_a_drive_err_together(together, drives):
    rng = np.random.default_rng(3)
    samples = [sample(rng, together=together) for _ in range(300)]
    fits = [regress(A, y, drive * drives // 20, np.zeros(2), NOTHING) for A, y, drive in samples]
    errors = np.array([fit.beta for fit in fits]) - [0.3, 1.2]
    claimed = np.sqrt(np.mean([np.diag(fit.cov) for fit in fits], axis=0))
    np.testing.assert_allclose(errors.std(axis=0), claimed, rtol=0.2)
