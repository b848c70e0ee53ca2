"""Another node of ROS 2 in a process of its own, made of zenoh and rosbags alone: keys, attachments and bytes.

Usage: other_node.py router PORT | publish PORT COUNT | listen PORT KEY TYPE COUNT
"""

import json
import struct
import sys
import time
from typing import Any

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore

BATTERY = "sensor_msgs/msg/BatteryState"
STORE = get_typestore(Stores.ROS2_JAZZY)


def session(mode: str, port: str):
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    where = "listen" if mode == "router" else "connect"
    config.insert_json5(f"{where}/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    return zenoh.open(config)


def router(port: str) -> None:
    with session("router", port):
        print("ready", flush=True)
        sys.stdin.read()


def publish(port: str, count: str) -> None:
    """Battery states with a current of -0.1 k."""
    types = STORE.types
    key = f"0/bms/battery/sensor_msgs::msg::dds_::BatteryState_/{STORE.hash_rihs01(BATTERY)}"
    with session("client", port) as node:
        publisher = node.declare_publisher(key)
        for k in range(int(count)):
            now_ns = time.time_ns()
            stamp = types["builtin_interfaces/msg/Time"](sec=now_ns // 10**9, nanosec=now_ns % 10**9)
            nan = float("nan")
            message = types[BATTERY](
                types["std_msgs/msg/Header"](stamp, "base_link"), 13.0, 25.0, -0.1 * k, nan, nan, nan, nan,
                2, 0, 4, True, np.full(4, 3.25, np.float32), np.empty(0, np.float32), "", "",
            )  # fmt: skip
            attachment = struct.pack("<qqB16s", k, now_ns, 16, b"x" * 16)
            publisher.put(bytes(STORE.serialize_cdr(message, BATTERY)), attachment=attachment)
            time.sleep(0.02)
        time.sleep(0.2)


def listen(port: str, key: str, type_: str, count: str) -> None:
    """Print what comes: fields, and the attachment's number and length of the identity."""
    left = int(count)

    def arrived(sample) -> None:
        message: Any = STORE.deserialize_cdr(bytes(sample.payload.to_bytes()), type_)
        number, stamp_ns, length, _ = struct.unpack("<qqB16s", sample.attachment.to_bytes())
        percentage = getattr(message, "percentage", None)
        frame = message.header.frame_id
        print(json.dumps([number, length, percentage, frame, abs(stamp_ns - time.time_ns()) < 10**10]), flush=True)

    with session("client", port) as node:
        subscription = node.declare_subscriber(key, arrived)
        tokens = node.liveliness().get("@ros2_lv/**")
        print(json.dumps([str(reply.ok.key_expr) for reply in tokens if reply.ok]), flush=True)
        time.sleep(left)
        subscription.undeclare()


if __name__ == "__main__":
    commands: dict[str, Any] = {"router": router, "publish": publish, "listen": listen}
    commands[sys.argv[1]](*sys.argv[2:])
