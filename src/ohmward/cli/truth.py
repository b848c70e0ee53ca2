"""A reference state of charge from a column of the log: a share, a percentage, or a counter of ampere hours."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.columns import guess, listed
from ohmward.logs.log import Log

#: A reference may leave [0, 1] by this much: cyclers count a little beyond full and empty.
MARGIN = 0.1
_AMPERE_HOURS = re.compile(r"(?<![a-z])(?P<milli>m?)a[.\s]?h(?![a-z])", re.IGNORECASE)
_PERCENT = re.compile(r"%|pct|percent", re.IGNORECASE)


class SocTruth(NamedTuple):
    """The reference and how it came about.

    soc: (T,) in [0, 1], nan where the column has no value.
    note: one sentence.
    """

    soc: np.ndarray
    note: str


def read_truth(log: Log, column: str, capacity_Ah: float, start_soc: float | None = None) -> SocTruth:
    """The reference in a column of the log; its name and its range say what it is.

    capacity_Ah: turns a counter of ampere hours into a share.
    start_soc: the reference at the first value of such a counter.

    Raises:
        InputError: there is no such column, it has no value, or its range is none of a state of charge.
    """
    values = _column(log, column)
    if unit := _AMPERE_HOURS.search(column):
        milli = 1e-3 if unit["milli"] else 1.0
        return _from_counter(log, column, milli * values, capacity_Ah, start_soc)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if not _PERCENT.search(column) and low >= -MARGIN and high <= 1.0 + MARGIN:
        return SocTruth(values, f"truth from {column!r}, taken as a share: {low:.3g} to {high:.3g}")
    if low >= -100 * MARGIN and high <= 100 * (1.0 + MARGIN):
        return SocTruth(values / 100, f"truth from {column!r}, taken as percent: {low:.3g} % to {high:.3g} %")
    raise InputError(
        f"{log.name}: --truth {column} runs from {low:g} to {high:g}; a state of charge lies between 0 and 1 or 0 and "
        "100 %; a counter of ampere hours must have Ah in its name"
    )


def _column(log: Log, column: str) -> np.ndarray:
    """The values (T,); `a - b` is the difference of two columns, as of a counter for each direction."""
    first, minus, second = (part.strip() for part in column.partition(" - "))
    missing = [name for name in ((first, second) if minus else (column,)) if name not in log.extra]
    if missing:
        names = list(log.extra)
        has = f"it has: {listed(names)}" if names else "it has no further numeric columns"
        raise InputError(f"{log.name}: there is no column {missing[0]!r} for --truth{guess(missing[0], names)}; {has}")
    values = log.extra[first] - log.extra[second] if minus else log.extra[column]
    if np.isnan(values).all():
        raise InputError(f"{log.name}: the column {column!r} for --truth has no value; choose another")
    return values


def _from_counter(
    log: Log, column: str, counter_Ah: np.ndarray, capacity_Ah: float, start_soc: float | None
) -> SocTruth:
    """Start plus counted charge over capacity; the current says which way the counter counts."""
    if start_soc is None:
        raise InputError(
            f"{log.name}: {column!r} counts ampere hours; say where it starts with --truth-start 1.0 (or --initial-soc)"
        )
    counted = np.isfinite(counter_Ah)
    charge = _charge_counted(log.select(counted), counter_Ah[counted])
    soc = np.full(len(log), np.nan)
    soc[counted] = start_soc + charge.total_Ah / capacity_Ah
    low, high = float(np.nanmin(soc)), float(np.nanmax(soc))
    if low < -MARGIN or high > 1.0 + MARGIN:
        raise InputError(
            f"{log.name}: from {start_soc:g}, {column!r} over {capacity_Ah:g} Ah would lead from {low:.3g} to "
            f"{high:.3g}; check --truth-start, the capacity in the battery file and what the column counts"
        )
    note = (
        f"truth from {column!r}: {start_soc:g} at its first value, counted up in {charge.way}, over {capacity_Ah:g} Ah"
    )
    return SocTruth(soc, note + (", resets undone" if charge.resets else ""))


class _Counted(NamedTuple):
    """Charge since the first sample (T,), > 0 when it went in; which way the counter counts; whether it was reset."""

    total_Ah: np.ndarray
    way: str
    resets: bool


def _charge_counted(log: Log, counter_Ah: np.ndarray) -> _Counted:
    """What the counter says, its sign and its resets told by the current."""
    from ohmward.battery.identification.charge import find_counter, find_gaps

    moved_Ah = np.diff(log.charge_Ah(), prepend=0.0)
    plain_Ah = np.diff(counter_Ah, prepend=counter_Ah[0])
    found = find_counter(replace(log, extra={"Ah": counter_Ah}), moved_Ah, find_gaps(log.time_s))
    sign = 1.0 if plain_Ah @ moved_Ah >= 0 else -1.0
    step_Ah = sign * plain_Ah if found is None else found.step_Ah
    up_in_charge = bool(plain_Ah @ step_Ah >= 0)
    resets = not np.allclose(np.abs(step_Ah), np.abs(plain_Ah))
    return _Counted(np.cumsum(step_Ah), "charging" if up_in_charge else "discharging", resets)
