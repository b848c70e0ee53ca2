"""A gyro that repeats itself is stuck once the wheels have turned the robot by another rate for long enough."""

import numpy as np
import pytest

from ohmward.logs.drive_log import DriveLog
from ohmward.trace import Kernel, where
from ohmward.traction import RLMA
from ohmward.traction.motion.sample import LONGEST_STEP_S, no_sample, sanitize
from ohmward.traction.motion.stuck_gyro import (
    MIRRORED_S,
    MOST_MIRRORED_S,
    REPEATS_AT_ZERO_S,
    REPEATS_S,
    SETTLED_S,
    GyroWatch,
    watch_gyro,
    watch_log,
)

DT_S = 0.02
TIME_S = DT_S * np.arange(2000)


def found(turn, gyro):
    """Conditions (2, T) that the gyro is suspected and stuck, while wheels turn the robot at these rates (T,)."""
    motion = np.column_stack([np.full(len(turn), 0.5), turn])
    speeds = motion @ RLMA.rolling.T / RLMA.wheel.radius_m
    log = DriveLog("turns", TIME_S, speeds, np.full((len(turn), 2), np.nan), yaw_rate_rad_s=gyro)
    return watch_log(RLMA, log)


def winding():
    """Yaw rates (T,) of a robot that is straight on for 5 s and turns at 0.4 to 0.6 rad/s then."""
    return np.where(TIME_S > 5.0, 0.5 + 0.1 * np.sin(3.0 * TIME_S), 0.0)


@pytest.mark.parametrize(("value", "after_s"), [(0.02, REPEATS_S), (0.0, REPEATS_AT_ZERO_S)])
def test_a_gyro_that_repeats_a_number_is_stuck_after_its_time_of_turning(value, after_s):
    suspected, stuck = found(winding(), np.full(TIME_S.size, value))
    lag_s = 0.1  # of the average
    assert TIME_S[np.argmax(suspected)] == pytest.approx(5.0 + REPEATS_S, abs=lag_s)
    assert TIME_S[np.argmax(stuck)] == pytest.approx(5.0 + after_s, abs=lag_s)


def test_a_gyro_that_freezes_is_stuck_once_the_turn_changes_and_until_it_reports_again():
    turn = np.where(TIME_S < 20.0, 0.5, 0.1) + 0.01 * np.sin(3.0 * TIME_S)
    frozen = (TIME_S > 10.0) & (TIME_S < 30.0)
    stuck = found(turn, np.where(frozen, 0.5, turn))[1]
    assert not stuck[TIME_S < 20.0 + REPEATS_S].any()
    assert stuck[(TIME_S > 20.0 + REPEATS_S + SETTLED_S) & frozen].all()
    assert not stuck[TIME_S >= 30.0].any()


def test_a_gyro_without_noise_is_not_stuck_on_a_robot_that_turns_in_steps():
    """Its wheels turn twice as far as the robot, as those that scrub do, and count coarsely."""
    turn = np.select([TIME_S < 5.0, TIME_S < 15.0, TIME_S < 25.0], [0.0, 0.4, -0.3], 0.0)
    counted = 2.0 * turn + 0.3 * (np.arange(TIME_S.size) % 2 - 0.5)
    assert not found(counted, turn).any()


def test_wheels_that_repeat_themselves_too_are_no_evidence():
    assert not found(np.full(TIME_S.size, 0.5), np.zeros(TIME_S.size)).any()


def mirrored(turn, gyro):
    """Conditions (T,) that the gyro is found to be mirrored, while wheels turn the robot at these rates (T,)."""
    motion = np.column_stack([np.full(len(turn), 0.5), turn])
    nothing = no_sample(RLMA)
    samples = nothing._replace(
        dt_s=np.full(len(turn), DT_S),
        wheel_speed_rad_s=np.pad(motion @ RLMA.rolling[:2].T / RLMA.wheel.radius_m, ((0, 0), (0, 2))),
        yaw_rate_rad_s=gyro,
    )

    def step(before, sample):
        after = watch_gyro(before, sanitize(sample, LONGEST_STEP_S), RLMA)
        return after, where(after.mirrored, 1.0, 0.0)

    _, found = Kernel(step, GyroWatch(), nothing).scan(GyroWatch(), samples)
    return found > 0.5


def test_a_gyro_that_turns_against_the_wheels_is_mirrored_until_it_turns_with_them():
    turn = winding() + 0.01 * np.sin(20.0 * TIME_S)
    found = mirrored(turn, np.where(TIME_S < 20.0, -turn, turn))
    assert TIME_S[np.argmax(found)] == pytest.approx(5.0 + MIRRORED_S, abs=2.0 * DT_S)
    assert found[TIME_S < 20.0][-1]
    assert not found[TIME_S > 20.0 + MOST_MIRRORED_S].any()


def test_wheels_that_slip_make_a_gyro_no_mirrored_one_that_has_turned_with_them():
    turn = 0.5 + 0.1 * np.sin(3.0 * TIME_S)
    slips = (TIME_S > 12.0) & (TIME_S < 20.0)
    assert not mirrored(np.where(slips, -turn, turn), turn).any()


def test_a_gyro_that_is_late_on_a_winding_way_is_not_mirrored():
    turn = 0.5 * np.sin(2.0 * TIME_S)
    assert not mirrored(turn, np.roll(turn, round(0.5 / DT_S))).any()


def test_wheels_that_turn_much_faster_than_the_robot_slip():
    turn = winding()
    assert not mirrored(turn, -0.25 * turn).any()
