import math

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction.floors import CrossingTest, crossing_test, slip_on_floors
from traction.floors.drives import OMNI, SMOOTH, SOFT, omni_drive

STEP = CrossingTest(step_share=0.06, ripple_share=0.012, ripple_growth=0.0)


def alarms(test, drag, dt_s=0.03):
    state, found = test.init(3), []
    for k, value in enumerate(drag):
        state, crossing = test.step(state, float(value), np.array([0.1, 0.0, 0.0]), True, dt_s)
        found += [k * dt_s] if crossing else []
    return found


def test_the_threshold_solves_the_equation_of_the_run_length():
    h, k = STEP.threshold, 5.0
    assert 2 * 0.3 / k**2 * (math.exp(h) - h - 1) == pytest.approx(2 * 3600.0)


@pytest.mark.parametrize("change", [0.06, -0.06])
def test_a_step_is_found_as_soon_as_the_sum_reaches_the_threshold(change):
    drag = np.where(np.arange(400) < 200, 0.1, 0.1 + change)
    (found,) = alarms(STEP, drag)
    gain = STEP.step_share / STEP.ripple_share**2 / STEP.ripple_s * (abs(change) - STEP.step_share / 2)
    assert 6.0 < found < 6.0 + 1.6 * STEP.threshold / gain


def test_a_change_of_half_a_step_is_none():
    assert alarms(STEP, np.where(np.arange(400) < 200, 0.1, 0.1 + 0.029)) == []


@pytest.mark.slow
def test_false_alarms_are_no_more_frequent_than_claimed():
    rng = np.random.default_rng(6)
    test = CrossingTest(step_share=0.03, ripple_share=0.015, ripple_growth=0.0, false_alarms_per_hour=60.0)
    white = rng.normal(0.0, 0.015 * math.sqrt(0.3 / 0.03), 200_000)  # the density of a ripple that lasts 0.3 s
    per_hour = len(alarms(test, 0.1 + white)) / (200_000 * 0.03 / 3600)
    assert per_hour < 60.0


def test_a_stop_and_another_direction_start_anew():
    state = STEP.init(3)
    for moving, motion in ((True, [0.1, 0, 0]), (False, [0.0, 0, 0]), (True, [0.0, 0.1, 0])):
        for _ in range(60):
            drag = 0.3 if motion[1] else 0.1
            state, crossing = STEP.step(state, drag, np.array(motion, dtype=float), moving, 0.03)
            assert crossing is None


@pytest.mark.parametrize("before, after, sign", [(SMOOTH, SOFT, 1), (SOFT, SMOOTH, -1)])
def test_one_wheel_on_another_floor_is_found_within_a_second(before, after, sign):
    drive = omni_drive([before] * 3, 20.0, rng=np.random.default_rng(7), later=[before, after, before])
    (crossing,) = slip_on_floors(OMNI, (SMOOTH, SOFT)).run(drive.log).crossings
    assert 4.0 < crossing.time_s < 5.0
    assert sign * (crossing.drag_after - crossing.drag_before) > 0


def test_one_floor_has_no_crossing():
    drive = omni_drive([SOFT] * 3, 20.0, seconds=30.0, rng=np.random.default_rng(8))
    assert slip_on_floors(OMNI, (SMOOTH, SOFT)).run(drive.log).crossings == []


def test_the_smallest_change_is_the_lightest_wheel_between_the_nearest_floors():
    found = crossing_test(OMNI, (SMOOTH, SOFT))
    assert found.step_share == pytest.approx((SOFT.drag - SMOOTH.drag) * 30.0 / 110.8)
    assert crossing_test(OMNI, ()).step_share == CrossingTest().step_share


def test_wrong_settings_are_refused():
    with pytest.raises(InputError, match="ripple_s must be > 0"):
        CrossingTest(ripple_s=0.0)
