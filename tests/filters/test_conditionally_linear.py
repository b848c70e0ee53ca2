"""An output that is linear in all but a few states: the unscented update of all of them, with fewer points."""

import numpy as np
import pytest

from filters.examples import largest_difference
from ohmward.errors import InputError
from ohmward.filters import Belief, conditionally_linear, kalman, unscented
from ohmward.filters.linear_algebra import mirror_lower

SIZES = [(3, 1, 1), (4, 1, 2), (5, 2, 1), (5, 2, 3), (3, 3, 1)]
sizes = pytest.mark.parametrize(("n", "k", "m"), SIZES)


def example(n, k, m):
    """A belief, y, g, H and R: curved enough that the second moments of g show."""
    rng = np.random.default_rng(10 * n + m)
    root, R = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    A, H = rng.normal(size=(m, k)), rng.normal(size=(m, n))
    return Belief(rng.normal(size=n), root @ root.T), rng.normal(size=m), lambda x: np.sin(A @ x) ** 2, H, R @ R.T


@sizes
@pytest.mark.parametrize("scaling", [unscented.DEFAULT, unscented.Scaling(1.0, 0.0, 1.5)])
def test_it_is_the_unscented_update(n, k, m, scaling):
    belief, y, g, H, R = example(n, k, m)
    expected = unscented.correct(belief, y, lambda x: g(x[:k]) + H @ x, R, scaling)
    found = conditionally_linear.correct(belief, y, g, H, R, k, scaling=scaling)
    assert largest_difference(found.belief, expected.belief) < 1e-11
    np.testing.assert_allclose(found.gain, expected.gain, atol=1e-12)
    np.testing.assert_allclose(found.innovation.value, expected.innovation.value, atol=1e-12)
    np.testing.assert_allclose(found.innovation.cov, expected.innovation.cov, rtol=1e-12, atol=1e-12)


@sizes
def test_where_g_is_straight_it_is_the_kalman_filter(n, k, m):
    belief, y, _, H, R = example(n, k, m)
    A = np.random.default_rng(1).normal(size=(m, k))
    expected, _ = kalman.update(belief, y, H + np.hstack([A, np.zeros((m, n - k))]), R)
    found = conditionally_linear.correct(belief, y, lambda x: A @ x, H, R, k).belief
    assert largest_difference(found, expected) < 1e-11


@sizes
def test_a_measurement_that_is_not_used_changes_no_bit(n, k, m):
    belief, y, g, H, R = example(n, k, m)
    left = conditionally_linear.correct(belief, y, g, H, R, k, used=False)
    np.testing.assert_array_equal(left.belief.mean, belief.mean)
    np.testing.assert_array_equal(left.belief.cov, mirror_lower(belief.cov))
    assert not left.gain.any()


def test_a_function_of_another_size_is_refused():
    belief, y, _, H, R = example(3, 1, 1)
    with pytest.raises(InputError, match="g"):
        conditionally_linear.correct(belief, y, lambda x: np.array([x[0], x[0]]), H, R)
