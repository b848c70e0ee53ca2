import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from filters.examples import (
    PENDULUM,
    PENDULUM_Q,
    PENDULUM_R,
    height,
    largest_difference,
    pendulum,
    random_linear,
    two_outputs,
)
from ohmward.errors import InputError
from ohmward.filters import Belief, extended, kalman, unscented
from ohmward.filters.unscented import Scaling
from ohmward_lab.reproduce.unscented_textbook import sigma_points, sigma_weights, textbook_step

TWO_R = np.array([[0.01, 0.002], [0.002, 0.03]])


SENSORS = [(height, PENDULUM_R), (two_outputs, TWO_R), (lambda x: x[:1], PENDULUM_R)]


def test_the_textbooks_sigma_points_and_weights_have_the_moments_of_the_belief():
    points = sigma_points(PENDULUM)
    w_mean, w_cov = sigma_weights(3)
    d = points - PENDULUM.mean
    assert largest_difference(PENDULUM, (w_mean @ points, d.T @ np.diag(w_cov) @ d)) < 1e-15
    np.testing.assert_allclose(points[1:4] - PENDULUM.mean, 0.85 * np.linalg.cholesky(3 * PENDULUM.cov).T, atol=1e-15)
    assert w_mean.sum() == pytest.approx(1.0, abs=1e-15)
    assert w_cov[0] - w_mean[0] == pytest.approx(1 - 0.85**2 + 2, abs=1e-15)


@pytest.mark.parametrize("filter_", [extended, unscented])
@pytest.mark.parametrize("m", [1, 2])
def test_on_a_linear_model_it_is_the_kalman_filter(filter_, m):
    rng = np.random.default_rng(m)
    F, offset, Q, H, R, belief = random_linear(rng, 4, m)
    y = rng.normal(size=m)
    predicted = filter_.predict(belief, lambda x: F @ x + offset, Q)
    corrected, innovation = filter_.update(predicted, y, lambda x: H @ x, R)
    exact = kalman.predict(belief, F, Q, offset)
    assert largest_difference(predicted, exact) < 1e-12
    exact_correction, exact_innovation = kalman.update(exact, y, H, R)
    assert largest_difference(corrected, exact_correction) < 1e-12
    assert largest_difference(innovation, exact_innovation) < 1e-12


def test_reuse_on_a_linear_model_without_process_noise_is_the_kalman_filter():
    rng = np.random.default_rng(7)
    F, offset, Q, H, R, belief = random_linear(rng, 4, 2)
    y = rng.normal(size=2)
    step, _ = unscented.step_reusing_points(belief, lambda x: F @ x + offset, lambda x: H @ x, y, 0 * Q, R)
    exact, _ = kalman.update(kalman.predict(belief, F, 0 * Q, offset), y, H, R)
    assert largest_difference(step, exact) < 1e-11


def test_second_moments_of_a_square_are_exact():
    # x ~ N(mu, s^2): E x^2 = mu^2 + s^2 and Var x^2 = 2 s^4 + 4 mu^2 s^2, which beta = 2 gives for any alpha and n = 1
    mu, variance = 0.7, 0.3
    belief = Belief(np.array([mu]), np.array([[variance]]))
    predicted = unscented.predict(belief, lambda x: x * x, np.zeros((1, 1)), Scaling(alpha=1.0))
    assert predicted.mean[0] == pytest.approx(mu**2 + variance, rel=1e-14)
    assert predicted.cov[0, 0] == pytest.approx(2 * variance**2 + 4 * mu**2 * variance, rel=1e-14)


@pytest.mark.parametrize("scaling", [Scaling(), Scaling(0.6, 2.0, 1.0), Scaling(1.0, 2.0, 0.0)])
@pytest.mark.parametrize(("h", "R"), [(height, PENDULUM_R), (two_outputs, TWO_R)])
def test_redrawing_equals_filterpy(scaling, h, R):
    m = len(R)
    belief = PENDULUM
    peer = UnscentedKalmanFilter(3, m, 0.1, h, lambda x, dt: pendulum(x), MerweScaledSigmaPoints(3, *scaling))
    peer.x, peer.P, peer.Q, peer.R = belief.mean, belief.cov, PENDULUM_Q, R
    for y in 0.3 + 0.1 * np.random.default_rng(1).normal(size=(50, m)):
        predicted = unscented.predict(belief, pendulum, PENDULUM_Q, scaling)
        belief, innovation = unscented.update(predicted, y, h, R, scaling)
        peer.predict()
        peer.update(y)
    assert largest_difference(belief, (peer.x, peer.P)) < 1e-10
    assert largest_difference(innovation, (peer.y, peer.S)) < 1e-10


def redrawing_step(belief, f, h, y, Q, R, scaling):
    return unscented.update(unscented.predict(belief, f, Q, scaling), y, h, R, scaling)


@pytest.mark.parametrize("scaling", [Scaling(), Scaling(0.6, 2.0, 1.0)])
@pytest.mark.parametrize(("h", "R"), SENSORS)
@pytest.mark.parametrize(("step", "redraw"), [(unscented.step_reusing_points, False), (redrawing_step, True)])
def test_both_variants_equal_the_textbook(step, redraw, h, R, scaling):
    belief = textbook = PENDULUM
    for y in 0.3 + 0.1 * np.random.default_rng(2).normal(size=(50, len(R))):
        belief, innovation = step(belief, pendulum, h, y, PENDULUM_Q, R, scaling)
        textbook, textbook_innovation = textbook_step(textbook, pendulum, h, y, PENDULUM_Q, R, scaling, redraw)
    assert largest_difference(belief, textbook) < 1e-12
    assert largest_difference(innovation, textbook_innovation) < 1e-12


def test_the_two_variants_differ():
    y = np.array([0.3])
    redrawn, _ = unscented.update(unscented.predict(PENDULUM, pendulum, PENDULUM_Q), y, height, PENDULUM_R)
    reused, _ = unscented.step_reusing_points(PENDULUM, pendulum, height, y, PENDULUM_Q, PENDULUM_R)
    assert largest_difference(redrawn, reused) > 1e-4


def test_a_parameter_keeps_its_mean_and_variance_to_the_bit():
    predicted = unscented.predict(PENDULUM, pendulum, np.zeros((3, 3)))
    assert predicted.mean[2] == PENDULUM.mean[2]
    assert predicted.cov[2, 2] == PENDULUM.cov[2, 2]


def test_taking_repeated_states_exactly_changes_nothing_but_rounding():
    sigma = unscented.draw_pairs(PENDULUM)
    seen = unscented.propagate(pendulum, sigma)
    images = [pendulum(x) + 1e-15 * np.sign(x[0] - 0.6) for x in sigma.points]
    unseen = unscented.in_pairs(images, sigma)
    assert seen.repeated_state == (None, None, 2)
    assert unseen.repeated_state == (None, None, None)
    P = PENDULUM.cov
    np.testing.assert_allclose(
        unscented.covariance(seen, seen, P), unscented.covariance(unseen, unseen, P), rtol=0, atol=1e-13
    )


def test_an_output_that_is_a_state_is_that_state():
    _, innovation = unscented.update(PENDULUM, np.array([1.0]), lambda x: x[1:2], PENDULUM_R)
    assert innovation.value[0] == 1.0 - PENDULUM.mean[1]
    assert innovation.cov[0, 0] == PENDULUM.cov[1, 1] + PENDULUM_R[0, 0]


def test_a_perfect_sensor_is_believed():
    posterior, _ = unscented.update(PENDULUM, np.array([0.5]), lambda x: x[:1], np.zeros((1, 1)))
    assert posterior.mean[0] == pytest.approx(0.5, abs=1e-14)
    np.testing.assert_allclose(posterior.cov[0], 0, atol=1e-15)


def test_a_precise_sensor_cannot_make_the_covariance_indefinite():
    belief = Belief(np.zeros(3), np.diag([1e6, 1.0, 1e-6]))
    R = np.array([[1e-18]])
    for h in (lambda x: np.array([x[0] + x[1]]), lambda x: np.array([x[0] + x[2]])):
        belief, _ = unscented.update(belief, np.zeros(1), h, R)
    assert np.linalg.eigvalsh(belief.cov).min() > -1e-9
    assert (np.diag(belief.cov) > 0).all()


@pytest.mark.parametrize(
    ("scaling", "message"),
    [
        (Scaling(alpha=1e-3), "the central covariance weight must be >= 0 .* choose alpha between 0.52 and 1.93"),
        (Scaling(kappa=-3.0), r"alpha\^2 \(n \+ kappa\) must be > 0 but is 0.0 .* raise kappa or alpha"),
    ],
)
def test_a_scaling_that_could_make_the_covariance_indefinite_is_refused(scaling, message):
    with pytest.raises(InputError, match=message):
        unscented.predict(PENDULUM, pendulum, PENDULUM_Q, scaling)


@pytest.mark.parametrize(
    ("y", "R", "message"),
    [
        (np.zeros(2), PENDULUM_R, r"y must have shape \(1,\) but has \(2,\)"),
        (np.zeros(1), np.eye(2), r"R must have shape \(1, 1\) but has \(2, 2\)"),
    ],
)
def test_wrong_shapes_are_refused(y, R, message):
    with pytest.raises(InputError, match=message):
        unscented.update(PENDULUM, y, height, R)
    with pytest.raises(InputError, match=message):
        unscented.step_reusing_points(PENDULUM, pendulum, height, y, PENDULUM_Q, R)
    with pytest.raises(InputError, match=r"f\(x\) must have shape \(3,\)"):
        unscented.predict(PENDULUM, height, PENDULUM_Q)
