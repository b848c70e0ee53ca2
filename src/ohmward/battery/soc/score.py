"""Errors of estimates where the truth is known: RMSE, MAE, extremes; and of their bands: coverage, interval score.

The truth is a recorded column: a share, a percentage, or a counter of ampere hours.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.charge_count import find_counter, find_gaps
from ohmward.battery.soc.sample import LEARNT, SocEstimate, SocFlag
from ohmward.checks import as_numbers
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.logs.log import Log
from ohmward.quantities import SECONDS_PER_HOUR

#: An unknown start is found within the first hour or not at all.
FIRST_HOUR_S = SECONDS_PER_HOUR

#: An error of more standard deviations is a confident wrong answer; 0.006 % of a normal distribution.
CONFIDENTLY_WRONG = 4.0

#: Names of the figures of a state of charge, and their fields in its score.
_SOC_FIGURES = {
    "soc_rmse": "rmse",
    "soc_mae": "mae",
    "soc_max_error": "max_error",
    "soc_error_mean": "mean",
    "soc_error_std": "std",
    "coverage_95": "coverage_95",
}


class Score(NamedTuple):
    """Errors are estimate minus truth, in the unit of both."""

    #: root mean square and mean absolute error
    rmse: float
    mae: float
    #: of the error
    mean: float
    std: float
    max_error: float  #: largest absolute error
    coverage_95: float  #: share of the samples whose truth is inside the estimate's own 95 % band; nan without a sigma
    #: mean interval score of that band, in the unit of the estimate: its width, and 40 times the distance of each truth
    #: outside it (Gneiting and Raftery 2007, J. Am. Stat. Assoc. 102, equation 43); small is good.
    interval_95: float
    error_over_std: float  #: root mean square of error over sigma; 1 where the band is as wide as the errors are
    confidently_wrong: float  #: share of the samples with an error of more than 4 sigma
    samples: int  #: number of samples with a truth


def score(estimate: np.ndarray, truth: np.ndarray, std: np.ndarray | None = None) -> Score | None:
    """The score over the samples where both are finite; None where there are none.

    >>> log = ow.read_log("day.csv")
    >>> run = ow.SocEstimator(ow.load_battery("battery.toml")).run(log)
    >>> found = ow.score(run.soc, log.column("soc_true"), run.soc_std)
    >>> found.rmse < 0.02, found.coverage_95 > 0.9
    (True, True)

    estimate, truth: (T,).  std: (T,) the estimate's own standard deviation.

    Raises:
        InputError: shapes differ.
    """
    estimate, truth = as_numbers("estimate", estimate), as_numbers("truth", truth)
    std = None if std is None else np.broadcast_to(as_numbers("std", std), estimate.shape)
    if np.shape(estimate) != np.shape(truth):
        raise InputError(
            f"estimate and truth must have the same length, got {np.shape(estimate)} and {np.shape(truth)}"
        )
    known = np.isfinite(estimate) & np.isfinite(truth)
    if not known.any():
        return None
    error = estimate[known] - truth[known]
    band = (np.nan,) * 4 if std is None else _band_score(error, std[known])
    return Score(
        _rms(error),
        float(np.mean(np.abs(error))),
        float(error.mean()),
        float(error.std()),
        float(np.abs(error).max()),
        *band,
        int(known.sum()),
    )


def _band_score(error: np.ndarray, std: np.ndarray) -> tuple[float, float, float, float]:
    """Scores of the band that the standard deviations (T,) claim for the errors (T,).

    They are `coverage_95`, `interval_95`, `error_over_std` and `confidently_wrong` of `Score`.
    """
    size, half = np.abs(error), BAND_95 * std
    outside = np.maximum(size - half, 0.0)
    ratio = size / np.maximum(std, np.finfo(float).tiny)
    coverage_95 = float(np.mean(size <= half))
    interval_95 = float(np.mean(2 * half + 2 / 0.05 * outside))
    return coverage_95, interval_95, _rms(ratio), float(np.mean(ratio > CONFIDENTLY_WRONG))


def soc_scores(log: Log, estimates: SocEstimate, truth: np.ndarray | None) -> dict[str, float | None]:
    """Errors of the state of charge by name, over the whole log and (`_after_1h`) after its first hour.

    truth: (T,) reference, nan where there is none; without one every figure is None.
    """
    parts = {"": slice(None), "_after_1h": log.time_s >= log.time_s[0] + FIRST_HOUR_S}
    figures: dict[str, float | None] = {}
    for suffix, part in parts.items():
        found = None if truth is None else score(estimates.soc[part], truth[part], estimates.soc_std[part])
        for name, field in _SOC_FIGURES.items():
            figures[name + suffix] = None if found is None else getattr(found, field)
    return figures


def soc_figures(log: Log, estimates: SocEstimate) -> dict[str, float | None]:
    """Start, end and range of the state of charge in a log, the error of the voltage, the states learnt at its end."""
    e, error_V = estimates, voltage_errors_V(log, estimates)
    return {
        "soc_initial": float(e.soc[0]),
        "soc_final": float(e.soc[-1]),
        "soc_std_final": float(e.soc_std[-1]),
        "soc_min": float(e.soc.min()),
        "soc_max": float(e.soc.max()),
        "voltage_rmse_V": _rms(error_V) if error_V.size else None,
        **{name: float(getattr(e, name)[-1]) for name in LEARNT},
    }


def voltage_errors_V(log: Log, estimates: SocEstimate) -> np.ndarray:
    """Errors (K,) of the expected voltage [V] without rejected samples; none where the estimator expects no voltage."""
    error_V = estimates.voltage_V - log.voltage_V
    known = np.isfinite(error_V)
    known[rejected_voltages(log, estimates)] = False
    return error_V if known.all() else error_V[known]


def rejected_voltages(log: Log, estimates: SocEstimate) -> np.ndarray:
    """Samples (K,) whose voltage the estimator did not use: outside its gate, or impossible for the battery."""
    left_out = int(SocFlag.VOLTAGE_REJECTED | SocFlag.NO_VOLTAGE)
    rows = np.flatnonzero(estimates.flags)
    rows = rows[np.nan_to_num(estimates.flags[rows]).astype(int) & left_out != 0]
    return rows[np.isfinite(log.voltage_V[rows])]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


#: A reference may leave [0, 1] by this much: cyclers count a little beyond full and empty.
REFERENCE_MARGIN = 0.1
_AMPERE_HOURS = re.compile(r"(?<![a-z])(?P<milli>m?)a[.\s]?h(?![a-z])", re.IGNORECASE)
_PERCENT = re.compile(r"%|pct|percent", re.IGNORECASE)


class SocReference(NamedTuple):
    """Reference state of charge and its origin."""

    soc: np.ndarray  #: (T,) in [0, 1], nan where the column has no value
    note: str  #: one sentence


def soc_reference(log: Log, column: str, capacity_Ah: float, start_soc: float | None = None) -> SocReference:
    """Reference in a column, whose kind follows from its name and range.

    column: name; Ah or mAh in it is a counter, "%" or "percent" a percentage; `a - b` is the difference of two columns,
        such as one counter for each direction.
    capacity_Ah: turns a counter of ampere hours into a share.
    start_soc: reference at the first value of such a counter.

    Raises:
        InputError: there is no such column, it has no value, or its range is not that of a state of charge.
    """
    first, minus, second = (part.strip() for part in column.partition(" - "))
    values = log.column(first) - log.column(second) if minus else log.column(column)
    if np.isnan(values).all():
        raise InputError(f"{log.name}: the reference {column!r} has no value; choose another column (--truth, truth=)")
    if unit := _AMPERE_HOURS.search(column):
        milli = 1e-3 if unit["milli"] else 1.0
        return _from_counter(log, column, milli * values, capacity_Ah, start_soc)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if not _PERCENT.search(column) and low >= -REFERENCE_MARGIN and high <= 1.0 + REFERENCE_MARGIN:
        return SocReference(values, f"truth from {column!r}, read as a share: {low:.3g} to {high:.3g}")
    if low >= -100 * REFERENCE_MARGIN and high <= 100 * (1.0 + REFERENCE_MARGIN):
        return SocReference(values / 100, f"truth from {column!r}, read as percent: {low:.3g} % to {high:.3g} %")
    raise InputError(
        f"{log.name}: the reference {column!r} (--truth, truth=) runs from {low:g} to {high:g}; a state of charge lies "
        "between 0 and 1 or 0 and 100 %; a counter of ampere hours must have Ah in its name"
    )


def _from_counter(
    log: Log, column: str, counter_Ah: np.ndarray, capacity_Ah: float, start_soc: float | None
) -> SocReference:
    """Start plus counted charge over capacity; the current shows in which direction the counter counts."""
    if start_soc is None:
        raise InputError(
            f"{log.name}: {column!r} counts ampere hours; say where it starts with initial_soc=1.0 (--truth-start "
            "1.0, or --initial-soc 1.0)"
        )
    counted = np.isfinite(counter_Ah)
    total_Ah, way, resets = _counted_charge(log.select(counted), counter_Ah[counted])
    soc = np.full(len(log), np.nan)
    soc[counted] = start_soc + total_Ah / capacity_Ah
    low, high = float(np.nanmin(soc)), float(np.nanmax(soc))
    if low < -REFERENCE_MARGIN or high > 1.0 + REFERENCE_MARGIN:
        raise InputError(
            f"{log.name}: from {start_soc:g}, {column!r} over {capacity_Ah:g} Ah would lead from {low:.3g} to "
            f"{high:.3g}; check its start (--truth-start, initial_soc=), the capacity in the battery file and what the "
            "column counts"
        )
    note = f"truth from {column!r}: {start_soc:g} at its first value, counted up in {way}, over {capacity_Ah:g} Ah"
    return SocReference(soc, note + (", resets undone" if resets else ""))


def _counted_charge(log: Log, counter_Ah: np.ndarray) -> tuple[np.ndarray, str, bool]:
    """Charge of a counter (T,) since the first sample [Ah], > 0 when it went in; the current shows sign and resets.

    Returns: also the direction in which it counts up, "charging" or "discharging", and True where it was reset.
    """
    moved_Ah = np.diff(log.charge_Ah(), prepend=0.0)
    plain_Ah = np.diff(counter_Ah, prepend=counter_Ah[0])
    found = find_counter(replace(log, extra={"Ah": counter_Ah}), moved_Ah, find_gaps(log.time_s))
    sign = 1.0 if plain_Ah @ moved_Ah >= 0 else -1.0
    step_Ah = sign * plain_Ah if found is None else found.step_Ah
    up_in_charge = bool(plain_Ah @ step_Ah >= 0)
    resets = not np.allclose(np.abs(step_Ah), np.abs(plain_Ah))
    return np.cumsum(step_Ah), "charging" if up_in_charge else "discharging", resets
