"""Messages by zenoh in the format of rmw_zenoh: keys, attachments and liveliness tokens of its design document.

github.com/ros2/rmw_zenoh, docs/design.md: a topic is the key DOMAIN/TOPIC/TYPE/HASH, a message carries its number, its
time and the identity of its writer, and nodes and topics are announced by tokens, which `ros2 topic list` shows.
"""

from __future__ import annotations

import itertools
import secrets
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from ohmward.errors import OhmwardError
from ohmward.onboard.ros.types import HASHES
from ohmward.optional import require

#: Number and time [ns] of a message, and length and bytes of its writer's identity.
_ATTACHMENT = struct.Struct("<qqB16s")
#: Reliable, volatile, the last ten; deadline, lifespan and liveliness as by default.
_QOS = "::,10:,:,:,,"
#: Longest wait for an answer of the router [ms].
_CONNECT_MS = 2000


def full_name(namespace: str, topic: str) -> str:
    """The topic with its namespace, a slash in front."""
    parts = topic.split("/") if topic.startswith("/") else [*namespace.split("/"), *topic.split("/")]
    return "/" + "/".join(filter(None, parts))


def dds_type(type_: str) -> str:
    """The type's name as DDS writes it: `sensor_msgs::msg::dds_::BatteryState_`."""
    package, kind, name = type_.split("/")
    return f"{package}::{kind}::dds_::{name}_"


class ZenohTransport:
    """A session of zenoh that appears as a node to rmw_zenoh.

    Args:
        node, namespace, domain: of ROS.
        router: endpoint of rmw_zenohd.

    Raises:
        OhmwardError: no router answers, or zenoh is not installed.
    """

    def __init__(self, node: str, namespace: str, domain: int, router: str):
        self._zenoh = require("zenoh", "ROS 2 without rclpy")
        self._names = (node, namespace, domain)
        self.router = router
        self._session = self._open()
        self._ids = itertools.count(10)
        self._publishers: dict[str, tuple[Any, bytes, itertools.count[int]]] = {}
        self._declared: list[Any] = [self._session.liveliness().declare_token(self._token("NN", "0"))]

    def advertise(self, topic: str, type_: str) -> None:
        """Declare the publisher of a topic, and announce it."""
        if topic not in self._publishers:
            publisher = self._session.declare_publisher(self._key(topic, type_, HASHES[type_]))
            self._announce("MP", topic, type_)
            self._publishers[topic] = publisher, secrets.token_bytes(16), itertools.count(1)

    def publish(self, topic: str, type_: str, payload: bytes) -> None:
        """Send a serialised message."""
        self.advertise(topic, type_)
        publisher, identity, numbers = self._publishers[topic]
        attachment = _ATTACHMENT.pack(next(numbers), time.time_ns(), len(identity), identity)
        publisher.put(payload, attachment=attachment)

    def subscribe(self, topic: str, type_: str, receive: Callable[[bytes, bytes], None]) -> None:
        """Receive the messages of a topic with any type hash, as writers of Humble give none."""

        def arrived(sample: Any) -> None:
            about = sample.attachment.to_bytes() if sample.attachment else b""
            is_known = len(about) == _ATTACHMENT.size  # early versions have another form
            receive(sample.payload.to_bytes(), _ATTACHMENT.unpack(about)[-1] if is_known else b"")

        self._declared.append(self._session.declare_subscriber(self._key(topic, type_, "*"), arrived))
        self._announce("MS", topic, type_)

    def serve(self, name: str, act: Callable[[], str]) -> None:
        """Do nothing: services need rclpy."""

    def check(self) -> None:
        """Raise `OhmwardError` if the router is away."""
        if not list(self._session.info.routers_zid()):
            raise OhmwardError(f"the zenoh router {self.router} is away; is rmw_zenohd running?")

    def close(self) -> None:
        """End the session, which removes its tokens."""
        with suppress(Exception):
            self._session.close()

    def _open(self) -> Any:
        config = self._zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{self.router}"]')
        config.insert_json5("connect/timeout_ms", str(_CONNECT_MS))
        config.insert_json5("scouting/multicast/enabled", "false")
        try:
            return self._zenoh.open(config)
        except Exception as error:  # zenoh's errors have no common type
            raise OhmwardError(
                f"no zenoh router at {self.router}; start one with: ros2 run rmw_zenoh_cpp rmw_zenohd"
            ) from error

    def _key(self, topic: str, type_: str, hash_: str) -> str:
        _, namespace, domain = self._names
        return f"{domain}/{full_name(namespace, topic)[1:]}/{dds_type(type_)}/{hash_}"

    def _announce(self, kind: str, topic: str, type_: str) -> None:
        """Announce a publisher (MP) or a subscription (MS)."""
        name = full_name(self._names[1], topic).replace("/", "%")
        token = f"{self._token(kind, str(next(self._ids)))}/{name}/{dds_type(type_)}/{HASHES[type_]}/{_QOS}"
        self._declared.append(self._session.liveliness().declare_token(token))

    def _token(self, kind: str, number: str) -> str:
        """The head of a token: domain, session, node, number, kind, enclave, namespace and name."""
        node, namespace, domain = self._names
        of_space = full_name("", namespace).replace("/", "%") if namespace.strip("/") else "%"
        return f"@ros2_lv/{domain}/{self._session.info.zid()}/0/{number}/{kind}/%/{of_space}/{node}"
