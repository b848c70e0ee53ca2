"""Lines that name each of their numbers: line protocol of InfluxDB, `V:12.3,I:-1.2` of a microcontroller."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

#: `battery,robot=r1 voltage=13.2,current=-1.5 1700000000000000000`; a mark with a backslash before it is none.
_NAME = r"(?:[^,=\s\\]|\\.)+"
_VALUE = r'(?:"(?:[^"\\]|\\.)*"|[^\s,]+)'
_PROTOCOL = re.compile(
    rf"(?P<measurement>{_NAME})(?P<tags>(?:,{_NAME}={_NAME})*) +"
    rf"(?P<fields>{_NAME}={_VALUE}(?:,{_NAME}={_VALUE})*)(?: +(?P<time>-?\d+))?\s*"
)
_TAG, _FIELD = re.compile(rf"({_NAME})=({_NAME})"), re.compile(rf"({_NAME})=({_VALUE})")
#: What the serial monitor of Arduino writes before a line.
_MONITOR = re.compile(r"(?P<time>\d\d:\d\d:\d\d(?:\.\d+)?) -> ")
_PAIR = re.compile(
    r"(?P<name>[A-Za-z_]\w*(?:[ /-][A-Za-z_]\w*)*)\s*[:=]\s*(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r"\s?(?P<unit>[A-Za-z°%µ]+(?![\w:=]))?(?=[\s,;|]|$)"
)
#: Lines that are looked at, and the share of a line that its pairs take.
_HEAD_LINES, _MOSTLY = 5, 0.8


def is_labelled(head: bytes) -> bool:
    """True for a text whose first lines name each of their numbers."""
    lines = [line for line in head.decode("utf-8", "replace").splitlines()[:-1] if line.strip() and line[0] != "#"]
    lines = lines[:_HEAD_LINES]
    return len(lines) > 1 and (all(map(_PROTOCOL.fullmatch, lines)) or all(map(_is_row_of_pairs, lines)))


def rows_of_lines(text: str) -> list[dict[str, Any]]:
    """The numbers and texts of each line by their names; a line that was cut off or says something else is left out."""
    rows = []
    for line in text.splitlines():
        if found := _PROTOCOL.fullmatch(line):
            rows.append(dict(_of_protocol(found)))
        elif _is_row_of_pairs(line):
            rows.append(dict(_of_pairs(line)))
    return rows


def _is_row_of_pairs(line: str) -> bool:
    text = _MONITOR.sub("", line.strip(), count=1)
    taken = sum(len(pair[0]) for pair in _PAIR.finditer(text))
    return len(_PAIR.findall(text)) > 1 and taken >= _MOSTLY * len(re.sub(r"[\s,;|]", "", text))


def _of_pairs(line: str) -> Iterator[tuple[str, Any]]:
    if monitor := _MONITOR.match(line.strip()):
        yield "time", monitor["time"]
    for pair in _PAIR.finditer(_MONITOR.sub("", line.strip(), count=1)):
        yield f"{pair['name']} [{pair['unit']}]" if pair["unit"] else pair["name"], float(pair["value"])


def _of_protocol(found: re.Match[str]) -> Iterator[tuple[str, Any]]:
    """The time, the tags and the fields; a field called `value` has the name of its measurement."""
    if found["time"]:
        yield "time", int(found["time"])
    for name, value in _TAG.findall(found["tags"]):
        yield _plain(name), _plain(value)
    for name, value in _FIELD.findall(found["fields"]):
        own = _plain(found["measurement"] if name == "value" else name)
        yield own, _number_or_text(value)


def _number_or_text(value: str) -> float | str:
    """The number in a field, `5i` and `5u` whole ones among them; else its text."""
    try:
        return float(value.removesuffix("i").removesuffix("u"))
    except ValueError:
        return _plain(value.strip('"'))


def _plain(text: str) -> str:
    """The text without the backslashes before its marks."""
    return re.sub(r"\\(.)", r"\1", text)
