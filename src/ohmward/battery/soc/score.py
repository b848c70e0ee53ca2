"""Errors of estimates where the truth is known: RMSE, MAE, extremes; and of their bands: coverage, interval score."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ohmward.battery.soc.sample import LEARNT, SocEstimate, SocFlag
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.logs.log import Log

#: A start that was not known is found within the first hour or not at all.
SETTLE_S = 3600.0

#: An error of more standard deviations is a wrong answer given with confidence; of a normal distribution 0.006 %.
CONFIDENTLY_WRONG = 4.0

#: Fields of the score of a state of charge by the names of its figures.
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

    estimate, truth: (T,).  std: (T,) the estimate's own standard deviation.

    Raises:
        InputError: shapes differ.
    """
    if np.shape(estimate) != np.shape(truth):
        raise InputError(
            f"estimate and truth must have the same length, got {np.shape(estimate)} and {np.shape(truth)}"
        )
    known = np.isfinite(estimate) & np.isfinite(truth)
    if not known.any():
        return None
    error = estimate[known] - truth[known]
    band = _BandScore(*(4 * (np.nan,))) if std is None else _band_score(error, std[known])
    return Score(
        _rms(error),
        float(np.mean(np.abs(error))),
        float(error.mean()),
        float(error.std()),
        float(np.abs(error).max()),
        *band,
        int(known.sum()),
    )


class _BandScore(NamedTuple):
    """The fields of `Score` that need a sigma."""

    coverage_95: float
    interval_95: float
    error_over_std: float
    confidently_wrong: float


def _band_score(error: np.ndarray, std: np.ndarray) -> _BandScore:
    """Scores of the band that the standard deviations (T,) claim for the errors (T,)."""
    size, half = np.abs(error), BAND_95 * std
    outside = np.maximum(size - half, 0.0)
    ratio = size / np.maximum(std, np.finfo(float).tiny)
    return _BandScore(
        coverage_95=float(np.mean(size <= half)),
        interval_95=float(np.mean(2 * half + 2 / 0.05 * outside)),
        error_over_std=_rms(ratio),
        confidently_wrong=float(np.mean(ratio > CONFIDENTLY_WRONG)),
    )


def soc_scores(log: Log, estimates: SocEstimate, truth: np.ndarray | None) -> dict[str, float | None]:
    """Errors of the state of charge by name, over the whole log and (`_after_1h`) after its first hour.

    truth: (T,) reference, nan where there is none; without one every figure is None.
    """
    parts = {"": slice(None), "_after_1h": log.time_s >= log.time_s[0] + SETTLE_S}
    figures: dict[str, float | None] = {}
    for suffix, part in parts.items():
        found = None if truth is None else score(estimates.soc[part], truth[part], estimates.soc_std[part])
        for name, field in _SOC_FIGURES.items():
            figures[name + suffix] = None if found is None else getattr(found, field)
    return figures


def soc_figures(log: Log, estimates: SocEstimate) -> dict[str, float | None]:
    """Start, end and range of the state of charge along a log, the error of the voltage, what was learnt at the end."""
    e, voltage = estimates, voltage_score(log, estimates)
    return {
        "soc_initial": float(e.soc[0]),
        "soc_final": float(e.soc[-1]),
        "soc_std_final": float(e.soc_std[-1]),
        "soc_min": float(e.soc.min()),
        "soc_max": float(e.soc.max()),
        "voltage_rmse_V": voltage.rmse if voltage else None,
        **{name: float(getattr(e, name)[-1]) for name in LEARNT},
    }


def voltage_score(log: Log, estimates: SocEstimate) -> Score | None:
    """Score of the expected voltage [V] without those that it rejected; None where the estimator expects none."""
    return score(estimates.voltage_V, np.where(rejected_voltages(log, estimates), np.nan, log.voltage_V))


def rejected_voltages(log: Log, estimates: SocEstimate) -> np.ndarray:
    """(T,) True for voltages that the estimator did not believe: outside its gate, or those of no such battery."""
    left_out = int(SocFlag.VOLTAGE_REJECTED | SocFlag.NO_VOLTAGE)
    return np.isfinite(log.voltage_V) & (np.nan_to_num(estimates.flags).astype(int) & left_out != 0)


def soc_rms_differences(estimates: Mapping[str, SocEstimate]) -> dict[str, dict[str, float]]:
    """Root mean square difference of the state of charge between every two estimators, by their names."""
    differences = {}
    for name, one in estimates.items():
        others = {other: two for other, two in estimates.items() if other != name}
        differences[name] = {other: _rms(one.soc - two.soc) for other, two in others.items()}
    return differences


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
