"""A skid-steered robot in two steps: the radius from straight stretches, the effective track from turns."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.trace import Kernel
from ohmward.traction import RLMA, ROBOTINO, RobotInput, SkidSteer, hard_terrain, load_robot, save_robot, scene, step
from ohmward.traction.calibration import CalibrationDrive, calibrate, calibrate_radius, calibrate_track
from ohmward.traction.calibration.calibrate import usual_parts
from ohmward.traction.odometry.model import RADIUS_STD
from ohmward.traction.robot.robot import free_sideways, motion_from_wheels

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
    found = calibrate_track([kinematic(*motion, robot=four, effective_m=0.31) for motion in MOTIONS], robot)
    assert (found.name, found.value) == ("chassis.track_m", pytest.approx(0.31, rel=1e-9))
    assert "track" not in usual_parts(four)
    assert "track" in usual_parts(SKID)


def test_a_robot_that_never_turns_keeps_its_track():
    found = calibrate_track([kinematic(0.5, 0.0)], SKID)
    assert not found.identified
    assert "hardly turns" in found.reason
    assert found.value == 0.30


def test_a_truth_without_yaw_rate_is_named():
    drives = [drive._replace(motion=drive.motion * [1.0, 1.0, 0.0]) for drive in (kinematic(*m) for m in MOTIONS)]
    found = calibrate_track(drives, SKID)
    assert not found.identified
    assert "no yaw rate was measured" in found.reason


def test_an_omni_robot_has_no_track():
    with pytest.raises(InputError, match="has no left and right side"):
        calibrate_track([], ROBOTINO)


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
    alone = calibrate_track(drives, SKID)
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
    plant, dt_s = scene(SKID, hard_terrain("wet asphalt")), 0.01

    def one(x, current_A):
        result = step(x, RobotInput(current_A), plant, dt_s)
        return result.state, result.state

    x = np.zeros(7)
    t = np.arange(0.0, seconds, dt_s)
    _, states = Kernel(one, x, np.zeros(4)).scan(x, np.tile([left_A, right_A, left_A, right_A], (t.size, 1)))
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
