import math
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from filters.examples import largest_difference, random_linear
from ohmward.errors import InputError
from ohmward.filters import Belief, kalman
from ohmward.filters.linear_algebra import mirror_lower


def test_scalar_filter_settles_on_the_riccati_root():
    f, q, r = 0.9, 0.5, 2.0
    # posterior p = r m / (m + r) with the prior m = f^2 p + q: m^2 + m (r - f^2 r - q) - q r = 0
    b = r - f * f * r - q
    prior = (-b + math.sqrt(b * b + 4 * q * r)) / 2
    F, Q, H, R = np.array([[f]]), np.array([[q]]), np.array([[1.0]]), np.array([[r]])
    belief = Belief(np.zeros(1), np.array([[100.0]]))
    for _ in range(60):
        predicted = kalman.predict(belief, F, Q)
        belief, _ = kalman.update(predicted, np.zeros(1), H, R)
    assert predicted.cov[0, 0] == pytest.approx(prior, rel=1e-13)
    assert belief.cov[0, 0] == pytest.approx(r * prior / (prior + r), rel=1e-13)


def test_a_constant_seen_k_times_is_its_mean():
    y = np.array([3.0, 5.0, 4.0, 8.0])
    belief = Belief(np.zeros(1), np.array([[1e12]]))
    for value in y:
        belief, _ = kalman.update(belief, np.array([value]), np.eye(1), np.array([[2.0]]))
    assert belief.mean[0] == pytest.approx(y.mean(), rel=1e-11)
    assert belief.cov[0, 0] == pytest.approx(2.0 / 4, rel=1e-11)


def test_predict_is_the_moment_equation():
    F, offset, Q, _, _, belief = random_linear(np.random.default_rng(2), 4, 2)
    predicted = kalman.predict(belief, F, Q, offset)
    np.testing.assert_allclose(predicted.mean, F @ belief.mean + offset, atol=1e-13)
    np.testing.assert_allclose(predicted.cov, F @ belief.cov @ F.T + Q, atol=1e-13)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_update_conditions_the_joint_gaussian(m):
    rng = np.random.default_rng(m)
    *_, H, R, belief = random_linear(rng, 4, m)
    y = rng.normal(size=m)
    joint_cov = np.block([[belief.cov, belief.cov @ H.T], [H @ belief.cov, H @ belief.cov @ H.T + R]])
    precision = np.linalg.inv(joint_cov)
    cov = np.linalg.inv(precision[:4, :4])
    mean = belief.mean - cov @ precision[:4, 4:] @ (y - H @ belief.mean)
    posterior, innovation = kalman.update(belief, y, H, R)
    np.testing.assert_allclose(posterior.mean, mean, atol=1e-10)
    np.testing.assert_allclose(posterior.cov, cov, atol=1e-10)
    np.testing.assert_allclose(innovation.value, y - H @ belief.mean, atol=1e-13)
    np.testing.assert_allclose(innovation.cov, joint_cov[4:, 4:], atol=1e-12)


def test_a_state_itself_is_corrected_as_by_its_row_of_the_identity():
    *_, belief = random_linear(np.random.default_rng(4), 4, 2)
    for i in range(4):
        expected, _ = kalman.update(belief, np.array([0.7]), np.eye(4)[i : i + 1], np.array([[0.3]]))
        corrected = kalman.correct_state(belief, i, 0.7, 0.3)
        np.testing.assert_allclose(corrected.mean, expected.mean, rtol=1e-13)
        np.testing.assert_allclose(corrected.cov, expected.cov, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(corrected.cov, corrected.cov.T)


def test_a_state_that_is_not_used_changes_nothing():
    *_, belief = random_linear(np.random.default_rng(5), 4, 2)
    left = kalman.correct_state(belief, 2, 1e3, 0.3, used=False)
    np.testing.assert_array_equal(left.mean, belief.mean)
    np.testing.assert_array_equal(left.cov, belief.cov)


@pytest.mark.parametrize("ratio", [1e-4, 1e-12, 1e-18])
def test_a_state_measured_ever_so_much_better_than_known_keeps_a_variance_above_zero(ratio):
    root = np.random.default_rng(6).normal(size=(4, 4))
    belief = Belief(np.zeros(4), root @ root.T)
    cov = kalman.correct_state(belief, 1, 0.0, ratio * belief.cov[1, 1]).cov
    assert cov[1, 1] == pytest.approx(ratio * belief.cov[1, 1], rel=max(ratio, 1e-12) * 2)
    assert np.linalg.eigvalsh(cov).min() > -1e-15 * np.trace(belief.cov)


def test_filtering_is_batch_least_squares():
    rng = np.random.default_rng(3)
    F, _, Q, H, R, belief = random_linear(rng, 3, 2)
    measurements = rng.normal(size=(5, 2))
    last = _batch_least_squares(belief, F, Q, H, R, measurements)
    for y in measurements:
        belief, _ = kalman.update(kalman.predict(belief, F, Q), y, H, R)
    assert largest_difference(belief, last) < 1e-11


def _batch_least_squares(prior, F, Q, H, R, measurements):
    """Belief about the last state from the normal equations of all states at once."""
    n, T = len(prior.mean), len(measurements)
    information, right = np.zeros(((T + 1) * n, (T + 1) * n)), np.zeros((T + 1) * n)

    def add(jacobian, cov, value):
        nonlocal information, right
        information = information + jacobian.T @ np.linalg.solve(cov, jacobian)
        right = right + jacobian.T @ np.linalg.solve(cov, value)

    state = np.eye((T + 1) * n).reshape(T + 1, n, -1)
    add(state[0], prior.cov, prior.mean)
    for k, y in enumerate(measurements):
        add(state[k + 1] - F @ state[k], Q, np.zeros(n))
        add(H @ state[k + 1], R, y)
    return Belief(np.linalg.solve(information, right)[-n:], np.linalg.inv(information)[-n:, -n:])


def test_equals_filterpy():
    rng = np.random.default_rng(4)
    F, offset, Q, H, R, belief = random_linear(rng, 4, 2)
    F = F / np.abs(np.linalg.eigvals(F)).max()
    peer = KalmanFilter(dim_x=4, dim_z=2, dim_u=4)
    peer.x, peer.P, peer.F, peer.Q, peer.H, peer.R, peer.B = belief.mean, belief.cov, F, Q, H, R, np.eye(4)
    for y in rng.normal(size=(50, 2)):
        belief, innovation = kalman.update(kalman.predict(belief, F, Q, offset), y, H, R)
        peer.predict(u=offset)
        peer.update(y)
    assert largest_difference(belief, (peer.x, peer.P)) < 1e-11
    assert largest_difference(innovation, (peer.y, peer.S)) < 1e-11


def test_a_perfect_sensor_is_believed():
    *_, belief = random_linear(np.random.default_rng(5), 3, 1)
    H = np.array([[0.0, 1.0, 0.0]])
    posterior, _ = kalman.update(belief, np.array([7.0]), H, np.zeros((1, 1)))
    assert posterior.mean[1] == pytest.approx(7.0, abs=1e-14)
    np.testing.assert_allclose(posterior.cov[1], 0, atol=1e-14)
    again, _ = kalman.update(posterior, np.array([7.0]), H, np.zeros((1, 1)))
    assert largest_difference(again, posterior) < 1e-6


def test_a_perfect_sensor_of_a_known_state_teaches_nothing():
    belief = Belief(np.array([1.0, 2.0]), np.diag([0.0, 3.0]))
    posterior, _ = kalman.update(belief, np.array([1.5]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    assert largest_difference(posterior, belief) == 0


def test_inputs_are_left_alone():
    F, _, Q, H, R, belief = random_linear(np.random.default_rng(6), 3, 1)
    copies = [array.copy() for array in (F, Q, H, R, *belief)]
    kalman.update(kalman.predict(belief, F, Q), np.zeros(1), H, R)
    assert all(np.array_equal(a, b) for a, b in zip(copies, (F, Q, H, R, *belief), strict=True))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y": np.array(1.0)}, r"y must have shape \(1,\) but has \(\); wrap the number: np.array\(\[value\]\)"),
        ({"H": np.ones(2)}, r"H must have shape \(1, 2\) but has \(2,\)"),
        ({"R": np.array(1.0)}, r"R must have shape \(1, 1\) but has \(\); wrap the number: np.array\(\[\[value\]\]\)"),
    ],
)
def test_update_refuses_wrong_shapes(change, message):
    arguments = {"y": np.zeros(1), "H": np.ones((1, 2)), "R": np.eye(1)} | change
    with pytest.raises(InputError, match=message):
        kalman.update(Belief(np.zeros(2), np.eye(2)), **arguments)


def test_predict_refuses_wrong_shapes():
    with pytest.raises(
        InputError, match=r"Q must have shape \(2, 2\) but has \(2,\); a covariance is a matrix: np.diag"
    ):
        kalman.predict(Belief(np.zeros(2), np.eye(2)), np.eye(2), np.ones(2))
    with pytest.raises(InputError, match=r"F must have shape \(2, 2\)"):
        kalman.predict(Belief(np.zeros(2), np.eye(2)), np.eye(3), np.eye(2))


@pytest.mark.parametrize("m", [1, 2])
def test_joseph_is_the_product_of_three_for_any_gain(m):
    rng = np.random.default_rng(11)
    *_, H, R, belief = random_linear(rng, 5, m)
    K = rng.normal(size=(5, m))
    A = np.eye(5) - K @ H
    np.testing.assert_allclose(kalman.joseph(belief.cov, K, H, R), A @ belief.cov @ A.T + K @ R @ K.T, atol=1e-12)


@pytest.mark.parametrize("ratio", [1e-3, 1e-9, 1e-14])
def test_josephs_form_keeps_the_digits_that_the_plain_difference_loses(ratio):
    P, H, R = np.full((1, 1), 2.0), np.full((1, 1), 0.7), np.full((1, 1), ratio)
    K = kalman.gain(P @ H.T, H @ P @ H.T + R)
    exact = ratio * 2.0 / (0.98 + ratio)
    assert kalman.joseph(P, K, H, R)[0, 0] == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("m", [1, 2])
def test_a_measurement_that_is_not_used_changes_no_bit(m):
    *_, H, R, belief = random_linear(np.random.default_rng(12), 4, m)
    belief = Belief(belief.mean, mirror_lower(belief.cov))
    left = kalman.correct(belief, np.full(m, 1e3), H, R, used=False)
    np.testing.assert_array_equal(left.belief.mean, belief.mean)
    np.testing.assert_array_equal(left.belief.cov, belief.cov)
    assert left.innovation.value[0] != 0.0 and not left.gain.any()
    yes: Any = np.bool_(True)
    used = kalman.correct(belief, np.full(m, 1e3), H, R, used=yes)
    assert largest_difference(used.belief, kalman.correct(belief, np.full(m, 1e3), H, R).belief) < 1e-12
