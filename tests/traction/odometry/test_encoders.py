"""Driven wheels without an encoder's value: with a gyro the others give their speed."""

import math

import numpy as np
import pytest

from ohmward.filters.belief import unpack
from ohmward.traction import RLMA
from ohmward.traction.motion.sample import FIRST_INTERVAL_S, LOST, STOPPED
from ohmward.traction.odometry.model import TURN_SCALE
from ohmward.traction.odometry.pose_filter import pose_filter
from ohmward.traction.odometry.sample import OdometryFlag
from ohmward.traction.robot.packaged import generic_robot
from traction.odometry.examples import DT_S, TRACK_M, drive, integrate, samples, scan

SETTINGS = pose_filter(RLMA)
TIME_S = DT_S * np.arange(2500)
FAILS = TIME_S >= 10.0
#: Time [s] without a value after which that is flagged.
MISSED_S = (LOST + 1) * FIRST_INTERVAL_S


def winding(change, fails=FAILS):
    """Samples of a winding drive whose left encoder shows what `change` makes of it from then on, and the pose."""
    rng = np.random.default_rng(5)
    v = np.interp(TIME_S, [3.0, 5.0], [0.0, 0.5])
    w = np.where(v > 0.4, 0.4 * np.sin(0.5 * TIME_S), 0.0)
    speeds = np.column_stack([v, w]) @ RLMA.rolling[: RLMA.driven].T / RLMA.wheel.radius_m
    speeds += 0.005 * rng.standard_normal(speeds.shape) * (v > 0.0)[:, None]
    left = np.where(fails, change(speeds[:, 0]), speeds[:, 0])
    gyro = w + 0.003 * rng.standard_normal(v.size)
    given = samples(SETTINGS, wheel_speed_rad_s=np.column_stack([left, speeds[:, 1]]), yaw_rate_rad_s=gyro)
    return given, integrate(v, 0.0 * v, w)


def flagged(estimates):
    return (estimates.flags.astype(int) & OdometryFlag.NO_ENCODER) > 0


def test_a_wheel_without_a_value_has_the_speed_that_the_other_and_the_gyro_give_it():
    given, pose = winding(lambda speed: speed * math.nan)
    _, e = scan(SETTINGS, given)
    assert TIME_S[np.argmax(flagged(e))] == pytest.approx(10.0 + MISSED_S, abs=2.0 * DT_S)
    assert flagged(e)[TIME_S > 10.1 + MISSED_S].all()
    assert not ((e.flags.astype(int) & OdometryFlag.NO_WHEELS) > 0)[1:].any()
    apart_m = np.hypot(e.x_m - pose[:, 0], e.y_m - pose[:, 1])
    assert apart_m[-1] < 2.0 * e.position_std_m[-1] < 2.0  # of 22 m


@pytest.mark.parametrize("layout", ["omni", "mecanum"])
@pytest.mark.parametrize("value", [math.nan, 0.0])
def test_the_others_and_the_gyro_give_the_speed_of_a_wheel_with_rollers(layout, value):
    robot = generic_robot(12.0, 0.05, 0.36, layout=layout)
    settings = pose_filter(robot)
    motion = np.column_stack([0.4 * np.cos(0.3 * TIME_S), 0.3 * np.sin(0.3 * TIME_S), 0.4 * np.sin(0.5 * TIME_S)])
    motion[TIME_S < 3.0] = 0.0
    speeds = motion @ robot.rolling[: robot.driven].T / robot.wheel.radius_m
    speeds[:, 1] = value
    _, e = scan(settings, samples(settings, wheel_speed_rad_s=speeds, yaw_rate_rad_s=motion[:, 2]))
    late = TIME_S > 10.0
    assert flagged(e)[late].all()
    assert not (e.flags.astype(int) & (OdometryFlag.NO_WHEELS | OdometryFlag.NO_GYRO))[late].any()
    found = np.column_stack([e.speed_m_s, e.speed_left_m_s, e.yaw_rate_rad_s])
    assert found[late] == pytest.approx(motion[late], abs=0.02)


def test_a_wheel_without_a_value_is_no_evidence_of_the_gyros_offset():
    given, _ = winding(lambda speed: speed * math.nan, fails=TIME_S >= 0.0)
    _, e = scan(SETTINGS, given)
    assert e.gyro_offset_std_rad_s[-1] >= SETTINGS.noise.gyro_offset_std_rad_s


@pytest.mark.parametrize(
    ("change", "after_s"),
    [(lambda speed: speed[FAILS][0], STOPPED.repeats_s), (lambda speed: 0.0, STOPPED.contradicts_s)],
    ids=["the last value", "zero"],
)
def test_an_encoder_that_repeats_itself_while_the_other_moves_has_stopped(change, after_s):
    given, _ = winding(change)
    _, e = scan(SETTINGS, given)
    due_s = 10.0 + after_s + MISSED_S
    assert TIME_S[np.argmax(flagged(e))] == pytest.approx(due_s, abs=2.0 * DT_S)
    assert flagged(e)[round((due_s + 0.1) / DT_S) :].all()
    assert np.abs(e.speed_m_s - 0.5)[TIME_S > 12.5].max() < 0.03


@pytest.mark.parametrize("left_rad_s", [4.0, 0.0])
def test_an_encoder_that_repeats_itself_beside_one_that_never_flickers_has_stopped(left_rad_s):
    """Both repeat the speeds that were commanded, which change every four seconds; the gyro contradicts one."""
    phase = (TIME_S // 4.0).astype(int) % 3
    v, w = np.array([0.48, 0.72, 0.6])[phase], np.array([0.0, 0.3, -0.4])[phase]
    speeds = np.column_stack([v, w]) @ RLMA.rolling[: RLMA.driven].T / RLMA.wheel.radius_m
    speeds[FAILS, 0] = left_rad_s
    gyro = w + 0.003 * np.random.default_rng(5).standard_normal(w.size)
    _, e = scan(SETTINGS, samples(SETTINGS, wheel_speed_rad_s=speeds, yaw_rate_rad_s=gyro))
    assert not flagged(e)[~FAILS].any() and flagged(e)[TIME_S > 20.0].all()
    assert np.abs(e.speed_m_s - v)[TIME_S > 20.0].max() < 0.03


def test_an_encoder_that_has_stopped_leaves_no_scale_of_the_turn():
    """Until that is known its turn counts, of which the gyro sees nothing."""
    given, _ = winding(lambda speed: speed[FAILS][0])
    end, _ = scan(SETTINGS, given)
    belief = unpack(end.belief)
    assert belief.mean[TURN_SCALE] == 0.0
    assert belief.cov[TURN_SCALE, TURN_SCALE] == pytest.approx(
        SETTINGS.noise.turn_scale_std**2 + SETTINGS.noise.gyro_scale_std**2
    )


def test_an_encoder_that_stopped_at_rest_has_stopped_once_the_gyro_turns_against_the_wheels():
    """On the way to its side the other wheel alone turns the robot, as it would about a wheel that stands."""
    given, _ = winding(lambda speed: 0.0, fails=TIME_S >= 0.0)
    _, e = scan(SETTINGS, given)
    first = TIME_S[np.argmax(flagged(e))]
    right = np.flatnonzero((given.robot.yaw_rate_rad_s < -0.05) & (TIME_S > 5.0))
    assert TIME_S[right[0]] < first < TIME_S[right[0]] + 1.5 * STOPPED.contradicts_s + MISSED_S


def test_a_robot_that_turns_about_a_wheel_that_stands_has_all_encoders():
    w = np.where(TIME_S > 3.0, 0.5, 0.0)
    speeds = np.column_stack([0.0 * w, TRACK_M * w]) / RLMA.wheel.radius_m
    rng = np.random.default_rng(6)
    speeds[:, 1] += 0.005 * rng.standard_normal(w.size) * (w > 0.0)
    _, e = scan(SETTINGS, samples(SETTINGS, wheel_speed_rad_s=speeds, yaw_rate_rad_s=w))
    assert not flagged(e).any()


def test_a_robot_that_brakes_to_a_stop_has_all_encoders():
    settings = pose_filter(RLMA)
    given = drive(settings, 3, distance_m=10.0).samples
    speeds = np.where((DT_S * np.arange(len(given.robot.dt_s)) > 15.0)[:, None], 0.0, given.robot.wheel_speed_rad_s)
    _, e = scan(settings, given._replace(robot=given.robot._replace(wheel_speed_rad_s=speeds)))
    assert not flagged(e).any()


def test_without_a_gyro_nothing_gives_the_speed_of_a_wheel():
    given, _ = winding(lambda speed: speed * math.nan)
    given = given._replace(robot=given.robot._replace(yaw_rate_rad_s=np.full(TIME_S.size, math.nan)))
    _, e = scan(SETTINGS, given)
    assert ((e.flags.astype(int) & OdometryFlag.NO_WHEELS) > 0)[TIME_S > 10.5].all()
