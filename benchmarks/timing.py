"""Timing side by side, and the table that comes of it."""

from __future__ import annotations

import gc
import math
import statistics
import time
from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import NamedTuple, TypeVar

from figure import table, verdict
from ohmward.report import Figure

K = TypeVar("K", bound=Hashable)

#: A call that is shorter is repeated within a measurement.
LEAST_S = 0.02


class Times(NamedTuple):
    """Median, least and most of the measurements of a call [s]."""

    median: float
    least: float
    most: float

    def per(self, count: float) -> Times:
        """Of one of so many."""
        return Times(*(t / count for t in self))


class Goal(NamedTuple):
    """Goal of a measurement.

    what: in words.
    value, bar: in s, or a ratio, or a share.
    unit: "s", "x", "%", or another that is printed as it is.
    most: whether the bar is the most allowed, else the least.
    """

    what: str
    value: float
    bar: float
    unit: str = "s"
    most: bool = True

    @property
    def met(self) -> bool:
        return self.value <= self.bar if self.most else self.value >= self.bar


class Picture(NamedTuple):
    """A figure, and the name of its file in docs/pictures."""

    name: str
    figure: Figure


class Section(NamedTuple):
    """A part of the page: a heading, what the table shows, the table, the goals in it, and a picture of it."""

    title: str
    text: str
    header: tuple[str, ...]
    rows: list[tuple[str, ...]]
    goals: tuple[Goal, ...] = ()
    picture: Picture | None = None


def measure(runs: Mapping[K, Callable[[], object]], repeats: int) -> dict[K, Times]:
    """Processor time of every call, taken in turns so that all see the same machine.

    A short call is repeated, and runs once before it is timed: what ran before has filled the cache with other things.
    No garbage is collected meanwhile, as in `timeit`.
    """
    counts = {key: _count(run) for key, run in runs.items()}
    found: dict[K, list[float]] = {key: [] for key in runs}
    gc.collect()
    gc.disable()
    try:
        for _ in range(repeats):
            for key, run in runs.items():
                if counts[key] > 1:
                    run()
                found[key].append(_seconds(run, counts[key]))
    finally:
        gc.enable()
    return {key: Times(statistics.median(t), min(t), max(t)) for key, t in found.items()}


def wall(run: Callable[[], object], repeats: int) -> Times:
    """Wall time of a call, for other processes."""
    found = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        found.append(time.perf_counter() - began)
    return Times(statistics.median(found), min(found), max(found))


def _count(run: Callable[[], object]) -> int:
    """Number of calls of a measurement; the first call compiles."""
    run()
    return math.ceil(LEAST_S / max(_seconds(run, 1), 1e-6))


def _seconds(run: Callable[[], object], count: int) -> float:
    began = time.process_time()
    for _ in range(count):
        run()
    return (time.process_time() - began) / count


# ---- words


def duration(seconds: float) -> str:
    """1.23 us; empty where there is none."""
    if math.isnan(seconds):
        return ""
    for unit, factor in (("s", 1.0), ("ms", 1e3), ("us", 1e6)):
        if abs(seconds) * factor >= 1.0:
            return f"{_digits(seconds * factor)} {unit}"
    return f"{_digits(seconds * 1e9)} ns"


def _digits(x: float) -> str:
    """Three of them, and no exponent."""
    return f"{x:.0f}" if abs(x) >= 100 else f"{x:.3g}"


def spread(times: Times) -> str:
    """Least and most, in the unit of the median."""
    value, unit = duration(times.median).split()
    factor = times.median / float(value)
    return f"{_digits(times.least / factor)} to {_digits(times.most / factor)} {unit}"


def ratio(a: float, b: float) -> str:
    """Ratio of a to b."""
    return f"{_digits(a / b)} x"


def share(x: float) -> str:
    return "" if math.isnan(x) else f"{x:.0%}" if x > 1 else f"{100 * x:.3g}%"


def quantity(value: float, unit: str) -> str:
    words = {"s": duration, "x": lambda v: f"{_digits(v)} x", "%": share}
    return words[unit](value) if unit in words else f"{_digits(value)} {unit}"


def page(section: Section) -> list[str]:
    """A section as lines of Markdown."""
    lines = [f"## {section.title}", "", section.text, "", *table(section.header, section.rows), ""]
    if section.picture:
        lines += [f"![{section.picture.figure.title}](../docs/pictures/{section.picture.name}.svg)", ""]
    return lines


def goal_rows(goals: Iterable[Goal]) -> list[tuple[str, ...]]:
    """What, measured, bar, verdict."""
    return [
        (
            g.what,
            quantity(g.value, g.unit),
            f"{'at most' if g.most else 'at least'} {quantity(g.bar, g.unit)}",
            verdict(g.met),
        )
        for g in goals
    ]
