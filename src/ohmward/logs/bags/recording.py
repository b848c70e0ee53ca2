"""Topics and messages of a recording, whatever the format of its files."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from ohmward.logs.table import Note

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
    #: all topics by name; None before the recording was looked through
    topics: dict[str, Topic] = field(default_factory=dict)
    notes: dict[str, Note] = field(default_factory=dict)  #: what could not be read
    all_known: bool = False  #: `topics` has every topic before any message is read

    def messages(self, names: Collection[str] | None = None) -> Iterator[Recorded]:
        """The messages of the topics of these names, in the order of the file."""
        return self.read(self, names)

    def first_messages(self) -> dict[str, Recorded]:
        """The first message of each topic that has one, by the name of the topic."""
        first: dict[str, Recorded] = {}
        for message in self.messages():
            first.setdefault(message.topic.name, message)
            if self.all_known and len(first) == len(self.topics):
                break
        return first

    def warn(self, text: str) -> None:
        """Add a warning once."""
        self.notes[text] = Note(text, "warning")


def full_type(name: str) -> str:
    """The type's name as ROS 2 writes it: `sensor_msgs/BatteryState` is `sensor_msgs/msg/BatteryState`."""
    return name if name.count("/") != 1 else name.replace("/", "/msg/")
