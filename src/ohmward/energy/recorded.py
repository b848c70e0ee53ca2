"""A recorded drive, cut into stretches: what was driven, on what, and what the battery gave for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.energy.leg import Stretch
from ohmward.errors import InputError

#: Label of the intervals in which the robot stands, and of those in which something was not measured.
_STANDS, _UNKNOWN = -1, -2


class Driven(NamedTuple):
    """One stretch of a recorded drive.

    start_s, stop_s: on the log's clock.
    stretch: what was driven.
    energy_J: out of the battery; < 0 where it was charged.
    """

    start_s: float
    stop_s: float
    stretch: Stretch
    energy_J: float


@dataclass(frozen=True)
class Cut:
    """Where a drive is cut.

    Attributes:
        longest_s: longest stretch.
        standing_m_s: below this speed the robot stands, if it does so for
        standing_s: at least.
        gap_s: a longer step between two samples is not bridged.
        height_s: heights are taken so far apart, or the noise of a pitch would count as climbing.
    """

    longest_s: float = 180.0
    standing_m_s: float = 0.03
    standing_s: float = 5.0
    gap_s: float = 10.0
    height_s: float = 10.0

    def __post_init__(self) -> None:
        for name in ("longest_s", "gap_s", "height_s"):
            require_positive(f"cut.{name}", getattr(self, name))
        for name in ("standing_m_s", "standing_s"):
            require_between(f"cut.{name}", getattr(self, name), 0.0, np.inf)


def cut_drive(
    time_s: np.ndarray,
    speed_m_s: np.ndarray,
    battery_W: np.ndarray,
    terrain: Sequence[str] | np.ndarray | str,
    grade_rad: np.ndarray | None = None,
    payload_kg: float = 0.0,
    cut: Cut | None = None,
) -> list[Driven]:
    """The stretches of a drive, in order of time: on one terrain each, standing or moving, none longer than a minute.

    time_s: (T,) increasing.  speed_m_s: (T,) forward.  battery_W: (T,) > 0 out of the battery; nan in either is bridged
    where its neighbours are close.  terrain: the name under each sample (T,), or one for all.  grade_rad: (T,) > 0 with
    the nose up.

    Raises:
        InputError: lengths differ, or nothing was measured long enough to be a stretch.
    """
    cut = cut or Cut()
    names = np.full(len(time_s), terrain, dtype=object) if isinstance(terrain, str) else np.array(terrain, dtype=object)
    _check(time_s, speed_m_s, battery_W, names, grade_rad)
    speed = bridged(time_s, speed_m_s, cut.gap_s)
    power_W = bridged(time_s, battery_W, cut.gap_s)
    climbing = np.zeros(len(time_s)) if grade_rad is None else np.sin(np.nan_to_num(bridged(time_s, grade_rad, np.inf)))
    known = sorted(set(names))
    labels = _labels(time_s, speed, power_W, np.array([known.index(n) for n in names]), cut)
    height_m = _integral(time_s, np.nan_to_num(speed) * climbing)
    driven = [
        _driven(rows, time_s, speed, power_W, height_m, "" if labels[rows.start] == _STANDS else names[rows.start], cut)
        for rows in _runs(time_s, labels, cut.longest_s)
    ]
    if not driven:
        raise InputError(
            "the drive has no stretch in which speed and battery power were both measured; check the columns"
        )
    return [d._replace(stretch=d.stretch._replace(payload_kg=payload_kg)) for d in driven]


def bridged(time_s: np.ndarray, values: np.ndarray, gap_s: float) -> np.ndarray:
    """(T,) with a straight line over what is nan, except where the known samples are farther apart than `gap_s`."""
    known = np.flatnonzero(np.isfinite(values))
    if not known.size:
        return np.full(len(time_s), np.nan)
    at = np.searchsorted(known, np.arange(len(time_s)))
    after, before = known[np.minimum(at, known.size - 1)], known[np.maximum(at - 1, 0)]
    near = np.minimum(np.abs(time_s[after] - time_s), np.abs(time_s - time_s[before])) <= gap_s / 2
    return np.where(near | np.isfinite(values), np.interp(time_s, time_s[known], values[known]), np.nan)


def _labels(time_s: np.ndarray, speed: np.ndarray, power_W: np.ndarray, terrain: np.ndarray, cut: Cut) -> np.ndarray:
    """(T - 1,) what each interval belongs to: the number of a terrain, standing, or unknown."""
    labels = terrain[:-1].copy()
    slow = np.abs(speed) < cut.standing_m_s
    still = slow[:-1] & slow[1:]
    for rows in _equal(still):
        if still[rows.start] and time_s[rows.stop] - time_s[rows.start] >= cut.standing_s:
            labels[rows] = _STANDS
    measured = np.isfinite(speed + power_W)
    labels[~(measured[:-1] & measured[1:]) | (np.diff(time_s) > cut.gap_s)] = _UNKNOWN
    return labels


def _runs(time_s: np.ndarray, labels: np.ndarray, longest_s: float) -> Iterator[slice]:
    """Intervals of one label, none longer than allowed."""
    for rows in _equal(labels):
        if labels[rows.start] == _UNKNOWN:
            continue
        duration_s = time_s[rows.stop] - time_s[rows.start]
        pieces = max(int(np.ceil(duration_s / longest_s)), 1)
        edges_s = np.linspace(time_s[rows.start], time_s[rows.stop], pieces + 1)[1:-1]
        edges = [rows.start, *(np.searchsorted(time_s, edges_s)), rows.stop]
        yield from (slice(int(a), int(b)) for a, b in pairwise(edges) if b > a)


def _equal(values: np.ndarray) -> Iterator[slice]:
    """Runs of equal values."""
    edges = [0, *(np.flatnonzero(values[1:] != values[:-1]) + 1), len(values)]
    return (slice(int(a), int(b)) for a, b in pairwise(edges) if b > a)


def _driven(
    rows: slice,
    time_s: np.ndarray,
    speed: np.ndarray,
    power_W: np.ndarray,
    height_m: np.ndarray,
    name: str,
    cut: Cut,
) -> Driven:
    """One stretch; rows: its intervals, so its samples are one more."""
    samples = slice(rows.start, rows.stop + 1)
    t, v = time_s[samples], np.abs(speed[samples])
    duration_s = float(t[-1] - t[0])
    energy_J = float(np.trapezoid(power_W[samples], t))
    if not name:
        return Driven(t[0], t[-1], Stretch("", duration_s), energy_J)
    knots = np.linspace(t[0], t[-1], max(round(duration_s / cut.height_s), 1) + 1)
    rise_m = np.diff(np.interp(knots, t, height_m[samples]))
    measures = np.trapezoid(v, t), np.trapezoid(v * v, t), rise_m.clip(0).sum(), (-rise_m).clip(0).sum()
    kinetic = 0.5 * (v[-1] ** 2 - v[0] ** 2)
    stretch = Stretch(name, duration_s, *map(float, measures))._replace(kinetic_m2_s2=float(kinetic))
    return Driven(t[0], t[-1], stretch, energy_J)


def _integral(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(T,) running integral by trapezoids."""
    return np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time_s) * (values[1:] + values[:-1]))])


def _check(time_s: np.ndarray, *columns: np.ndarray | None) -> None:
    if len(time_s) < 2:
        raise InputError(f"a drive needs at least 2 samples, got {len(time_s)}")
    for values in columns:
        if values is not None and np.shape(values) != np.shape(time_s):
            raise InputError(
                f"every column of a drive must have the length of time_s, {np.shape(time_s)}; got {np.shape(values)}"
            )
