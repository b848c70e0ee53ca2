"""Columns of a log that `--truth` names: the reference that estimates are compared with."""

from __future__ import annotations

import numpy as np

from ohmward.battery.soc.reference import SocReference, soc_reference
from ohmward.errors import InputError
from ohmward.logs import DriveLog, Log
from ohmward.logs.columns import guess, listed


def read_soc_truth(log: Log, text: str, capacity_Ah: float, start_soc: float | None = None) -> SocReference:
    """Reference state of charge in a column; `a - b` is the difference of two, as of a counter for each direction.

    capacity_Ah, start_soc: of a counter of ampere hours, see `soc_reference`.

    Raises:
        InputError: there is no such column, it has no value, or its range is not that of a state of charge.
    """
    first, minus, second = (part.strip() for part in text.partition(" - "))
    if minus:
        values = truth_column(log, first) - truth_column(log, second)
    else:
        values = truth_column(log, text)
    return soc_reference(log, text, values, capacity_Ah, start_soc)


def truth_column(log: Log | DriveLog, name: str) -> np.ndarray:
    """(T,) a column in its own unit.

    Raises:
        InputError: there is no such column.
    """
    if name in log.extra:
        return log.extra[name]
    names = list(log.extra)
    there = f"it has: {listed(names)}" if names else "it has no further numeric columns"
    raise InputError(f"{log.name}: there is no column {name!r} for --truth{guess(name, names)}; {there}")
