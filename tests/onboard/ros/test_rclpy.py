"""The node of the package against a real ROS 2: rclpy and Fast DDS, as PyPI has them for Linux on x86-64."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import ohmward
from ohmward import generic_battery, save_battery
from ohmward.traction import RLMA

rclpy = pytest.importorskip("rclpy", reason="rclpy is not installed: pip install '.[rclpy]'")
messages = pytest.importorskip("sensor_msgs.msg")
navigation = pytest.importorskip("nav_msgs.msg")

ROOT = Path(__file__).parents[3]
WHEEL_RAD_S = 5.0
END_S = 60.0


@pytest.fixture
def domain(monkeypatch):
    """A domain of this test alone, on this machine."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init()
    yield
    rclpy.shutdown()


@pytest.mark.slow
@pytest.mark.usefixtures("domain")
def test_the_node_hears_a_robot_and_says_charge_and_odometry(tmp_path):
    """A robot that drives straight on: its battery and its wheels go in, charge and speed come out."""
    save_battery(generic_battery("lfp", 12.0, 4), tmp_path / "battery.toml")
    paths = [str(ROOT / "ros" / "ohmward_ros"), str(Path(ohmward.__file__).parents[1]), *sys.path]
    program = [sys.executable, "-c", "from ohmward_ros.node import main; main()", "--ros-args"]
    parameters = ["-p", f"battery:={tmp_path / 'battery.toml'}", "-p", "robot:=rlma"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    process = subprocess.Popen(
        [*program, *parameters], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    )
    robot = rclpy.create_node("robot")
    try:
        batteries, poses = _drive(robot, process)
    finally:
        robot.destroy_node()
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=20)
    assert process.returncode == 0 and "Traceback" not in error, error
    assert 0.0 < batteries[-1].percentage < 1.0 and batteries[-1].voltage == pytest.approx(13.2)
    speed_m_s = WHEEL_RAD_S * RLMA.wheel.radius_m
    assert poses[-1].twist.twist.linear.x == pytest.approx(speed_m_s, rel=0.05)
    assert poses[-1].header.frame_id == "odom"


def _drive(robot, process) -> tuple[list, list]:
    """Publish as a robot does until the node has answered for some seconds; its last messages."""
    batteries: list = []
    poses: list = []
    sent_battery = robot.create_publisher(messages.BatteryState, "battery/raw", 10)
    sent_joints = robot.create_publisher(messages.JointState, "joint_states", 10)
    robot.create_subscription(messages.BatteryState, "battery_state", batteries.append, 10)
    robot.create_subscription(navigation.Odometry, "ohmward/odometry", poses.append, 10)
    names = [f"{place.name}_wheel_joint" for place in RLMA.chassis.places]
    end_s = time.monotonic() + END_S
    while time.monotonic() < end_s and process.poll() is None and (len(batteries) < 6 or len(poses) < 100):
        stamp = robot.get_clock().now().to_msg()
        battery = messages.BatteryState(voltage=13.2, current=-3.0, temperature=24.0, present=True)
        battery.header.stamp = stamp
        joints = messages.JointState(name=names, velocity=[WHEEL_RAD_S] * len(names))
        joints.header.stamp = stamp
        sent_battery.publish(battery)
        sent_joints.publish(joints)
        rclpy.spin_once(robot, timeout_sec=0.02)
        rclpy.spin_once(robot, timeout_sec=0.0)
    return batteries, poses
