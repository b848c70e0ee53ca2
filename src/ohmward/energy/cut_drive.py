"""Stretches of a drive, recorded or under way: motion, terrain and energy of each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np

from ohmward.energy.balance import running_integral
from ohmward.energy.leg import STEEPEST_RAD, STRETCH_S, Stretch, joined
from ohmward.errors import InputError
from ohmward.runs import between, runs

#: Below this speed [m/s] the robot stands, if it does so for at least this time [s].
STANDS_M_S, STANDS_S = 0.03, 5.0
#: Longest step [s] between two samples that is bridged.
BRIDGED_S = 10.0
#: Time [s] between two heights; with less, pitch noise would count as climbing.
HEIGHT_S = 10.0
#: Label of the intervals in which the robot stands.
_STANDS = -1
#: Label of the intervals in which something was not measured.
_UNKNOWN = -2


class Driven(NamedTuple):
    """One stretch of a recorded drive."""

    #: on the log's clock
    start_s: float
    stop_s: float
    stretch: Stretch  #: what was driven
    energy_J: float  #: out of the battery; < 0 where it was charged


def cut_drive(
    time_s: np.ndarray,
    speed_m_s: np.ndarray,
    battery_W: np.ndarray,
    terrain: Sequence[str] | np.ndarray | str,
    grade_rad: np.ndarray | None = None,
    payload_kg: float = 0.0,
) -> list[Driven]:
    """Stretches of a drive in order of time: on one terrain each, standing or moving, none longer than `STRETCH_S`.

    time_s: (T,) increasing.
    speed_m_s: (T,) forward.  battery_W: (T,) > 0 out of the battery; nan in either is bridged where its neighbours are
        close.
    terrain: name of the ground under each sample (T,), or one for all.
    grade_rad: (T,) > 0 with the nose up; level ground by default. Slopes steeper than 45 degrees are unknown.
    payload_kg: on top of the robot's mass.

    Left out: time at a charger (`without_charger`).

    Raises:
        InputError: lengths differ, or nothing was measured long enough to be a stretch.
    """
    names = np.full(len(time_s), terrain, dtype=object) if isinstance(terrain, str) else np.array(terrain, dtype=object)
    if len(time_s) < 2:
        raise InputError(f"a drive needs at least 2 samples, got {len(time_s)}")
    for values in (speed_m_s, battery_W, names, grade_rad):
        if values is not None and np.shape(values) != np.shape(time_s):
            raise InputError(
                f"every column of a drive must have the length of time_s, {np.shape(time_s)}; got {np.shape(values)}"
            )
    speed, power = (between(time_s, values, BRIDGED_S) for values in (speed_m_s, battery_W))
    grade = np.zeros(len(time_s))
    if grade_rad is not None:  # an unknown slope is interpolated between its known neighbours
        credible = np.where(np.abs(grade_rad) <= STEEPEST_RAD, grade_rad, np.nan)
        grade = np.nan_to_num(between(time_s, credible))
    height_m = running_integral(time_s, np.nan_to_num(speed) * np.sin(grade))
    still = _still(speed)
    parts = []
    for intervals in _pieces(time_s, _labels(time_s, np.isfinite(speed + power), still, names)):
        name = "" if still[intervals].all() else names[intervals.start]
        samples = slice(intervals.start, intervals.stop + 1)
        parts.append(_driven(time_s[samples], speed[samples], power[samples], height_m[samples], name, payload_kg))
    driven, _ = without_charger(parts)
    if not driven:
        raise InputError(
            "the drive has no stretch: speed and battery power must both be measured, at least every "
            f"{BRIDGED_S:g} s, and not only at a charger; check the columns and the interval of the rows"
        )
    return driven


def _labels(time_s: np.ndarray, measured: np.ndarray, still: np.ndarray, names: np.ndarray) -> np.ndarray:
    """(T - 1,) label of each interval: the number of a terrain, standing, or unknown."""
    known = sorted(set(names))
    labels = np.array([known.index(name) for name in names[:-1]])
    for first, stop in runs(still):
        if time_s[stop] - time_s[first] >= STANDS_S:
            labels[first:stop] = _STANDS
    labels[~(measured[:-1] & measured[1:]) | (np.diff(time_s) > BRIDGED_S)] = _UNKNOWN
    return labels


def _pieces(time_s: np.ndarray, labels: np.ndarray) -> Iterator[slice]:
    """Runs of intervals of one known label, cut evenly where they are longer than allowed."""
    changes = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    for first, stop in pairwise([0, *changes, len(labels)]):
        if labels[first] == _UNKNOWN:
            continue
        start_s, stop_s = time_s[first], time_s[stop]
        count = max(int(np.ceil((stop_s - start_s) / STRETCH_S)), 1)
        inner_s = np.linspace(start_s, stop_s, count + 1)[1:-1]
        edges = [first, *np.searchsorted(time_s, inner_s), stop]
        yield from (slice(int(a), int(b)) for a, b in pairwise(edges) if b > a)


def _still(speed_m_s: np.ndarray) -> np.ndarray:
    """(T - 1,) True for the intervals with both ends below the speed of standing."""
    slow = np.abs(speed_m_s) < STANDS_M_S
    return slow[:-1] & slow[1:]


def _driven(
    t: np.ndarray, speed_m_s: np.ndarray, battery_W: np.ndarray, height_m: np.ndarray, terrain: str, payload_kg: float
) -> Driven:
    """One stretch from all of these samples, on one terrain, or standing where `terrain` is ""."""
    v = np.abs(speed_m_s)
    duration_s = float(t[-1] - t[0])
    stretch = Stretch(terrain, duration_s, payload_kg=payload_kg)
    if terrain:
        knots = np.linspace(t[0], t[-1], max(round(duration_s / HEIGHT_S), 1) + 1)
        rise_m = np.diff(np.interp(knots, t, height_m))
        stretch = stretch._replace(
            distance_m=float(np.trapezoid(v, t)),
            speed_distance_m2_s=float(np.trapezoid(v * v, t)),
            climb_m=float(rise_m.clip(0).sum()),
            descent_m=float((-rise_m).clip(0).sum()),
            kinetic_m2_s2=float(0.5 * (v[-1] ** 2 - v[0] ** 2)),
            standing_s=float(np.diff(t)[_still(v)].sum()),
        )
    return Driven(t[0], t[-1], stretch, float(np.trapezoid(battery_W, t)))


class DriveSample(NamedTuple):
    """Measurements at an instant of a drive; nan where one is missing."""

    time_s: float  #: on any clock
    speed_m_s: float  #: forward
    battery_W: float  #: > 0 out of the battery
    grade_rad: float  #: > 0 with the nose up; unknown where steeper than 45 degrees
    terrain: str  #: name of the ground


class Measured(NamedTuple):
    """A stretch under way."""

    stretch: Stretch  #: so far
    energy_J: float  #: out of the battery
    #: height gained that is not yet in the stretch, and the time in which it was gained
    rise_m: float = 0.0
    rise_s: float = 0.0


class DriveMeter(NamedTuple):
    """State of a drive under way: the last sample, the stretch so far, and a stop that may become part of it."""

    last: DriveSample | None = None
    moving: Measured | None = None
    stop: Measured | None = None
    measured: DriveSample | None = None  #: last sample with speed and power, until a gap
    at_charger: bool = False  #: the last finished stretch was at a charger


_Part = TypeVar("_Part", Driven, Measured)


def without_charger(parts: Iterable[_Part], at_charger: bool = False) -> tuple[list[_Part], bool]:
    """Stretches of a drive without those at a charger, and whether the last one was: they show no idle power.

    A robot is at a charger from the first stretch of standing in which its battery is charged until it moves.

    at_charger: of the stretch before.
    """
    driven = []
    for part in parts:
        at_charger = not part.stretch.terrain and (at_charger or part.energy_J < 0.0)
        if not at_charger:
            driven.append(part)
    return driven, at_charger


def advance(meter: DriveMeter, now: DriveSample) -> tuple[DriveMeter, list[Measured]]:
    """The drive after a sample, and the stretches that it has finished.

    A stop shorter than `STANDS_S` is part of the stretch in which it happens. Samples without speed or power are
    bridged; where the measured ones are farther apart than `BRIDGED_S`, the stretch ends.
    """
    before, is_measured = meter.measured, math.isfinite(now.speed_m_s) and math.isfinite(now.battery_W)
    if before is None or not 0.0 < now.time_s - before.time_s <= BRIDGED_S:
        return _after(meter, DriveMeter(now, measured=now if is_measured else None), _ended(meter))
    if not is_measured:
        return meter._replace(last=now), []
    interval = _interval(before, now)
    if max(abs(before.speed_m_s), abs(now.speed_m_s)) < STANDS_M_S:
        standing = interval.stretch._replace(standing_s=interval.stretch.time_s)
        moving, stop, done = _stand(meter, interval._replace(stretch=standing))
    else:
        moving, stop, done = _move(meter, interval)
    return _after(meter, DriveMeter(now, moving, stop, now), done)


def _after(before: DriveMeter, after: DriveMeter, done: list[Measured]) -> tuple[DriveMeter, list[Measured]]:
    """The meter after a sample, and the stretches that it has finished away from a charger."""
    driven, at_charger = without_charger(map(_finished, done), before.at_charger)
    return after._replace(at_charger=at_charger), driven


def _ended(meter: DriveMeter) -> list[Measured]:
    """Parts of a drive that ends here; a short stop is part of the stretch before it, or stands for itself."""
    moving, stop = meter.moving, meter.stop
    if stop is None:
        return [moving] if moving else []
    if moving and moving.stretch.terrain == stop.stretch.terrain:
        return [_joined(moving, stop)]
    standing = _standing(stop)
    return [moving, standing] if moving else [standing]


_Step = tuple[Measured | None, Measured | None, list[Measured]]


def _stand(meter: DriveMeter, interval: Measured) -> _Step:
    """Stretch, stop and finished parts after an interval of standing."""
    stop = _together(meter.stop, interval)
    if stop.stretch.time_s < STANDS_S:
        return meter.moving, stop, []
    standing = _standing(stop)
    done = [meter.moving] if meter.moving else []
    if standing.stretch.time_s >= STRETCH_S:
        return None, None, [*done, standing]
    return None, standing, done


def _move(meter: DriveMeter, interval: Measured) -> _Step:
    """Stretch, stop and finished parts after an interval of moving."""
    moving, done = meter.moving, []
    if meter.stop and meter.stop.stretch.terrain:
        interval = _together(meter.stop, interval)
    elif meter.stop:
        done.append(meter.stop)
    if moving and moving.stretch.terrain != interval.stretch.terrain:
        done.append(moving)
        moving = None
    moving = _together(moving, interval)
    if moving.stretch.time_s >= STRETCH_S:
        return None, None, [*done, moving]
    return moving, None, done


def _standing(stop: Measured) -> Measured:
    """A stop as a stretch of its own."""
    return stop._replace(stretch=Stretch("", stop.stretch.time_s))


def _interval(a: DriveSample, b: DriveSample) -> Measured:
    """Motion and energy between two samples by the trapezoidal rule, on the ground of the first."""
    half_s = 0.5 * (b.time_s - a.time_s)
    v, w = abs(a.speed_m_s), abs(b.speed_m_s)
    stretch = Stretch(
        a.terrain,
        time_s=2.0 * half_s,
        distance_m=half_s * (v + w),
        speed_distance_m2_s=half_s * (v * v + w * w),
        kinetic_m2_s2=0.5 * (w * w - v * v),
    )
    climbing_m_s = [s.speed_m_s * math.sin(s.grade_rad) for s in (a, b) if abs(s.grade_rad) <= STEEPEST_RAD]
    rise_m = 2.0 * half_s * sum(climbing_m_s) / max(len(climbing_m_s), 1)
    return Measured(stretch, half_s * (a.battery_W + b.battery_W), rise_m, stretch.time_s)


def _together(first: Measured | None, second: Measured) -> Measured:
    """Join two consecutive parts of one stretch; the height gained enters the stretch when that is due."""
    if first is None:
        return second
    both = _joined(first, second)
    return _finished(both) if both.rise_s >= HEIGHT_S else both


def _joined(first: Measured, second: Measured) -> Measured:
    """Two consecutive parts of one stretch as one."""
    return Measured(
        joined(first.stretch, second.stretch),
        first.energy_J + second.energy_J,
        first.rise_m + second.rise_m,
        first.rise_s + second.rise_s,
    )


def _finished(part: Measured) -> Measured:
    """The part with its height gained added to climb or descent; a stop has none."""
    if not part.stretch.terrain:
        return part._replace(rise_m=0.0, rise_s=0.0)
    climb_m = part.stretch.climb_m + max(part.rise_m, 0.0)
    descent_m = part.stretch.descent_m + max(-part.rise_m, 0.0)
    return Measured(part.stretch._replace(climb_m=climb_m, descent_m=descent_m), part.energy_J)
