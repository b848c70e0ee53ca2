import numpy as np
import pytest

from filters.examples import random_covariance
from ohmward.filters.linear_algebra import cholesky, mirror_lower, solve_lower, solve_spd, solve_upper


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_cholesky_is_the_factor(rng, n):
    P = random_covariance(rng, n)
    L, ok = cholesky(P)
    np.testing.assert_allclose(L, np.linalg.cholesky(P), rtol=0, atol=1e-13)
    assert ok == 1


def test_cholesky_takes_integers():
    L, _ = cholesky(np.array([[4, 2], [2, 3]]))
    np.testing.assert_allclose(L, [[2, 0], [1, np.sqrt(2)]])


def test_cholesky_reads_the_lower_triangle_only(rng):
    P = random_covariance(rng, 4)
    np.testing.assert_array_equal(cholesky(np.tril(P))[0], cholesky(P)[0])


def test_structural_zeros_stay():
    L, ok = cholesky(np.array([[2.0, 0, 0], [0, 3, 1], [0, 1, 4]]))
    assert L[1, 0] == 0
    assert L[2, 0] == 0
    assert ok == 1


def test_a_state_known_exactly_is_no_failure():
    L, ok = cholesky(np.diag([1.0, 0.0, 4.0]))
    np.testing.assert_allclose(L, np.diag([1.0, 0.0, 2.0]), atol=1e-15)
    assert ok == 1


def test_a_singular_covariance_is_no_failure():
    v = np.array([1.0, 2.0, -3.0])
    L, ok = cholesky(np.outer(v, v))
    np.testing.assert_allclose(L @ L.T, np.outer(v, v), atol=1e-11)
    assert ok == 1


@pytest.mark.parametrize(
    "P",
    [
        np.array([[1.0, 2.0], [2.0, 1.0]]),
        np.diag([1.0, -1e-3]),
        np.diag([-1e-3, 1.0]),
        np.array([[0.0, 1.0], [1.0, 1.0]]),
    ],
    ids=["correlation above one", "negative variance", "negative variance first", "covariance with a constant"],
)
def test_an_indefinite_matrix_is_flagged_and_finite(P):
    L, ok = cholesky(P)
    assert ok == 0
    assert np.isfinite(L).all()


def test_not_a_number_is_flagged():
    assert cholesky(np.array([[np.nan]]))[1] == 0
    assert cholesky(np.array([[1.0, 0.0], [np.nan, 1.0]]))[1] == 0


@pytest.mark.parametrize("shape", [(4,), (4, 3)])
def test_solvers_invert(rng, shape):
    P, B = random_covariance(rng, 4), rng.normal(size=shape)
    L = np.linalg.cholesky(P)
    np.testing.assert_allclose(L @ solve_lower(L, B), B, atol=1e-12)
    np.testing.assert_allclose(L.T @ solve_upper(L.T, B), B, atol=1e-12)
    np.testing.assert_allclose(P @ solve_spd(P, B), B, atol=1e-12)


def test_one_output_needs_one_division():
    np.testing.assert_array_equal(solve_spd(np.array([[4.0]]), np.array([[2.0, 6.0]])), [[0.5, 1.5]])


def test_nothing_to_learn_from_a_variance_of_zero():
    assert solve_spd(np.zeros((1, 1)), np.zeros((1, 3))).tolist() == [[0, 0, 0]]


def test_mirror_lower_repeats_the_very_elements():
    M = np.array([[object() for _ in range(3)] for _ in range(3)])
    mirrored = mirror_lower(M)
    for i in range(3):
        for j in range(i + 1):
            assert mirrored[i, j] is M[i, j]
            assert mirrored[j, i] is M[i, j]
