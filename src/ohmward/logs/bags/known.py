"""Message types whose fields are quantities of a battery or of a drive, and the names of their columns.

Units are those of REP-103. `Odometry` and twists are read where `--topic` names them alone: odometry from the wheels
tells nothing that the wheels do not tell.
"""

from __future__ import annotations

import re

from ohmward.logs.bags.choice import BATTERY, BOTH, DRIVE, KnownType
from ohmward.logs.bags.layout import Layout
from ohmward.logs.bags.recording import Topic

#: Rows of a table that ohmward has written.
TABLE_TYPE = "ohmward_msgs/msg/Table"

_SPEED = "speed [m/s]"
#: Types that are found without being named, and those that a name makes a quantity.
KNOWN = {
    "sensor_msgs/msg/BatteryState": KnownType(
        BATTERY,
        {
            **{"voltage": "voltage [V]", "current": "current [A]", "temperature": "temperature [degC]"},
            **{"charge": "charge [Ah]", "percentage": "percentage", "power_supply_status": "power_supply_status"},
        },
    ),
    "sensor_msgs/msg/JointState": KnownType(DRIVE, {}),
    "sensor_msgs/msg/Imu": KnownType(
        DRIVE,
        {
            "angular_velocity.z": "angular velocity z [rad/s]",
            "linear_acceleration.x": "linear acceleration x [m/s2]",
        },
    ),
    TABLE_TYPE: KnownType(BOTH, {}),
    "nav_msgs/msg/Odometry": KnownType(DRIVE, {"twist.twist.linear.x": _SPEED}, by_name_only=True),
    "geometry_msgs/msg/TwistStamped": KnownType(DRIVE, {"twist.linear.x": _SPEED}, by_name_only=True),
    "geometry_msgs/msg/TwistWithCovarianceStamped": KnownType(
        DRIVE, {"twist.twist.linear.x": _SPEED}, by_name_only=True
    ),
}  # fmt: skip

_CELL = re.compile(r"cell_(voltage|temperature)\[\d+\]")
_JOINT = re.compile(r"name\[(\d+)\]")


def column_names(topic: Topic, layout: Layout) -> dict[str, str]:
    """Name of the column -> path of the number, of the messages of a topic.

    A topic of a type that is not known has all its numbers as `/topic/path`, or `/topic` of a message of one number.
    """
    known = KNOWN.get(topic.type)
    if known is None:
        return {f"{topic.name}/{path}".removesuffix("/data"): path for path in layout.numbers if not _is_stamp(path)}
    if topic.type == TABLE_TYPE:
        return {path: path for path in layout.numbers if not _is_stamp(path)}
    if topic.type == "sensor_msgs/msg/JointState":
        return _of_joints(layout)
    named = {name: path for path, name in known.columns.items() if path in layout.numbers}
    return named | {path: path for path in layout.numbers if _CELL.fullmatch(path)}


def _of_joints(layout: Layout) -> dict[str, str]:
    """Speed and angle of each joint, by the name of the joint."""
    names: dict[str, str] = {}
    for path, joint in layout.texts.items():
        if not (found := _JOINT.fullmatch(path)):
            continue
        for field, unit in (("velocity", "rad/s"), ("position", "rad")):
            if (number := f"{field}[{found[1]}]") in layout.numbers:
                names[f"{joint} {field} [{unit}]"] = number
    return names


def _is_stamp(path: str) -> bool:
    return "stamp" in path.split(".")
