"""Bags of ROS 1, read from the front and without their index, so that a truncated or unclosed one can be read.

Format: wiki.ros.org/Bags/Format/2.0; a record is a header of `name=value` fields and data, each after its length.
"""

from __future__ import annotations

import bz2
import mmap
import struct
from collections.abc import Collection, Iterator
from pathlib import Path

from ohmward.logs.bags.recording import ROS1, Recorded, Recording, Topic, full_type
from ohmward.optional import require

MAGIC = b"#ROSBAG V2.0\n"

# Kinds of records.
_MESSAGE, _CHUNK, _CONNECTION = b"\x02", b"\x05", b"\x07"
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")
#: The header of a bag is padded to 4096 bytes.
_LARGEST_HEADER = 8192


#: Header and data of a record of a bag.
_Record = tuple[dict[bytes, bytes], memoryview]


def open_rosbag1(path: Path) -> Recording:
    """The messages of a bag of ROS 1."""

    def read(recording: Recording, names: Collection[str] | None) -> Iterator[Recorded]:
        connections: dict[bytes, Topic] = {}
        with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as whole:
            view = memoryview(whole)
            try:
                for record in _records(view[len(MAGIC) :], recording):
                    block = _unpacked(*record, recording) if record[0].get(b"op") == _CHUNK else None
                    inner = [record] if block is None else _records(block, recording)
                    yield from _messages(inner, recording, connections, names)
            finally:
                record = block = inner = None  # type: ignore[assignment] # they keep the file mapped
                view.release()

    topics = _index(path)
    return Recording(path.name, read, topics, all_known=bool(topics))


def _index(path: Path) -> dict[str, Topic]:
    """The topics in the index at the end of a bag; none if it was never closed."""
    found = Recording(path.name, lambda *_: iter(()))
    with path.open("rb") as stream:
        first = next(_records(memoryview(stream.read(_LARGEST_HEADER))[len(MAGIC) :], found), None)
        begin = int.from_bytes(first[0].get(b"index_pos", b""), "little") if first else 0
        if not len(MAGIC) < begin < path.stat().st_size:
            return {}
        stream.seek(begin)
        for _ in _messages(_records(memoryview(stream.read()), found), found, {}, ()):
            pass
    return {} if found.notes else found.topics


def _records(view: memoryview, recording: Recording) -> Iterator[_Record]:
    """The complete records from the front of a file or a chunk."""
    at, end = 0, len(view)
    while at + 4 <= end:
        (size,) = _LENGTH.unpack_from(view, at)
        begin = at + 4 + size
        if begin + 4 > end:
            break
        (length,) = _LENGTH.unpack_from(view, begin)
        if length > end - begin - 4:
            break
        yield _header(bytes(view[at + 4 : begin])), view[begin + 4 : begin + 4 + length]
        at = begin + 4 + length
    if at < end:
        recording.warn("the file is cut off, as by a loss of power: everything before the cut was read")


def _header(text: bytes) -> dict[bytes, bytes]:
    """The fields of a header."""
    fields, at = {}, 0
    while at + 4 <= len(text):
        (length,) = _LENGTH.unpack_from(text, at)
        name, _, value = text[at + 4 : at + 4 + length].partition(b"=")
        fields[name] = value
        at += 4 + length
    return fields


def _unpacked(header: dict[bytes, bytes], data: memoryview, recording: Recording) -> memoryview:
    """The records in a chunk; nothing if it is damaged."""
    compression = header.get(b"compression", b"none")
    try:
        if compression == b"bz2":
            return memoryview(bz2.decompress(data))
        if compression == b"lz4":
            return memoryview(require("lz4.frame", "a compressed bag").decompress(data))
    except (OSError, ValueError, RuntimeError):
        recording.warn("a damaged chunk was left out")
        return memoryview(b"")
    return data


def _messages(
    records: Iterator[_Record] | list[_Record],
    recording: Recording,
    connections: dict[bytes, Topic],
    names: Collection[str] | None,
) -> Iterator[Recorded]:
    """The messages among records."""
    for header, data in records:
        kind, number = header.get(b"op"), header.get(b"conn", b"")
        if kind == _CONNECTION:
            about = _header(bytes(data))
            name = header.get(b"topic", b"").decode(errors="replace")
            type_ = full_type(about.get(b"type", b"").decode(errors="replace"))
            definition = about.get(b"message_definition", b"").decode(errors="replace")
            connections[number] = recording.topics[name] = Topic(name, type_, ROS1, definition)
        elif kind == _MESSAGE and number in connections and len(header.get(b"time", b"")) == _TIME.size:
            topic = connections[number]
            if names is None or topic.name in names:
                seconds, nanoseconds = _TIME.unpack(header[b"time"])
                yield Recorded(topic, seconds * 1_000_000_000 + nanoseconds, bytes(data))
