"""Reference state of charge from a recorded column: a share, a percentage, or a counter of ampere hours."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.charge import find_counter, find_gaps
from ohmward.errors import InputError
from ohmward.logs.log import Log

#: A reference may leave [0, 1] by this much: cyclers count a little beyond full and empty.
REFERENCE_MARGIN = 0.1
_AMPERE_HOURS = re.compile(r"(?<![a-z])(?P<milli>m?)a[.\s]?h(?![a-z])", re.IGNORECASE)
_PERCENT = re.compile(r"%|pct|percent", re.IGNORECASE)


class SocReference(NamedTuple):
    """Reference state of charge and its origin."""

    soc: np.ndarray  #: (T,) in [0, 1], nan where the column has no value
    note: str  #: one sentence


def soc_reference(
    log: Log, column: str, values: np.ndarray, capacity_Ah: float, start_soc: float | None = None
) -> SocReference:
    """Reference from the values of a column, whose name and range tell its kind.

    column: name; Ah or mAh in it is a counter, "%" or "percent" a percentage.
    values: (T,) at the samples of the log, nan where there is none.
    capacity_Ah: turns a counter of ampere hours into a share.
    start_soc: reference at the first value of such a counter.

    Raises:
        InputError: the column has no value, or its range is not that of a state of charge.
    """
    if np.isnan(values).all():
        raise InputError(f"{log.name}: the column {column!r} for --truth has no value; choose another")
    if unit := _AMPERE_HOURS.search(column):
        milli = 1e-3 if unit["milli"] else 1.0
        return _from_counter(log, column, milli * values, capacity_Ah, start_soc)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if not _PERCENT.search(column) and low >= -REFERENCE_MARGIN and high <= 1.0 + REFERENCE_MARGIN:
        return SocReference(values, f"truth from {column!r}, taken as a share: {low:.3g} to {high:.3g}")
    if low >= -100 * REFERENCE_MARGIN and high <= 100 * (1.0 + REFERENCE_MARGIN):
        return SocReference(values / 100, f"truth from {column!r}, taken as percent: {low:.3g} % to {high:.3g} %")
    raise InputError(
        f"{log.name}: --truth {column} runs from {low:g} to {high:g}; a state of charge lies between 0 and 1 or 0 and "
        "100 %; a counter of ampere hours must have Ah in its name"
    )


def _from_counter(
    log: Log, column: str, counter_Ah: np.ndarray, capacity_Ah: float, start_soc: float | None
) -> SocReference:
    """Start plus counted charge over capacity; the current tells in which direction the counter counts."""
    if start_soc is None:
        raise InputError(
            f"{log.name}: {column!r} counts ampere hours; say where it starts with --truth-start 1.0 (or --initial-soc)"
        )
    counted = np.isfinite(counter_Ah)
    charge = _counted_charge(log.select(counted), counter_Ah[counted])
    soc = np.full(len(log), np.nan)
    soc[counted] = start_soc + charge.total_Ah / capacity_Ah
    low, high = float(np.nanmin(soc)), float(np.nanmax(soc))
    if low < -REFERENCE_MARGIN or high > 1.0 + REFERENCE_MARGIN:
        raise InputError(
            f"{log.name}: from {start_soc:g}, {column!r} over {capacity_Ah:g} Ah would lead from {low:.3g} to "
            f"{high:.3g}; check --truth-start, the capacity in the battery file and what the column counts"
        )
    note = (
        f"truth from {column!r}: {start_soc:g} at its first value, counted up in {charge.way}, over {capacity_Ah:g} Ah"
    )
    return SocReference(soc, note + (", resets undone" if charge.resets else ""))


class _CountedCharge(NamedTuple):
    """Charge of a counter."""

    total_Ah: np.ndarray  #: (T,) since the first sample, > 0 when it went in
    way: str  #: "charging" or "discharging", in which the counter counts up
    resets: bool  #: True where the counter was reset on the way


def _counted_charge(log: Log, counter_Ah: np.ndarray) -> _CountedCharge:
    """Charge of a counter (T,), its sign and its resets told by the current."""
    moved_Ah = np.diff(log.charge_Ah(), prepend=0.0)
    plain_Ah = np.diff(counter_Ah, prepend=counter_Ah[0])
    found = find_counter(replace(log, extra={"Ah": counter_Ah}), moved_Ah, find_gaps(log.time_s))
    sign = 1.0 if plain_Ah @ moved_Ah >= 0 else -1.0
    step_Ah = sign * plain_Ah if found is None else found.step_Ah
    up_in_charge = bool(plain_Ah @ step_Ah >= 0)
    resets = not np.allclose(np.abs(step_Ah), np.abs(plain_Ah))
    return _CountedCharge(np.cumsum(step_Ah), "charging" if up_in_charge else "discharging", resets)
