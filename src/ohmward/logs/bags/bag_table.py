"""A recording of ROS as a table: the topics of a battery or of a drive, found by their types or named."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import numpy as np

from ohmward.errors import InputError
from ohmward.logs import sqlite_file
from ohmward.logs.bags import mcap_file, rosbag1_file
from ohmward.logs.bags.recording import (
    CDR,
    JOINT_STATE,
    ROS1,
    Layout,
    Recorded,
    Recording,
    Topic,
    definitions_of,
    layout_of,
)
from ohmward.logs.battery_columns import has_log
from ohmward.logs.table import (
    BATTERY,
    BOTH,
    DRIVE,
    RECORDING_ENDINGS,
    KnownType,
    Note,
    Progress,
    Stream,
    Table,
    TableFile,
    choose_topics,
    counted,
    in_order,
    rows_of,
)
from ohmward.logs.wheel_columns import wheel_places

#: Type of messages that are rows of a table written by ohmward.
TABLE_TYPE = "ohmward_msgs/msg/Table"

_SPEED = "speed [m/s]"
#: Column of the yaw rate beside such a speed; not that of a gyro, as it may come from the wheels.
OUTSIDE_YAW_RATE = "outside yaw rate [rad/s]"
#: Types that are found without being named, and those that become a quantity when named.
KNOWN = {
    "sensor_msgs/msg/BatteryState": KnownType(
        BATTERY,
        {
            **{"voltage": "voltage [V]", "current": "current [A]", "temperature": "temperature [degC]"},
            **{"charge": "charge [Ah]", "percentage": "percentage", "power_supply_status": "power_supply_status"},
        },
    ),
    JOINT_STATE: KnownType(DRIVE, {}),
    "sensor_msgs/msg/Imu": KnownType(
        DRIVE,
        {
            "angular_velocity.z": "angular velocity z [rad/s]",
            "linear_acceleration.x": "linear acceleration x [m/s2]",
        },
    ),
    TABLE_TYPE: KnownType(BOTH, {}),
    **{
        type_: KnownType(DRIVE, {f"{at}linear.x": _SPEED, f"{at}angular.z": OUTSIDE_YAW_RATE}, by_name_only=True)
        for type_, at in (
            ("nav_msgs/msg/Odometry", "twist.twist."),
            ("geometry_msgs/msg/TwistStamped", "twist."),
            ("geometry_msgs/msg/TwistWithCovarianceStamped", "twist.twist."),
        )
    },
}  # fmt: skip

_CELL = re.compile(r"cell_(voltage|temperature)\[\d+\]")
_JOINT = re.compile(r"name\[(\d+)\]")
_NUMBER = re.compile(r"std_msgs/msg/(?:U?Int|Float)\d+")


def column_names(topic: Topic, layout: Layout) -> dict[str, str]:
    """Name of a column -> path of its number in the messages of a topic.

    A topic of unknown type has all its numbers as `/topic/path`, or `/topic` where the path is `data`.
    """
    known = KNOWN.get(topic.type)
    if known is None:
        return {f"{topic.name}/{path}".removesuffix("/data"): path for path in layout.numbers if not _is_stamp(path)}
    if topic.type == TABLE_TYPE:
        return {path: path for path in layout.numbers if not _is_stamp(path)}
    if topic.type == JOINT_STATE:
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


_OPENERS = {
    mcap_file.MAGIC: mcap_file.open_mcap,
    rosbag1_file.MAGIC: rosbag1_file.open_rosbag1,
    sqlite_file.MAGIC: sqlite_file.open_sqlite,
}
#: First bytes of recordings.
MAGICS = tuple(_OPENERS)
METADATA = "metadata.yaml"


def is_recording(path: Path) -> bool:
    """True if a file begins as a recording does, or a folder holds one from `ros2 bag record`."""
    return bool(parts_of(path)) if path.is_dir() else _magic(path) is not None


def open_recording(path: Path) -> Recording:
    """The messages of a file, or of the files of a folder one after the other."""
    files = parts_of(path) if path.is_dir() else [path]
    parts = [_OPENERS[magic](file) for file in files if (magic := _magic(file))]
    if len(parts) == 1:
        return parts[0]

    def read(recording: Recording, names: Collection[str] | None) -> Iterator[Recorded]:
        for part in parts:
            for message in part.messages(names):
                recording.topics.setdefault(message.topic.name, message.topic)
                yield message
            recording.notes |= {f"{part.source}: {text}": note for text, note in part.notes.items()}

    return Recording(path.name, read)


def parts_of(folder: Path) -> list[Path]:
    """The files of a recording in a folder, as they were written, or none; InputError for one compressed as a whole."""
    try:
        files = sorted((path for path in folder.iterdir() if path.name.endswith(RECORDING_ENDINGS[:2])), key=in_order)
        packed = [
            path for path in folder.iterdir() if path.name.endswith(tuple(f"{end}.zstd" for end in RECORDING_ENDINGS))
        ]
        described = (folder / METADATA).exists()
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror}); check its permissions") from error
    if packed and described:
        raise InputError(f"{packed[0]} is compressed as a whole; unpack it first: zstd -d --rm {packed[0]}")
    whole = described or all(path.stem.startswith(folder.resolve().name) for path in files)
    return [path for path in files if _magic(path)] if whole else []


def _magic(path: Path) -> bytes | None:
    """The first bytes of a file that identify its format; None if none do, or for a database of something else."""
    with path.open("rb") as stream:
        head = stream.read(max(map(len, _OPENERS)))
    magic = next((magic for magic in _OPENERS if head.startswith(magic)), None)
    return None if magic == sqlite_file.MAGIC and not sqlite_file.is_bag(path) else magic


#: Messages decoded at a time.
MESSAGES_AT_ONCE = 8192
#: Stamps that differ from the times of receipt by more than this [s] come from a clock never set, or a simulation.
_STAMP_WITHIN_S = 86400.0

_SECONDS, _NANOSECONDS = (
    ("header.stamp.sec", "stamp.sec", "header.stamp.secs"),
    ("header.stamp.nanosec", "stamp.nanosec", "header.stamp.nsecs"),
)


class Gatherer:
    """Columns of one topic, from its messages in order.

    Attributes:
        broken: number of messages that could not be read.
    """

    def __init__(self, topic: Topic, names: Collection[str]):
        self.topic, self.names = topic, names
        self.definitions = definitions_of(topic)
        self.broken = 0
        self._received: list[int] = []
        self._payloads: list[bytes] = []
        self._blocks: list[tuple[np.ndarray, dict[str, np.ndarray]]] = []

    def put(self, received_ns: int, payload: bytes) -> None:
        """Take in a message."""
        self._received.append(received_ns)
        self._payloads.append(payload)
        if len(self._payloads) == MESSAGES_AT_ONCE:
            self._take_apart()

    def columns(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Times (n,) [ns] of the messages and their columns (n,), nan where a message lacks one.

        The time of a message is its stamp if that is of the recorder's clock, else the time of receipt.
        """
        if self._payloads:
            self._take_apart()
        names = dict.fromkeys(name for _, columns in self._blocks for name in columns)
        whole = {
            name: np.concatenate([columns.get(name, np.full(t.size, np.nan)) for t, columns in self._blocks])
            for name in names
        }
        times = [t for t, _ in self._blocks]
        return np.concatenate(times) if times else np.empty(0, np.int64), whole

    def _take_apart(self) -> None:
        received = np.array(self._received, dtype=np.int64)
        sizes = np.fromiter(map(len, self._payloads), np.int64, len(self._payloads))
        columns: dict[str, np.ndarray] = {}
        stamp_ns = np.zeros(received.size, dtype=np.int64)
        whole = np.zeros(received.size, dtype=bool)
        for size in np.unique(sizes):
            rows = np.flatnonzero(sizes == size)
            bytes_ = np.frombuffer(b"".join([self._payloads[k] for k in rows]), np.uint8).reshape(rows.size, size)
            for layout, alike in self._layouts(bytes_):
                at = rows[alike]
                whole[at] = True
                stamp_ns[at] = _stamps(layout, bytes_[alike])
                for name, path in column_names(self.topic, layout).items():
                    if name in self.names:
                        values = columns.setdefault(name, np.full(received.size, math.nan))
                        values[at] = _numbers(layout, path, bytes_[alike])
        is_of_this_clock = np.abs(stamp_ns - received) < _STAMP_WITHIN_S * 1e9
        time_ns = np.where(is_of_this_clock, stamp_ns, received)
        self.broken += int((~whole).sum())
        self._blocks.append((time_ns[whole], {name: values[whole] for name, values in columns.items()}))
        self._received, self._payloads = [], []

    def _layouts(self, bytes_: np.ndarray) -> Iterator[tuple[Layout, np.ndarray]]:
        """The layouts of messages (n, size) of one size, and the rows that have each."""
        left = np.arange(len(bytes_))
        while left.size:
            try:
                layout = layout_of(bytes_[left[0]].tobytes(), self.topic.type, self.definitions, self.topic.encoding)
            except ValueError:
                left = left[1:]
                continue
            alike = (bytes_[np.ix_(left, layout.marks)] == bytes_[left[0], layout.marks]).all(axis=1)
            yield layout, left[alike]
            left = left[~alike]


def _numbers(layout: Layout, path: str, bytes_: np.ndarray) -> np.ndarray:
    """One number of each message (n,)."""
    number = layout.numbers[path]
    dtype = np.dtype(number.dtype)
    cells = np.ascontiguousarray(bytes_[:, number.at : number.at + dtype.itemsize]).view(dtype)[:, 0]
    with np.errstate(invalid="ignore"):  # a float32 may have the bits of a signalling NaN
        return cells.astype(float)


def _stamps(layout: Layout, bytes_: np.ndarray) -> np.ndarray:
    """Time of each message (n,) [ns] by its own stamp; 0 where it has none."""
    fields = [next((name for name in names if name in layout.numbers), None) for names in (_SECONDS, _NANOSECONDS)]
    if None in fields:
        return np.zeros(len(bytes_), dtype=np.int64)
    seconds, nanoseconds = (_numbers(layout, str(name), bytes_).astype(np.int64) for name in fields)
    return seconds * 1_000_000_000 + nanoseconds


TIME = "time"
#: Earlier times are those of a simulation, or of a clock that counts from its own start.
_YEAR_2000_NS = 946_684_800 * 10**9


def open_bag(path: Path) -> TableFile:
    """The columns of a ROS recording, from all topics of known types; InputError where it holds no message."""
    recording = open_recording(path)
    first = recording.first_messages()
    if not first:
        raise InputError(f"{recording.source}: the recording holds no message; record it again, or name another one")
    # those in a known serialisation
    readable = {name: messages for name, messages in first.items() if messages[0].topic.encoding in (CDR, ROS1)}
    if not readable:
        listed = ", ".join(f"{name} ({messages[0].topic.encoding})" for name, messages in first.items())
        raise InputError(
            f"{recording.source}: no topic is in a serialisation of ROS (cdr, ros1); it has: {listed}; export the log "
            "as CSV or JSON with the program that wrote it"
        )
    types = {name: KNOWN.get(messages[0].topic.type) for name, messages in readable.items()}
    known = [name for name, type_ in types.items() if type_ and not type_.by_name_only]
    return _table_file(recording, path.name, readable, known)


def _table_file(
    recording: Recording,
    source: str,
    first: Mapping[str, list[Recorded]],
    chosen: list[str],
    notes: tuple[Note, ...] = (),
) -> TableFile:
    """The columns of some topics; first: the first messages of each that can be chosen; notes: about the choice."""
    topics = [first[name][0].topic for name in chosen]
    layouts = {name: _layouts(recording.source, first[name]) for name in chosen}
    of_topic = {t.name: _columns(t, layouts[t.name]) for t in topics}
    notes += tuple(note for topic in topics for note in _frame_notes(topic, layouts[topic.name][0]))
    known = dict.fromkeys([TIME, *(name for columns in of_topic.values() for name in columns)])

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        with_any = [topic for topic in topics if of_topic[topic.name].keys() & set(names)] or topics
        return _load(recording, source, with_any, names, notes)

    def part(kind: str, where: Mapping[str, float | str]) -> TableFile:
        types = {name: messages[0].topic.type for name, messages in first.items()}
        of_part = choose_topics(source, kind, where, types, KNOWN, _of_numbers(kind, types))
        return _table_file(recording, source, first, of_part, _unread(kind, types, of_part))

    battery = any(topic.type == "sensor_msgs/msg/BatteryState" for topic in topics)
    return TableFile(source, tuple(known), load, TIME, part, "charge" if battery else None)


def _of_numbers(kind: str, types: Mapping[str, str]) -> list[str]:
    """The topics of one number each, topic -> type, if their names are those of a battery's log or of wheels."""
    names = [name for name, type_ in types.items() if _NUMBER.fullmatch(type_)]
    return names if (has_log([TIME, *names]) if kind == BATTERY else wheel_places(names)) else []


def _unread(kind: str, types: Mapping[str, str], chosen: Collection[str]) -> tuple[Note, ...]:
    """A note on the topics that would be read for the "battery" or the "drive" if they were named; none without any.

    types: topic -> type.
    """
    by_name = {type_ for type_, known in KNOWN.items() if known.by_name_only and known.part == kind}
    unread = [f"{name} ({type_})" for name, type_ in types.items() if type_ in by_name and name not in chosen]
    text = f"not read: {', '.join(unread)}; add a forward speed that is not from the wheels with --topic NAME"
    return (Note(text),) if unread else ()


#: Frames that do not move with a robot: of REP-105, and those of MAVROS.
_FIXED_FRAMES = ("map", "odom", "earth", "world", "enu", "ned")


def _frame_notes(topic: Topic, layout: Layout) -> Iterator[Note]:
    """A warning for a velocity whose frame does not turn with the robot."""
    frame = layout.texts.get("child_frame_id", layout.texts.get("header.frame_id", ""))
    if topic.type in KNOWN and KNOWN[topic.type].by_name_only and frame.rpartition("/")[2] in _FIXED_FRAMES:
        yield Note(
            f"topic {topic.name}: its velocity is said to be in {frame!r}, a frame that does not turn with the robot; "
            "if so, its x is no forward speed: leave the topic out, or publish it in base_link",
            "warning",
        )


def _columns(topic: Topic, layouts: Collection[Layout]) -> dict[str, None]:
    """The names of the columns of a topic, in order."""
    return dict.fromkeys(name for layout in layouts for name in column_names(topic, layout))


def _layouts(source: str, messages: Collection[Recorded]) -> list[Layout]:
    """The layouts of the first messages of a topic."""
    layouts = []
    for topic, _, payload in messages:
        try:
            layouts.append(layout_of(payload, topic.type, definitions_of(topic), topic.encoding))
        except ValueError as error:
            raise InputError(
                f"{source}: topic {topic.name} cannot be read as {topic.type} ({error}); choose another topic"
            ) from error
    return layouts


def _load(
    recording: Recording, source: str, topics: list[Topic], wanted: Collection[str], about: tuple[Note, ...]
) -> Table:
    """The columns of some topics, a row for each message, in order of time if there are several topics.

    about: notes about their choice.
    """
    gatherers = {topic.name: Gatherer(topic, wanted) for topic in topics}
    puts = {name: gatherer.put for name, gatherer in gatherers.items()}
    for topic, received_ns, payload in recording.messages(gatherers):
        puts[topic.name](received_ns, payload)
    found = {name: gatherer.columns() for name, gatherer in gatherers.items()}
    first_ns = next((times[0] for times, _ in found.values() if times.size), None)
    if first_ns is None:
        raise InputError(f"{source}: no message of {', '.join(gatherers)} could be read; record it again")
    kind = "M8[ns]" if first_ns > _YEAR_2000_NS else "m8[ns]"
    streams = {
        name: Stream(gatherers[name].topic.type, times.view(kind), columns) for name, (times, columns) in found.items()
    }
    read = ", ".join(f"{topic.name} ({topic.type})" for topic in topics)
    notes = [Note(f"topic {read}" if len(topics) == 1 else f"topics {read}"), *about, *recording.notes.values()]
    if broken := sum(gatherer.broken for gatherer in gatherers.values()):
        notes.append(Note(f"{counted(broken, 'message')} could not be read: left out", "warning"))
    return rows_of(source, TIME, streams, wanted, tuple(notes))
