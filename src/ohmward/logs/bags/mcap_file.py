"""MCAP files, read from the front, so that a truncated one gives everything before the cut.

Format: mcap.dev/spec; a record is its kind (1 byte), its length (8 bytes) and its content, little-endian throughout.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from zlib import crc32

from ohmward.logs.bags.recording import Recorded, Recording, Topic, full_type
from ohmward.optional import require

MAGIC = b"\x89MCAP0\r\n"

# Kinds of records.
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_RECORD = struct.Struct("<BQ")
_SCHEMA_HEAD, _CHANNEL_HEAD = struct.Struct("<H"), struct.Struct("<HH")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_TAIL = struct.Struct("<BQQQI8s")
_CHUNK_HEAD = struct.Struct("<QQQI")
#: No recorder makes larger chunks [bytes]; a damaged one may claim any size.
_LARGEST_CHUNK = 1 << 30


class _Channels:
    """Schemas and channels as far as they were read."""

    def __init__(self) -> None:
        self.schemas: dict[int, tuple[str, str]] = {}
        self.topics: dict[int, Topic] = {}

    def add(self, kind: int, content: memoryview) -> None:
        """Take in a record of a schema or a channel."""
        if kind == _SCHEMA:
            (number,) = _SCHEMA_HEAD.unpack_from(content)
            (name, notation, definition), _ = _texts(content, _SCHEMA_HEAD.size, 3)
            self.schemas[number] = full_type(name), definition if notation in ("ros2msg", "ros1msg") else ""
            return
        number, schema = _CHANNEL_HEAD.unpack_from(content)
        (name, encoding), _ = _texts(content, _CHANNEL_HEAD.size, 2)
        type_, definition = self.schemas.get(schema, ("", ""))
        self.topics[number] = Topic(name, type_, encoding, definition)


def open_mcap(path: Path) -> Recording:
    """The messages of an MCAP file."""

    def read(recording: Recording, names: Collection[str] | None) -> Iterator[Recorded]:
        channels = _Channels()
        for block in _blocks(path, recording):
            yield from _messages(block, recording, channels, names)

    topics = _summary(path)
    return Recording(path.name, read, topics, all_known=bool(topics))


def _summary(path: Path) -> dict[str, Topic]:
    """The topics in the summary at the end of a file; none if it was cut off."""
    with path.open("rb") as stream:
        stream.seek(max(path.stat().st_size - _TAIL.size, 0))
        tail = stream.read()
        if len(tail) < _TAIL.size or not tail.endswith(MAGIC):
            return {}
        kind, _, begin, _, _, _ = _TAIL.unpack(tail)
        end = path.stat().st_size - _TAIL.size
        if kind != _FOOTER or not 0 < begin < end:
            return {}
        stream.seek(begin)
        found = Recording(path.name, lambda *_: iter(()))
        for _ in _messages(memoryview(stream.read(end - begin)), found, _Channels(), ()):
            pass
    return found.topics


def _blocks(path: Path, recording: Recording) -> Iterator[memoryview]:
    """Runs of records with messages: contents of the chunks, and single messages outside of them."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        stream.seek(len(MAGIC))
        while True:
            head = stream.read(_RECORD.size)
            if len(head) < _RECORD.size:
                break
            kind, length = _RECORD.unpack(head)
            if kind in (_FOOTER, _DATA_END):
                return
            if length > size - stream.tell():
                break
            if kind == _CHUNK:
                if (block := _unpacked(memoryview(stream.read(length)), recording)) is not None:
                    yield block
            elif kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                yield memoryview(head + stream.read(length))
            else:
                stream.seek(length, 1)
    recording.warn("the file is cut off, as by a loss of power: everything before the cut was read")


def _unpacked(chunk: memoryview, recording: Recording) -> memoryview | None:
    """The records in a chunk; None where it is damaged."""
    try:
        _, _, size, checksum = _CHUNK_HEAD.unpack_from(chunk)
        (compression,), at = _texts(chunk, _CHUNK_HEAD.size, 1)
        block = _decompressed(compression, chunk[at + 8 :], size)
        if len(block) != size or (checksum and crc32(block) != checksum):
            raise ValueError
    except (struct.error, ValueError, RuntimeError):
        recording.warn("a damaged chunk was left out")
        return None
    return block


def _decompressed(compression: str, packed: memoryview, size: int) -> memoryview:
    """The content of a chunk; ValueError or RuntimeError if it is damaged, or claims an implausible size."""
    if compression == "":
        return packed
    if compression == "lz4" and 0 < size <= _LARGEST_CHUNK:
        return memoryview(require("lz4.frame", "a compressed MCAP file").decompress(packed))
    if compression == "zstd" and 0 < size <= _LARGEST_CHUNK:
        zstandard = require("zstandard", "a compressed MCAP file")
        try:
            with zstandard.ZstdDecompressor().stream_reader(packed) as reader:
                return memoryview(reader.read(size))
        except zstandard.ZstdError as error:
            raise ValueError from error
    raise ValueError


def _messages(
    block: memoryview, recording: Recording, channels: _Channels, names: Collection[str] | None
) -> Iterator[Recorded]:
    """The messages of a run of records."""
    at, end = 0, len(block)
    wanted: dict[int, Topic | None] = {}
    while at + _RECORD.size <= end:
        kind, length = _RECORD.unpack_from(block, at)
        at += _RECORD.size
        if length > end - at:
            break
        if kind == _MESSAGE and length >= _MESSAGE_HEAD.size:
            channel, _, received_ns, _ = _MESSAGE_HEAD.unpack_from(block, at)
            if channel not in wanted:
                topic = channels.topics.get(channel)
                wanted[channel] = topic if topic and (names is None or topic.name in names) else None
            if topic := wanted[channel]:
                yield Recorded(topic, received_ns, bytes(block[at + _MESSAGE_HEAD.size : at + length]))
        elif kind in (_SCHEMA, _CHANNEL):
            try:
                channels.add(kind, block[at : at + length])
            except (struct.error, UnicodeDecodeError):
                recording.warn("the description of a topic is damaged: it was left out")
            recording.topics |= {topic.name: topic for topic in channels.topics.values()}
            wanted.clear()
        at += length


def _texts(content: memoryview, at: int, count: int) -> tuple[list[str], int]:
    """Consecutive texts, each stored as a length and that many bytes, and the place after them."""
    texts = []
    for _ in range(count):
        (length,) = struct.unpack_from("<I", content, at)
        if length > len(content) - at - 4:
            raise struct.error("text longer than its record")
        texts.append(str(content[at + 4 : at + 4 + length], "utf-8"))
        at += 4 + length
    return texts, at
