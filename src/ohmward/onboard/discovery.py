"""Signals that a robot offers: those of a CAN database, recorded or heard; numbers on a broker; topics of a ROS bag."""

from __future__ import annotations

import asyncio
import math
from collections import defaultdict
from collections.abc import Coroutine, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError, OhmwardError
from ohmward.logs.bags.bag_table import open_recording
from ohmward.logs.bags.recording import CDR, Recorded
from ohmward.logs.can_file import received_frames
from ohmward.logs.objects_file import CHECKSUM, VICTRON
from ohmward.onboard.can_bus import CanDatabase, CanPort, frames_of
from ohmward.onboard.message import as_number, json_value
from ohmward.onboard.mqtt_broker import MqttBroker
from ohmward.onboard.recognition import Offered, short_name
from ohmward.onboard.ros.cdr import read
from ohmward.onboard.ros.types import BATTERY_STATE, JOINT_STATE
from ohmward.onboard.serial_frame import FrameReader
from ohmward.onboard.sources.serial import PrintedLines, SerialSource

#: Most names recorded; a broker with more serves a whole building, and the rest is left out.
MOST_NAMES = 2000


class Heard:
    """Received numbers, by name."""

    def __init__(self) -> None:
        self._rows: dict[str, list[tuple[float, float]]] = defaultdict(list)

    def put(self, time_s: float, numbers: Mapping[str, object]) -> None:
        """Add numbers of one time; values that are not numbers are left out."""
        for name, value in numbers.items():
            if isinstance(value, bool | int | float) and (name in self._rows or len(self._rows) < MOST_NAMES):
                self._rows[name].append((time_s, as_number(value)))

    def offered(self, name: str, short: str, unit: str = "") -> Offered:
        """The numbers received under a name."""
        rows = np.array(self._rows[name])
        return Offered(name, short, unit, rows[:, 0], rows[:, 1])

    @property
    def names(self) -> list[str]:
        """Names of all received numbers."""
        return list(self._rows)


def of_database(database: CanDatabase, heard: Heard | None = None) -> list[Offered]:
    """Signals of a database; only those heard, if `heard` is given."""
    signals = database.signals.items()
    if heard:
        return [heard.offered(name, signal.name, signal.unit or "") for name, signal in signals if name in heard.names]
    limits = {name: (as_number(signal.minimum), as_number(signal.maximum)) for name, signal in signals}
    return [
        Offered(name, signal.name, signal.unit or "", lowest=limits[name][0], highest=limits[name][1])
        for name, signal in signals
    ]


def of_can_log(path: str, database: CanDatabase) -> list[Offered]:
    """Signals in a recording of a bus: candump, ASC, BLF, TRC or CSV.

    Raises:
        InputError: it cannot be read, or the database knows none of its frames.
    """
    heard = Heard()
    for sender, time_s, payload in received_frames(Path(path)):
        heard.put(time_s, database.decoded(sender.identifier, sender.is_extended, payload) or {})
    if not heard.names:
        raise InputError(f"{path}: {database.path} knows none of its frames; name the database of this bus with --dbc")
    return of_database(database, heard)


def of_bus(port: CanPort, database: CanDatabase, seconds: float) -> list[Offered]:
    """Signals heard on a bus.

    Raises:
        OhmwardError: the bus cannot be opened or fails, or carries no frame of the database.
    """
    heard = Heard()

    async def listen() -> None:
        async with frames_of(port) as frames:
            while True:
                for frame, received_s in await frames.take():
                    message = frame.arbitration_id, frame.is_extended_id, bytes(frame.data)
                    heard.put(received_s, database.decoded(*message) or {})

    _for_so_long(listen(), seconds)
    if not heard.names:
        raise OhmwardError(f"{port.channel}: no frame of {database.path} in {seconds:g} s; is the robot on?")
    return of_database(database, heard)


def of_broker(broker: MqttBroker, seconds: float) -> list[Offered]:
    """Numbers heard on a broker: payloads, and those in JSON objects as TOPIC#KEY.

    The topics of an ohmward are left out: its estimates are no measurements.

    Raises:
        OhmwardError: no broker, or no number on any of its topics.
    """
    heard, own = Heard(), set[str]()

    async def listen() -> None:
        async with broker.connected() as (client, received):
            client.subscribe("#", 0)
            while True:
                for topic, payload, received_s, _ in await received.take():
                    if _is_state(topic, payload):
                        own.add(topic.removesuffix("state"))
                    heard.put(received_s, dict(_numbers(topic, payload)))

    _for_so_long(listen(), seconds)
    names = [name for name in heard.names if not name.startswith(tuple(own))]
    if not names:
        raise OhmwardError(f"{broker.host}: no number on any topic in {seconds:g} s; is the robot on?")
    return [heard.offered(name, short_name(name)) for name in names]


def _is_state(topic: str, payload: bytes) -> bool:
    """True for the state of a robot from the MQTT sink, see `plain_state`; its other topics stand beside it."""
    found = json_value(payload) if topic.endswith("/state") else None
    return isinstance(found, dict) and {"time_s", "unix_s", "sample", "diagnostics"} <= found.keys()


def _numbers(topic: str, payload: bytes) -> Iterator[tuple[str, object]]:
    found = json_value(payload)
    if isinstance(found, dict):
        yield from ((f"{topic}#{key}", value) for key, value in found.items())
    else:
        yield topic, found


def of_line(port: str, baud: int, seconds: float) -> tuple[dict[int, int], list[Offered]]:
    """Numbers of the messages heard on a serial line -> count of values of each; or the numbers that a board prints.

    Raises:
        OhmwardError: the line cannot be opened or fails, or has neither a frame nor a line with numbers.
    """
    frames, lines, heard = FrameReader(), PrintedLines(), Heard()
    found: dict[int, int] = {}
    units: Mapping[str, str] = {}

    async def listen() -> None:
        nonlocal units
        async with SerialSource(port, baud=baud).line() as line:
            while True:
                for data, received_s in await line.take():
                    found.update({frame.number: len(frame.values) for frame in frames.feed(data)})
                    for numbers in lines.feed(data):
                        heard.put(received_s, numbers)
                        units = VICTRON if CHECKSUM in numbers else units

    _for_so_long(listen(), seconds)
    if not found and not heard.names:
        raise OhmwardError(
            f"{port}: no frame and no line with numbers in {seconds:g} s; is the board on, does it send without being "
            f"asked, and is --baud {baud} its rate?"
        )
    places = [name for name in heard.names if name.isdecimal()]
    header = dict(zip(places, lines.headers.get(len(places), ()), strict=False))
    return dict(sorted(found.items())), [
        heard.offered(name, header.get(name, name), units.get(name, "")) for name in heard.names
    ]


class BagTopic(NamedTuple):
    """A topic of a recording, its type, its joints if it is about joints, and the voltage if it is about a battery."""

    name: str
    type: str
    joints: tuple[str, ...] = ()
    voltage_V: float = math.nan  #: of the first message


def topics_of_bag(path: str) -> list[BagTopic]:
    """Topics of a recording of ROS.

    Raises:
        InputError: it is not a recording.
    """
    return [_bag_topic(messages) for messages in open_recording(Path(path)).first_messages().values()]


def _bag_topic(messages: Sequence[Recorded]) -> BagTopic:
    """A topic with what its first messages show, but for ROS 1."""
    topic = messages[0].topic
    found = BagTopic(topic.name, topic.type)
    if topic.encoding != CDR or topic.type not in (BATTERY_STATE, JOINT_STATE):
        return found
    read_of = [read(topic.type, message.payload) for message in messages]
    texts = [text for layout, _ in read_of for text in layout.texts.items()]
    joints = dict.fromkeys(joint for path, joint in texts if path.startswith("name["))
    return found._replace(joints=tuple(joints), voltage_V=read_of[0][1].get("voltage", math.nan))


def _for_so_long(listening: Coroutine[Any, Any, None], seconds: float) -> None:
    with suppress(TimeoutError):
        asyncio.run(asyncio.wait_for(listening, seconds))
