"""Figures of a method under a condition, over many shifts."""

from __future__ import annotations

import math
import time
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.soc.sample import SocSample
from ohmward.filters.consistency import BAND_95
from ohmward.trace import Kernel
from ohmward.trace.structure import side_by_side
from ohmward_lab.assess.battery.conditions import Condition
from ohmward_lab.assess.battery.methods import METHODS, SocMethod
from ohmward_lab.assess.battery.shifts import identified, measured
from ohmward_lab.assess.draws import signs

#: Errors count from here on [s]; before, a wrong start is being found, which `converged_min` tells.
SCORED_FROM_S = 3600.0
#: A start has been found when the error stays within this for good.
FOUND = 0.05
#: Given with a start that is wrong: `SocEstimator` assumes it too. Given with one that is right: the first voltage then
#: moves it by no more than the chance that an estimator leaves for any value to be wrong.
_START_STD, _RIGHT_START_STD = 0.03, 1e-4
#: Samples of all lanes at once: some hundred megabytes with all that belongs to them.
_MOST_SAMPLES = 1 << 20


class SocFigures(NamedTuple):
    """Figures of one method under one condition."""

    chemistry: str
    condition: str
    method: str
    #: of the state of charge after the first hour, over all runs; nan where it was no number once
    rmse: float
    largest: float
    covered: float  #: share of these samples with the truth in the 95 % band; nan without a band
    found_min: float  #: minutes until the error stays within 5 points, the median of the runs; inf where it never does
    lost: float  #: share of the runs that end more than 5 points off
    operations: int  #: in a step
    ns: float  #: time of a sample, with many runs side by side; of this machine, and no part of the results' equality

    @property
    def subject(self) -> str:
        """The chemistry."""
        return self.chemistry


def soc_cell(chemistry: str, condition: Condition, method: SocMethod, runs: int, seed: int) -> SocFigures:
    """Run the method along every shift of this condition."""
    samples, truth = measured(chemistry, condition, runs, seed)
    kernel, estimator = _compiled(chemistry, method.name)
    told = np.clip(truth[0] + signs(runs) * (condition.start_error or 0.0), 0.0, 1.0)
    start_std = _RIGHT_START_STD if condition.start_error == 0.0 else _START_STD
    length = len(truth)
    width = max(1, _MOST_SAMPLES // length)
    soc, std, spent_s = np.empty_like(truth), np.empty_like(truth), 0.0
    for first in range(0, runs, width):
        lanes = slice(first, min(first + width, runs))
        part = SocSample(samples.dt_s, *(values[:, lanes] for values in samples[1:]))
        states = []
        for run in range(lanes.start, lanes.stop):
            beginning = SocSample(0.0, *(float(values[0, run]) for values in samples[1:]))
            start = None if condition.start_error is None else float(told[run])
            states.append(estimator.init(beginning, start, start_std))
        began = time.perf_counter()
        _, (soc[:, lanes], std[:, lanes]) = kernel.scan_lanes(side_by_side(states), part)
        spent_s += time.perf_counter() - began
    found = figures(np.cumsum(samples.dt_s), soc - truth, std)
    operations = len(kernel.program.nodes)
    return SocFigures(chemistry, condition.name, method.name, *found, operations, 1e9 * spent_s / truth.size)


@lru_cache(maxsize=len(METHODS))
def _compiled(chemistry: str, name: str) -> tuple[Kernel, Any]:
    """The step that gives the state of charge and its band alone, and the estimator."""
    estimator: Any = next(method for method in METHODS if method.name == name).make(identified(chemistry))

    def step(state: Any, sample: SocSample) -> Any:
        after, found = estimator.step(state, sample)
        return after, (found.soc, found.soc_std)

    nothing = SocSample(0.0, math.nan, math.nan, math.nan)
    return Kernel(step, estimator.init(nothing, 0.5), SocSample(0.0, 0.0, 0.0, 0.0)), estimator


def figures(time_s: np.ndarray, error: np.ndarray, std: np.ndarray) -> tuple[float, float, float, float, float]:
    """rmse, largest, covered, found_min and lost of errors and their standard deviations (T, B)."""
    late = time_s >= SCORED_FROM_S
    size = np.abs(error)
    inside = np.where(np.isfinite(std), size <= BAND_95 * std, np.nan)[late]
    far = ~(size <= FOUND)
    last = np.where(far.any(axis=0), len(far) - 1 - np.argmax(far[::-1], axis=0), -1)
    minutes = np.where(last < 0, 0.0, time_s[np.minimum(last + 1, len(far) - 1)] / 60.0)
    minutes = np.where(far[-1], np.inf, minutes)
    covered = float(np.nanmean(inside)) if np.isfinite(inside).any() else math.nan
    return (
        float(np.sqrt(np.mean(error[late] ** 2))),
        float(size[late].max()),
        covered,
        float(np.median(minutes)),
        float(np.mean(far[-1])),
    )
