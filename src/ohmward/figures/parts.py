"""Parts that the figures share: bands of 95 %, and stretches of time in which a condition holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ohmward.filters.consistency import BAND_95
from ohmward.filters.flags import SampleFlag
from ohmward.filters.run import Run
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Log
from ohmward.report import Band, Figure, Marker, Series, Span, WallClock
from ohmward.report.figure import Meaning
from ohmward.runs import runs

#: More spans than this would be a grey wall; the longest are drawn.
MOST_SPANS = 300

#: Largest half width drawn of a band of logarithms; a wider one carries no information.
_WIDEST_LOGARITHM = 10.0


#: What has the times (T,) of its samples: a log, or a run over one.
Timed = Log | Run[Any]


def wall_clock(log: Log | DriveLog) -> WallClock | None:
    """Clock of a log that has dates."""
    return None if log.start_unix_s is None else WallClock(log.start_unix_s, log.time_zone)


def band_95(
    x: np.ndarray,
    mean: np.ndarray,
    std: np.ndarray,
    limits: tuple[float, float] = (-np.inf, np.inf),
    label: str = "95 % band",
    role: Meaning = "estimate",
) -> Band:
    """The 95 % band, cut at the limits of the quantity."""
    low, high = mean - BAND_95 * std, mean + BAND_95 * std
    for edge in (low, high):
        np.clip(edge, *limits, out=edge)
    return Band(x, low, high, label, role)


def lognormal_band_95(
    x: np.ndarray, mean: np.ndarray, log_std: np.ndarray, label: str = "95 % band", role: Meaning = "estimate"
) -> Band:
    """The 95 % band of a quantity > 0 whose logarithm has this standard deviation; a gap where the mean is not > 0."""
    known = np.where(mean > 0.0, mean, np.nan)
    factor = np.exp(np.minimum(BAND_95 * log_std, _WIDEST_LOGARITHM))
    return Band(x, known / factor, known * factor, label, role)


def estimated(
    x: np.ndarray,
    mean: np.ndarray,
    std: np.ndarray,
    truth: np.ndarray | None = None,
    limits: tuple[float, float] = (-np.inf, np.inf),
) -> tuple[list[Series], list[Band]]:
    """The line of an estimate, and of the reference where there is one; the 95 % band of the estimate."""
    series = [Series(x, mean, "estimate", role="estimate")]
    if truth is not None:
        series.append(Series(x, truth, "reference", "dashed", "reference"))
    return series, [band_95(x, mean, std, limits)]


def arriving_figure(
    x_label: str,
    x: np.ndarray,
    probability: np.ndarray,
    markers: Sequence[Marker] = (),
    height_px: int = Figure.height_px,
) -> Figure:
    """Probability in [0, 1] of arriving, along a plan or over time."""
    line = Series(x, 100 * probability, "probability", role="estimate")
    limits = -2.0, 102.0
    title = "Probability of arriving with the reserve left"
    return Figure(title, x_label, "Probability [%]", [line], markers=markers, y_limits=limits, height_px=height_px)


def spans_where(time_s: np.ndarray, condition: np.ndarray, label: str, role: Meaning) -> list[Span]:
    """A span for every stretch of True in `condition` (T,), the longest where there are many."""
    ends = [(float(time_s[first]), float(time_s[stop - 1])) for first, stop in runs(condition)]
    return longest([Span(from_s, to_s, label, role) for from_s, to_s in ends])


def flag_spans(time_s: np.ndarray, flags: np.ndarray, roles: Mapping[SampleFlag, Meaning]) -> list[Span]:
    """Spans of the samples that carry one of these flags; flags: (T,) sums of flag values."""
    spans = []
    for flag, role in roles.items():
        words = str(flag.name).lower().replace("_", " ")
        spans += spans_where(time_s, flags.astype(int) & flag != 0, words, role)
    return longest(spans)


def longest(spans: Sequence[Span]) -> list[Span]:
    """The longest spans, in order of time."""
    return sorted(sorted(spans, key=lambda s: s.x_from - s.x_to)[:MOST_SPANS])
