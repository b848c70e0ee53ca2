"""Transport of serialised messages: rclpy if ROS is installed, otherwise zenoh in the format of rmw_zenoh.

Sources and sinks of a process that have the same node share it.
"""

from __future__ import annotations

import asyncio
import os
import re
import threading
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

from ohmward.checks import require_between, require_one_of
from ohmward.errors import InputError
from ohmward.onboard.ros.zenoh_transport import ZenohTransport, full_name
from ohmward.optional import require

#: Accepts a serialised message and the identity of its publisher; called from a thread of the transport.
Receive = Callable[[bytes, bytes], None]

#: Largest domain of ROS 2: beyond it there are no UDP ports.
MOST_DOMAIN = 232

#: A topic of ROS 2: relative, absolute, or below the node.
_TOPIC = re.compile(r"(~/|/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)

#: Time that the thread of a node has to end [s].
_SPIN_END_S = 2.0
#: Time between two polls for messages, and between two turns of the executor [s], which cost as much as ten messages.
_LOOK_S, _TURN_S = 0.01, 0.1
#: Length of the queue of a topic, for a process that was held up, or a sender that had been waiting.
_QUEUE = 1000
#: Most messages of a topic in one poll, so that one topic cannot keep the others waiting.
_MOST_TAKEN = 100


@dataclass(frozen=True)
class RosNetwork:
    """Node of ROS 2, and its connection to the others."""

    transport: str = "auto"  #: "rclpy" or "zenoh"; "auto" takes rclpy if it is installed
    node: str = "ohmward"  #: name of the node
    namespace: str = ""  #: of node and topics, such as "/robot1"; a topic that begins with a slash is outside of it
    domain: int | None = None  #: ROS domain, 0 to 232; default: the environment variable ROS_DOMAIN_ID, or 0
    router: str = "tcp/localhost:7447"  #: address of the zenoh router, which `ros2 run rmw_zenoh_cpp rmw_zenohd` starts

    def __post_init__(self) -> None:
        require_one_of("transport", self.transport, ("auto", "rclpy", "zenoh"))
        if not self.node.isidentifier():
            raise InputError(f"node must be a name of letters, digits and _, got {self.node!r}")
        if self.domain is not None:
            require_between("domain", self.domain, 0, MOST_DOMAIN)
        for part in filter(None, self.namespace.split("/")):
            if not part.isidentifier():
                raise InputError(f"namespace must be names of letters, digits and _ with /, got {self.namespace!r}")

    @property
    def full_name(self) -> str:
        """Name of the node with its namespace, "/robot1/ohmward"; the node alone without one."""
        return full_name(self.namespace, self.node) if self.namespace.strip("/") else self.node

    @property
    def uses_rclpy(self) -> bool:
        """True if messages go through rclpy."""
        return self.transport == "rclpy" or (self.transport == "auto" and find_spec("rclpy") is not None)

    def open(self) -> Transport:
        """Open the connection to other nodes.

        Raises:
            InputError: the domain in the environment is not valid.
            OhmwardError: no router of zenoh, or a package is not installed.
        """
        domain = self.domain
        if domain is None:
            given = os.environ.get("ROS_DOMAIN_ID") or "0"
            if not given.isdecimal() or int(given) > MOST_DOMAIN:
                raise InputError(f"the environment variable ROS_DOMAIN_ID must be 0 to {MOST_DOMAIN}, got {given!r}")
            domain = int(given)
        if self.uses_rclpy:
            rclpy = require("rclpy", 'transport = "rclpy"')
            context = require("rclpy.context", 'transport = "rclpy"').Context()
            rclpy.init(args=None, context=context, domain_id=domain)
            node = rclpy.create_node(self.node, namespace=self.namespace, context=context)
            return RclpyTransport(node, context.shutdown)
        return ZenohTransport(self.node, self.namespace, domain, self.router)


class _Subscription(NamedTuple):
    """A subscription of rclpy and the receiver of its messages."""

    made: Any
    receive: Receive

    def take_all(self) -> None:
        """Hand over the messages that have arrived, `_MOST_TAKEN` at most."""
        with self.made.handle:
            for _ in range(_MOST_TAKEN):
                taken = self.made.handle.take_message(self.made.msg_type, True)
                if not taken:
                    break
                payload, about = taken
                self.receive(payload, bytes(about.get("publisher_gid", {}).get("data", b"")))


class SharedNode:
    """A node for several parts of a process: opened for the first of them, closed after the last.

    Args:
        network: settings that the parts have in common.
        node: of rclpy, if somebody else has made it and will end it.
    """

    def __init__(self, network: RosNetwork, node: Any = None):
        self._network, self._node = network, node
        self._lock = asyncio.Lock()
        self._transport: Transport | None = None
        self._users = 0

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[Transport]:
        """The connection to other nodes, for as long as a part needs it; errors as in `RosNetwork.open`."""
        async with self._lock:
            if self._transport is None:
                open_ = self._network.open if self._node is None else partial(RclpyTransport, self._node)
                self._transport = await asyncio.to_thread(open_)
            self._users += 1
        try:
            yield self._transport
        finally:
            async with self._lock:
                self._users -= 1
                if not self._users:
                    transport, self._transport = self._transport, None
                    await asyncio.to_thread(transport.close)


def require_topics(topics: Mapping[str, str]) -> None:
    """Raise InputError for a topic that ROS does not take; topics: setting -> topic, "" where there is none."""
    for setting, topic in topics.items():
        if topic and not _TOPIC.fullmatch(topic):
            raise InputError(
                f"{setting} must be a topic of words of letters, digits and _ with / between them, none of which "
                f"begins with a digit, got {topic!r}"
            )


def require_others_topics(heard: Mapping[str, str], sent: Mapping[str, str]) -> None:
    """Raise InputError if ohmward would receive its own messages.

    heard, sent: setting -> full name of its topic.
    """
    for input_, topic in heard.items():
        for output, own in sent.items():
            if topic == own:
                raise InputError(
                    f"{input_} and {output} are both {topic}: ohmward would take its own estimates for measurements; "
                    f'give one of them another topic, the second for example "ohmward/{topic.rpartition("/")[2]}"'
                )


class RclpyTransport:
    """A node of rclpy; messages pass through it serialised, so that both transports carry the same bytes.

    The executor serves parameters, services and the node's clock. Messages are taken without it, because it would
    rebuild its wait set for each of them, at ten times the cost of the message.

    Args:
        node: it is served from a thread of this object.
        shut_down: ends the node's context; the node then ends with this object. None leaves both to others.
    """

    def __init__(self, node: Any, shut_down: Callable[[], None] | None = None):
        self._node, self._shut_down = node, shut_down
        self._publishers: dict[str, Any] = {}
        self._subscriptions: list[_Subscription] = []
        self._services: list[Any] = []
        #: The default callbacks cost much of every spin; incompatible readers are warned on their own side.
        self._events = require("rclpy.event_handler", 'transport = "rclpy"')
        executors = require("rclpy.executors", 'transport = "rclpy"')
        self._executor = executors.SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def advertise(self, topic: str, type_: str) -> None:
        """Make the publisher of a topic, reliable and volatile: matches readers of either reliability."""
        if topic not in self._publishers:
            events = self._events.PublisherEventCallbacks(use_default_callbacks=False)
            made = self._node.create_publisher(message_class(type_), topic, 10, event_callbacks=events)
            self._publishers[topic] = made

    def publish(self, topic: str, type_: str, payload: bytes) -> None:
        """Send a serialised message."""
        self.advertise(topic, type_)
        self._publishers[topic].publish(payload)

    def subscribe(self, topic: str, type_: str, receive: Receive) -> None:
        """Receive messages as sensors send them, best effort: matches every writer."""
        qos = require("rclpy.qos", 'transport = "rclpy"')
        groups = require("rclpy.callback_groups", 'transport = "rclpy"')
        best_effort = qos.QoSProfile(depth=_QUEUE, reliability=qos.ReliabilityPolicy.BEST_EFFORT)
        events = self._events.SubscriptionEventCallbacks(use_default_callbacks=False)
        group = type("NotByTheExecutor", (groups.CallbackGroup,), {"can_execute": lambda *_: False})()
        made = self._node.create_subscription(
            message_class(type_), topic, receive, best_effort, callback_group=group, event_callbacks=events, raw=True
        )
        self._subscriptions.append(_Subscription(made, receive))

    def serve(self, name: str, act: Callable[[], str]) -> None:
        """Offer a service of type `std_srvs/Trigger`, answered by a sentence; without that package there is none."""
        if find_spec("std_srvs") is None:
            return
        trigger = require("std_srvs.srv", "services of ROS").Trigger

        def answer(_: Any, response: Any) -> Any:
            response.success, response.message = True, act()
            return response

        self._services.append(self._node.create_service(trigger, name, answer))

    def check(self) -> None:
        """Do nothing: DDS finds the other nodes again by itself."""

    def close(self) -> None:
        """End publishers, subscriptions and services, and the node if it is our own."""
        self._ended.set()
        self._executor.shutdown()
        self._thread.join(_SPIN_END_S)
        if self._shut_down is None:
            for destroy, made in (
                (self._node.destroy_publisher, self._publishers.values()),
                (self._node.destroy_subscription, [subscription.made for subscription in self._subscriptions]),
                (self._node.destroy_service, self._services),
            ):
                for one in made:
                    destroy(one)
        else:
            self._node.destroy_node()
            with suppress(Exception):
                self._shut_down()

    def _spin(self) -> None:
        """Take messages and serve the rest of the node until it is closed."""
        turn_s = time.monotonic()
        with suppress(Exception):
            while not self._ended.wait(_LOOK_S):
                for subscription in tuple(self._subscriptions):
                    subscription.take_all()
                if time.monotonic() >= turn_s:
                    self._executor.spin_once(0.0)
                    turn_s = time.monotonic() + _TURN_S


#: Connection for serialised messages to and from other nodes.
Transport = RclpyTransport | ZenohTransport


def message_class(type_: str) -> object:
    """The class of a message type in the packages of ROS: `sensor_msgs.msg.BatteryState`."""
    package, _, name = type_.split("/")
    return getattr(require(f"{package}.msg", "rclpy"), name)
