"""A gyro and encoders that contradict each other: mirrored, in another unit, or counting the other way."""

import math
from typing import Any

import numpy as np
import pytest

from ohmward.trace import Kernel, where
from ohmward.traction import RLMA, load_robot
from ohmward.traction.motion.sample import LONGEST_STEP_S, no_sample, sanitize
from ohmward.traction.motion.stuck_sensors import GyroWatch, watch_gyro
from ohmward.traction.odometry.pose_filter import pose_filter
from ohmward.traction.odometry.sample import OdometryFlag
from ohmward.traction.odometry.turn_watch import (
    LEAST_TURN_SHARE,
    MOST_SPINS_RAD,
    MOST_WRONG_S,
    REVERSED_S,
    SCALED_COUNTS,
    UNSHOWN_COUNTS,
    WRONG_S,
    watch_of_turn,
    watch_turn,
)
from ohmward.traction.robot.packaged import generic_robot
from traction.odometry.examples import DT_S, integrate, samples, scan

TIME_S = DT_S * np.arange(3000)
SKID = load_robot("husky")
TWO = generic_robot(15.0, 0.08, 0.36, layout="two-wheel")


def watched(turn, gyro, robot=RLMA, signs=1.0, speed_m_s=0.5):
    """Conditions (3, T): a wrong gyro, a reversed encoder, an open way; wheels turn the robot at these rates (T,)."""
    n, nothing = robot.driven, no_sample(robot)
    motion = np.zeros((turn.size, robot.freedoms))
    motion[:, 0], motion[:, -1] = speed_m_s, turn
    speeds = np.zeros((turn.size, len(robot.places)))
    speeds[:, :n] = signs * (motion @ robot.rolling[:n].T / robot.wheel.radius_m)
    given = nothing._replace(dt_s=np.full(turn.size, DT_S), wheel_speed_rad_s=speeds, yaw_rate_rad_s=gyro)

    def step(before, sample):
        clean = sanitize(sample, LONGEST_STEP_S)
        gyro = watch_gyro(before[1], clean, robot)
        after = watch_turn(before[0], clean, sample.dt_s, gyro.average_rad_s, robot)
        return (after, gyro), where(np.array([after.wrong, after.some_reversed, after.way_open]), 1.0, 0.0)

    first = watch_of_turn(robot), GyroWatch()
    return Kernel(step, first, nothing).scan(first, given)[1].T > 0.5


def since(condition):
    """Time [s] of the first sample in which a condition (T,) holds."""
    return TIME_S[np.argmax(condition)]


def winding():
    """Yaw rates (T,) of a robot that is straight on for 5 s and turns at 0.4 to 0.6 rad/s then."""
    return np.where(TIME_S > 5.0, 0.5 + 0.1 * np.sin(3.0 * TIME_S), 0.0)


def test_a_gyro_that_turns_against_the_wheels_is_mirrored_until_it_turns_with_them():
    turn = winding() + 0.01 * np.sin(20.0 * TIME_S)
    found, *_ = watched(turn, np.where(TIME_S < 20.0, -turn, turn))
    assert since(found) == pytest.approx(5.0 + WRONG_S, abs=2.0 * DT_S)
    assert found[TIME_S < 20.0][-1]
    assert not found[TIME_S > 20.0 + MOST_WRONG_S].any()


@pytest.mark.parametrize("from_s", [5.0, 20.0])
def test_a_gyro_in_degrees_per_second_is_found_from_the_start_and_after_it_was_right(from_s):
    found, *_ = watched(winding(), np.where(from_s <= TIME_S, 180.0 / math.pi, 1.0) * winding())
    counted_s = WRONG_S if from_s == 5.0 else WRONG_S + MOST_WRONG_S
    assert since(found) == pytest.approx(from_s + counted_s / SCALED_COUNTS, abs=2.0 * DT_S)


@pytest.mark.parametrize("robot", [TWO, RLMA], ids=["cannot scrub", "scrubs"])
@pytest.mark.parametrize("from_s", [5.0, 20.0])
def test_a_gyro_of_another_axis_is_found_from_the_start_later_where_wheels_scrub(robot, from_s):
    found, *_ = watched(winding(), np.where(from_s <= TIME_S, 0.01, 1.0) * winding(), robot)
    if robot is TWO and from_s == 5.0:
        assert since(found) == pytest.approx(from_s + WRONG_S / UNSHOWN_COUNTS, abs=2.0 * DT_S)
    elif from_s == 5.0:  # the mean of 1 over a second and of the gyro's share since then
        assert since(found) == pytest.approx(from_s + (1.0 - LEAST_TURN_SHARE) / (LEAST_TURN_SHARE - 0.01), abs=1.0)
    else:  # wheels spin for a while
        assert not found.any()


@pytest.mark.parametrize("robot, turns", [(RLMA, 1.0), (SKID, 0.5)], ids=["rolls", "scrubs"])
@pytest.mark.parametrize("from_s", [5.0, 20.0])
@pytest.mark.parametrize("side", ["left", "right"])
def test_encoders_of_a_side_that_count_the_other_way_are_found(robot, turns, from_s, side):
    names = [place.name for place in robot.places[: robot.driven]]
    signs = np.where((from_s <= TIME_S)[:, None] & np.array([side in name for name in names]), -1.0, 1.0)
    wrong, found, way_open = watched(winding(), turns * winding(), robot, signs)
    counted_s = REVERSED_S if from_s == 5.0 else 2.0 * REVERSED_S
    assert since(found) == pytest.approx(from_s + counted_s, abs=2.0 * DT_S)
    assert found[from_s + counted_s + 1.0 < TIME_S].all()
    assert way_open[(from_s + 1.0 < TIME_S) & (from_s + counted_s - 1.0 > TIME_S)].all()
    assert not wrong.any() and not way_open[found].any()


def test_without_a_gyro_the_way_is_open_once_the_robot_has_turned_on_the_spot_for_long():
    *_, way_open = watched(0.0 * TIME_S, np.full(TIME_S.size, math.nan), signs=np.array([-1.0, 1.0]))
    rate_rad_s = 0.5 / RLMA.places[0].y_m
    assert since(way_open) == pytest.approx(MOST_SPINS_RAD / rate_rad_s, abs=2.0 * DT_S)
    *_, way_open = watched(winding(), np.full(TIME_S.size, math.nan))
    assert not way_open.any()


@pytest.mark.parametrize(
    "turn, gyro",
    [
        (np.where((TIME_S > 12.0) & (TIME_S < 20.0), -1.0, 1.0) * winding(), winding()),
        (0.5 * np.sin(2.0 * TIME_S), np.roll(0.5 * np.sin(2.0 * TIME_S), round(0.5 / DT_S))),
        (winding(), -0.25 * winding()),
        (winding(), 1.5 * winding()),
        (4.0 * winding(), 0.36 * winding()),
    ],
    ids=["slips for a while", "a late gyro", "scrubs", "a wrong track", "turns on the spot in snow"],
)
@pytest.mark.parametrize("robot", [RLMA, SKID], ids=["rolls", "scrubs"])
def test_what_slips_scrubs_or_is_late_is_neither(turn, gyro, robot):
    wrong, found, _ = watched(turn, gyro, robot, speed_m_s=np.where(np.abs(turn) > 1.0, 0.0, 0.5))
    assert not wrong.any() and not found.any()


def driven(share=1.0, signs=(1.0, 1.0), from_s=0.0, robot=RLMA):
    """Estimates, pose (T, 3) and speed (T,) of a winding drive with such a gyro and encoders from then on."""
    rng = np.random.default_rng(5)
    settings, late = pose_filter(robot), from_s <= TIME_S
    v = np.interp(TIME_S, [3.0, 5.0], [0.0, 0.5])
    w = np.where(v > 0.4, 0.4 * np.sin(0.5 * TIME_S), 0.0)
    speeds = np.column_stack([v, w]) @ robot.rolling[: robot.driven].T / robot.wheel.radius_m
    speeds += 0.005 * rng.standard_normal(speeds.shape) * (v > 0.0)[:, None]
    gyro = np.where(late, share, 1.0) * w + 0.003 * rng.standard_normal(v.size)
    given = samples(
        settings,
        wheel_speed_rad_s=np.where(late[:, None], signs, 1.0) * speeds,
        yaw_rate_rad_s=gyro,
    )
    return scan(settings, given)[1], integrate(v, 0.0 * v, w), v


FAULTS: dict[str, dict[str, Any]] = {
    "mirrored": {"share": -1.0},
    "in degrees": {"share": 180.0 / math.pi},
    "counts back": {"signs": (-1.0, 1.0)},
    "without a gyro": {"share": math.nan, "signs": (1.0, -1.0)},
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize("from_s", [0.0, 25.0])
def test_pose_and_speed_are_in_their_bands_although_a_sensor_is_wrong(fault, from_s):
    e, pose, v = driven(**fault, from_s=from_s)
    late = max(from_s, 5.0) < TIME_S
    position = np.hypot(e.x_m - pose[:, 0], e.y_m - pose[:, 1]) < 2.45 * e.position_std_m
    yaw = np.abs(e.yaw_rad - pose[:, 2]) < 1.96 * np.sqrt(e.pose_cov[:, 2, 2])
    speed = np.abs(e.speed_m_s - v) < 1.96 * np.sqrt(e.twist_cov[:, 0, 0])
    for covered in (position, yaw, speed):
        assert covered[late].mean() > (0.8 if np.isnan(fault.get("share", 1.0)) else 0.95)


def test_the_wheels_give_the_turn_beside_a_gyro_of_another_axis():
    e, pose, _ = driven(share=0.0, robot=TWO)
    assert e.yaw_rad[-1] == pytest.approx(pose[-1, 2], abs=0.2)
    assert (np.abs(e.yaw_rad - pose[:, 2]) < 1.96 * np.sqrt(e.pose_cov[:, 2, 2])).mean() > 0.9


@pytest.mark.parametrize("fault", ["in degrees", "counts back"])
@pytest.mark.parametrize("from_s", [0.0, 25.0])
def test_the_others_go_on_once_the_wrong_one_is_found(fault, from_s):
    e, pose, v = driven(**FAULTS[fault], from_s=from_s)
    assert e.yaw_rad[-1] == pytest.approx(pose[-1, 2], abs=0.2)
    assert np.abs(e.speed_m_s - v)[TIME_S > 50.0].max() < 0.05
    way = np.diff(np.array([[*e.x_m[[2500, -1]]], [*e.y_m[[2500, -1]]]]), axis=1)
    assert np.linalg.norm(way) == pytest.approx(np.linalg.norm(pose[-1, :2] - pose[2500, :2]), abs=0.3)
    flagged = e.flags.astype(int) & (OdometryFlag.NO_GYRO if fault == "in degrees" else OdometryFlag.NO_ENCODER)
    assert flagged[TIME_S > 50.0].all()
