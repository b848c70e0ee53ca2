"""Parameters of the node as a setup of ohmward; needs no ROS."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ohmward.errors import InputError
from ohmward.onboard.robot_setup import SETUP_FILE, Setup
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sources.ros2 import Ros2Source
from ohmward_ros.parameters import IN, OUT, PARAMETERS

#: Parameters that are settings of the sink by the same name.
_OF_SINK = (*OUT, "odom_frame", "base_frame", "publish_tf", "interval_s", "slow_s", "percentage")


def setup_of(parameters: Mapping[str, Any], node: str = "ohmward", namespace: str = "") -> Setup:
    """The setup with the source and the sink of ROS that the parameters describe.

    node, namespace: of the node.

    Raises:
        InputError: a file that cannot be read, neither battery nor robot, or a value that cannot be.
    """
    p = {name: default for name, (default, _) in PARAMETERS.items()} | dict(parameters)
    live = not p["bagfile"] and not p.get("use_sim_time", False)
    network = {"transport": "rclpy", "node": node, "namespace": namespace, "name": "ros2 node"}
    battery, robot, setup_path, state = (_path(p[name]) for name in ("battery", "robot", "setup", "state"))
    source = Ros2Source(
        **network,
        **{name.removesuffix("_in"): p[name] for name in IN},
        joints=dict(map(_joint, filter(None, p["joints"]))),
        imu_rpy=tuple(p["imu_rpy"]),
        live=live,
    )
    sink = Ros2Sink(**network, battery=battery, **{name: p[name] for name in _OF_SINK})
    kept = {"state": state or (state_folder(node, namespace) if live else None)}
    if setup_path:
        setup = SETUP_FILE.load(setup_path)
        sink = replace(sink, battery=battery or setup.battery, robot=setup.name)
        if setup.state and not state:
            kept = {}
        return replace(setup, source=(*setup.source, source), sink=(*setup.sink, sink), **kept)
    of_all = {"battery": battery, "robot": robot, "learn": p["learn"], "delay_s": p["delay_s"]}
    return Setup(**of_all, **kept, source=(source,), sink=(sink,))


def state_folder(node: str, namespace: str) -> str:
    """Folder of the state of a robot: below ROS_HOME, one for each node."""
    home = os.environ.get("ROS_HOME") or "~/.ros"
    return str(Path(home).expanduser().joinpath("ohmward", *filter(None, namespace.split("/")), node))


def _path(given: str) -> str | None:
    """The path with ~ as the home; None where none is given."""
    return str(Path(given).expanduser()) if given else None


def _joint(given: str) -> tuple[str, str]:
    """Wheel and joint of an entry of the parameter `joints`."""
    wheel, equals, joint = given.partition("=")
    if not (wheel and equals and joint):
        raise InputError(f'joints must be entries like "left=wheel_left_joint", got {given!r}')
    return wheel, joint
