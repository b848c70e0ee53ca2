"""Totals of everything that a store holds, for a robot that has counted none yet."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ohmward.onboard.store.store import Columns, Store
from ohmward.onboard.totals import TOTALS_GAP_S, Totals

_DAY_S = 86_400.0


def totals_of_store(folder: Path, capacity_Ah: float) -> Totals:
    """The totals of everything in a store, read a day at a time.

    capacity_Ah: of the battery; nan without one.

    Raises:
        OhmwardError: there is no store, or it cannot be read.
    """
    store, totals = Store(folder, read_only=True), Totals()
    try:
        for kind, names in (("battery", ("battery_current_A", "battery_voltage_V")), ("drive", ("distance_m",))):
            rows, first_ns, last_ns = store.span_ns(kind)
            days = np.arange(1e-9 * first_ns, 1e-9 * last_ns + 1.0, _DAY_S) if rows else ()
            for day_s in days:
                columns = store.read(kind, names, day_s, day_s + _DAY_S)
                totals = (
                    _with_battery(totals, columns, capacity_Ah) if kind == "battery" else _with_drive(totals, columns)
                )
    finally:
        store.close()
    return totals


def _with_battery(totals: Totals, columns: Columns, capacity_Ah: float) -> Totals:
    """The totals with the rows of a day: the charge of each direction at its mean voltage."""
    nothing = np.full(len(columns["unix_ns"]), math.nan)
    dt_s = np.diff(1e-9 * columns["unix_ns"], prepend=math.nan)
    charge_Ah = np.where((dt_s > 0.0) & (dt_s <= TOTALS_GAP_S), dt_s / 3600.0, math.nan)
    charge_Ah = charge_Ah * columns.get("battery_current_A", nothing)
    voltage_V = columns.get("battery_voltage_V", nothing)
    for way in (charge_Ah > 0.0, charge_Ah < 0.0):
        known = way & np.isfinite(voltage_V)
        whole_Ah, known_Ah = float(np.sum(charge_Ah[way])), float(np.sum(charge_Ah[known]))
        mean_V = float(np.sum(charge_Ah[known] * voltage_V[known])) / known_Ah if known_Ah else math.nan
        totals = totals.plus_charge(whole_Ah, mean_V, capacity_Ah) if whole_Ah else totals
    return totals


def _with_drive(totals: Totals, columns: Columns) -> Totals:
    """The totals with the rows of a day, whose path begins again at each start."""
    length_m = columns.get("distance_m", np.empty(0))
    known_m = length_m[np.isfinite(length_m)]
    grown_m = np.diff(known_m)
    return totals.after_drive(0.0, float(np.sum(np.where(grown_m >= 0.0, grown_m, known_m[1:]))))
