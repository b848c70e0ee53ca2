"""OCV curve from a table that the user has: from a data sheet, a paper, a GITT or low-rate test of the same cell."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.ocv import LEAST_SPAN, OCV_GRID, OcvCurve, monotone
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.errors import InputError
from ohmward.logs.log import Note
from ohmward.logs.ocv_table import OcvTable, read_ocv_table
from ohmward.optional import require

#: SoC beyond 0 or 1 by less is put down to counting errors in the table.
_COUNTING_ERROR = 0.005
#: A voltage that falls with rising SoC by less than this share of itself is noise of the measurement and is levelled.
_FALL_SHARE = 0.0015
#: A table that ends further than this from empty or full is worth a note on how the curve goes on.
_END_GAP = 0.02
#: Largest distance of a log's usual voltage from the curve, as a share of it: the overpotential of its currents.
_OVERPOTENTIAL = 0.1


class GivenOcv(NamedTuple):
    """An OCV curve given by the user, and the assumptions made about it."""

    curve: OcvCurve  #: of a cell or of the pack
    notes: tuple[Note, ...] = ()  #: assumptions


def load_ocv(source: Any) -> GivenOcv:
    """The OCV curve of a CSV or Parquet file or a DataFrame with the columns SoC and voltage.

    SoC in 0 to 1 or in percent, rising or falling, any spacing. Optional: the change with temperature (dV/dT), the
    charge and the discharge branch or half their distance (hysteresis), the temperature of the table. Columns are
    recognised by name and unit: `soc, ocv_V`, `SOC [%], OCV (mV)`, `ocv_charge_V, ocv_discharge_V`, `dV/dT [mV/K]`.
    Between the points the curve is a monotone cubic; beyond the ends it goes straight on.

    Raises:
        InputError: a column is missing, SoC is outside 0 to 1 or unsorted, a voltage falls with SoC, or there are fewer
            than 2 points or less than 20 % of SoC.
    """
    return curve_of(read_ocv_table(source))


def given_ocv(ocv: Any, voltage_V: np.ndarray, n_series: int) -> GivenOcv:
    """The curve of the pack from what the user gave: an OcvCurve, the path of a table, or a DataFrame.

    voltage_V: (T,) of all logs; decides whether the curve is of a cell or of the pack.
    """
    given = ocv if isinstance(ocv, GivenOcv) else GivenOcv(ocv) if isinstance(ocv, OcvCurve) else load_ocv(ocv)
    return in_series(given, voltage_V, n_series)


def curve_of(table: OcvTable) -> GivenOcv:
    """The curve of a table on a uniform grid."""
    order = _order(table)
    soc = np.clip(table.soc[order], 0.0, 1.0)
    mean_V, hysteresis_V = _mean_and_hysteresis(table)
    rising_V, levelled_V = _rising(table, soc, mean_V[order])
    slope = np.zeros(soc.size) if table.slope_V_per_K is None else table.slope_V_per_K[order]
    soc, (rising_V, half_V, slope) = _one_per_soc(soc, (rising_V, hysteresis_V[order], slope))
    if soc[-1] - soc[0] < LEAST_SPAN:
        raise InputError(
            f"{table.source}: its SoC spans {soc[0]:.3g} to {soc[-1]:.3g}; a curve needs at least {LEAST_SPAN:.0%} "
            "of SoC (is the column in 0 to 1, or in percent?)"
        )
    curve = OcvCurve(
        tuple(np.maximum.accumulate(_on_grid(soc, rising_V)).tolist()),
        tuple(np.interp(OCV_GRID, soc, half_V).tolist()),
        tuple(np.interp(OCV_GRID, soc, slope).tolist()),
        ROOM_DEGC if table.reference_degC is None else table.reference_degC,
    )
    return GivenOcv(curve, (*table.notes, *_notes(table.source, soc, levelled_V)))


def in_series(given: GivenOcv, voltage_V: np.ndarray, n_series: int) -> GivenOcv:
    """The curve of the pack whose logs show these voltages: the curve itself, or `n_series` times that of a cell.

    Raises:
        InputError: the usual voltage of the logs is more than 10 % beyond both.
    """
    usual_V = float(np.nanmedian(voltage_V))
    low_V, high_V = given.curve.voltage_V[0], given.curve.voltage_V[-1]
    for cells in dict.fromkeys((1, n_series)):
        if (1 - _OVERPOTENTIAL) * low_V <= usual_V / cells <= (1 + _OVERPOTENTIAL) * high_V:
            text = f"the given OCV curve was assumed to be that of one cell and multiplied by {cells}"
            notes = (*given.notes, Note(text)) if cells > 1 else given.notes
            return given._replace(curve=given.curve.scaled(cells) if cells > 1 else given.curve, notes=notes)
    raise InputError(
        f"the given OCV curve runs from {low_V:.4g} to {high_V:.4g} V, but the logs usually show {usual_V:.4g} V with "
        f"n_series = {n_series}; give the curve of one cell and the number of cells in series (--n-series, n_series=), "
        "or the curve of the whole pack, in volts"
    )


def _order(table: OcvTable) -> np.ndarray:
    """(K,) indices that put the rows in order of SoC."""
    soc = table.soc
    outside = np.flatnonzero((soc < -_COUNTING_ERROR) | (soc > 1 + _COUNTING_ERROR))
    if outside.size:
        raise InputError(
            f"{table.source}: SoC must be between 0 and 1 (or 0 and 100 %), got {soc[outside[0]]:.4g}; it is the share "
            "of the capacity that estimators use"
        )
    steps = np.diff(soc)
    if np.any(steps > 0) and np.any(steps < 0):
        turn = 1 + int(np.argmax(np.abs(np.diff(np.sign(steps)))))
        raise InputError(
            f"{table.source}: SoC turns back at {soc[turn]:.4g}; it must rise or fall throughout; give charge and "
            "discharge as two columns of one table ('ocv_charge_V', 'ocv_discharge_V')"
        )
    return np.argsort(soc, kind="stable")


def _mean_and_hysteresis(table: OcvTable) -> tuple[np.ndarray, np.ndarray]:
    """Mean curve and half the distance of the branches, (K,) each [V]."""
    half_V = np.zeros(table.soc.size) if table.hysteresis_V is None else np.maximum(table.hysteresis_V, 0.0)
    if table.charge_V is not None and table.discharge_V is not None:
        half_V = np.maximum(0.5 * (table.charge_V - table.discharge_V), 0.0)
        mean_V = 0.5 * (table.charge_V + table.discharge_V)
        return (mean_V if table.ocv_V is None else table.ocv_V), half_V
    assert table.ocv_V is not None  # the reader refuses a table without a voltage
    return table.ocv_V, half_V


def _rising(table: OcvTable, soc: np.ndarray, voltage_V: np.ndarray) -> tuple[np.ndarray, float]:
    """The voltage without the small falls of noise, and the largest of them [V].

    Raises:
        InputError: it falls by more than noise does.
    """
    levelled_V = monotone(voltage_V)
    falls_V = np.abs(voltage_V - levelled_V)
    worst = int(np.argmax(falls_V))
    if 2 * falls_V[worst] > _FALL_SHARE * float(np.median(voltage_V)):
        raise InputError(
            f"{table.source}: the open-circuit voltage must not fall with SoC, but near SoC {soc[worst]:.3f} it falls "
            f"by {2 * falls_V[worst]:.3g} V; is it the voltage of a rested cell, and is SoC 1 full?"
        )
    return levelled_V, float(2 * falls_V[worst])


def _one_per_soc(soc: np.ndarray, columns: tuple[np.ndarray, ...]) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Each SoC once, with the mean of its rows."""
    unique, where = np.unique(soc, return_inverse=True)
    counts = np.bincount(where)
    return unique, tuple(np.bincount(where, values) / counts for values in columns)


def _on_grid(soc: np.ndarray, voltage_V: np.ndarray) -> np.ndarray:
    """(201,) monotone cubic through the points, straight on beyond the ends."""
    PchipInterpolator = require("scipy.interpolate", "an OCV curve from a table").PchipInterpolator

    inside = np.clip(OCV_GRID, soc[0], soc[-1])
    slope = np.diff(voltage_V) / np.diff(soc)
    below, above = slope[0] * (OCV_GRID - inside), slope[-1] * (OCV_GRID - inside)
    return PchipInterpolator(soc, voltage_V)(inside) + np.where(soc[0] > OCV_GRID, below, above)


def _notes(source: str, soc: np.ndarray, levelled_V: float) -> tuple[Note, ...]:
    notes = []
    if soc[0] > _END_GAP or soc[-1] < 1 - _END_GAP:
        text = f"{source}: the table covers SoC {soc[0]:.3f} to {soc[-1]:.3f}; beyond it the curve goes straight on"
        notes.append(Note(text, "warning"))
    if levelled_V > 0:
        notes.append(Note(f"{source}: the voltage falls with SoC by up to {1e3 * levelled_V:.2g} mV; levelled"))
    return tuple(notes)
