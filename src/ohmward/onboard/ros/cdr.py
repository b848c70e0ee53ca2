"""Serialisation of messages as plain CDR, little-endian, as ROS 2 sends them (OMG DDS-XTypes 1.3, 7.4.1)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

from ohmward.logs.bags.recording import CDR, Layout, Several, Single, layout_of
from ohmward.onboard.ros.types import DEFINITIONS

_ENCAPSULATION = b"\x00\x01\x00\x00"
_FORMATS = {"bool": "?", "byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "float32": "f", "float64": "d"}


def serialize(type_: str, message: Mapping[str, Any]) -> bytes:
    """The message as bytes.

    message: field -> number, text, sequence or nested message, every field.
    """
    out = bytearray(_ENCAPSULATION)
    _message(out, type_, message)
    return bytes(out)


def read(type_: str, payload: bytes) -> tuple[Layout, dict[str, float]]:
    """Layout and numbers by their paths, `header.stamp.sec`, `velocity[1]`, of a message.

    Raises:
        ValueError: no such message.
    """
    layout = layout_of(payload, type_, DEFINITIONS, CDR)
    numbers = {
        path: float(struct.unpack_from(_struct(number.dtype), payload, number.at)[0])
        for path, number in layout.numbers.items()
    }
    return layout, numbers


def _struct(dtype: str) -> str:
    """The format of a number for `struct` from that of NumPy."""
    letters = {"u1": "B", "i1": "b", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q"}
    return dtype[0] + (letters | {"f4": "f", "f8": "d"})[dtype[1:]]


def _message(out: bytearray, type_: str, message: Mapping[str, Any]) -> None:
    for name, content in DEFINITIONS[type_]:
        if isinstance(content, Single):
            _single(out, content.type, message[name])
        else:
            _several(out, content, message[name])


def _several(out: bytearray, content: Several, values: Any) -> None:
    if content.size is None:
        _numbers(out, "I", (len(values),))
    elif len(values) != content.size:
        raise ValueError(f"{content.size} values needed, got {len(values)}")
    if content.item.type in _FORMATS:
        _numbers(out, _FORMATS[content.item.type], values)
        return
    for value in values:
        _single(out, content.item.type, value)


def _single(out: bytearray, type_: str, value: Any) -> None:
    if type_ == "string":
        text = value.encode() + b"\x00"
        _numbers(out, "I", (len(text),))
        out += text
    elif type_ in _FORMATS:
        _numbers(out, _FORMATS[type_], (value,))
    else:
        _message(out, type_, value)


def _numbers(out: bytearray, format_: str, values: Sequence[Any]) -> None:
    """Append numbers from the next place on that is a multiple of their size."""
    if len(values):
        out += bytes(-(len(out) - len(_ENCAPSULATION)) % struct.calcsize(format_))
        out += struct.pack(f"<{len(values)}{format_}", *values)
