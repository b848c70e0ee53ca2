"""ULog files of PX4: the topics of a battery or of a drive."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.bags.choice import BATTERY, DRIVE, KnownType
from ohmward.logs.note import Note
from ohmward.logs.streams import Stream, Streams
from ohmward.logs.table import TableFile
from ohmward.optional import require

ULOG_MAGIC = b"ULog\x01\x12\x35"

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
    names = [f"{data.name}[{data.multi_id}]" if data.multi_id else data.name for data in log.data_list]
    streams = {
        name: Stream(data.name, 1e-6 * np.asarray(data.data["timestamp"], float), _columns(name, data))
        for name, data in zip(names, log.data_list, strict=True)
    }
    damaged = (Note("the file is damaged: what could not be read was left out", "warning"),)
    sign = "discharge" if any(stream.type == "battery_status" for stream in streams.values()) else None
    notes = damaged if log.file_corruption else ()
    return Streams(path.name, streams, "topics of PX4", _KNOWN, sign, notes).open()


def _columns(name: str, data: Any) -> dict[str, np.ndarray]:
    """The columns of a topic: those of a known one by their quantities, others by their names."""
    known = _KNOWN.get(data.name)
    if known is None:
        return {f"{name}/{key}": values for key, values in data.data.items() if key != "timestamp"}
    found = {column: data.data[key] for key, column in known.columns.items() if key in data.data}
    cells = [column for column in found if column.startswith("cell_voltage")]  # 0 of those that there are not
    return {column: values for column, values in found.items() if column not in cells or np.any(values)}
