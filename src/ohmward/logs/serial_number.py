"""Serial numbers of the batteries in a log, told by the name of a column."""

from __future__ import annotations

import re
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np

from ohmward.logs.read import open_table
from ohmward.logs.table import MISSING

#: Names of the column, written together and in small letters, with or without the word for the battery before them.
_NAMES = frozenset(("serial", "serialnumber", "serialno", "serialnr"))
_OF_BATTERY = re.compile(r"^(battery|batt|bat|pack|accu)(state)?")


def serial_column(names: tuple[str, ...]) -> str | None:
    """The column that holds the serial number of the battery, `battery_serial` or `Serial No.`; None for none."""
    fits = (name for name in names if _OF_BATTERY.sub("", re.sub(r"[^a-z]", "", name.lower())) in _NAMES)
    return next(fits, None)


def serial_numbers(
    source: str | PathLike[str] | Any, where: Mapping[str, float | str] | None = None
) -> tuple[tuple[str, str], ...]:
    """Column and value of each serial number in a file, in order of appearance; () for a file without any.

    where: column -> value of the rows wanted; a serial number among them is the only one.

    Raises:
        InputError: the file cannot be read.
    """
    file = open_table(source)
    column = serial_column(file.names)
    if column is None:
        return ()
    if column in (where or {}):
        return ((column, str((where or {})[column])),)
    values = file.load({column}).columns[column]
    changes = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    found = dict.fromkeys(text(value) for value in values[changes])
    return tuple((column, value) for value in found if value.lower() not in MISSING)


def text(value: Any) -> str:
    """A serial number as text: whole numbers without a decimal point."""
    if isinstance(value, float | np.floating) and float(value).is_integer():
        return str(int(value))
    return str(value).strip()
