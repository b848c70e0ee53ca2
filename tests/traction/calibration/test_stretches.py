from dataclasses import replace

import numpy as np
import pytest

from ohmward.traction.calibration import calibrate_radius
from ohmward.traction.calibration.floor import traction
from ohmward.traction.calibration.stretches import Stretches, cut, parabola
from traction.terrain.drives import OMNI, SOFT, omni_drive


def test_the_weighted_mean_of_a_rate_is_the_slope_of_its_integral():
    t = np.linspace(0.0, 1.0, 2001)
    rate = np.where(t < 0.37, -1.0, 2.0)  # a step within the stretch
    integral = np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(t))])
    weight = parabola(t)
    assert weight @ rate / weight.sum() == pytest.approx(np.polyfit(t, integral, 1)[0], rel=2e-3)


def test_starts_and_stops_are_left_out_where_motion_must_be_steady():
    drive = omni_drive([SOFT] * 3, 0.0, seconds=6.0)
    speeds = drive.log.wheel_speed_rad_s * np.minimum(drive.log.time_s / 3.0, 1.0)[:, None]
    started = drive._replace(log=type(drive.log)("start", drive.log.time_s, speeds, drive.log.motor_current_A))
    assert len(cut([started], OMNI).drive) == 4
    assert len(cut([started], OMNI, steady=False).drive) == 6


def at_other_rates(drive, every):
    """The drive with the speeds of its wheels in every so many rows, each in rows of its own."""
    rows = np.arange(len(drive.log))[:, None]
    speeds = np.where(rows % every == np.arange(3), drive.log.wheel_speed_rad_s, np.nan)
    return drive._replace(log=replace(drive.log, wheel_speed_rad_s=speeds))


def test_wheels_of_a_slower_rate_and_an_empty_cell_cost_no_stretch():
    drive = omni_drive([SOFT] * 3, 40.0, seconds=6.0)
    whole = cut([drive], OMNI)
    one_empty = drive.log.wheel_speed_rad_s.copy()
    one_empty[50, 1] = np.nan
    gap = cut([drive._replace(log=replace(drive.log, wheel_speed_rad_s=one_empty))], OMNI)
    slow = cut([at_other_rates(drive, 4)], OMNI)
    assert len(gap.drive) == len(slow.drive) == len(whole.drive) == 6
    np.testing.assert_allclose(gap.rim, whole.rim, atol=1e-3)
    np.testing.assert_allclose(slow.rim, whole.rim, atol=5e-3)
    assert calibrate_radius([at_other_rates(drive, 4)], OMNI).value == pytest.approx(
        calibrate_radius([drive], OMNI).value, rel=0.01
    )


def test_a_wheel_that_is_silent_for_longer_than_a_stretch_is_not_made_up():
    drive = omni_drive([SOFT] * 3, 0.0, seconds=6.0)
    silent = np.flatnonzero((drive.log.time_s > 1.5) & (drive.log.time_s < 4.5))
    speeds = drive.log.wheel_speed_rad_s.copy()
    speeds[silent, 2] = np.nan
    found = cut([drive._replace(log=replace(drive.log, wheel_speed_rad_s=speeds))], OMNI)
    assert len(found.drive) < 5


def test_a_drive_without_its_motion_gives_no_stretch():
    drive = omni_drive([SOFT] * 3, 0.0, seconds=6.0)
    motion = drive.motion.copy()
    motion[drive.log.time_s > 2.5] = np.nan
    assert len(cut([drive, drive._replace(motion=motion)], OMNI).drive) == 6 + 3


def test_the_ground_gives_a_wheel_its_torque_less_what_turns_it_faster():
    omega, rate, current = np.array([[3.0, 3.0, 3.0]]), np.array([[0.0, 0.0, 0.4]]), np.array([[0.8, 0.8, 0.8]])
    rim = np.zeros((1, 3))
    s = Stretches(np.zeros(1), omega, current, rim, rim, rate, np.zeros(1))
    motor, radius_m = OMNI.motor, OMNI.wheel.radius_m
    inertia = OMNI.wheel.inertia_kg_m2 + motor.gear_ratio**2 * motor.rotor_inertia_kg_m2
    torque = 16 * 0.0514 * 0.8 * 0.8 - 0.15  # gear of 80 %, friction; the tanh of 6 is 1
    expected = (torque - inertia * 0.4 * 0.125 / radius_m) / radius_m
    np.testing.assert_allclose(traction(s, OMNI), np.full((1, 3), expected), rtol=1e-4)
