"""Scores of files that have learnt, beside those that have not: the figures that every part of `learning.py` shares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from figure import Figure, at_least, at_most, rms
from lives_table import FOUND_S, SETTLED_S
from measured_cells import Recording
from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.score import Score, score
from ohmward.filters.consistency import BAND_95
from ohmward.logs import Log

#: Who made the file that is scored.
LABEL, LIVE, TESTED, LEARNT = "label", "label, filter runs on", "full test", "learn"
COVERAGE_BAR = 90.0


class Errors(NamedTuple):
    """Errors of the state of charge over recordings, in points: their RMSE, the band's coverage and calibration.

    error / sigma is the root mean square; a recording counts as one, at any rate and length.
    """

    rmse: float
    covered: float
    interval: float
    error_over_std: float


def without_truth(log: Log) -> Log:
    """The log as a robot has it."""
    return replace(log, extra={})


def errors(
    battery: Battery,
    recordings: Iterable[Recording],
    start_error: float | None,
    settled_s: float = SETTLED_S,
    found_s: float = FOUND_S,
) -> Errors:
    """Errors of the default filter with this file, started anew on each recording.

    start_error: of the state of charge that the filter is told; None where it is told nothing.
    settled_s: the band is judged after this time; found_s: the RMSE of an unknown start.
    """
    found = []
    for log, truth in recordings:
        told = None if start_error is None else float(np.clip(truth[np.isfinite(truth)][0] + start_error, 0.0, 1.0))
        run = SocEstimator(battery, told).run(log).estimates
        since_s = log.time_s - log.time_s[0]
        late, settled = since_s >= (found_s if told is None else 0.0), since_s >= settled_s
        found.append(
            (
                score(run.soc[late], truth[late], run.soc_std[late]),
                score(run.soc[settled], truth[settled], run.soc_std[settled]),
            )
        )
    return pooled(found)


def pooled(found: Sequence[tuple[Score | None, Score | None]]) -> Errors:
    """Errors over recordings, of which each counts as one; those without a truth do not."""
    rmse = [late.rmse for late, _ in found if late is not None]
    bands = [band for _, band in found if band is not None]
    return Errors(
        100 * rms(rmse),
        100 * float(np.mean([band.coverage_95 for band in bands])),
        100 * float(np.mean([band.interval_95 for band in bands])),
        rms([band.error_over_std for band in bands]),
    )


def error_figures(data: str, method: str, words: str, found: Errors, rmse_bar: float | None) -> Iterator[Figure]:
    """The figures of errors; judged where there is a bar for the RMSE [points]."""
    judged = rmse_bar is not None
    yield at_most(data, method, f"RMSE {words}, points", found.rmse, rmse_bar, ".2f")
    yield at_least(data, method, f"covered {words}, %", found.covered, COVERAGE_BAR if judged else None, ".0f")
    yield at_most(data, method, f"error / sigma {words}", found.error_over_std, None, ".2f")
    yield at_most(data, method, f"interval score {words}, points", found.interval, None, ".1f")


def value_figures(
    data: str, method: str, name: str, found: Normal, truth: float, bar: float | None = None
) -> Iterator[Figure]:
    """Error of a value that was learnt [%], and how many of its own sigmas that is."""
    error = found.mean - truth
    yield at_most(data, method, f"error of the {name}, %", float(100 * abs(error) / truth), bar, ".1f")
    most = None if bar is None else BAND_95
    yield at_most(data, method, f"error of the {name}, sigmas", float(abs(error) / found.std), most, ".2f")
