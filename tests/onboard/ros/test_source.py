"""Messages of ROS 2 as signals."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.ros import messages, types
from ohmward.onboard.ros.cdr import serialize
from ohmward.onboard.sources.ros2 import Ros2Source, pitch_of

UP_RAD = 0.2


@pytest.mark.parametrize(("status", "full"), [(4, {"battery_full": 1.0}), (2, {"battery_full": 0.0}), (0, {})])
def test_a_battery_says_whether_it_is_full_where_it_knows(status, full):
    message = messages.battery_state(RobotState(1.0, 1.0), {"battery_voltage_V": 13.0}, None, "base_link")
    payload = serialize(types.BATTERY_STATE, message | {"power_supply_status": status})
    found = Ros2Source(battery_state="/battery").message(types.BATTERY_STATE, payload, 1.0)
    assert found is not None and found.values == {"battery_voltage_V": 13.0} | full


def unit(quaternion, covariance=0.0, imu_rpy=(0.0, 0.0, 0.0)):
    """Values of a message of an inertial unit."""
    vector = {"x": 1.5, "y": 0.0, "z": 0.3}
    message = {
        "header": {"stamp": {"sec": 5, "nanosec": 0}, "frame_id": "base_link"},
        "orientation": dict(zip("xyzw", map(float, quaternion), strict=True)),
        "orientation_covariance": [covariance] + [0.0] * 8,
        "angular_velocity": vector,
        "angular_velocity_covariance": [0.0] * 9,
        "linear_acceleration": vector,
        "linear_acceleration_covariance": [0.0] * 9,
    }
    found = Ros2Source(imu="/imu", imu_rpy=imu_rpy).message(types.IMU, serialize(types.IMU, message), 1.0)
    assert found is not None
    return found.values


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("roll", [0.0, 0.3])
def test_pitch_is_that_of_the_nose_whatever_heading_and_roll(heading, roll):
    attitude = Rotation.from_euler("ZYX", [heading, -UP_RAD, roll])
    assert attitude.apply([1.0, 0.0, 0.0])[2] == pytest.approx(math.sin(UP_RAD))  # the nose is up
    for quaternion in (attitude.as_quat(), -attitude.as_quat()):
        assert unit(quaternion)["pitch_rad"] == pytest.approx(UP_RAD, abs=1e-12)


def test_straight_up_and_rounded_quaternions():
    up = Rotation.from_euler("ZYX", [0.4, -math.pi / 2, 0.0]).as_quat()
    assert pitch_of(*(1.001 * up)) == pytest.approx(math.pi / 2, abs=1e-3)


@pytest.mark.parametrize(
    ("quaternion", "covariance"),
    [
        ((0, 0, 0, 0), 0.0),
        ((0, 0, 0, 1), 0.0),
        ((0, 0.1, 0, 0.995), -1.0),
        ((np.nan, 0, 0, 1), 0.0),
        ((0, 3, 0, 1), 0.0),
    ],
)
def test_without_an_attitude_there_is_no_pitch(quaternion, covariance):
    assert set(unit(quaternion, covariance)) == {"yaw_rate_rad_s", "acceleration_m_s2"}


@pytest.mark.parametrize("imu_rpy", [(math.pi, 0.0, 0.0), (0.0, 0.0, math.pi / 2), (0.3, -0.2, 1.1)])
def test_a_unit_that_is_mounted_turned_shows_the_motion_of_the_robot(imu_rpy):
    """The rotation as SciPy has it; the robot's nose is up by `UP_RAD`."""
    mounted = Rotation.from_euler("ZYX", imu_rpy[::-1])
    in_unit = np.array([1.5, 0.0, 0.3])
    robot = Rotation.from_euler("ZYX", [0.7, -UP_RAD, 0.1])
    found = unit((robot * mounted).as_quat(), imu_rpy=imu_rpy)
    assert found["acceleration_m_s2"] == pytest.approx(mounted.apply(in_unit)[0])
    assert found["yaw_rate_rad_s"] == pytest.approx(mounted.apply(in_unit)[2])
    assert found["pitch_rad"] == pytest.approx(UP_RAD)


@pytest.mark.parametrize(
    ("places", "found"), [([(0, 0, 0), (3, 4, 0), (3, 4, 12)], {"home_distance_m": 17.0}), ([], None)]
)
def test_a_path_to_the_charger_is_the_way_home(places, found):
    header = {"stamp": {"sec": 5, "nanosec": 0}, "frame_id": "map"}
    turned = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    poses = [
        {"header": header, "pose": {"position": dict(zip("xyz", p, strict=True)), "orientation": turned}}
        for p in places
    ]
    payload = serialize(types.PATH, {"header": header, "poses": poses})
    message = Ros2Source(home_path="/plan").message(types.PATH, payload, 1.0)
    assert (message and message.values) == found
    assert message is None or message.stamp_s == 5.0
    assert Ros2Source(home_path="/plan").message(types.PATH, payload[:-9], 1.0) is None


@pytest.mark.parametrize(("variance", "std"), [(0.0025, {"speed_std_m_s": 0.05}), (0.0, {})])
def test_a_twist_is_a_speed_with_its_standard_deviation_if_given(variance, std):
    covariance = [variance] + [0.0] * 35
    vector, still = {"x": 0.7, "y": 0.1, "z": 0.0}, {"x": 0.0, "y": 0.0, "z": 0.0}
    message = {
        "header": {"stamp": {"sec": 5, "nanosec": 0}, "frame_id": "base_link"},
        "twist": {"twist": {"linear": vector, "angular": still}, "covariance": covariance},
    }
    source = Ros2Source(twist="/gnss/vel")
    found = source.message(types.TWIST, serialize(types.TWIST, message), 1.0)
    assert found is not None and found.values == pytest.approx({"speed_m_s": 0.7} | std)
    assert source.topics()["twist"] == "/gnss/vel"
