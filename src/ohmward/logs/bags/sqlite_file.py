"""Files of rosbag2 in SQLite; of one that is damaged or cut off everything before the damage is read."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from pathlib import Path
from urllib.parse import quote

from ohmward.errors import InputError
from ohmward.logs.bags.recording import Recorded, Recording, Topic, full_type

MAGIC = b"SQLite format 3\x00"

_CUT = "the file is damaged or cut off, as by a loss of power: everything before that was read"


def open_sqlite(path: Path) -> Recording:
    """The messages of a file of rosbag2.

    Raises:
        InputError: a database of something else.
    """
    with closing(connect(path)) as database:
        topics = _topics(path, database)

    def read(recording: Recording, names: Collection[str] | None) -> Iterator[Recorded]:
        with closing(connect(path)) as database:
            wanted = {key: topic for key, topic in topics.items() if names is None or topic.name in names}
            try:
                for key, received_ns, payload in database.execute("SELECT topic_id, timestamp, data FROM messages"):
                    if key in wanted and isinstance(payload, bytes) and isinstance(received_ns, int):
                        yield Recorded(wanted[key], received_ns, payload)
            except sqlite3.DatabaseError:
                recording.warn(_CUT)

    return Recording(path.name, read, {topic.name: topic for topic in topics.values()}, all_known=True)


def is_bag(path: Path) -> bool:
    """True for the database of a recording, and for one whose tables cannot be read."""
    try:
        with closing(connect(path)) as database:
            names = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    except sqlite3.DatabaseError:
        return True
    return {"topics", "messages"} <= names or not names


def connect(path: Path) -> sqlite3.Connection:
    """The database, which is not written to: a log of changes beside it is read where there is one."""
    mode = "mode=ro" if path.with_name(path.name + "-wal").exists() else "immutable=1"
    database = sqlite3.connect(f"file:{quote(str(path.resolve()))}?{mode}", uri=True)
    database.text_factory = lambda text: text.decode(errors="replace")
    with suppress(sqlite3.DatabaseError):
        database.execute("PRAGMA writable_schema = ON")  # without it a file shorter than it says is refused as a whole
    return database


def _topics(path: Path, database: sqlite3.Connection) -> dict[int, Topic]:
    """The topics by their keys, with definitions where the recorder has written them."""
    try:
        rows = list(database.execute("SELECT id, name, type, serialization_format FROM topics"))
    except sqlite3.DatabaseError as error:
        raise InputError(
            f"{path}: no bag of ROS 2 ({error}); name a .db3 or .mcap file of `ros2 bag record`, or its folder"
        ) from error
    try:
        found = database.execute("SELECT topic_type, encoded_message_definition FROM message_definitions")
        definitions = {full_type(type_): text for type_, text in found if isinstance(type_, str)}
    except sqlite3.DatabaseError:  # written by Humble or before
        definitions = {}
    return {
        key: Topic(name, full_type(type_), form, str(definitions.get(full_type(type_)) or ""))
        for key, name, type_, form in rows
        if all(isinstance(text, str) for text in (name, type_, form))
    }
