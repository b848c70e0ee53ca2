"""Scores of a run by the names that --json uses."""

from __future__ import annotations

import numpy as np

from ohmward.battery.soc.sample import SocEstimate
from ohmward.battery.soc.score import Score, score
from ohmward.logs.log import Log

#: A start that was not known is found within the first hour or not at all.
SETTLE_S = 3600.0
_SUFFIX = "_after_1h"


def soc_scores(log: Log, estimates: SocEstimate, truth: np.ndarray | None) -> dict[str, float | None]:
    """Errors of the state of charge, over the whole log and after its first hour; None without a truth there.

    truth: (T,) reference, nan where there is none.
    """
    late = log.time_s >= log.time_s[0] + SETTLE_S
    parts = {"": slice(None), _SUFFIX: late}
    figures: dict[str, float | None] = {}
    for suffix, part in parts.items():
        found = None if truth is None else score(estimates.soc[part], truth[part], estimates.soc_std[part])
        figures |= {f"{name}{suffix}": value for name, value in _named(found).items()}
    return figures


def voltage_score(log: Log, estimates: SocEstimate) -> Score | None:
    """Expected minus measured voltage [V]; None where the estimator expects none."""
    return score(estimates.voltage_V, log.voltage_V)


def _named(found: Score | None) -> dict[str, float | None]:
    names = {
        "soc_rmse": "rmse",
        "soc_mae": "mae",
        "soc_max_error": "max_error",
        "soc_error_mean": "mean",
        "soc_error_std": "std",
        "coverage_95": "coverage_95",
    }
    return {name: None if found is None else getattr(found, field) for name, field in names.items()}
