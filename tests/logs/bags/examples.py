"""Messages of a battery, and files of them that the packages of others have written."""

import math
from pathlib import Path

import numpy as np
import pytest

TYPE = "sensor_msgs/msg/BatteryState"
START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
COMPRESSIONS = ("ZSTD", "LZ4", "NONE")
FORMATS = ("folder.mcap", "folder.db3", "one.bag", *(f"{name}.mcap" for name in COMPRESSIONS))
N = 3000


def store(ros1: bool = False):
    typesys = pytest.importorskip("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)


def truth(n: int = N) -> dict[str, np.ndarray]:
    """Current and voltage of a battery in float32, as the messages hold them."""
    rng = np.random.default_rng(1)
    current_A = np.where((np.arange(n) // 60) % 3 == 0, -8.0, 0.0) + rng.normal(0.0, 0.01, n)
    voltage_V = 13.2 + 0.03 * current_A + rng.normal(0.0, 0.002, n)
    return {"current": current_A.astype(np.float32), "voltage": voltage_V.astype(np.float32)}


def header(types, k: int, ros1: bool = False, frame: str = "base_link"):
    now_ns = START_NS + k * STEP_NS
    stamp = types["builtin_interfaces/msg/Time"](sec=now_ns // 10**9, nanosec=now_ns % 10**9)
    more = {"seq": k} if ros1 else {}
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **more)


def payloads(n: int = N, ros1: bool = False, cells: int = 4) -> list[bytes]:
    """Messages of a battery."""
    found, known = store(ros1), truth(n)
    fields = {name for name, _ in found.fielddefs[TYPE][1]}
    constant = {
        "temperature": 25.0, "charge": math.nan, "capacity": 12.0, "design_capacity": 12.0, "percentage": 0.5,
        "power_supply_status": 2, "power_supply_health": 1, "power_supply_technology": 4, "present": True,
        "cell_temperature": np.array([], np.float32), "location": "", "serial_number": "abc",
    }  # fmt: skip
    constant = {name: value for name, value in constant.items() if name in fields}
    serialize = found.serialize_ros1 if ros1 else found.serialize_cdr
    return [
        bytes(serialize(
            found.types[TYPE](
                header=header(found.types, k, ros1), voltage=known["voltage"][k], current=known["current"][k],
                cell_voltage=np.full(cells, known["voltage"][k] / max(cells, 1), np.float32), **constant,
            ),
            TYPE,
        ))
        for k in range(n)
    ]  # fmt: skip


def joint_states(names: list[str], speeds: np.ndarray) -> list[bytes]:
    """Messages of joints with these speeds (n, joints)."""
    found, type_ = store(), "sensor_msgs/msg/JointState"
    message, empty = found.types[type_], np.array([])
    return [
        bytes(found.serialize_cdr(message(header(found.types, k), names, k * row, row, empty), type_))
        for k, row in enumerate(speeds)
    ]


def twists(speeds: np.ndarray, turns: np.ndarray | None = None, frame: str = "base_link") -> list[bytes]:
    """Messages `TwistWithCovarianceStamped` with these forward speeds and yaw rates (n,) and a std of 0.05 m/s."""
    found, type_ = store(), "geometry_msgs/msg/TwistWithCovarianceStamped"
    types = found.types
    vector, covariance = types["geometry_msgs/msg/Vector3"], np.diag([0.05**2] * 6).ravel()
    messages = []
    for k, (speed, turn) in enumerate(zip(speeds, np.zeros_like(speeds) if turns is None else turns, strict=True)):
        twist = types["geometry_msgs/msg/Twist"](vector(float(speed), 0.0, 0.0), vector(0.0, 0.0, float(turn)))
        known = types["geometry_msgs/msg/TwistWithCovariance"](twist, covariance)
        messages.append(bytes(found.serialize_cdr(types[type_](header(types, k, frame=frame), known), type_)))
    return messages


def write_mcap(path: Path, topics: dict[str, tuple[str, list[bytes]]], compression: str = "ZSTD", chunk: int = 16384):
    """An MCAP file of topics: name -> type and messages, one every 0.1 s."""
    writing = pytest.importorskip("mcap.writer")
    found = store()
    with path.open("wb") as stream:
        writer = writing.Writer(stream, chunk_size=chunk, compression=writing.CompressionType[compression])
        writer.start("ros2")
        channels = {}
        for name, (type_, _) in topics.items():
            definition = found.generate_msgdef(type_, ros_version=2)[0].encode()
            schema = writer.register_schema(type_, "ros2msg", definition)
            channels[name] = writer.register_channel(name, "cdr", schema)
        for k in range(max(len(messages) for _, messages in topics.values())):
            for name, (_, messages) in topics.items():
                if k < len(messages):
                    now_ns = START_NS + k * STEP_NS
                    writer.add_message(channels[name], now_ns + 1000, messages[k], now_ns)
        writer.finish()
