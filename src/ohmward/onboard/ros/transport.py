"""Serialised messages out and in: by rclpy where ROS is installed, else by zenoh as rmw_zenoh speaks it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Protocol

from ohmward.checks import require_between, require_one_of
from ohmward.errors import InputError
from ohmward.onboard.ros.zenoh_transport import ZenohTransport
from ohmward.optional import require

#: Takes a serialised message in; called from a thread of the transport.
Receive = Callable[[bytes], None]

#: Largest domain of ROS 2: beyond it the ports of UDP end.
MOST_DOMAIN = 232


class Transport(Protocol):
    """Way of messages to and from other nodes."""

    def publish(self, topic: str, type_: str, payload: bytes) -> None:
        """Send a serialised message."""
        ...

    def subscribe(self, topic: str, type_: str, receive: Receive) -> None:
        """Receive the messages of a topic from now on."""
        ...

    def check(self) -> None:
        """Raise `OhmwardError` where the way is lost."""
        ...

    def close(self) -> None:
        """End publishers and subscriptions."""
        ...


@dataclass(frozen=True)
class RosNetwork:
    """Node of ROS 2, and its way to the others."""

    transport: str = "auto"  #: "auto" takes rclpy where it is installed, else zenoh; or "rclpy" or "zenoh"
    node: str = "ohmward"  #: name of the node
    namespace: str = ""  #: of node and topics, "/robot1"; topics with a slash in front are outside of it
    domain: int | None = None  #: as ROS_DOMAIN_ID, 0 to 232; that of the environment, or 0, unless given
    router: str = "tcp/localhost:7447"  #: of zenoh, that `ros2 run rmw_zenoh_cpp rmw_zenohd` starts

    def __post_init__(self) -> None:
        require_one_of("transport", self.transport, ("auto", "rclpy", "zenoh"))
        if not self.node.isidentifier():
            raise InputError(f"node must be a name of letters, digits and _, got {self.node!r}")
        if self.domain is not None:
            require_between("domain", self.domain, 0, MOST_DOMAIN)
        for part in filter(None, self.namespace.split("/")):
            if not part.isidentifier():
                raise InputError(f"namespace must be names of letters, digits and _ with /, got {self.namespace!r}")

    def open(self) -> Transport:
        """The way to other nodes.

        Raises:
            OhmwardError: no router of zenoh, or a package that is not installed.
        """
        domain = domain_of_environment() if self.domain is None else self.domain
        use_rclpy = self.transport == "rclpy" or (self.transport == "auto" and find_spec("rclpy") is not None)
        if use_rclpy:
            return RclpyTransport(self.node, self.namespace, domain)
        return ZenohTransport(self.node, self.namespace, domain, self.router)


def require_others_topics(heard: Mapping[str, str], sent: Mapping[str, str]) -> None:
    """Raise InputError where ohmward would hear itself.

    heard, sent: setting -> full name of its topic.
    """
    for input_, topic in heard.items():
        for output, own in sent.items():
            if topic == own:
                raise InputError(
                    f"{input_} and {output} are both {topic}: ohmward would take its own estimates for measurements; "
                    f'give one of them another topic, the second for example "ohmward/{topic.rpartition("/")[2]}"'
                )


def domain_of_environment() -> int:
    """The domain that ROS_DOMAIN_ID names; 0 without.

    Raises:
        InputError: it is no such number.
    """
    given = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not given.isdecimal() or int(given) > MOST_DOMAIN:
        raise InputError(f"the environment variable ROS_DOMAIN_ID must be 0 to {MOST_DOMAIN}, got {given!r}")
    return int(given)


class RclpyTransport:
    """A node of rclpy; messages pass through it serialised, so that both ways carry the same bytes."""

    def __init__(self, node: str, namespace: str, domain: int):
        self._rclpy = require("rclpy", 'transport = "rclpy"')
        self._context = require("rclpy.context", 'transport = "rclpy"').Context()
        self._rclpy.init(args=None, context=self._context, domain_id=domain)
        self._node = self._rclpy.create_node(node, namespace=namespace, context=self._context)
        self._publishers: dict[str, object] = {}
        executors = require("rclpy.executors", 'transport = "rclpy"')
        self._executor = executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def publish(self, topic: str, type_: str, payload: bytes) -> None:
        """Send a serialised message, reliable and volatile: matches readers of either reliability."""
        if topic not in self._publishers:
            self._publishers[topic] = self._node.create_publisher(message_class(type_), topic, 10)
        self._publishers[topic].publish(payload)  # type: ignore[attr-defined]

    def subscribe(self, topic: str, type_: str, receive: Receive) -> None:
        """Receive messages as sensors send them, best effort: matches every writer."""
        qos = require("rclpy.qos", 'transport = "rclpy"').qos_profile_sensor_data
        self._node.create_subscription(message_class(type_), topic, receive, qos, raw=True)

    def check(self) -> None:
        """Nothing: DDS finds the others again by itself."""

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self._node.destroy_node()
        with suppress(Exception):
            self._context.shutdown()

    def _spin(self) -> None:
        """Serve subscriptions until the executor is shut down."""
        with suppress(Exception):
            self._executor.spin()


def message_class(type_: str) -> object:
    """The class of a message type in the packages of ROS: `sensor_msgs.msg.BatteryState`."""
    package, _, name = type_.split("/")
    return getattr(require(f"{package}.msg", "rclpy"), name)
