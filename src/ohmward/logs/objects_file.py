"""Texts that name each value: JSON, echoed messages of ROS 2, line protocol, `V:12.3,I:-1.2`, blocks of VE.Direct."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from statistics import mode
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.cells import with_units_of_cells
from ohmward.logs.frame import plain_array
from ohmward.logs.hints import HEAD_BYTES, FileHints
from ohmward.logs.table import Note, Table, TableFile, file_of, row_numbers

#: Beginning of a file of JSON.
_JSON = re.compile(rb"^(?:\xef\xbb\xbf)?\s*(?:\{|\[\s*(?:[\[{\]]|null\b))")
#: The first message as `ros2 topic echo` writes it: keys and items of lists, a line each, and the end.
_ECHO = re.compile(rb"(?:---\s*\n)?(?:[A-Za-z_]\w*:.*\n(?: *(?:- .*|[A-Za-z_]\w*:.*)?\n)*)---\s*\n")
_ECHOED = re.compile(r"^(?P<indent> *)(?:- |(?P<name>[A-Za-z_]\w*):)\s*(?P<value>.*?)\s*$")
#: `battery,robot=r1 voltage=13.2,current=-1.5 1700000000000000000`; a mark after a backslash does not separate.
_NAME = r"(?:[^,=\s\\]|\\.)+"
_VALUE = r'(?:"(?:[^"\\]|\\.)*"|[^\s,]+)'
_PROTOCOL = re.compile(
    rf"(?P<measurement>{_NAME})(?P<tags>(?:,{_NAME}={_NAME})*) +"
    rf"(?P<fields>{_NAME}={_VALUE}(?:,{_NAME}={_VALUE})*)(?: +(?P<time>-?\d+))?\s*"
)
_TAG, _FIELD = re.compile(rf"({_NAME})=({_NAME})"), re.compile(rf"({_NAME})=({_VALUE})")
#: Digits of a whole number that is too long for a stamp in nanoseconds.
_TOO_LONG = 20
#: Time or date that serial monitors and logs of programs write before a line: `09:15:00.000 -> `, `[09:15:00] `,
#: `[   12.345] bms: `, `2026-03-28 09:15:00,123 - battery - INFO - `, `ts=2026-03-28T09:15:00Z level=info `,
#: `Mar 28 09:15:00 host bms[712]: `.
_MONITOR = re.compile(
    r"(?:ts=|time=)?\[? *"
    r"(?P<time>(?:\d{4}-\d\d-\d\d[ T]|[A-Z][a-z]{2} [ \d]\d )?\d\d:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?"
    r"|(?<=[\[ ])\d+\.\d+(?=\]))\]?"
    r"(?: *->| *[>:|,])? +(?:- (?:[\w.]+ - )?)?(?:(?:level=)?(?i:debug|info|warn(?:ing)?|error)\b(?: -|:)? +)?"
    r"(?:(?:[\w.-]+ )?[A-Za-z_][\w./-]*(?:\[\d+\])?: +(?=[A-Za-z_]\w*(?:[ /-][A-Za-z_]\w*)*\s*[:=]))?"
)
#: Time and topic before an object: `09:15:00 robot/bms {"v": 13.2}`, `1774689300.5 {"v": 13.2}`.
_BEFORE_OBJECT = re.compile(
    rf"(?:{_MONITOR.pattern}|(?P<unix>\d{{9,}}(?:\.\d+)?)\s+)?(?:[A-Za-z_][\w./-]*\s+)?(?=\{{\s*\")"
)
_PAIR = re.compile(
    r"(?P<name>[A-Za-z_]\w*(?:[ /-][A-Za-z_]\w*)*)\s*[:=]\s*(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r"\s?(?P<unit>[A-Za-z°%µ]+(?![\w:=]))?(?=[\s,;|]|$)"
)
#: Number of lines examined, and smallest share of a line that its pairs take up.
_EXAMINED_LINES, _PAIRS_SHARE = 5, 0.8
#: A line of a block: `V\t13200`, `Bus Voltage: 13.2 V`, `POWER_SUPPLY_VOLTAGE_NOW=13200000`, `bms/voltage 13.2`,
#: `'pack voltage': Sending state 13.2 V with 2 decimals of accuracy` of ESPHome.
_LABELLED = re.compile(
    r"(?:(?P<name>[A-Za-z_][\w#/ .-]*?)(?:\t\s*|\s*[:=]\s*)|(?P<topic>[A-Za-z_]\w*(?:/[\w-]+)+)\s+"
    r"|(?:\[(?P<clock>\d\d:\d\d:\d\d(?:\.\d+)?)\])?(?:\[[^\]]*\])*:? *'(?P<entity>[^']+)'(?:: Sending state| >>) )"
    r"(?P<value>\S.*?)(?: with \d+ decimals.*)?"
)
_VALUE_WITH_UNIT = re.compile(r"(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s?(?P<unit>[A-Za-z°%µ]+)?")
#: Smallest share of the lines that are those of blocks, and of the labels that follow each other as in the first block.
_BLOCK_LINES_SHARE, _SAME_ORDER = 0.7, 0.7
_LONGEST_LABELLED = 200
#: Longest line of a board that is searched for pairs: one of noise takes the square of its length.
_LONGEST_PAIRS = 500
CHECKSUM = "Checksum"
#: Units of VE.Direct of Victron, whose blocks end in a checksum.
VICTRON = {"V": "mV", "VS": "mV", "VM": "mV", "VPV": "mV", "I": "mA", "IL": "mA", "P": "W", "PPV": "W", "CE": "mAh",
           "T": "degC", "SOC": "permille"}  # fmt: skip
#: Prefix of the keys in `uevent` of a power supply under Linux.
_UEVENT = "POWER_SUPPLY_"


def names_values(head: bytes) -> bool:
    """True if a file begins like one of these texts."""
    text = head.decode("utf-8", "replace")
    of_objects = _JSON.match(head) or _ECHO.match(head) or _BEFORE_OBJECT.match(text)
    return of_objects is not None or is_labelled(head) or are_blocks(head)


def open_objects(path: Path, hints: FileHints) -> TableFile:
    """The columns of echoed messages, labelled lines, a JSON object a line, an array of objects, an object of columns.

    Nested names are joined by points.
    """
    text = path.read_text(encoding=hints.encoding or "utf-8-sig", errors="replace")
    head = text[:HEAD_BYTES].encode()
    if _ECHO.match(head):
        content = _echoed(text)
    elif is_labelled(head):
        content = rows_of_lines(text)
    else:
        content = rows_of_blocks(text) if are_blocks(head) else _content(path.name, text)
    try:
        columns, notes = _columns(path.name, content)
        columns = with_units_of_cells(columns)
    except RecursionError:
        raise InputError(f"{path.name}: hundreds of objects within each other, as in no log; export a table") from None
    rows = row_numbers(1, len(next(iter(columns.values()))))
    first = {name: tuple(map(str, values[:100])) for name, values in columns.items() if values.dtype == object}
    return file_of(Table(path.name, columns, rows, "object", tuple(notes)), hints, head=first)


def _content(source: str, text: str) -> Any:
    try:
        return json.loads(text, parse_int=_whole)
    except (ValueError, RecursionError):
        pass
    objects = []
    lines = [line for line in text.splitlines() if line.strip()]
    for number, line in enumerate(lines, 1):
        try:
            before = _BEFORE_OBJECT.match(line)
            found = json.loads(line[before.end() :] if before else line, parse_int=_whole)
            time = (before["time"] or before["unix"]) if before else None
            objects.append({"time": time, **found} if time else found)
        except (ValueError, RecursionError) as error:
            if number == len(lines) and objects:
                break  # cut off
            raise InputError(f"{source}, line {number}: no JSON ({error}); repair or delete the line") from None
    return objects


def _whole(digits: str) -> float:
    """A whole number, as a float if it has too many digits for 64 bits."""
    return int(digits) if len(digits) < _TOO_LONG else float(digits)


def _columns(source: str, content: Any) -> tuple[dict[str, np.ndarray], list[Note]]:
    """Columns of equal length, from lists of values or a list of objects, whichever is longer; what was left out."""
    lists = _lists(content)
    nested = {name for name, values in lists.items() if any(isinstance(value, Mapping | list) for value in values)}
    rows = max((lists[name] for name in nested), key=len, default=[])
    columns = {name: values for name, values in lists.items() if name not in nested}
    length, count = Counter(map(len, columns.values())).most_common(1)[0] if columns else (0, 0)
    if count > 1 and length > len(rows):
        others = [name for name, values in columns.items() if len(values) != length]
        equal = {name: plain_array(_alike(values)) for name, values in columns.items() if len(values) == length}
        return equal, [Note(f"lists of another length left out: {', '.join(others)}", "warning")] if others else []
    flat = [dict(_flattened(row)) for row in rows or [content] if isinstance(row, Mapping)]
    names = dict.fromkeys(name for row in flat for name in row)
    if len(names) < 2:
        raise InputError(
            f'{source}: no objects with two values and more; write one object a line: {{"t": 0, "I": 1}}; '
            "messages of ROS without a stamp have no time here: record them with `ros2 bag record`"
        )
    return {name: plain_array(_alike([row.get(name) for row in flat])) for name in names}, []


def _lists(content: Any) -> dict[str, list[Any]]:
    """The lists in JSON at any depth, by their names, which are joined by points where several objects have lists.

    Objects of equal keys with a value each are lists as well, and names beside rows make objects, as pandas writes
    tables.
    """
    if isinstance(content, list):
        while content and all(isinstance(one, list) for one in content):
            content = [one for inner in content for one in inner]
        return {"": content} if content else {}
    if not isinstance(content, Mapping):
        return {}
    if all(isinstance(content.get(key), list) for key in ("columns", "data")):
        rows = [row for row in content["data"] if isinstance(row, list)]
        return {"": [dict(zip(map(str, content["columns"]), row, strict=False)) for row in rows]}
    alike = Counter(map(_keys_of_values, content.values()))
    by_row = {key for key, value in content.items() if (keys := _keys_of_values(value)) and alike[keys] > 1}
    inner = {key: {"": list(value.values())} if key in by_row else _lists(value) for key, value in content.items()}
    several = sum(map(bool, inner.values())) > 1
    return {
        (f"{key}.{name}" if name and several else name or key): values
        for key, lists in inner.items()
        for name, values in lists.items()
    }


def _keys_of_values(value: Any) -> tuple[str, ...]:
    """The keys of an object that has several, with a single value each; () for anything else."""
    if not isinstance(value, Mapping) or len(value) < 2 or any(isinstance(v, list | Mapping) for v in value.values()):
        return ()
    return tuple(value)


def _echoed(text: str) -> list[dict[str, str]]:
    """The values of each message that `ros2 topic echo` wrote, by names like `header.stamp.sec` and `velocity[0]`."""
    messages = []
    for document in re.split(r"^---\s*$", text, flags=re.MULTILINE):
        message: dict[str, str] = {}
        above: list[tuple[int, str]] = []
        item = 0
        for line in filter(None, map(_ECHOED.match, document.splitlines())):
            indent, name, value = len(line["indent"]), line["name"], line["value"].strip("'\"")
            while above and (above[-1][0] > indent or (name and above[-1][0] == indent)):
                above.pop()
            before = ".".join(key for _, key in above)
            if name is None:
                message[f"{before}[{item}]"] = value
                item += 1
                continue
            item, path = 0, f"{before}.{name}" if before else name
            if value.startswith("["):
                message |= {f"{path}[{k}]": cell.strip() for k, cell in enumerate(value.strip("[]").split(","))}
            elif value:
                message[path] = value
            else:
                above.append((indent, name))
        messages += [message] if message else []
    return messages


def _alike(values: list[Any]) -> list[Any]:
    """The values as numbers, with None for missing ones; all of them as text if any is not a number."""
    if all(isinstance(value, int | float) for value in values):
        return values
    try:
        return [None if value is None else float(value) for value in values]
    except (TypeError, ValueError):
        return ["" if value is None else str(value) for value in values]


def _flattened(one: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in one.items():
        if isinstance(value, Mapping):
            yield from _flattened(value, f"{before}{name}.")
        elif isinstance(value, list):
            yield from (
                (f"{before}{name}[{k}]", item) for k, item in enumerate(value) if not isinstance(item, list | dict)
            )
        else:
            yield f"{before}{name}", value


def is_labelled(head: bytes) -> bool:
    """True for a text whose first lines name each of their numbers."""
    lines = [line for line in head.decode("utf-8", "replace").splitlines()[:-1] if line.strip() and line[0] != "#"]
    lines = lines[:_EXAMINED_LINES]
    return len(lines) > 1 and (all(map(_PROTOCOL.fullmatch, lines)) or all(map(_of_pairs, lines)))


def are_blocks(head: bytes) -> bool:
    """True for a text that names a value in each line, with the same names again and again."""
    lines = [line for line in head.decode("utf-8", "replace").splitlines()[:-1] if line.strip()]
    labels = [label for label, _, _ in map(_labelled, lines) if label]
    if len(labels) < _BLOCK_LINES_SHARE * len(lines):
        return False
    labels = [label for label in labels if label != CHECKSUM]
    most_frequent = mode(labels) if labels else ""
    at = [k for k, label in enumerate(labels) if label == most_frequent]
    if len(at) < 2:
        return False
    length = at[1] - at[0]
    same = sum(label == later for label, later in zip(labels, labels[length:], strict=False))
    return length > 1 and same >= _SAME_ORDER * (len(labels) - length)


def _labelled(line: str) -> tuple[str, str, str]:
    """Label, value and time of a line of a block; empty texts for any other line."""
    text = line.strip()[:_LONGEST_LABELLED]
    monitor = _MONITOR.match(text)
    found = _LABELLED.fullmatch(_MONITOR.sub("", text, count=1))
    if found is None:
        return "", "", ""
    time = monitor["time"] if monitor else found["clock"] or ""
    return found["name"] or found["topic"] or found["entity"], found["value"], time


def rows_of_blocks(text: str) -> list[dict[str, Any]]:
    """The numbers and texts of each block by their names, with units; a name that comes again begins the next block."""
    lines = [found for found in map(_labelled, text.splitlines()) if found[0]]
    units = VICTRON if any(label == CHECKSUM for label, _, _ in lines) else {}
    rows: list[dict[str, Any]] = []
    labels: set[str] = set()
    for label, cell, time in lines:
        if label == CHECKSUM:
            continue
        if not rows or label in labels:
            rows.append({"time": time} if time else {})
            labels = set()
        labels.add(label)
        rows[-1].update([_named_value(label, cell, units)])
    return rows


def _named_value(label: str, cell: str, units: Mapping[str, str]) -> tuple[str, float | str]:
    """Name with its unit, and number or text, of a line of a block; units: of labels whose numbers have none."""
    number = _VALUE_WITH_UNIT.fullmatch(cell)
    name = label.removeprefix(_UEVENT).lower() if label.startswith(_UEVENT) else label
    unit = (number and number["unit"]) or units.get(label)
    return f"{name} [{unit}]" if unit else name, float(number["value"]) if number else cell


def cells_of_line(line: str) -> list[str]:
    """The cells of a line, at its commas, semicolons or tabs; else at its spaces."""
    return re.split(r"[,;\t]" if re.search(r"[,;\t]", line) else r"\s+", line.strip())


def numbers_of_line(line: str) -> dict[str, Any]:
    """The values of a line by their names: a JSON object, pairs or a label; {} for any other line.

    Those of a row of numbers are named by their places, from "1"; an empty cell is nan.
    """
    with suppress(ValueError):
        return {str(place): float(cell or "nan") for place, cell in enumerate(cells_of_line(line), 1)}
    with suppress(ValueError, RecursionError):
        found = json.loads(line)
        return found if isinstance(found, dict) else {}
    if len(line) > _LONGEST_PAIRS or not re.search(r"[=:\t]", line):
        return {}
    if rows := rows_of_lines(line):
        return rows[0]
    label, cell, _ = _labelled(line)
    return dict([_named_value(label, cell, {})]) if label else {}


def rows_of_lines(text: str) -> list[dict[str, Any]]:
    """The numbers and texts of each line by their names; truncated lines and lines of another form are left out."""
    rows = []
    for line in text.splitlines():
        if found := _PROTOCOL.fullmatch(line):
            rows.append(dict(_of_protocol(found)))
        elif row := _of_pairs(line):
            rows.append(row)
    return rows


def _of_pairs(line: str) -> dict[str, Any]:
    """The time and the numbers of a line of pairs by their names; {} for any other line."""
    monitor = _MONITOR.match(line.strip())
    text = line.strip()[monitor.end() if monitor else 0 :]
    pairs = list(_PAIR.finditer(text))
    taken = sum(len(pair[0]) for pair in pairs)
    if len(pairs) < 2 or taken < _PAIRS_SHARE * len(re.sub(r"[\s,;|]", "", text)):
        return {}
    named = {f"{p['name']} [{p['unit']}]" if p["unit"] else p["name"]: float(p["value"]) for p in pairs}
    return ({"time": monitor["time"].replace(",", ".")} if monitor else {}) | named


def _of_protocol(found: re.Match[str]) -> Iterator[tuple[str, Any]]:
    """The time, the tags and the fields; a field called `value` is named after its measurement."""
    if found["time"]:
        yield "time", _whole(found["time"])
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
