"""Frames of a serial line, as `NAME_frame.c` of an exported library writes them.

frame = COBS(number, sequence, time, values, crc), 0

COBS (Cheshire and Baker 1999) leaves no zero inside a frame: after any fault a complete frame starts at the next zero.
The CRC-32 of IEEE 802.3 lets 1 in 4e9 of random faults through, a 16-bit one would let 1 in 65 thousand.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

#: Before and after the values of a frame: number, sequence, time [us]; CRC.
_HEAD, _CRC = struct.Struct("<BBI"), struct.Struct("<I")

#: Most values of a frame.
MOST_VALUES = 250
_LONGEST = _HEAD.size + 4 * MOST_VALUES + _CRC.size + 8


class SerialFrame(NamedTuple):
    """A complete frame."""

    number: int  #: of the message
    sequence: int  #: counted by the sender for each number, modulo 256
    time_us: int  #: the sender's timer, modulo 2^32
    values: tuple[float, ...]  #: in the order that the setup names


def encode(frame: SerialFrame) -> bytes:
    """The bytes of a frame, the zero at its end included."""
    body = _HEAD.pack(frame.number, frame.sequence, frame.time_us) + struct.pack(
        f"<{len(frame.values)}f", *frame.values
    )
    return _stuffed(body + _CRC.pack(zlib.crc32(body))) + b"\0"


def decode(stuffed: bytes) -> SerialFrame | None:
    """The frame between two zeros; None if its length or CRC is wrong."""
    body = _unstuffed(stuffed)
    count, rest = divmod(len(body) - _HEAD.size - _CRC.size, 4)
    if count < 0 or rest or zlib.crc32(body[: -_CRC.size]) != _CRC.unpack(body[-_CRC.size :])[0]:
        return None
    number, sequence, time_us = _HEAD.unpack_from(body)
    return SerialFrame(number, sequence, time_us, struct.unpack_from(f"<{count}f", body, _HEAD.size))


class FrameReader:
    """Frames from bytes as they come, in pieces of any size.

    Attributes:
        faulty: number of frames with a wrong length or CRC.
        lost: number of frames missing from the sequence.
    """

    def __init__(self) -> None:
        self.faulty = self.lost = 0
        self._rest = b""
        self._first = True
        self._sequences: dict[int, int] = {}

    def feed(self, data: bytes) -> list[SerialFrame]:
        """Frames completed by these bytes."""
        *pieces, rest = (self._rest + data).split(b"\0")
        self._rest = rest if len(rest) <= _LONGEST else rest[:_LONGEST] + b"\xff"  # too long stays too long
        frames = []
        for piece in filter(None, pieces):
            frame = decode(piece) if len(piece) <= _LONGEST else None
            if frame:
                self._count(frame)
                frames.append(frame)
            else:
                self.faulty += not self._first  # the first piece may have begun before we listened
            self._first = False
        return frames

    def _count(self, frame: SerialFrame) -> None:
        if (before := self._sequences.get(frame.number)) is not None:
            self.lost += (frame.sequence - before - 1) % 256
        self._sequences[frame.number] = frame.sequence


class FrameClock:
    """Time [s] from a timer that overflows every 71.6 minutes."""

    def __init__(self) -> None:
        self._before_us: int | None = None
        self._sum_us = 0

    def stamp_s(self, time_us: int) -> float:
        """Time of a frame since the first one."""
        if self._before_us is not None:
            self._sum_us += (time_us - self._before_us) % 2**32
        self._before_us = time_us
        return 1e-6 * self._sum_us


def _stuffed(body: bytes) -> bytes:
    """The bytes in COBS: zeros become distances."""
    out = bytearray()
    for block in body.split(b"\0"):
        while len(block) >= 254:
            out += b"\xff" + block[:254]
            block = block[254:]
        out += bytes([len(block) + 1]) + block
    return bytes(out)


def _unstuffed(stuffed: bytes) -> bytes:
    """The bytes decoded from COBS; empty if a distance is 0 or leads beyond the end."""
    out, at = bytearray(), 0
    while at < len(stuffed):
        distance = stuffed[at]
        if not distance or at + distance > len(stuffed):
            return b""
        out += stuffed[at + 1 : at + distance]
        at += distance
        if distance < 255 and at < len(stuffed):
            out.append(0)
    return bytes(out)
