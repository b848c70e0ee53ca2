"""The radius from straight stretches, and from turns the size to which the yaw rate is proportional."""

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA, ROBOTINO, SkidSteer, hard_terrain, load_robot, save_robot, scene
from ohmward.traction.calibration import CalibrationDrive, calibrate, calibrate_radius, calibrate_track
from ohmward.traction.calibration.calibrate import usual_parts
from ohmward.traction.odometry.model import RADIUS_STD
from ohmward.traction.robot.chassis import Omni, Steered
from ohmward.traction.robot.packaged import generic_robot
from ohmward.traction.robot.robot import free_sideways, motion_from_wheels
from traction.examples import plant

SKID = replace(RLMA, chassis=SkidSteer(0.314, 0.314, 0.30))
RADIUS_M, EFFECTIVE_M = 0.118, 0.51


def chassis(robot) -> Any:
    """The chassis, of whichever kind."""
    return robot.chassis


def kinematic(speed_m_s, yaw_rate_rad_s, robot=SKID, effective_m=EFFECTIVE_M, seconds=6.0):
    """A drive whose wheels have another radius and another track than the robot file says."""
    t = np.arange(0.0, seconds, 0.02)
    sides = np.array([-0.5, 0.5]) * effective_m * yaw_rate_rad_s
    wheels = np.tile(speed_m_s + np.tile(sides, 2), (t.size, 1)) / RADIUS_M
    motion = np.tile([speed_m_s, 0.0, yaw_rate_rad_s], (t.size, 1))
    if robot.freedoms == 2:
        motion = motion[:, [0, 2]]
    return CalibrationDrive(DriveLog("drive", t, wheels, np.full((t.size, robot.driven), np.nan)), motion)


MOTIONS = [(0.5, 0.0), (0.8, 0.02), (0.4, 0.6), (0.3, -0.8), (0.0, 1.0), (-0.4, 0.3)]


def test_radius_and_effective_track_come_out_exactly():
    found = calibrate([kinematic(*motion) for motion in MOTIONS], SKID, parts=("radius", "track"))
    assert found.robot.wheel.radius_m == pytest.approx(RADIUS_M, rel=1e-9)
    assert chassis(found.robot).effective_track_m == pytest.approx(EFFECTIVE_M, rel=1e-9)
    assert chassis(found.robot).track_m == 0.30


def test_the_radius_is_that_of_straight_stretches_whatever_turns_cost():
    straight, turns = [kinematic(0.5, 0.0)], [kinematic(0.4, w) for w in (-0.6, 0.5, 0.8)]
    dragged = [d._replace(motion=d.motion * [0.8, 1.0, 1.0]) for d in turns]  # wheels slip forward as they scrub
    assert calibrate_radius(straight + dragged, SKID).value == pytest.approx(RADIUS_M, rel=1e-9)
    with pytest.raises(InputError, match="no stretch of the drives is straight; add a drive straight ahead"):
        calibrate_radius(turns, SKID)


def test_the_track_of_wheels_that_roll_is_the_track():
    four = replace(RLMA, chassis=replace(chassis(RLMA), driven="all"))
    robot = replace(four, wheel=replace(RLMA.wheel, radius_m=RADIUS_M))
    (found,) = calibrate_track([kinematic(*motion, robot=four, effective_m=0.31) for motion in MOTIONS], robot)
    assert (found.name, found.value) == ("chassis.track_m", pytest.approx(0.31, rel=1e-9))
    assert "track" not in usual_parts(four)
    assert "track" in usual_parts(SKID)


def test_a_robot_that_never_turns_keeps_its_track():
    (found,) = calibrate_track([kinematic(0.5, 0.0)], SKID)
    assert not found.identified
    assert "hardly turns" in found.reason
    assert found.value == 0.30


def test_turns_to_one_side_leave_the_track_to_the_difference_of_the_radii():
    """One circle: eps v / b turns the robot as v_r - v_l does, so the track is off by eps v / (b_eff psi_dot)."""
    robot = replace(SKID, wheel=replace(SKID.wheel, radius_m=RADIUS_M))
    circle, rest = kinematic(0.5, 0.5), kinematic(0.0, 0.0)
    (one,) = calibrate_track([circle, rest], robot, 0.0)
    (both,) = calibrate_track([circle, kinematic(0.5, -0.5), rest], robot, 0.0)
    assert one.std / one.value == pytest.approx(np.sqrt(2.0) * RADIUS_STD / EFFECTIVE_M, rel=1e-3)
    assert both.std / both.value < 1e-5


@pytest.mark.parametrize(
    ("factors", "reason"),
    [
        ([1.0, 1.0, -1.0], "turns the other way than its wheels: left and right wheels are exchanged"),
        ([1.0, 1.0, 57.3], "the unit of the yaw rate (--unit) or of the heading (--pose-unit) is wrong"),
        ([0.5, 1.0, 1.0], "the radius is not identified"),
    ],
)
def test_a_motion_of_another_sign_or_unit_keeps_the_track_and_is_named(factors, reason):
    drives = [drive._replace(motion=drive.motion * factors) for drive in (kinematic(*m) for m in MOTIONS)]
    found = calibrate(drives, SKID, parts=("radius", "track"))
    assert chassis(found.robot) == SKID.chassis and reason in found.parameters[1].reason


def test_a_truth_without_yaw_rate_is_named():
    drives = [drive._replace(motion=drive.motion * [1.0, 1.0, 0.0]) for drive in (kinematic(*m) for m in MOTIONS)]
    (found,) = calibrate_track(drives, SKID)
    assert not found.identified
    assert "no yaw rate was measured" in found.reason


def test_a_gyro_with_an_offset_shows_the_track_by_its_rests():
    four = replace(RLMA, chassis=replace(chassis(RLMA), driven="all"), wheel=replace(RLMA.wheel, radius_m=RADIUS_M))
    drives = [kinematic(*motion, robot=four, effective_m=0.31) for motion in ((0.4, 0.6), (0.3, 0.8), (0.0, 0.0))]
    (found,) = calibrate_track([drive._replace(motion=drive.motion + np.array([0.0, 0.05])) for drive in drives], four)
    assert found.value == pytest.approx(0.31, rel=0.001)


def test_an_omni_robot_turns_by_its_arm_and_a_mecanum_one_by_two_sizes():
    t = np.arange(0.0, 8.0, 0.02)
    turned = np.column_stack([np.full(t.size, 0.1), np.zeros(t.size), np.where(t < 4.0, 0.5, 0.0)])
    wheels = turned @ replace(ROBOTINO, chassis=Omni(0.15)).rolling.T / ROBOTINO.wheel.radius_m
    drive = CalibrationDrive(DriveLog("omni", t, wheels, np.full(wheels.shape, np.nan)), turned)
    (found,) = calibrate_track([drive], ROBOTINO)
    assert (found.name, found.value) == ("chassis.arm_m", pytest.approx(0.15, rel=1e-9))
    with pytest.raises(InputError, match="turns by the sum of its track and wheelbase"):
        calibrate_track([], generic_robot(9.0, 0.05, 0.3, layout="mecanum"))


@pytest.mark.parametrize("layout", ["car", "tricycle"])
@pytest.mark.parametrize("speeds", [(0.3, 1.0), (0.6,)], ids=["speeds", "one speed"])
def test_a_steered_robot_gets_its_wheelbase_and_the_zero_of_its_angle(layout, speeds):
    """The offset of the gyro turns the robot as the zero does, unless the speed changes."""
    robot, zero_rad, offset_rad_s = generic_robot(40.0, 0.1, 0.5, 0.8, layout=layout), 0.03, 0.01
    rng, drives = np.random.default_rng(1), []
    for speed_m_s, curvature in itertools.product(speeds, (0.1, -0.1, 0.0)):
        t, angle = np.arange(0.0, 6.0, 0.05), np.arctan(0.9 * curvature)
        rim = speed_m_s / np.cos(angle) if layout == "tricycle" else speed_m_s
        measured = np.tile([rim / 0.1, np.nan, np.nan], (t.size, 1))
        assert isinstance(robot.chassis, Steered)
        wheels = robot.chassis.wheel_speeds(measured, np.full(t.size, angle + zero_rad))
        motion = np.tile([speed_m_s, speed_m_s * curvature + offset_rad_s], (t.size, 1))
        motion[:, 1] += 0.003 * rng.standard_normal(t.size)
        drives.append(CalibrationDrive(DriveLog("drive", t, wheels, np.full((t.size, 2), np.nan)), motion))
    found = calibrate(drives, robot)
    base, zero = found.parameters[1:]
    assert base.identified and base.value == pytest.approx(0.9, rel=0.01)
    assert zero.identified == (len(speeds) > 1)
    assert zero.value == pytest.approx(zero_rad if zero.identified else 0.0, abs=0.001)
    assert chassis(found.robot).steering_zero_rad == (zero.value if zero.identified else 0.0)
    assert chassis(found.robot).rear_m / chassis(found.robot).wheelbase_m == pytest.approx(0.5)


def test_one_speed_is_enough_for_a_robot_that_does_not_move_sideways_at_will():
    drives = [kinematic(*motion) for motion in MOTIONS]
    logs = [replace(d.log, speed_m_s=d.motion[:, 0], yaw_rate_rad_s=d.motion[:, 2]) for d in drives]
    found = calibrate(logs, SKID, parts=("radius", "track")).robot
    assert found.wheel.radius_m == pytest.approx(RADIUS_M, rel=1e-9)
    assert chassis(found).effective_track_m == pytest.approx(EFFECTIVE_M, rel=1e-9)


def test_the_track_is_known_no_better_than_the_radius():
    drives = [kinematic(*motion) for motion in MOTIONS]
    radius, track = calibrate(drives, SKID, parts=("radius", "track")).parameters
    assert track.std / track.value == pytest.approx(radius.std / radius.value, rel=1e-6)
    (alone,) = calibrate_track(drives, SKID)
    assert alone.std / alone.value == pytest.approx(RADIUS_STD, rel=1e-6)


def test_the_robot_file_keeps_the_effective_track(tmp_path):
    robot = replace(SKID, chassis=replace(chassis(SKID), effective_track_m=0.52))
    save_robot(robot, tmp_path / "robot.toml")
    assert load_robot(tmp_path / "robot.toml") == robot
    assert "effective_track_m =" not in _saved(SKID, tmp_path / "plain.toml")
    assert chassis(free_sideways(robot)).track_m == 0.52
    assert chassis(free_sideways(SKID)).track_m == 0.30
    with pytest.raises(InputError, match=r"chassis\.effective_track_m must be > 0"):
        replace(chassis(SKID), effective_track_m=-0.5)


def _saved(robot, path):
    save_robot(robot, path)
    return path.read_text(encoding="utf-8")


def simulated(left_A, right_A, seconds=8.0):
    """Our own dynamics: wheels that are dragged sideways on wet asphalt."""
    t = np.arange(0.0, seconds, 0.01)
    current_A = np.tile([left_A, right_A, left_A, right_A], (t.size, 1))
    _, states = plant(scene(SKID, hard_terrain("wet asphalt"))).scan(np.zeros(7), current_A)
    log = DriveLog("skid", t, states[:, 3:], np.full((t.size, 4), np.nan))
    return CalibrationDrive(log, states[:, :3])


def test_a_simulated_robot_that_scrubs_turns_as_its_effective_track_says():
    drives = [simulated(3.0, 3.0, 4.0), *(simulated(a, b) for a, b in ((-20.0, 22.0), (24.0, -20.0), (-21.0, 23.0)))]
    found = calibrate(drives, SKID, parts=("radius", "track")).robot
    assert chassis(found).effective_track_m > 1.2 * 0.30
    turn = drives[-1]
    plain, calibrated = (
        np.array([motion_from_wheels(free_sideways(r), w)[-1] for w in turn.log.wheel_speed_rad_s])
        for r in (SKID, found)
    )
    errors = [np.sqrt(np.mean((rate - turn.motion[:, -1])[100:] ** 2)) for rate in (plain, calibrated)]
    assert errors[1] < 0.5 * errors[0]
