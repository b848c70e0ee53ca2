"""A gyro that repeats itself is stuck once the wheels have turned the robot by another rate for long enough."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA
from ohmward.traction.motion.sample import STOPPED
from ohmward.traction.motion.stuck_sensors import COMPARABLE_S, SETTLED_S, watch_log

DT_S = 0.02
TIME_S = DT_S * np.arange(2000)


def found(turn, gyro):
    """Conditions (2, T) that the gyro is suspected and stuck, while wheels turn the robot at these rates (T,)."""
    motion = np.column_stack([np.full(len(turn), 0.5), turn])
    speeds = motion @ RLMA.rolling.T / RLMA.wheel.radius_m
    log = DriveLog("turns", TIME_S, speeds, np.full((len(turn), 2), np.nan), yaw_rate_rad_s=gyro)
    return np.array(watch_log(RLMA, log)[:2])


def winding():
    """Yaw rates (T,) of a robot that is straight on for 5 s and turns at 0.4 to 0.6 rad/s then."""
    return np.where(TIME_S > 5.0, 0.5 + 0.1 * np.sin(3.0 * TIME_S), 0.0)


@pytest.mark.parametrize(("value", "after_s"), [(0.02, STOPPED.contradicts_s), (0.0, STOPPED.gyro_at_zero_s)])
def test_a_gyro_that_repeats_a_number_is_stuck_after_its_time_of_turning(value, after_s):
    suspected, stuck = found(winding(), np.full(TIME_S.size, value))
    lag_s = 0.1  # of the average
    assert TIME_S[np.argmax(suspected)] == pytest.approx(5.0 + STOPPED.contradicts_s, abs=lag_s)
    assert TIME_S[np.argmax(stuck)] == pytest.approx(5.0 + after_s, abs=lag_s)


def test_a_gyro_that_freezes_is_stuck_once_the_turn_changes_and_until_it_reports_again():
    turn = np.where(TIME_S < 20.0, 0.5, 0.1) + 0.01 * np.sin(3.0 * TIME_S)
    frozen = (TIME_S > 10.0) & (TIME_S < 30.0)
    stuck = found(turn, np.where(frozen, 0.5, turn))[1]
    assert not stuck[20.0 + STOPPED.contradicts_s > TIME_S].any()
    assert stuck[(20.0 + STOPPED.contradicts_s + SETTLED_S < TIME_S) & frozen].all()
    assert not stuck[TIME_S >= 30.0].any()


def test_a_gyro_clips_where_it_repeats_a_fast_turn():
    turn = 3.0 * np.sin(TIME_S)
    stuck = found(turn, np.clip(turn, -2.5, 2.5))[1]
    samples = round(COMPARABLE_S / DT_S) + 2
    np.testing.assert_array_equal(stuck[samples - 1 :], sliding_window_view(np.abs(turn), samples).min(axis=1) > 2.5)


def test_a_gyro_without_noise_is_not_stuck_on_a_robot_that_turns_in_steps():
    """Its wheels turn twice as far as the robot, as those that scrub do, and count coarsely."""
    turn = np.select([TIME_S < 5.0, TIME_S < 15.0, TIME_S < 25.0], [0.0, 0.4, -0.3], 0.0)
    counted = 2.0 * turn + 0.3 * (np.arange(TIME_S.size) % 2 - 0.5)
    assert not found(counted, turn).any()


def test_wheels_that_repeat_themselves_too_are_no_evidence():
    assert not found(np.full(TIME_S.size, 0.5), np.zeros(TIME_S.size)).any()
