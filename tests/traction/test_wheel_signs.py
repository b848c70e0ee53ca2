"""Signs of wheel speeds whose logger wrote sizes only."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA
from ohmward.traction.drive_checks import mended
from ohmward.traction.robot.packaged import generic_robot
from ohmward.traction.wheel_signs import with_wheel_signs

TIME = np.arange(0.0, 60.0, 0.05)
#: Ahead and back on curves, on the spot, then straight back between two stops.
SPEED_M_S = (
    np.interp(
        TIME, [1, 2, 14, 16, 28, 29, 31, 32, 44, 45, 48, 49, 58, 59], [0, 6, 6, -6, -6, 0] + 4 * [0] + [0, -6, -6, 0]
    )
    / 10
)
YAW_RAD_S = np.interp(TIME, [1, 2, 28, 29, 31, 32, 44, 45], [0, 4, 4, 0, 0, -8, -8, 0]) / 10
STRAIGHT = TIME > 48.0


def drive(robot, turns=1.0):
    """A log of a robot whose wheels show so many times its turn."""
    motion = np.column_stack([SPEED_M_S, *[0.0 * TIME] * (robot.freedoms - 2), turns * YAW_RAD_S])
    wheels = motion @ robot.rolling.T / robot.wheel.radius_m
    gyro = YAW_RAD_S + 0.01 + 0.003 * np.random.default_rng(0).standard_normal(TIME.size)
    return DriveLog("drive", TIME, wheels, np.full((TIME.size, robot.driven), np.nan), yaw_rate_rad_s=gyro)


def unsigned(log):
    return replace(log, wheel_speed_rad_s=np.abs(log.wheel_speed_rad_s))


@pytest.mark.parametrize(
    "robot, turns",
    [(RLMA, 1.0), (generic_robot(50.0, 0.165, 0.55, 0.5, layout="skid-steer"), 1.6)],
    ids=["rolls", "scrubs"],
)
def test_a_gyro_shows_them_in_turns_and_straight_on_they_stay_unknown(robot, turns):
    log = drive(robot, turns)
    found = mended(robot, unsigned(log)).wheel_speed_rad_s
    moves, known = np.abs(log.wheel_speed_rad_s) > 1.0, np.isfinite(found)
    np.testing.assert_array_equal(found[moves & known], log.wheel_speed_rad_s[moves & known])
    assert known[moves & ~STRAIGHT[:, None]].mean() > 0.95
    assert not known[moves & STRAIGHT[:, None]].any()


@pytest.mark.parametrize("sensor", ["speed", "currents"])
def test_a_signed_speed_or_signed_currents_show_them_straight_on_too(sensor):
    log = drive(RLMA)
    if sensor == "speed":
        log = replace(log, speed_m_s=np.where(np.arange(TIME.size) % 20 == 0, SPEED_M_S, np.nan))
    else:
        pull = 2.0 * SPEED_M_S + 10.0 * np.gradient(SPEED_M_S, TIME)
        log = replace(log, motor_current_A=np.column_stack([pull, pull]))
    found = with_wheel_signs(RLMA, unsigned(log)).wheel_speed_rad_s[STRAIGHT]
    moves = np.abs(log.wheel_speed_rad_s[STRAIGHT]) > 1.0
    np.testing.assert_array_equal(found[moves], log.wheel_speed_rad_s[STRAIGHT][moves])


def test_speeds_with_signs_and_those_of_a_robot_that_never_drives_back_stay_as_they_are():
    log = drive(RLMA)
    ahead = log.select(np.flatnonzero(TIME < 14.0))
    mirrored = replace(ahead, yaw_rate_rad_s=-ahead.yaw_rate_rad_s)
    assert with_wheel_signs(RLMA, log) is log
    assert with_wheel_signs(RLMA, mirrored) is mirrored
    assert with_wheel_signs(RLMA, ahead) is ahead


def test_noise_of_a_speed_from_outside_takes_no_signs():
    log = unsigned(replace(drive(RLMA), yaw_rate_rad_s=None))
    noise_m_s = 0.5 * np.random.default_rng(0).standard_normal(TIME.size)
    noisy = replace(log, speed_m_s=np.abs(SPEED_M_S) + noise_m_s)
    assert with_wheel_signs(RLMA, noisy) is noisy
