import numpy as np
import pytest

from filters.examples import PENDULUM, PENDULUM_Q, PENDULUM_R, height, largest_difference, pendulum, random_linear
from ohmward.errors import InputError
from ohmward.filters import Belief, adaptive, kalman, nis, unscented
from ohmward.filters.adaptive import Matching, NoiseEstimate
from ohmward.trace import Kernel

STEPS = [adaptive.extended_step, adaptive.unscented_step, adaptive.unscented_step_reusing_points]
WALK_STD, SENSOR_STD, HIDDEN_STD = 0.03, 0.2, 0.01


def scalar(value):
    return np.array([[value]])


def same(x):
    """A random walk's next state, and its output."""
    return x * 1.0


def follow_walk(Q, R, matching, length=20_000):
    """Mean R, mean Q and mean NIS of the adaptive filter after a while on a random walk whose noise is known."""

    def step(state, y):
        state, innovation = adaptive.extended_step(state, same, same, np.array([y]), matching)
        return state, (state.R[0, 0], state.Q[0, 0], nis(innovation))

    rng = np.random.default_rng(1)
    walk = np.cumsum(WALK_STD * rng.normal(size=length))
    y = walk + SENSOR_STD * rng.normal(size=length)
    start = adaptive.init(Belief(np.zeros(1), np.eye(1)), scalar(Q), scalar(R))
    _, history = Kernel(step, start, 0.0).scan(start, y)
    return tuple(np.mean(values[length // 4 :]) for values in history)


def test_moments_are_plain_means_up_to_the_window():
    rng = np.random.default_rng(1)
    values = rng.normal(size=(50, 2, 2))
    noise = NoiseEstimate(np.zeros((2, 2)), np.zeros((2, 2)), 0.0)
    for innovation, residual in values:
        noise = adaptive.remember(noise, innovation, residual, window=50)
    assert noise.samples == 50
    np.testing.assert_allclose(noise.innovation, values[:, 0].T @ values[:, 0] / 50, atol=1e-14)
    np.testing.assert_allclose(noise.residual, values[:, 1].T @ values[:, 1] / 50, atol=1e-14)


def test_later_moments_forget_exponentially():
    values = np.random.default_rng(1).normal(size=(400, 1))
    window, noise = 20, NoiseEstimate(np.zeros((1, 1)), np.zeros((1, 1)), 0.0)
    for value in values:
        noise = adaptive.remember(noise, value, value, window)
    age = np.arange(400)[::-1]
    weight = np.where(age < 380, (1 - 1 / window) ** age / window, (1 - 1 / window) ** 380 / window)
    assert weight.sum() == pytest.approx(1, abs=1e-14)
    assert noise.innovation[0, 0] == pytest.approx((weight @ values**2)[0], rel=1e-13)


def test_forgetting_scatters_as_a_ring_of_twice_the_window():
    values = np.random.default_rng(2).normal(size=(20_000, 1))
    window, start = 20, NoiseEstimate(np.zeros((1, 1)), np.zeros((1, 1)), 0.0)

    def step(noise, value):
        noise = adaptive.remember(noise, value, value, window)
        return noise, noise.innovation[0, 0]

    _, recursive = Kernel(step, start, values[0]).scan(start, values)
    count = 2 * window - 1
    ring = np.convolve(values[:, 0] ** 2, np.full(count, 1 / count), "valid")
    assert np.std(recursive[500:]) == pytest.approx(np.std(ring[500:]), rel=0.05)


def test_matching_is_equations_3_49_and_3_50():
    rng = np.random.default_rng(3)
    F, offset, Q, H, R, belief = random_linear(rng, 4, 2)
    y, floors = rng.normal(size=2), Matching(1e-3 * np.eye(4), 1e-4 * np.eye(2))
    prior = kalman.predict(belief, F, Q, offset)
    posterior, innovation, K = kalman.correct(prior, y, H, R)
    e, eps = innovation.value, y - H @ posterior.mean
    for step in (adaptive.extended_step, adaptive.unscented_step):
        state, _ = step(adaptive.init(belief, Q, R), lambda x: F @ x + offset, lambda x: H @ x, y, floors)
        assert largest_difference(state.belief, posterior) < 1e-12
        np.testing.assert_allclose(state.Q, K @ np.outer(e, e) @ K.T + 1e-3 * np.eye(4), atol=1e-12)
        expected = np.outer(eps, eps) + H @ posterior.cov @ H.T + 1e-4 * np.eye(2)
        np.testing.assert_allclose(state.R, expected, atol=1e-12)


@pytest.mark.parametrize("R", [100 * SENSOR_STD**2, SENSOR_STD**2 / 100])
def test_a_wrong_measurement_noise_is_found(R):
    matching = Matching(scalar(WALK_STD**2), scalar(1e-8), match_Q=False)
    found, _, mean_nis = follow_walk(WALK_STD**2, R, matching)
    assert found == pytest.approx(SENSOR_STD**2, rel=0.03)
    assert mean_nis == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("Q", [100 * WALK_STD**2, WALK_STD**2 / 100])
def test_a_wrong_process_noise_is_found_in_a_long_window(Q):
    matching = Matching(scalar(1e-8), scalar(SENSOR_STD**2), window=1000, match_R=False)
    _, found, mean_nis = follow_walk(Q, SENSOR_STD**2, matching)
    assert found == pytest.approx(WALK_STD**2, rel=0.15)
    assert mean_nis == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("scale", [100.0, 0.01])
def test_matching_both_finds_the_size_but_not_the_ratio(scale):
    R, Q, mean_nis = follow_walk(WALK_STD**2, scale * SENSOR_STD**2, Matching(scalar(1e-8), scalar(1e-8)))
    assert mean_nis == pytest.approx(1, abs=0.05)
    assert Q / R > 10 * (WALK_STD / SENSOR_STD) ** 2


def nees_of_a_hidden_walk(matching, length=20_000):
    """Mean NEES, 1 when right, of a walking bias that shows in every other 2000 samples only.

    While it does not show its gain is zero, so K C K' adds nothing to its variance.
    """

    def step(state, sample):
        shows, y, truth = sample
        y = np.array([y])
        state, _ = adaptive.extended_step(state, same, lambda x: np.array([x[0] + shows * x[1]]), y, matching)
        return state, (state.belief.mean[1] - truth) ** 2 / state.belief.cov[1, 1]

    rng, shows = np.random.default_rng(4), np.arange(length) // 2000 % 2
    level, bias = np.cumsum(HIDDEN_STD * rng.normal(size=(2, length)), axis=1)
    y = level + shows * bias + 0.1 * rng.normal(size=length)
    start = adaptive.init(Belief(np.zeros(2), np.eye(2)), HIDDEN_STD**2 * np.eye(2), scalar(0.01))
    _, nees = Kernel(step, start, (0.0, 0.0, 0.0)).scan(start, (shows, y, bias))
    return nees[length // 10 :].mean()


def test_without_floors_a_weakly_observable_state_collapses_and_with_floors_it_does_not():
    no_floors = Matching(np.zeros((2, 2)), scalar(0.0))
    floors = Matching(HIDDEN_STD**2 * np.eye(2), scalar(1e-6))
    assert nees_of_a_hidden_walk(no_floors) > 5
    assert nees_of_a_hidden_walk(floors) < 1.5


@pytest.mark.parametrize("step", STEPS)
def test_a_missing_measurement_is_a_prediction_and_leaves_the_noise_alone(step):
    matching = Matching(PENDULUM_Q, PENDULUM_R / 10, gate=np.inf)
    state = adaptive.init(PENDULUM, PENDULUM_Q, PENDULUM_R)
    state, _ = step(state, pendulum, height, np.array([0.3]), matching)
    skipped, _ = step(state, pendulum, height, np.array([np.nan]), matching)
    np.testing.assert_array_equal(skipped.Q, state.Q)
    np.testing.assert_array_equal(skipped.R, state.R)
    assert skipped.noise.samples == 1
    if step is not adaptive.extended_step:
        assert largest_difference(skipped.belief, unscented.predict(state.belief, pendulum, state.Q)) < 1e-15


@pytest.mark.parametrize("step", STEPS)
def test_the_gate_keeps_a_spike_out_of_the_noise(step):
    matching = Matching(PENDULUM_Q, PENDULUM_R / 10, gate=10.8)
    state = adaptive.init(PENDULUM, PENDULUM_Q, PENDULUM_R)
    spiked, _ = step(state, pendulum, height, np.array([50.0]), matching)
    np.testing.assert_array_equal(spiked.R, PENDULUM_R)
    assert spiked.noise.samples == 0


def test_wrong_settings_are_refused():
    with pytest.raises(InputError, match="window must be at least 1 sample but is 0"):
        Matching(np.eye(1), np.eye(1), window=0)
    with pytest.raises(InputError, match="gate must be > 0 but is -1"):
        Matching(np.eye(1), np.eye(1), gate=-1)
    state = adaptive.init(PENDULUM, PENDULUM_Q, PENDULUM_R)
    with pytest.raises(InputError, match=r"matching.Q_floor must have shape \(3, 3\) but has \(1, 1\)"):
        adaptive.extended_step(state, pendulum, height, np.zeros(1), Matching(np.eye(1), np.eye(1)))
    with pytest.raises(InputError, match=r"Q must have shape \(3, 3\)"):
        adaptive.init(PENDULUM, np.eye(2), PENDULUM_R)
