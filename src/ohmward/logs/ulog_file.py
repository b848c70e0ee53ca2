"""ULog files of PX4: the topics of a battery or of a drive."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.bags.choice import BATTERY, DRIVE, KnownType, choose_topics
from ohmward.logs.note import Note
from ohmward.logs.table import Progress, Table, TableFile, row_numbers
from ohmward.optional import require

ULOG_MAGIC = b"ULog\x01\x12\x35"

_TIME = "timestamp [us]"
_MOST_CELLS, _MOST_WHEELS = 14, 4

#: Topics of PX4 that are found without being named, by the names of their messages.
_KNOWN = {
    "battery_status": KnownType(
        BATTERY,
        {"voltage_v": "voltage [V]", "current_a": "current [A]", "temperature": "temperature [degC]"}
        | {"remaining": "remaining"}
        | {f"voltage_cell_v[{k}]": f"cell_voltage[{k}]" for k in range(_MOST_CELLS)},
    ),
    "wheel_encoders": KnownType(DRIVE, {f"wheel_speed[{k}]": f"wheel_speed_{k} [rad/s]" for k in range(_MOST_WHEELS)}),
}

#: Topic -> columns, the time [us] among them.
_Topics = Mapping[str, Mapping[str, np.ndarray]]


def open_ulog(path: Path) -> TableFile:
    """The columns of a ULog file; of one that was cut off those before the cut.

    Raises:
        InputError: no readable ULog file.
        OhmwardError: the package pyulog is not installed.
    """
    pyulog = require("pyulog", "a ULog file")
    try:
        log = pyulog.ULog(str(path), disable_str_exceptions=True)
    except Exception as error:  # of its parser, many kinds
        raise InputError(f"{path.name}: no readable ULog file ({error}); download it from the vehicle again") from error
    types = {f"{data.name}[{data.multi_id}]" if data.multi_id else data.name: data.name for data in log.data_list}
    topics = {name: _columns(name, data) for name, data in zip(types, log.data_list, strict=True)}
    damaged = (Note("the file is damaged: what could not be read was left out", "warning"),)
    return _table_file(path.name, topics, types, list(types), damaged if log.file_corruption else ())


def _columns(name: str, data: Any) -> dict[str, np.ndarray]:
    """The columns of a topic: those of a known one by their quantities, others by their names."""
    known = _KNOWN.get(data.name)
    time = {_TIME: np.asarray(data.data["timestamp"], dtype=np.int64)}
    if known is None:
        return time | {f"{name}/{key}": values for key, values in data.data.items() if key != "timestamp"}
    found = {column: data.data[key] for key, column in known.columns.items() if key in data.data}
    cells = [column for column in found if column.startswith("cell_voltage")]  # 0 of those that there are not
    return time | {column: values for column, values in found.items() if column not in cells or np.any(values)}


def _table_file(
    source: str, topics: _Topics, types: Mapping[str, str], chosen: list[str], notes: tuple[Note, ...]
) -> TableFile:
    """The columns of some topics."""
    names = tuple(dict.fromkeys([_TIME, *(name for topic in chosen for name in topics[topic])]))

    def part(kind: str, where: Mapping[str, float | str]) -> TableFile:
        return _table_file(source, topics, types, choose_topics(source, kind, where, types, _KNOWN), notes)

    load = partial(_load, source, {name: topics[name] for name in chosen}, notes)
    return TableFile(source, names, load, _TIME, part, "discharge" if "battery_status" in types.values() else None)


def _load(
    source: str, topics: _Topics, notes: tuple[Note, ...], wanted: Collection[str], progress: Progress | None = None
) -> Table:
    """The columns of some topics, a row for each message; in order of time where there are several topics."""
    chosen = {name: columns for name, columns in topics.items() if (set(columns) & set(wanted)) - {_TIME}}
    time_us = np.concatenate([columns[_TIME] for columns in (chosen or topics).values()] or [np.empty(0, np.int64)])
    if not time_us.size:
        raise InputError(f"{source}: no message of {', '.join(topics)}; a log needs samples")
    table: dict[str, np.ndarray] = {_TIME: time_us}
    begin = 0
    for columns in (chosen or topics).values():
        end = begin + columns[_TIME].size
        for name in columns.keys() & set(wanted) - {_TIME}:
            table.setdefault(name, np.full(time_us.size, np.nan))[begin:end] = columns[name]
        begin = end
    note = Note(f"topics of PX4: {', '.join(chosen or topics)}")
    whole = Table(source, table, row_numbers(1, time_us.size), "message", (note, *notes))
    return whole if len(chosen) == 1 else whole.pick(np.argsort(time_us, kind="stable"))
