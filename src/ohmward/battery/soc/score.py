"""How good an estimate was, where the truth is known: the one place that turns errors into figures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95

#: Standard deviations that a normal error exceeds in 5 % of the cases.


class Score(NamedTuple):
    """Errors are estimate minus truth, in the unit of both.

    rmse, mae: root mean square and mean absolute error.
    mean, std: of the error.
    max_error: largest absolute error.
    coverage_95: share of the samples whose truth is inside the estimate's own 95 % band; nan without a sigma.
    samples: how many had a truth.
    """

    rmse: float
    mae: float
    mean: float
    std: float
    max_error: float
    coverage_95: float
    samples: int


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
    covered = np.nan if std is None else float(np.mean(np.abs(error) <= BAND_95 * std[known]))
    return Score(
        float(np.sqrt(np.mean(error**2))),
        float(np.mean(np.abs(error))),
        float(error.mean()),
        float(error.std()),
        float(np.abs(error).max()),
        covered,
        int(known.sum()),
    )
