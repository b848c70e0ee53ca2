import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward.traction.terrain.crossing import CrossingSample, CrossingTest, crossing_test
from traction.terrain.drives import OMNI, SMOOTH, SOFT, omni_drive, on_floors

TEST = CrossingTest(ripple_share=0.02, ripple_growth=0.0)
SPEED_M_S = 0.1
TAU_S = TEST.ripple_m / SPEED_M_S
#: What counts under each of three wheels, in the forces of the wheels.
CHANGE = np.array([[0.08, 0.02, 0.0], [0.02, -0.06, 0.01], [0.0, 0.03, 0.09]])


def alarms(test, force, dt_s=0.03):
    state, found = test.init(OMNI), []
    for k, value in enumerate(force):
        sample = CrossingSample(value, CHANGE, np.array([SPEED_M_S, 0.0, 0.0]), True, dt_s)
        state, result = test.step(state, sample)
        found += [k * dt_s] if result.alarm else []
    return found


def later(change):
    """Forces (400, 3) that change at 6 s."""
    return np.where(np.arange(400)[:, None] < 200, 0.1, 0.1 + change)


def test_the_threshold_solves_the_equation_of_the_run_length():
    k2 = np.array([0.1, 0.5, 30.0])
    h = TEST.threshold(k2, TAU_S)
    np.testing.assert_allclose(2 * TAU_S / k2 * (np.exp(h) - h - 1), 6 * 3600.0, rtol=1e-9)


@pytest.mark.parametrize("wheel", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_change_under_each_wheel_is_found_as_soon_as_its_sum_reaches_the_threshold(wheel, sign):
    e = CHANGE[:, wheel]
    k2 = np.sum(CHANGE**2, axis=0) / TEST.ripple_share**2
    (found,) = alarms(TEST, later(sign * e))
    soonest = TEST.threshold(k2, TAU_S)[wheel] * TAU_S / (k2[wheel] / 2)
    assert 6.0 + 0.9 * soonest < found < 6.0 + 1.8 * soonest


def test_a_second_change_soon_after_the_first_is_found_too():
    force = 0.1 + 1.5 * CHANGE[:, 0] * (np.arange(400) >= 200)[:, None] * np.where(np.arange(400) < 225, 1, 2)[:, None]
    first, second = alarms(TEST, force)
    assert 6.0 < first < 6.5 and 6.75 < second < 7.25


def test_less_than_half_a_change_is_none():
    assert alarms(TEST, later(0.45 * CHANGE[:, 0])) == []


def test_forces_that_no_wheel_explains_are_no_crossing():
    two = CHANGE[:, [0, 1, 0]]
    across = np.cross(two[:, 0], two[:, 1])
    state = TEST.init(OMNI)
    for force in later(0.3 * across / np.linalg.norm(across)):
        state, result = TEST.step(state, CrossingSample(force, two, np.array([SPEED_M_S, 0.0, 0.0]), True, 0.03))
        assert not result.alarm


def in_lanes(test, force, lanes=0, change=CHANGE):
    """Whether each sample of forces (T, 3) or (T, 3, lanes) raises an alarm."""
    motion = np.array([SPEED_M_S, 0.0, 0.0])
    state = test.init(OMNI)
    kernel = Kernel(test.step, state, CrossingSample(np.zeros(3), CHANGE, motion, 1.0 > 0.0, 0.03))
    samples = CrossingSample(force, change, motion, True, 0.03)
    return (kernel.scan_lanes if lanes else kernel.scan)(state, samples)[1]


def ripple(shape):
    """White noise with the density of a ripple that lasts tau."""
    return np.random.default_rng(6).normal(0.0, TEST.ripple_share * math.sqrt(TAU_S / 0.03), shape)


@pytest.mark.slow
def test_false_alarms_are_no_more_frequent_than_claimed():
    found = in_lanes(replace(TEST, false_alarms_per_hour=60.0), 0.1 + ripple((100_000, 3)))
    assert 2.0 < found.alarm.sum() / (100_000 * 0.03 / 3600) < 60.0


@pytest.mark.parametrize("wheel", [0, 1, 2])
@pytest.mark.parametrize("share", [1.0, 1.3])
def test_a_change_is_known_after_the_mean_delay_that_is_said(wheel, share):
    lanes, changes, e = 400, 400, share * CHANGE
    force = 0.1 + ripple((800, 3, lanes))
    force[changes:] += e[:, wheel, None]
    found = in_lanes(TEST, force, lanes, e)
    quiet = ~found.alarm[:changes].any(axis=0)
    late = found.alarm[changes:, quiet]
    given_s = found.delay_s[changes - 1, wheel, quiet].mean()
    assert quiet.mean() > 0.9 and late.any(axis=0).mean() > 0.97
    assert 0.1 < given_s < 1.0
    assert 0.03 * (0.5 + late.argmax(axis=0)[late.any(axis=0)]).mean() == pytest.approx(given_s, rel=0.15)


def test_the_delay_with_a_mean_that_is_known_is_siegmunds():
    k2 = np.array([3.0, 30.0])
    h = TEST.threshold(k2, TAU_S)
    np.testing.assert_allclose(TEST.delay_s(k2, TAU_S, 1e6), 2 * TAU_S / k2 * (np.exp(-h) + h - 1), rtol=1e-4)


def test_a_test_that_waits_says_so_and_a_wheel_that_does_not_show_is_found_late():
    unseen = CrossingSample(np.full(3, 0.1), CHANGE * [1.0, 1.0, 1e-4], np.array([SPEED_M_S, 0.0, 0.0]), True, 0.03)
    state, result = TEST.step(TEST.init(OMNI), unseen)
    assert np.isinf(result.delay_s).all()
    for _ in range(200):
        state, result = TEST.step(state, unseen)
    assert result.delay_s[0] < 1.0 and np.isinf(result.delay_s[2])


def test_a_stop_and_another_direction_start_anew():
    state = TEST.init(OMNI)
    for moving, motion in ((True, [0.1, 0, 0]), (False, [0.0, 0, 0]), (True, [0.0, 0.1, 0])):
        for _ in range(60):
            force = np.full(3, 0.5 if motion[1] else 0.1)
            sample = CrossingSample(force, CHANGE, np.array(motion, dtype=float), moving, 0.03)
            state, result = TEST.step(state, sample)
            assert not result.alarm


@pytest.mark.parametrize("before, after, sign", [(SMOOTH, SOFT, 1), (SOFT, SMOOTH, -1)])
def test_one_wheel_on_another_floor_is_found_within_a_second(before, after, sign):
    drive = omni_drive([before] * 3, 20.0, rng=np.random.default_rng(7), later=[before, after, before])
    (crossing,) = on_floors((SMOOTH, SOFT)).run(drive.log).crossings
    assert 4.0 < crossing.time_s < 5.0
    assert sign * (crossing.drag_after - crossing.drag_before) > 0


def test_one_floor_has_no_crossing():
    drive = omni_drive([SOFT] * 3, 20.0, seconds=30.0, rng=np.random.default_rng(8))
    assert on_floors((SMOOTH, SOFT)).run(drive.log).crossings == []


def test_what_counts_is_a_share_of_what_sets_the_nearest_floors_apart():
    found = crossing_test((SMOOTH, SOFT, replace(SOFT, name="far", rolling=0.5, roller=0.8)))
    assert found.rolling_step == pytest.approx(0.7 * (SOFT.rolling - SMOOTH.rolling))
    assert found.roller_step == pytest.approx(0.7 * (SOFT.roller - SMOOTH.roller))
    assert crossing_test(()) == crossing_test((SOFT,)) == CrossingTest()


def test_wrong_settings_are_refused():
    with pytest.raises(InputError, match="ripple_m must be > 0"):
        CrossingTest(ripple_m=0.0)
