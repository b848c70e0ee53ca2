"""Stretches of a drive under way, sample by sample; `cut_drive` cuts a recorded one."""

from __future__ import annotations

import math
from typing import NamedTuple

from ohmward.energy.leg import Stretch, joined
from ohmward.energy.recorded import Cut


class DriveSample(NamedTuple):
    """Measurements at an instant of a drive; nan where one is missing."""

    time_s: float  #: on any clock
    speed_m_s: float  #: forward
    battery_W: float  #: > 0 out of the battery
    grade_rad: float  #: > 0 with the nose up
    terrain: str  #: name of the ground


class Measured(NamedTuple):
    """A stretch that is under way."""

    stretch: Stretch  #: so far
    energy_J: float  #: out of the battery
    #: height won since the last height was taken, and the time since then
    rise_m: float = 0.0
    rise_s: float = 0.0


class DriveMeter(NamedTuple):
    """State of a drive under way: the last sample, the stretch so far, and the stop that may be a part of it."""

    last: DriveSample | None = None
    moving: Measured | None = None
    stop: Measured | None = None


def advance(meter: DriveMeter, now: DriveSample, cut: Cut) -> tuple[DriveMeter, list[Measured]]:
    """The drive after a sample, and the stretches that it has finished.

    A stop that is shorter than `cut.standing_s` is a part of the stretch in which it happens. What was not measured, or
    not for more than `cut.gap_s`, is left out.
    """
    before = meter.last
    if before is None or not _is_bridged(before, now, cut):
        return DriveMeter(now), [_finished(part) for part in (meter.moving, meter.stop) if part]
    interval = _interval(before, now)
    if max(abs(before.speed_m_s), abs(now.speed_m_s)) < cut.standing_m_s:
        moving, stop, done = _stand(meter, _standing(interval), cut)
    else:
        moving, stop, done = _move(meter, interval, cut)
    return DriveMeter(now, moving, stop), [_finished(part) for part in done]


_Step = tuple[Measured | None, Measured | None, list[Measured]]


def _stand(meter: DriveMeter, interval: Measured, cut: Cut) -> _Step:
    """Stretch, stop and what is finished after an interval in which the robot stands."""
    stop = _together(meter.stop, interval, cut)
    if stop.stretch.time_s < cut.standing_s:
        return meter.moving, stop, []
    standing = stop._replace(stretch=Stretch("", stop.stretch.time_s))
    done = [meter.moving] if meter.moving else []
    if standing.stretch.time_s >= cut.longest_s:
        return None, None, [*done, standing]
    return None, standing, done


def _move(meter: DriveMeter, interval: Measured, cut: Cut) -> _Step:
    """Stretch, stop and what is finished after an interval in which the robot moves."""
    moving, done = meter.moving, []
    if meter.stop and meter.stop.stretch.terrain:
        interval = _together(meter.stop, interval, cut)
    elif meter.stop:
        done.append(meter.stop)
    if moving and moving.stretch.terrain != interval.stretch.terrain:
        done.append(moving)
        moving = None
    moving = _together(moving, interval, cut)
    if moving.stretch.time_s >= cut.longest_s:
        return None, None, [*done, moving]
    return moving, None, done


def _is_bridged(before: DriveSample, now: DriveSample, cut: Cut) -> bool:
    """True where the line between two samples can be believed."""
    measured = (before.speed_m_s, before.battery_W, now.speed_m_s, now.battery_W)
    return all(map(math.isfinite, measured)) and 0.0 < now.time_s - before.time_s <= cut.gap_s


def _standing(interval: Measured) -> Measured:
    """The same as time in which the robot stands."""
    return interval._replace(stretch=interval.stretch._replace(standing_s=interval.stretch.time_s))


def _interval(a: DriveSample, b: DriveSample) -> Measured:
    """The way between two samples by the trapezoidal rule, on the ground of the first."""
    half_s = 0.5 * (b.time_s - a.time_s)
    v, w = abs(a.speed_m_s), abs(b.speed_m_s)
    stretch = Stretch(
        a.terrain,
        time_s=2.0 * half_s,
        distance_m=half_s * (v + w),
        speed_distance_m2_s=half_s * (v * v + w * w),
        kinetic_m2_s2=0.5 * (w * w - v * v),
    )
    climbing_m_s = [s.speed_m_s * math.sin(s.grade_rad) for s in (a, b) if math.isfinite(s.grade_rad)]
    rise_m = half_s * sum(climbing_m_s)
    return Measured(stretch, half_s * (a.battery_W + b.battery_W), rise_m, stretch.time_s)


def _together(first: Measured | None, second: Measured, cut: Cut) -> Measured:
    """Two parts of one stretch, one after the other, with the heights taken that are due."""
    if first is None:
        return second
    both = Measured(
        joined(first.stretch, second.stretch),
        first.energy_J + second.energy_J,
        first.rise_m + second.rise_m,
        first.rise_s + second.rise_s,
    )
    return _finished(both) if both.rise_s >= cut.height_s else both


def _finished(part: Measured) -> Measured:
    """The same with its height taken; one that stands has none."""
    if not part.stretch.terrain:
        return part._replace(rise_m=0.0, rise_s=0.0)
    climb_m = part.stretch.climb_m + max(part.rise_m, 0.0)
    descent_m = part.stretch.descent_m + max(-part.rise_m, 0.0)
    return Measured(part.stretch._replace(climb_m=climb_m, descent_m=descent_m), part.energy_J)
