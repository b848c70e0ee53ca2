import numpy as np
import pytest
from scipy import stats

from ohmward.energy.points import normal_points, normal_tail, quantiles, student, two_piece


@pytest.mark.parametrize("dimensions", [1, 3, 8])
def test_every_dimension_is_a_standard_normal(dimensions):
    z = normal_points(dimensions)
    assert z.shape == (dimensions, 4096)
    for row in z:
        assert np.array(quantiles(row)) == pytest.approx([-1.28155, 0.0, 1.28155], abs=0.002)
    assert np.cov(z).reshape(dimensions, dimensions) == pytest.approx(np.eye(dimensions), abs=0.02)


def test_a_sum_over_all_dimensions_has_the_right_quantiles():
    assert np.array(quantiles(normal_points(6).sum(axis=0))) == pytest.approx(
        np.sqrt(6) * np.array([-1.28155, 0.0, 1.28155]), abs=0.05
    )


@pytest.mark.parametrize(("dof", "error"), [(3.0, 0.03), (6.0, 0.003), (30.0, 1e-4)])
def test_students_t_against_scipy(dof, error):
    p = np.linspace(0.01, 0.99, 99)
    assert student(stats.norm.ppf(p), dof) == pytest.approx(stats.t.ppf(p, dof), rel=error, abs=1e-9)


@pytest.mark.parametrize("lower", [0.5, 1.0, 1.5])
def test_a_two_piece_normal_has_no_step_at_its_mode(lower):
    x = np.linspace(-9.0, 9.0, 180001)
    density = stats.norm.pdf(x / np.where(x < 0.0, lower, 2.0 - lower))  # (2 / (s + 2 - s) is 1)
    upto = np.cumsum(density) * (x[1] - x[0])
    p = np.linspace(0.001, 0.999, 999)
    assert two_piece(stats.norm.ppf(p), lower) == pytest.approx(np.interp(p, upto, x), abs=1e-3)


def test_infinite_values_have_quantiles():
    assert quantiles(np.array([1.0, 2.0, np.inf, np.inf, np.inf])).p90 == np.inf


def test_the_tail_of_a_normal():
    x = np.linspace(-9.0, 9.0, 1001)
    assert normal_tail(x) == pytest.approx(stats.norm.sf(x), abs=1e-6)
