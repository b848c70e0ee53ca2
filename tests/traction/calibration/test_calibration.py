"""Calibration in a closed loop: what went into a drive comes out, within its own band."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA, RollingResistance, Terrain, scene
from ohmward.traction.calibration import (
    CalibrationDrive,
    Parameter,
    calibrate_motor,
    calibrate_radius,
    learn_floor,
    with_parameters,
)
from ohmward.traction.friction.law import Burckhardt
from traction.examples import plant
from traction.terrain.drives import OMNI, SMOOTH, SOFT, omni_drive

DIRECTIONS = range(0, 360, 30)
ROLLING = 0.012


def around(floor, rng, speeds=(0.12,), robot=OMNI):
    """Drives in all directions; the ground differs a little from drive to drive."""
    return [
        omni_drive([replace(floor, stiffness=floor.stiffness * rng.lognormal(0.0, 0.03))] * 3, d, v, 6.0, rng, robot)
        for d in DIRECTIONS
        for v in speeds
    ]


@pytest.fixture(scope="module")
def straight():
    """Drives of RLMA on a floor of Burckhardt's law with changing currents: robot, ground's truth and drives."""
    truth = replace(
        RLMA,
        wheel=replace(RLMA.wheel, radius_m=0.118),
        motor=replace(RLMA.motor, friction_Nm=0.35, torque_constant_Nm_per_A=0.49),
    )
    floor = Terrain("gravel", Burckhardt(0.6, 6.0 / 0.6, 0.0), RollingResistance(ROLLING, 50.0, 0.0), "test")
    kernel, drives = plant(scene(truth, floor)), []
    rng = np.random.default_rng(5)
    for seed in range(12):
        t = np.arange(0.0, 20.0, 0.01)
        wave = 1.45 + 1.2 * np.sign(np.sin(2 * np.pi * t / (5.0 + 0.5 * seed)))
        current = np.column_stack([wave, wave])
        _, states = kernel.scan(np.array([0.5, 0.0, 0.5 / 0.118, 0.5 / 0.118]), current)
        speeds = np.full((t.size, 4), np.nan)
        speeds[:, :2] = states[:, 2:] + rng.normal(0.0, 0.05, (t.size, 2))
        log = DriveLog("rlma", t, speeds, current + rng.normal(0.0, 0.1, current.shape))
        motion = np.column_stack([states[:, 0] + rng.normal(0.0, 0.01, t.size), states[:, 1]])
        drives.append(CalibrationDrive(log, motion))
    return truth, drives


def within_band(parameter, truth, sigmas=3.0):
    return abs(parameter.value - truth) < sigmas * parameter.std


def test_the_radius_of_an_omni_robot_comes_out():
    grips = replace(SMOOTH, stiffness=3000.0)
    found = calibrate_radius(
        around(grips, np.random.default_rng(1)), replace(OMNI, wheel=replace(OMNI.wheel, radius_m=0.04))
    )
    assert found.value == pytest.approx(0.036, rel=0.002)
    assert within_band(found, 0.036)


def test_an_omni_robot_tells_the_friction_of_its_motors_from_the_drag_of_its_rollers():
    drives = around(SMOOTH, np.random.default_rng(2), speeds=(0.08, 0.25))
    constant, friction, damping = calibrate_motor(drives, with_friction(OMNI, 0.0))
    assert within_band(friction, 0.15)
    assert friction.std < 0.01
    assert not constant.identified
    assert "accelerates" in constant.reason
    assert within_band(damping, 0.0) or not damping.identified


def test_damping_needs_different_speeds():
    *_, damping = calibrate_motor(around(SMOOTH, np.random.default_rng(3)), OMNI)
    assert not damping.identified
    assert "too much alike" in damping.reason


def test_a_floor_is_learnt_within_its_own_band():
    floor = learn_floor("soft", around(SOFT, np.random.default_rng(4)), OMNI)
    assert abs(np.log(floor.stiffness / SOFT.stiffness)) < 3 * max(floor.stiffness_std, 0.02)
    assert abs(np.log(floor.friction / SOFT.friction)) < 3 * floor.friction_std
    assert floor.rolling == pytest.approx(SOFT.rolling, rel=0.15)
    assert floor.roller == pytest.approx(SOFT.roller, rel=0.1)
    assert floor.slip_std < 0.02
    assert floor.drives == 12


def test_how_slip_goes_with_direction_and_speed_is_learnt():
    truth = replace(SOFT, across=0.6, side=-0.15, speed_power=-0.1, slowest_m_s=0.06, fastest_m_s=0.24)
    floor = learn_floor("soft", around(truth, np.random.default_rng(8), (0.06, 0.12, 0.24)), OMNI)
    assert abs(np.log(floor.across / 0.6)) < 3 * floor.across_std < 0.3
    assert abs(floor.side + 0.15) < 3 * floor.side_std < 0.1
    assert abs(floor.speed_power + 0.1) < 3 * floor.speed_power_std < 0.1
    assert abs(np.log(floor.stiffness / SOFT.stiffness)) < 3 * floor.stiffness_std
    assert floor.slowest_m_s == pytest.approx(0.06, rel=0.05)
    assert floor.fastest_m_s == pytest.approx(0.24, rel=0.05)
    plain = learn_floor("soft", around(SOFT, np.random.default_rng(8), (0.06, 0.12, 0.24)), OMNI)
    assert abs(plain.side) < 3 * plain.side_std
    assert abs(plain.speed_power) < 3 * plain.speed_power_std
    assert floor.slip_std < 0.02


def test_drives_at_one_speed_leave_the_speed_to_the_prior():
    floor = learn_floor("soft", around(SOFT, np.random.default_rng(4)), OMNI)
    assert floor.speed_power_std == pytest.approx(0.1, rel=0.1)


def test_a_floor_on_which_nothing_slips_keeps_what_is_believed_of_friction():
    floor = learn_floor("smooth", around(SMOOTH, np.random.default_rng(6)), OMNI)
    assert floor.friction_std == pytest.approx(0.5, abs=0.05)
    assert floor.across <= 1.0


def test_radius_motor_and_floor_of_a_robot_with_two_driven_wheels_come_out(straight):
    truth, drives = straight
    start = replace(RLMA, motor=replace(RLMA.motor, torque_constant_Nm_per_A=0.517))
    radius = calibrate_radius(drives, start)
    assert within_band(radius, truth.wheel.radius_m)
    robot = with_parameters(start, [replace_value(radius, truth.wheel.radius_m)])
    constant, friction, _ = calibrate_motor(drives, robot, rolling=(ROLLING, 0.002))
    assert constant.identified
    assert friction.identified
    assert within_band(constant, 0.49)
    assert within_band(friction, 0.35)
    floor = learn_floor("gravel", drives, truth)
    assert abs(np.log(floor.stiffness / 6.0)) < 3 * floor.stiffness_std


def test_where_the_rolling_resistance_is_unknown_so_is_the_friction(straight):
    truth, drives = straight
    _, friction, _ = calibrate_motor(drives, truth, rolling=(ROLLING, 0.05))
    assert friction.identified is False
    assert "rolling resistance" in friction.reason
    assert friction.value == truth.motor.friction_Nm


def test_a_rolling_resistance_may_be_known(straight):
    truth, drives = straight
    _, friction, _ = calibrate_motor(drives, truth, rolling=(ROLLING, 0.0))
    assert within_band(friction, 0.35)
    assert friction.std < 0.02


def test_only_what_was_identified_changes_the_robot():
    found = [Parameter("wheel.radius_m", 0.11, 0.001), Parameter("motor.friction_Nm", 0.3, 0.1, "no currents")]
    robot = with_parameters(RLMA, found)
    assert robot.wheel.radius_m == 0.11
    assert robot.motor == RLMA.motor


def test_drives_that_tell_nothing_are_refused():
    drive = omni_drive([SOFT] * 3, 0.0)
    still = drive._replace(log=replace(drive.log, wheel_speed_rad_s=np.zeros((len(drive.log), 3))))
    with pytest.raises(InputError, match="no stretch of 1 s in which the wheels turn steadily"):
        calibrate_radius([still], OMNI)
    blind = drive._replace(log=replace(drive.log, motor_current_A=np.full((len(drive.log), 3), np.nan)))
    with pytest.raises(InputError, match="without motor currents"):
        calibrate_motor([blind], OMNI)
    with pytest.raises(InputError, match="without motor currents"):
        learn_floor("x", [blind], OMNI)


def with_friction(robot, friction_Nm):
    return replace(robot, motor=replace(robot.motor, friction_Nm=friction_Nm))


def replace_value(parameter, value):
    return parameter._replace(value=value)
