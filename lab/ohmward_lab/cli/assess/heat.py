"""Figures of a study as heat maps: what a cell says, and how dark it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple


class Heat(NamedTuple):
    """One figure of every method under every condition."""

    caption: str  #: in words, with its unit
    text: Callable[[Any], str]  #: of a cell; an empty one where there is no such figure
    value: Callable[[Any], float]  #: of a row; nan is the worst
    edges: tuple[float, ...]  #: values at which the shade becomes darker, from the lightest on

    def level(self, row: Any) -> int:
        """Number of the edges that the row is at or beyond."""
        value = self.value(row)
        return len(self.edges) if math.isnan(value) else sum(value >= edge for edge in self.edges)


def hundredths(value: float, digits: int = 1) -> str:
    """A share in points of percent, a speed [m/s] in cm/s."""
    return f"{100.0 * value:.{digits}f}" if math.isfinite(value) else "nan"


def _covered(row: Any) -> str:
    return "" if math.isnan(row.covered) else hundredths(row.covered, 0)


def _minutes(row: Any) -> str:
    return "never" if math.isinf(row.found_min) else f"{row.found_min:.0f}"


_COVERED = Heat(
    "Samples with the truth in the 95 % band, %", _covered, lambda row: 1.0 - row.covered, (0.05, 0.1, 0.2, 0.4)
)

#: Of each study; the first one is that of the text, and of the recommendation.
HEATS: Mapping[str, tuple[Heat, ...]] = {
    "battery": (
        Heat(
            "RMSE of the charge after the first hour, points of percent",
            lambda row: hundredths(row.rmse),
            lambda row: row.rmse,
            (0.01, 0.02, 0.04, 0.08),
        ),
        _COVERED,
        Heat(
            "Minutes until the error stays within 5 points, the median of the shifts",
            _minutes,
            lambda row: row.found_min,
            (10.0, 60.0, 180.0, 480.0),
        ),
    ),
    "traction": (
        Heat(
            "RMSE of the speed, cm/s", lambda row: hundredths(row.rmse), lambda row: row.rmse, (0.01, 0.02, 0.05, 0.1)
        ),
        _COVERED._replace(caption="Samples with the truth in the 95 % band, %, the lesser of speed and slip"),
        Heat(
            "RMSE of the slip ratio, points of percent",
            lambda row: hundredths(row.slip_rmse),
            lambda row: row.slip_rmse,
            (0.02, 0.05, 0.1, 0.2),
        ),
        Heat(
            "Error of the distance, %", lambda row: hundredths(row.way), lambda row: row.way, (0.005, 0.01, 0.02, 0.05)
        ),
    ),
}

#: Unit of the RMSE, a hundredth of what the figures hold.
UNITS: Mapping[str, str] = {"battery": "points", "traction": "cm/s"}


def grid(found: Sequence[Any], text: Callable[[Any], str]) -> Iterator[list[str]]:
    """Header, then a row for each condition with a cell for each method; an empty one where there are no figures."""
    methods = list(dict.fromkeys(row.method for row in found))
    by_place = {(row.condition, row.method): row for row in found}
    yield ["condition", *methods]
    for condition in dict.fromkeys(row.condition for row in found):
        here = [by_place.get((condition, method)) for method in methods]
        yield [condition, *(text(row) if row else "" for row in here)]
