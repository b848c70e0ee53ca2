import math

import numpy as np
import pytest

from filters.examples import PENDULUM, PENDULUM_R, height, largest_difference, two_outputs
from ohmward.filters import Belief, kalman, unscented
from ohmward.filters.consistency import gate_threshold
from ohmward.filters.gate import choose, inflate, passes, time_rejected

THRESHOLD = gate_threshold(1)


def gated(y, threshold=THRESHOLD):
    posterior, innovation = unscented.update(PENDULUM, np.array([y]), height, PENDULUM_R)
    return choose(passes(innovation, threshold), posterior, PENDULUM), posterior


def test_a_plausible_measurement_is_used():
    belief, posterior = gated(0.3)
    assert largest_difference(belief, posterior) == 0


@pytest.mark.parametrize("y", [1e3, -1e3, 1e100])
def test_a_huge_innovation_is_rejected(y):
    belief, _ = gated(y)
    assert largest_difference(belief, PENDULUM) == 0


@pytest.mark.parametrize("y", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("threshold", [THRESHOLD, math.inf])
def test_a_missing_measurement_is_skipped(y, threshold):
    belief, _ = gated(y, threshold)
    assert largest_difference(belief, PENDULUM) == 0


def test_the_boundary_is_accepted():
    belief = Belief(np.zeros(1), np.array([[3.0]]))
    _, innovation = kalman.update(belief, np.array([4.0]), np.eye(1), np.eye(1))
    assert passes(innovation, 4.0)
    assert not passes(innovation, 4.0 - 1e-12)


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("y", [[0.2, np.nan], [np.nan, 0.2], [0.2, np.inf], [np.inf, -np.inf]])
def test_one_missing_element_of_two_skips_both(y):
    posterior, innovation = unscented.update(PENDULUM, np.array(y), two_outputs, np.eye(2))
    assert largest_difference(choose(passes(innovation), posterior, PENDULUM), PENDULUM) == 0


def test_the_gate_lets_the_right_share_through():
    rng = np.random.default_rng(1)
    belief = Belief(np.zeros(1), np.array([[3.0]]))
    threshold = gate_threshold(1, 0.9)
    accepted = 0
    for y in 2.0 * rng.normal(size=2000):
        _, innovation = kalman.update(belief, np.array([y]), np.eye(1), np.eye(1))
        accepted += bool(passes(innovation, threshold))
    assert abs(accepted / 2000 - 0.9) < 3 * math.sqrt(0.9 * 0.1 / 2000)


def test_the_time_of_rejection_grows_and_ends_with_the_first_measurement_that_passes():
    seen: list = [0.0]
    for rejected in (True, True, False, True):
        seen.append(time_rejected(seen[-1], 0.5, rejected))
    assert seen == [0.0, 0.5, 1.0, 0.0, 0.5]


@pytest.mark.parametrize("rejected", [True, False])
def test_a_missing_measurement_neither_confirms_nor_contradicts(rejected):
    assert time_rejected(2.0, 0.5, rejected, measured=False) == 2.0


def test_between_two_measurements_of_a_slow_sensor_the_time_goes_on():
    assert time_rejected(2.0, 0.5, False, measured=False, sparse=True) == 2.5
    assert time_rejected(0.0, 0.5, False, measured=False, sparse=True) == 0.0
    assert time_rejected(2.0, 0.5, True, sparse=True) == 2.5
    assert time_rejected(2.0, 0.5, False, sparse=True) == 0.0


def test_inflating_adds_to_one_variance_and_never_takes():
    wider = inflate(PENDULUM, 1, 0.7)
    assert wider.cov[1, 1] == PENDULUM.cov[1, 1] + 0.7
    assert np.abs(wider.cov - PENDULUM.cov).sum() == pytest.approx(0.7)
    assert largest_difference(inflate(PENDULUM, 1, -0.7), PENDULUM) == 0
