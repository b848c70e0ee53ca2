import numpy as np
import pytest
from scipy.stats import chi2

from filters.examples import PENDULUM, PENDULUM_R, height, pendulum
from ohmward.errors import InputError
from ohmward.filters import Belief, extended, nis, unscented
from ohmward.filters.consistency import Verdict, ensemble, gate_threshold, mean_bounds, nees, time_average, whiteness

RUNS, STEPS = 40, 25
Q = np.diag([1e-5, 1e-4, 1e-6])
SMALL = Belief(PENDULUM.mean, PENDULUM.cov / 20)


def test_nees_is_the_squared_mahalanobis_distance():
    truth = np.array([1.0, -0.2, 1.1])
    expected = (truth - PENDULUM.mean) @ np.linalg.inv(PENDULUM.cov) @ (truth - PENDULUM.mean)
    assert nees(PENDULUM, truth) == pytest.approx(expected, rel=1e-12)


def test_bounds_have_their_probability():
    lower, upper = mean_bounds(3, 50, 0.95)
    assert chi2.cdf(50 * upper, 150) - chi2.cdf(50 * lower, 150) == pytest.approx(0.95, abs=1e-12)
    assert chi2.cdf(50 * lower, 150) == pytest.approx(0.025, abs=1e-12)
    means = np.random.default_rng(1).chisquare(3, size=(20_000, 50)).mean(axis=1)
    assert np.mean((means > lower) & (means < upper)) == pytest.approx(0.95, abs=0.005)


def test_gate_threshold_is_three_sigma_for_one_output():
    assert gate_threshold(1, 0.9973002039367398) == pytest.approx(9.0, rel=1e-9)


def simulate(filter_step, seed, Q_claimed=Q, R_claimed=PENDULUM_R):
    """NEES and NIS (STEPS,) of one run of the pendulum."""
    rng = np.random.default_rng(seed)
    truth, belief = rng.multivariate_normal(SMALL.mean, SMALL.cov), SMALL
    history = []
    for _ in range(STEPS):
        truth = rng.multivariate_normal(pendulum(truth), Q)
        y = height(truth) + np.sqrt(PENDULUM_R[0]) * rng.normal(size=1)
        belief, innovation = filter_step(belief, y, Q_claimed, R_claimed)
        history.append((nees(belief, truth), nis(innovation)))
    return np.array(history).T


def extended_step(belief, y, Q, R):
    return extended.update(extended.predict(belief, pendulum, Q), y, height, R)


def unscented_step(belief, y, Q, R):
    return unscented.update(unscented.predict(belief, pendulum, Q), y, height, R)


def reusing_step(belief, y, Q, R):
    return unscented.step_reusing_points(belief, pendulum, height, y, Q, R)


@pytest.fixture(scope="module", params=[extended_step, unscented_step, reusing_step])
def runs(request):
    """NEES and NIS over independent runs, (RUNS, 2, STEPS)."""
    return np.array([simulate(request.param, seed) for seed in range(RUNS)])


def test_nees_over_independent_runs(runs):
    verdicts = ensemble(runs[:, 0], dof=3, probability=0.999)
    assert all(verdict.consistent for verdict in verdicts)


def test_nis_over_runs_and_time(runs):
    verdict = time_average(runs[:, 1].ravel(), dof=1, probability=0.999)
    assert verdict.consistent


@pytest.mark.parametrize(("factor", "word"), [(0.5, "less"), (2.0, "more")])
def test_a_wrong_claim_is_found(factor, word):
    nis_values = np.array([simulate(unscented_step, seed, factor * Q, factor * PENDULUM_R)[1] for seed in range(20)])
    verdict = time_average(nis_values.ravel(), dof=1, probability=0.999)
    assert not verdict.consistent
    assert f"claims {word} uncertainty" in verdict.advice


def test_a_verdict_on_no_number_is_not_consistent():
    verdict = Verdict(np.nan, 0.9, 1.1)
    assert not verdict.consistent
    assert "diverged" in verdict.advice


def test_white_noise_is_white():
    rng = np.random.default_rng(1)
    rejected = [whiteness(rng.normal(size=(300, 1)), 10).p_value[0] < 0.05 for _ in range(400)]
    assert np.mean(rejected) == pytest.approx(0.05, abs=0.033)


def test_autocorrelation_of_a_known_series():
    result = whiteness(np.array([[1.0], [1.0], [-1.0], [-1.0]]), 3)
    np.testing.assert_allclose(result.autocorrelation[:, 0], [1 / 4, -2 / 4, -1 / 4])
    assert result.bound == pytest.approx(1.959964 / 2, rel=1e-6)
    # Ljung-Box by hand: 4 * 6 * ((1/4)^2 / 3 + (2/4)^2 / 2 + (1/4)^2 / 1) = 5
    assert result.p_value[0] == pytest.approx(chi2.sf(5.0, 3), rel=1e-12)


def test_a_constant_is_correlated_with_itself():
    np.testing.assert_allclose(whiteness(np.ones((4, 1)), 3).autocorrelation[:, 0], [3 / 4, 2 / 4, 1 / 4])


def test_correlation_and_bias_are_found():
    noise = np.random.default_rng(2).normal(size=(500, 2))
    coloured = noise.copy()
    coloured[1:, 0] += 0.4 * noise[:-1, 0]
    result = whiteness(coloured, 10)
    assert result.p_value[0] < 1e-6
    assert result.p_value[1] > 0.01
    assert result.autocorrelation[0, 0] == pytest.approx(0.4 / 1.16, abs=0.1)
    assert whiteness(noise + 0.5, 10).p_value.max() < 1e-6


def test_bad_arguments_are_refused():
    with pytest.raises(InputError, match=r"max_lag must be from 1 to 9 .* but is 10"):
        whiteness(np.zeros((10, 1)), 10)
    with pytest.raises(InputError, match=r"probability must lie between 0 and 1 but is 95"):
        mean_bounds(1, 1, 95)
    with pytest.raises(InputError, match=r"truth must have shape \(3,\)"):
        nees(PENDULUM, np.zeros(2))
