"""Parameters of the node as a setup of ohmward; needs no ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ohmward.onboard.robot_setup import SETUP_FILE, Setup
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sources.ros2 import Ros2Source

#: Parameters and their values where none are given; config/ohmward.yaml describes them.
DEFAULTS = {
    "battery": "",
    "robot": "",
    "setup": "",
    "bagfile": "",
    "battery_state_in": "battery/raw",
    "joint_states": "joint_states",
    "imu": "imu/data",
    "odometry_in": "",
    "battery_state": "battery_state",
    "odometry": "ohmward/odometry",
    "twist": "ohmward/twist",
    "diagnostics": "/diagnostics",
    "odom_frame": "odom",
    "base_frame": "base_link",
}


#: Parameters that are topics.
IN = ("battery_state_in", "joint_states", "imu", "odometry_in")
OUT = ("battery_state", "odometry", "twist", "diagnostics")


def setup_of(parameters: Mapping[str, str], namespace: str = "") -> Setup:
    """The setup with the source and the sink of ROS that the parameters describe.

    namespace: of the node.

    Raises:
        InputError: a file that cannot be read, or neither battery nor robot.
    """
    p = DEFAULTS | dict(parameters)
    source = Ros2Source(
        transport="rclpy",
        namespace=namespace,
        battery_state=p["battery_state_in"],
        joint_states=p["joint_states"],
        imu=p["imu"],
        odometry=p["odometry_in"],
        live=not p["bagfile"],
        name="ros2 node",
    )
    sink = Ros2Sink(
        transport="rclpy",
        namespace=namespace,
        battery=p["battery"] or None,
        **{name: p[name] for name in ("battery_state", "odometry", "twist", "diagnostics", "odom_frame", "base_frame")},
        name="ros2 node",
    )
    if p["setup"]:
        setup = SETUP_FILE.load(p["setup"])
        sink = replace(sink, battery=sink.battery or setup.battery, robot=setup.name)
        return replace(setup, source=(*setup.source, source), sink=(*setup.sink, sink))
    return Setup(battery=p["battery"] or None, robot=p["robot"] or None, source=(source,), sink=(sink,))
