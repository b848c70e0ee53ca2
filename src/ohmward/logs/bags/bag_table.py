"""A recording of ROS as a table: the topics of a battery or of a drive, found by their types or named."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.bags.choice import choose_topics
from ohmward.logs.bags.definitions import definitions_of
from ohmward.logs.bags.files import open_recording
from ohmward.logs.bags.gather import Gatherer
from ohmward.logs.bags.known import KNOWN, column_names
from ohmward.logs.bags.layout import layout_of
from ohmward.logs.bags.recording import CDR, ROS1, Recorded, Recording, Topic
from ohmward.logs.note import Note, counted
from ohmward.logs.table import Progress, Table, TableFile, row_numbers

TIME = "time"
#: Earlier times are those of a simulation, or of a clock that counts from its own start.
_YEAR_2000_NS = 946_684_800 * 10**9


class _Bag(NamedTuple):
    """A recording and the first messages of its topics."""

    recording: Recording
    first: Mapping[str, Recorded]


def open_bag(path: Path) -> TableFile:
    """The columns of a recording of ROS, of all topics that are known by their types.

    Raises:
        InputError: no recording of ROS, or one without messages.
        OhmwardError: the package rosbags is not installed.
    """
    bag = _look(open_recording(path))
    known = [topic for topic in _readable(bag) if topic.type in KNOWN and not KNOWN[topic.type].by_name_only]
    return _table_file(bag, path.name, known)


def _look(recording: Recording) -> _Bag:
    """The recording and the first message of each topic."""
    first: dict[str, Recorded] = {}
    for message in recording.messages():
        if message.topic.name not in first:
            first[message.topic.name] = message
            if recording.all_known and len(first) == len(recording.topics):
                break
    if not first:
        raise InputError(f"{recording.source}: the recording holds no message; record it again, or name another one")
    return _Bag(recording, first)


def _table_file(bag: _Bag, source: str, topics: list[Topic]) -> TableFile:
    """The columns of some topics."""
    of_topic = {topic.name: _columns(bag, topic) for topic in topics}
    known = dict.fromkeys([TIME, *(name for columns in of_topic.values() for name in columns)])

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        chosen = [topic for topic in topics if set(of_topic[topic.name]) & set(names)] or topics
        return _load(bag, source, chosen, names, progress)

    def part(kind: str, where: Mapping[str, float | str]) -> TableFile:
        readable = {topic.name: topic for topic in _readable(bag)}
        types = {name: topic.type for name, topic in readable.items()}
        chosen = choose_topics(source, kind, where, types, KNOWN)
        return _table_file(bag, source, [readable[name] for name in chosen])

    battery = any(topic.type == "sensor_msgs/msg/BatteryState" for topic in topics)
    return TableFile(source, tuple(known), load, TIME, part, "charge" if battery else None)


def _readable(bag: _Bag) -> list[Topic]:
    """The topics that have messages in a serialisation that is known."""
    return [message.topic for message in bag.first.values() if message.topic.encoding in (CDR, ROS1)]


def _columns(bag: _Bag, topic: Topic) -> list[str]:
    """The columns of a topic, by its first message."""
    try:
        layout = layout_of(bag.first[topic.name].payload, topic.type, definitions_of(topic), topic.encoding)
    except ValueError as error:
        raise InputError(
            f"{bag.recording.source}: topic {topic.name} cannot be read as {topic.type} ({error}); choose another topic"
        ) from error
    return list(column_names(topic, layout))


def _load(
    bag: _Bag, source: str, topics: list[Topic], wanted: Collection[str], progress: Progress | None = None
) -> Table:
    """The columns of some topics, a row for each message, in order of time where there are several topics."""
    gatherers = {topic.name: Gatherer(topic, wanted) for topic in topics}
    puts = {name: gatherer.put for name, gatherer in gatherers.items()}
    for topic, received_ns, payload in bag.recording.messages(gatherers):
        puts[topic.name](received_ns, payload)
    found = {name: gatherer.columns() for name, gatherer in gatherers.items()}
    time_ns = np.concatenate([times for times, _ in found.values()])
    if not time_ns.size:
        raise InputError(f"{source}: no message of {', '.join(gatherers)} could be read; record it again")
    columns: dict[str, np.ndarray] = {TIME: time_ns.view("M8[ns]" if time_ns[0] > _YEAR_2000_NS else "m8[ns]")}
    begin = 0
    for times, values in found.values():
        for name, column in values.items():
            whole = columns.setdefault(name, np.full(time_ns.size, np.nan))
            whole[begin : begin + times.size] = column
        begin += times.size
    table = Table(source, columns, row_numbers(1, time_ns.size), "message", _notes(bag, gatherers))
    return table if len(topics) == 1 else table.pick(np.argsort(time_ns, kind="stable"))


def _notes(bag: _Bag, gatherers: Mapping[str, Gatherer]) -> tuple[Note, ...]:
    """Notes on the topics that were read and on what could not be."""
    topics = ", ".join(f"{name} ({gatherer.topic.type})" for name, gatherer in gatherers.items())
    broken = sum(gatherer.broken for gatherer in gatherers.values())
    left_out = [Note(f"{counted(broken, 'message')} could not be read: left out", "warning")] if broken else []
    read = Note(f"topic {topics}" if len(gatherers) == 1 else f"topics {topics}")
    return (read, *bag.recording.notes.values(), *left_out)
