"""Topics and messages of a recording of ROS, whatever the format of its files, and the layout of the messages.

A layout is the fields of a message by its definition, and the places of its numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.table import Note
from ohmward.optional import require

JOINT_STATE = "sensor_msgs/msg/JointState"
#: Several nodes may publish on a topic of joints, each the joints that it drives: so many messages are looked at.
OF_JOINTS = 100
#: Serialisations of messages, by the names that MCAP and rosbag2 give them: that of ROS 2 and that of ROS 1.
CDR, ROS1 = "cdr", "ros1"


class Topic(NamedTuple):
    """A topic of a recording."""

    name: str  #: `/battery_state`
    type: str  #: `sensor_msgs/msg/BatteryState`, of ROS 1 as well
    encoding: str  #: of the messages, `cdr` or `ros1`; another one cannot be read
    definition: str = ""  #: text of the message's definition and of those that it uses, "" where the recording has none


class Recorded(NamedTuple):
    """A message as it was recorded: its topic, the time of its receipt [ns since 1970] and its bytes."""

    topic: Topic
    received_ns: int
    payload: bytes


@dataclass
class Recording:
    """Messages of a file or of several."""

    source: str  #: name for messages
    #: yields the messages of these topics, of all where None, in the order of the file, and adds to `notes`
    read: Callable[[Recording, Collection[str] | None], Iterator[Recorded]]
    #: topics by name; before the recording is read those in its index
    topics: dict[str, Topic] = field(default_factory=dict)
    notes: dict[str, Note] = field(default_factory=dict)  #: what could not be read
    all_known: bool = False  #: `topics` has every topic before any message is read

    def messages(self, names: Collection[str] | None = None) -> Iterator[Recorded]:
        """The messages of the topics of these names, in the order of the file."""
        return self.read(self, names)

    def first_messages(self) -> dict[str, list[Recorded]]:
        """The first message of each topic that has one, of joints the first `OF_JOINTS`, by the name of the topic."""
        first: dict[str, list[Recorded]] = {}
        incomplete = set(self.topics)
        for message in self.messages():
            of_topic = first.setdefault(message.topic.name, [])
            wanted = OF_JOINTS if message.topic.type == JOINT_STATE else 1
            if len(of_topic) < wanted:
                of_topic.append(message)
            if len(of_topic) == wanted:
                incomplete.discard(message.topic.name)
            if self.all_known and not incomplete:
                break
        return first

    def warn(self, text: str) -> None:
        """Add a warning once."""
        self.notes[text] = Note(text, "warning")


def full_type(name: str) -> str:
    """The type's name as ROS 2 writes it: `sensor_msgs/BatteryState` is `sensor_msgs/msg/BatteryState`."""
    return name if name.count("/") != 1 else name.replace("/", "/msg/")


class Single(NamedTuple):
    """A number, text or message: `float64`, `string`, `std_msgs/msg/Header`."""

    type: str


class Several(NamedTuple):
    """An array of fixed `size`, or if that is None a sequence preceded by its length."""

    item: Single
    size: int | None


#: Name and content of each field of a message, in order.
Fields = Sequence[tuple[str, Single | Several]]
#: Fields of each type.
Definitions = dict[str, Fields]


@lru_cache(maxsize=64)
def definitions_of(topic: Topic) -> Definitions:
    """The type of a topic and all types that it uses; InputError where neither the recording nor ROS defines it."""
    typesys = require("rosbags.typesys", "a recording of ROS")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if topic.encoding == ROS1 else typesys.Stores.LATEST)
    known = dict(store.fielddefs)
    if topic.definition:
        try:
            known |= typesys.get_types_from_msg(topic.definition, topic.type)
        except Exception as error:  # its parser raises many kinds
            raise InputError(f"topic {topic.name}: the definition of {topic.type} cannot be read ({error})") from error
    if topic.type not in known:
        raise InputError(
            f"topic {topic.name}: neither the recording nor ROS defines {topic.type!r}; record it as MCAP, which "
            "carries definitions"
        )
    return {type_: [(name, _content(found)) for name, found in fields] for type_, (_, fields) in known.items()}


def _content(found: Any) -> Single | Several:
    """A field as the package rosbags describes it: kind and detail."""
    kind, detail = found
    if kind.name in ("ARRAY", "SEQUENCE"):
        item, count = detail
        inner = _content(item)
        assert isinstance(inner, Single)
        return Several(inner, count if kind.name == "ARRAY" else None)
    return Single(detail[0] if kind.name == "BASE" else detail)


#: Types of numbers and their notation in NumPy, without the byte order.
_NUMBERS = {
    **{"bool": "u1", "byte": "u1", "octet": "u1", "char": "u1", "uint8": "u1", "int8": "i1"},
    **{"int16": "i2", "int32": "i4", "int64": "i8", "uint16": "u2", "uint32": "u4", "uint64": "u8"},
    **{"float32": "f4", "float64": "f8"},
}
#: Arrays of more elements are images and scans, not quantities: their numbers are skipped.
MOST_ELEMENTS = 64
#: Deepest nesting of messages.
_DEEPEST = 32


class Number(NamedTuple):
    """A number in a message: its NumPy type with byte order, and its place [bytes]."""

    dtype: str
    at: int


class Layout(NamedTuple):
    """Places in messages that are laid out alike."""

    numbers: dict[str, Number]  #: by their paths, `header.stamp.sec`, `cell_voltage[0]`
    texts: dict[str, str]  #: by their paths
    marks: np.ndarray  #: (K,) places of the bytes that are the same in all such messages: lengths, and names in arrays


def layout_of(payload: bytes, type_: str, definitions: Definitions, encoding: str) -> Layout:
    """The layout of a message; ValueError where it is shorter than its fields, or not in a known form."""
    walk = _Walk(payload, definitions, encoding)
    walk.message(type_, "")
    return Layout(walk.numbers, walk.texts, np.array(walk.marks, dtype=np.intp))


class _Walk:
    """A walk through the fields of a message."""

    def __init__(self, payload: bytes, definitions: Definitions, encoding: str):
        self.payload, self.definitions = payload, definitions
        self.aligned = encoding == CDR
        if self.aligned and (len(payload) < 4 or payload[:2] not in (b"\x00\x00", b"\x00\x01")):
            raise ValueError("not plain CDR")
        self.order = ">" if self.aligned and payload[1] == 0 else "<"
        self.origin = self.at = 4 if self.aligned else 0
        self.numbers: dict[str, Number] = {}
        self.texts: dict[str, str] = {}
        self.marks: list[int] = [1] if self.aligned else []
        self.depth = 0

    def message(self, type_: str, path: str) -> None:
        """All fields of a message."""
        if type_ not in self.definitions or self.depth == _DEEPEST:
            raise ValueError(f"no definition of {type_}")
        self.depth += 1
        for name, content in self.definitions[type_]:
            inner = f"{path}.{name}" if path else name
            if isinstance(content, Single):
                self.single(content, inner)
            else:
                self.several(content, inner)
        self.depth -= 1

    def single(self, content: Single, path: str, in_array: bool = False) -> None:
        """A number, a text or a message."""
        if content.type in _NUMBERS:
            size = int(_NUMBERS[content.type][1])
            self.align(size)
            self.numbers[path] = Number(self.order + _NUMBERS[content.type], self.at)
            self.skip(size)
        elif content.type in ("string", "wstring"):
            self.text(path, in_array, 2 if content.type == "wstring" else 1)
        else:
            self.message(content.type, path)

    def several(self, content: Several, path: str) -> None:
        """An array, preceded by its length unless that is fixed."""
        count = self.length() if content.size is None else content.size
        if content.item.type in _NUMBERS and count > MOST_ELEMENTS:
            size = int(_NUMBERS[content.item.type][1])
            self.align(size)
            self.skip(count * size)
            return
        if count > len(self.payload) - self.at:
            raise ValueError("array longer than its message")
        for k in range(count):
            self.single(content.item, f"{path}[{k}]", in_array=True)

    def text(self, path: str, in_array: bool, width: int) -> None:
        """A text, in ROS 2 with a zero at its end; in arrays texts are names, which tell layouts apart."""
        length = width * self.length()
        begin = self.at
        self.skip(length)
        self.texts[path] = self.payload[begin : self.at].decode("utf-8", "replace").rstrip("\x00")
        if in_array:
            self.marks += range(begin, self.at)

    def length(self) -> int:
        """The length of an array or a text."""
        self.align(4)
        self.skip(4)
        self.marks += range(self.at - 4, self.at)
        return int.from_bytes(self.payload[self.at - 4 : self.at], "big" if self.order == ">" else "little")

    def align(self, size: int) -> None:
        """Go to the next aligned place for a number of this size [bytes]; ROS 1 does not align numbers."""
        if self.aligned:
            self.at += -(self.at - self.origin) % size

    def skip(self, size: int) -> None:
        """Go on by this size [bytes]."""
        self.at += size
        if self.at > len(self.payload):
            raise ValueError("message shorter than its fields")
