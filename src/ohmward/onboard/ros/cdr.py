"""Serialisation of messages as plain CDR, little-endian, as ROS 2 sends them (OMG DDS-XTypes 1.3, 7.4.1)."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from ohmward.logs.bags.recording import CDR, Layout, Several, Single, layout_of
from ohmward.onboard.ros.types import DEFINITIONS

_ENCAPSULATION = b"\x00\x01\x00\x00"
#: Formats of numbers for `struct` by those of NumPy.
_LETTERS = dict(zip(("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"), "BbHhIiQqfd", strict=True))
_FORMATS = {"bool": "?", "byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "float32": "f", "float64": "d"}


def serialize(type_: str, message: Mapping[str, Any]) -> bytes:
    """The message as bytes.

    message: field -> number, text, sequence or nested message, every field.
    """
    out = bytearray(_ENCAPSULATION)
    _message(out, type_, message)
    return bytes(out)


def read(type_: str, payload: bytes) -> tuple[Layout, dict[str, float]]:
    """Layout of a message, and its numbers by their paths, such as `header.stamp.sec` or `velocity[1]`.

    Messages with the same layout share that of the first one, with its texts outside arrays, such as the frame.

    Raises:
        ValueError: the bytes are no such message.
    """
    key = type_, len(payload)
    form = _FORMS.get(key)
    if form is None or form.marked(payload) != form.marks:
        if len(_FORMS) >= _MOST_FORMS:
            _FORMS.clear()
        form = _FORMS[key] = _form(type_, payload)
    return form.layout, dict(zip(form.layout.numbers, map(float, form.numbers.unpack_from(payload)), strict=True))


def read_path(payload: bytes) -> dict[str, float]:
    """Stamp of a `nav_msgs/Path`, and its `length_m`, nan for one without poses.

    Planners send thousands of poses of another number each time, for which `read` would need a tenth of a second.

    Raises:
        ValueError: the bytes are no such message.
    """
    order, at = "<" if payload[1:2] == b"\x01" else ">", len(_ENCAPSULATION)
    base, places = at, []

    def take(format_: str) -> tuple[Any, ...]:
        nonlocal at
        at += -(at - base) % struct.calcsize(format_[-1])
        values = struct.unpack_from(order + format_, payload, at)
        at += struct.calcsize(order + format_)
        return values

    def skip_text() -> None:
        nonlocal at
        (length,) = take("I")
        at += length

    try:
        sec, nanosec = take("2I")
        skip_text()
        (count,) = take("I")
        for _ in range(count):
            take("2I")
            skip_text()
            places.append(take("7d")[:3])
    except struct.error as error:
        raise ValueError(f"no path: {error}") from error
    steps_m = np.linalg.norm(np.diff(np.array(places).reshape(-1, 3), axis=0), axis=1)
    length_m = float(steps_m.sum()) if places else math.nan
    return {"header.stamp.sec": float(sec), "header.stamp.nanosec": float(nanosec), "length_m": length_m}


class _Form(NamedTuple):
    """Common form of messages with the same type, length and layout."""

    layout: Layout
    marked: Callable[[bytes], Any]  #: extracts the bytes of a message that are equal in all of them
    marks: Any  #: those bytes
    numbers: struct.Struct  #: extracts the numbers, in the order of the layout


#: Forms by type and length, as drivers repeat a few; bounded, so that no sender can make it grow.
_FORMS: dict[tuple[str, int], _Form] = {}
_MOST_FORMS = 256


def _form(type_: str, payload: bytes) -> _Form:
    layout = layout_of(payload, type_, DEFINITIONS, CDR)
    marked = itemgetter(*layout.marks.tolist())
    order = "<" if payload[1] else ">"
    formats = []
    at = 0
    for number in layout.numbers.values():
        formats.append(f"{number.at - at}x{_LETTERS[number.dtype[1:]]}")
        at = number.at + int(number.dtype[2:])
    return _Form(layout, marked, marked(payload), struct.Struct(order + "".join(formats)))


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
    """Append numbers, aligned to a multiple of their size."""
    if len(values):
        out += bytes(-(len(out) - len(_ENCAPSULATION)) % struct.calcsize(format_))
        out += struct.pack(f"<{len(values)}{format_}", *values)
