"""Fields and hashes of the message types that go out or come in: `types.msg`, as ros2/common_interfaces has them."""

from __future__ import annotations

from importlib.resources import files

from ohmward.logs.bags.recording import Definitions, Several, Single

BATTERY_STATE = "sensor_msgs/msg/BatteryState"
JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
ODOMETRY = "nav_msgs/msg/Odometry"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
TF = "tf2_msgs/msg/TFMessage"
CLOCK = "rosgraph_msgs/msg/Clock"
FLOATS = "std_msgs/msg/Float64MultiArray"
PATH = "nav_msgs/msg/Path"

#: Fields of each type, a line each, and REP-2011 hashes, the same from Iron on; `ros2 topic info -v` shows them.
_FIELDS: dict[str, str] = {}
HASHES: dict[str, str] = {}
for _block in files("ohmward.onboard.ros").joinpath("types.msg").read_text(encoding="utf-8").strip().split("\n\n"):
    _head, _lines = _block.split("\n", 1)
    _, _type, *_hash = _head.split()
    _FIELDS[_type] = f"{_lines}\n"
    if _hash:
        HASHES[_type] = _hash[0]


def definition_text(type_: str) -> str:
    """The definition of a type and of the types in it, in the form that recordings and viewers take."""
    texts, waiting = dict[str, str](), [type_]
    while waiting:
        name = waiting.pop(0)
        if name not in texts:
            texts[name] = _FIELDS[name]
            inner = [content.item if isinstance(content, Several) else content for _, content in DEFINITIONS[name]]
            waiting += [content.type for content in inner if content.type in _FIELDS]
    first, *others = texts.values()
    headed = zip(list(texts)[1:], others, strict=True)
    return "".join([first, *(f"{'=' * 80}\nMSG: {name.replace('/msg/', '/')}\n{text}" for name, text in headed)])


def _content(type_: str) -> Single | Several:
    item, bracket, size = type_.removesuffix("]").partition("[")
    return Several(Single(item), int(size) if size else None) if bracket else Single(item)


DEFINITIONS: Definitions = {
    type_: [(name, _content(of_field)) for of_field, name in map(str.split, lines.splitlines())]
    for type_, lines in _FIELDS.items()
}
