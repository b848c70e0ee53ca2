"""A car or tricycle: speeds of its rear wheels from one speed and the steering angle, in logs, live and from ROS."""

import math

import numpy as np
import pytest

from kernels import kernel_of
from ohmward.errors import InputError
from ohmward.logs import read_drive, write_table
from ohmward.onboard.message import MessageSorter, unmeasured_wheels
from ohmward.onboard.robot_state import Level
from ohmward.onboard.ros import messages, types
from ohmward.onboard.ros.cdr import serialize
from ohmward.onboard.sources.ros2 import Ros2Source
from ohmward.onboard.wiring_check import Recorder, check_wiring
from ohmward.traction import RLMA, Odometry, SensorInbox, load_robot, save_robot
from ohmward.traction.odometry.estimator import odometry_samples
from ohmward.traction.odometry.pose_filter import pose_filter
from ohmward.traction.robot.chassis import Steered
from ohmward.traction.robot.packaged import generic_robot
from ohmward.traction.robot.robot import motion_from_wheels
from ohmward.traction.speed_observer.estimator import SlipEstimator

BASE_M, RADIUS_M = 0.9, 0.1
CAR, TRICYCLE = (generic_robot(40.0, RADIUS_M, 0.5, BASE_M, layout=layout) for layout in ("car", "tricycle"))


def sensed(robot, speed_m_s, turn_rad_s):
    """The speed [rad/s] and the steering angle that such a robot measures; the motion is that of the rear axle."""
    steering_rad = np.arctan2(BASE_M * turn_rad_s, speed_m_s)
    rim_m_s = np.hypot(speed_m_s, BASE_M * turn_rad_s) if robot is TRICYCLE else speed_m_s
    return rim_m_s / RADIUS_M, steering_rad


def wheels(robot, measured, steering_rad):
    """Speeds (..., 3) of the wheels of a steered robot."""
    assert isinstance(robot.chassis, Steered)
    return robot.chassis.wheel_speeds(np.asarray(measured), np.asarray(steering_rad))


def drive(seed, seconds=120.0, rate_hz=50.0):
    """Time, motion (T, 2) and pose (T, 3) of the rear axle: stretches of 4 s at other speeds and curvatures."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, 1.0 / rate_hz)
    knots = np.arange(0.0, seconds + 8.0, 4.0)
    speed = np.interp(t, knots, [0.0, *rng.uniform(0.3, 1.0, knots.size - 1)])
    turn = speed * np.interp(t, knots, rng.uniform(-0.5, 0.5, knots.size))
    yaw = np.cumsum(turn) / rate_hz
    way = np.stack([speed * np.cos(yaw - turn / rate_hz / 2), speed * np.sin(yaw - turn / rate_hz / 2)], axis=1)
    return t, np.stack([speed, turn], axis=1), np.column_stack([np.cumsum(way, axis=0) / rate_hz, yaw])


@pytest.mark.parametrize("robot", [CAR, TRICYCLE], ids=["car", "tricycle"])
@pytest.mark.parametrize("motion", [(0.8, 0.0), (0.8, 0.6), (-0.5, 0.3), (0.3, -0.4)])
def test_the_wheels_roll_as_a_rigid_body_moves(robot, motion):
    speed_rad_s, steering_rad = sensed(robot, *motion)
    if robot is CAR and motion[0] < 0.0:
        steering_rad = math.atan(BASE_M * motion[1] / motion[0])  # backwards it steers to the other side
    speeds = wheels(robot, [speed_rad_s, np.nan, np.nan], steering_rad)
    np.testing.assert_allclose(motion_from_wheels(robot, speeds[:2]), motion, atol=1e-12)


def test_a_tricycle_with_its_wheel_across_turns_on_the_spot():
    speeds = wheels(TRICYCLE, [2.0, np.nan, np.nan], math.pi / 2)
    np.testing.assert_allclose(motion_from_wheels(TRICYCLE, speeds[:2]), [0.0, 2.0 * RADIUS_M / BASE_M], atol=1e-12)


def test_encoders_at_both_rear_wheels_count_as_they_are():
    measured = [3.0, 4.0, np.nan]
    np.testing.assert_array_equal(wheels(CAR, measured, 0.5), measured)


def test_a_missing_or_impossible_angle_gives_no_speed():
    assert np.isnan(wheels(CAR, [[3.0, np.nan, np.nan]] * 2, [math.nan, 1.5])).all()


def test_its_file_says_where_the_speed_is_measured(tmp_path):
    save_robot(TRICYCLE, tmp_path / "robot.toml")
    assert load_robot(tmp_path / "robot.toml").chassis == TRICYCLE.chassis
    assert 'measured = "front"' in (tmp_path / "robot.toml").read_text(encoding="utf-8")
    with pytest.raises(InputError, match=r"chassis\.rear_m must be below chassis\.wheelbase_m = 0\.9, got 0\.9"):
        Steered(0.9, 0.9, 0.5)


@pytest.mark.parametrize("robot", [CAR, TRICYCLE], ids=["car", "tricycle"])
@pytest.mark.parametrize("gyro", [True, False], ids=["gyro", "no gyro"])
def test_its_pose_is_in_the_ellipse(robot, gyro, tmp_path):
    """Drives with errors of the angle, of the wheels and of the gyro, each twice the standard deviation or less."""
    nees, settings = [], pose_filter(robot)
    nothing = settings.no_sample()
    kernel = kernel_of(settings, settings.init(nothing), nothing, lowering="machine")
    for seed in range(8):
        t, motion, pose = drive(seed)
        rng = np.random.default_rng(100 + seed)
        speed, angle = sensed(robot, *motion.T)
        zero, scale, radius, offset = rng.normal(0.0, [0.015, 0.05, 0.006, 0.01])
        columns = {
            "time_s": t,
            "motor_rpm": speed * (1.0 - radius + 0.0075) * 30.0 / math.pi,
            "steering_angle_deg": np.degrees((1.0 + scale) * angle + zero),
        }
        if gyro:
            columns["gyro_z"] = motion[:, 1] + offset + 0.002 * rng.standard_normal(t.size)
        write_table(columns, tmp_path / f"{seed}.csv")
        samples = odometry_samples(read_drive(tmp_path / f"{seed}.csv", robot), settings)
        _, found = kernel.scan(settings.init(nothing), samples)
        error = np.array([found.x_m[-1], found.y_m[-1], found.yaw_rad[-1]]) - pose[-1]
        nees.append(error @ np.linalg.solve(found.pose_cov[-1], error))
    assert 0.5 < np.mean(nees) < 6.0  # 3, of eight drives


def test_a_log_and_live_samples_give_the_same(tmp_path):
    t, motion, _ = drive(1, seconds=20.0)
    speed, angle = sensed(CAR, *motion.T)
    write_table({"time_s": t, "drive_wheel_speed_rad_s": speed, "steering_rad": angle}, tmp_path / "car.csv")
    log = read_drive(tmp_path / "car.csv", CAR)
    np.testing.assert_allclose(motion_from_wheels(CAR, log.wheel_speed_rad_s[:, :2]), motion, atol=1e-9)
    assert np.isnan(log.motor_current_A).all() and np.isnan(log.wheel_speed_rad_s[:, 2]).all()
    odometry, slip = Odometry(CAR, lowering="python"), SlipEstimator(CAR, lowering="python")
    for sample in zip(t[:50], speed[:50, None], angle[:50], strict=True):
        pose = odometry.update(sample[0], sample[1], steering_rad=sample[2])
        now = slip.update(sample[0], sample[1], current_A=[3.0], steering_rad=sample[2])
    found = Odometry(CAR, lowering="python").run(log.select(np.arange(t.size) < 50)).estimates
    assert pose.x_m == pytest.approx(found.x_m[-1], rel=1e-9) and now.speed_m_s == pytest.approx(pose.speed_m_s)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (["motor_rpm"], "no column for the steering angle found; name it with --column steering=NAME"),
        (
            ["steering_angle", "motor_rpm"],
            "steering angles are usually 20 rad, beyond 1.4; in degrees.* --unit steering=deg",
        ),
        (["speed_m_s", "steering_deg"], "no column for the speed of a wheel .* --column wheel_speed=NAME"),
    ],
)
def test_a_log_without_one_of_them_is_refused(tmp_path, columns, message):
    t = np.arange(0.0, 5.0, 0.05)
    write_table({"time_s": t, **dict.fromkeys(columns, np.full(t.size, 20.0))}, tmp_path / "car.csv")
    with pytest.raises(InputError, match=message):
        read_drive(tmp_path / "car.csv", CAR)


def test_an_angle_for_a_robot_that_does_not_steer_is_refused():
    with pytest.raises(InputError, match="no wheel of robot 'RLMA' steers"):
        Odometry(RLMA, lowering="python").update(0.0, [1.0, 1.0], steering_rad=0.1)


def test_an_angle_of_an_own_rate_holds_until_it_is_silent():
    inbox = SensorInbox(CAR, delay_s=0.0, silence_s=0.25)
    inbox.put(0.0, steering_rad=0.2)
    for k in range(1, 50):
        inbox.put(0.01 * k, wheel_speed_rad_s=[3.0, math.nan])
    steered = [sample.get("steering_rad", math.nan) for sample in inbox.take() if sample["time_s"] > 0.0]
    assert steered[:20] == [0.2] * 20 and np.isnan(steered[30:]).all()


def test_joints_of_ros_give_speed_and_angle():
    source = Ros2Source(joint_states="/joint_states", joints={"rear_left": "rear_motor", "steering": "front_steer"})
    joints = {"name": ["front_steer", "rear_motor"], "position": [0.3, 7.0], "velocity": [0.0, 5.0], "effort": []}
    payload = serialize(types.JOINT_STATE, {"header": messages.header(1.0, ""), **joints})
    found = source.message(types.JOINT_STATE, payload, 0.0)
    assert found is not None and found.values == {"steering_rad": 0.3, "wheel_speed_rad_s.rear_left": 5.0}
    assert unmeasured_wheels(found.values, CAR) == []
    assert MessageSorter(CAR, counted=False).parts(found.values).body == ("steering_rad",)


@pytest.mark.parametrize(("sign", "level"), [(1.0, Level.OK), (-1.0, Level.ERROR)])
def test_an_angle_that_counts_to_the_right_is_found_when_it_is_wired(sign, level):
    recorder = Recorder()
    t, motion, _ = drive(2, seconds=30.0)
    for time_s, speed, angle, turn in zip(t, *sensed(CAR, *motion.T), motion[:, 1], strict=True):
        values = {"wheel_speed_rad_s.0": speed, "steering_rad": sign * angle, "yaw_rate_rad_s": turn}
        recorder.put("car", float(time_s), {name: float(value) for name, value in values.items()})
    found = [
        f for f in check_wiring(recorder.signals(), {"car": ()}, None, CAR) if "sign" in f.name or f.level == level
    ]
    assert any(f.level == level for f in found)
    assert sign > 0.0 or any("a steering angle that counts to the right; scale = -1" in f.message for f in found)
