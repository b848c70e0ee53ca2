"""History of a battery: its logs in order of time, and the health that each of them alone shows.

Capacity of a discharge: what the battery gives from full down to where its recent discharges have ended.

    D = Q (1 - s_low)

Q is the charge down to the empty end of the open-circuit curve; a high current, or a resistance that has grown, ends a
discharge earlier, at s_low. Q and s_low are found together from the same log, and their errors cancel in D: it is as
accurate as the count of that charge, and as the full charge before or after it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal
from ohmward.battery.health.ageing import REVERSIBLE_STD, HealthPoint, logarithm
from ohmward.battery.learning.fold import pulse_ohm
from ohmward.battery.learning.log_update import LogUpdate
from ohmward.errors import InputError
from ohmward.logs.log import SECONDS_PER_HOUR, Log

#: A battery that has been below this SoC counts as emptied in use.
_EMPTIED_BELOW = 0.25
#: A discharge that gave this share of the previous one was not broken off: a battery loses less from one to the next.
_WHOLE = 0.95
#: A battery above this SoC has been charged fully.
_FULLY_CHARGED_SOC = 0.97
#: A file with a larger error of the resistances was not tested: the first logs stand for the new battery.
_TESTED_RESISTANCE_STD = 0.35
#: A log shows the resistance if it determines it better than this.
_KNOWN_RESISTANCE_STD = 0.1


class DatedLogs(NamedTuple):
    """Logs in order of time."""

    logs: tuple[Log, ...]  #: as given, in order
    start_s: np.ndarray  #: (n,) Unix time of their first samples; if no log has a clock, time since the first
    has_clock: bool  #: True where these are dates
    notes: tuple[str, ...] = ()  #: assumptions about the time
    left_out: tuple[str, ...] = ()  #: logs whose time is not known, among more that have one, and why


class Newness(NamedTuple):
    """Battery when new, the reference for its health."""

    capacity_Ah: float  #: between full and empty
    resistance_ohm: float  #: of a pulse of 1 C and ten seconds at half charge and 25 degC
    notes: tuple[str, ...] = ()  #: sources of these values


def in_order_of_time(logs: Sequence[Log]) -> DatedLogs:
    """The logs in order of their clocks; without any clock, one after the other as they are given.

    Raises:
        InputError: no logs, or as many have no clock as have one.
    """
    if not logs:
        raise InputError("health needs at least one log")
    dated = [(log.begin_unix_s, log) for log in logs if log.begin_unix_s is not None]
    without = tuple(
        f"{log.name}: no date in this log, one that may name the day or the month first, or that of a clock that was "
        "not set, but there is one in others, so their order is not known; give it dates (a column of dates or Unix "
        "time), or say how they are written with --time-format '%d.%m.%Y %H:%M:%S' (FileHints(time_format=...))"
        for log in logs
        if log.begin_unix_s is None
    )
    if len(dated) > len(without):
        begins, ordered = zip(*sorted(dated, key=lambda pair: pair[0]), strict=True)
        return DatedLogs(ordered, np.array(begins), True, left_out=without)
    if dated:
        raise InputError(f"{without[0]}, or leave it out")
    ends_s = np.cumsum([log.duration_s for log in logs])
    note = "no log has a wall clock: the order given is used, without pauses in between"
    return DatedLogs(tuple(logs), ends_s - [log.duration_s for log in logs], False, (note,))


def unlearnt(battery: Battery) -> Battery:
    """The battery as if it had learnt from no log: health uses all logs, also those that are in the file already."""
    knowledge = battery.knowledge
    return battery if knowledge is None else replace(battery, knowledge=replace(knowledge, logs=()))


def newness(battery: Battery, updates: Sequence[LogUpdate], capacity_Ah: float | None = None) -> Newness:
    """The battery when new: the file's, but with the resistance of the first logs if the file was not tested."""
    new_Ah = battery.capacity_Ah if capacity_Ah is None else capacity_Ah
    source = "the battery file's" if capacity_Ah is None else "as given"
    notes = [f"capacity when new: {new_Ah:.4g} Ah, {source}"]
    if capacity_Ah is None and battery.knowledge is not None:
        notes.append(
            "the battery file has learnt since the battery was new, so its capacity has changed; say what it was then"
        )
    learnt = [update for update in updates if update.verdict != "set aside"]
    if not learnt:
        return Newness(new_Ah, math.nan, tuple(notes))
    if battery.noise.resistance_std <= _TESTED_RESISTANCE_STD:
        new_ohm = pulse_ohm(battery.thevenin)
        return Newness(new_Ah, new_ohm, (*notes, f"resistance when new: {1e3 * new_ohm:.3g} mΩ, the battery file's"))
    known = next((x for x in learnt if x.own_resistance_ohm.relative_std < _KNOWN_RESISTANCE_STD), learnt[-1])
    new_ohm = (
        known.own_resistance_ohm.mean if math.isfinite(known.own_resistance_ohm.std) else known.resistance_ohm.mean
    )
    text = f"resistance when new: nobody tested it; {1e3 * new_ohm:.3g} mΩ of {known.log}, the first log that shows it"
    return Newness(new_Ah, new_ohm, (*notes, text))


def points_of(dated: DatedLogs, updates: Sequence[LogUpdate], new: Newness) -> list[HealthPoint]:
    """One point per log; a log that was set aside has only its time and throughput, a copy of another only its time.

    The capacity is that of a discharge in use, over what a new battery would have given down to the end of its first
    discharge; of a deeper one only the share down to there. If it is never emptied, it is the whole capacity.
    """
    used = used_capacities(updates)
    first = next((each.latest for each in used if each.latest), None)
    new_Ah = new.capacity_Ah * (1.0 if first is None else 1.0 - first.soc)
    points = []
    for log, start_s, update, each in zip(dated.logs, dated.start_s, updates, used, strict=True):
        point = _point(log, start_s, update, new)
        if update.verdict != "set aside":
            own_Ah = update.own_capacity_Ah if first is None else _own_discharge(update, each, first)
            point = point._replace(
                log_capacity=logarithm(own_Ah, new_Ah),
                log_resistance=logarithm(update.own_resistance_ohm, new.resistance_ohm),
            )
        points.append(point)
    return points


def common_error(battery: Battery, updates: Sequence[LogUpdate]) -> float:
    """Relative error that all logs share: of the capacity, the sensor's gain, and the empty end of the curve.

    Along the charge below full the curve is the same whatever the capacity is: later logs are relative to the capacity
    after the first. Where discharges are compared, they are relative to the first that shows their end.
    """
    used = used_capacities(updates)
    first = next((update for update, each in zip(updates, used, strict=True) if each.latest), None)
    if first is not None:
        return first.capacity_Ah.relative_std
    of_first = next((update.capacity_Ah.relative_std for update in updates if update.verdict == "learnt"), 0.0)
    return max(of_first, math.hypot(battery.sensor.gain_std, battery.noise.soc_axis_std))


def _own_discharge(update: LogUpdate, used: UsedCapacity, first: FullDischarge) -> Normal:
    """Capacity of a discharge no deeper than the first; its std is inf unless this log shows its end."""
    mean, std = used.capacity_Ah.mean, used.capacity_Ah.std
    if used.latest is None or used.latest.log != update.log:
        return Normal(mean, math.inf)
    is_deeper = used.latest.given_Ah.mean > first.given_Ah.mean
    share = min((1.0 - first.soc) / (1.0 - used.latest.soc), 1.0) if is_deeper else 1.0
    return Normal(share * mean, share * std)


def _point(log: Log, start_s: float, update: LogUpdate, new: Newness) -> HealthPoint:
    """Time, throughput, temperature and anchors of a log."""
    degC = log.temperature_degC
    return HealthPoint(
        log=log.name,
        time_s=start_s + log.duration_s / 2,
        hours=log.duration_s / SECONDS_PER_HOUR,
        cycles=0.0 if update.verdict == "seen" else log.throughput_Ah() / (2 * new.capacity_Ah),
        temperature_degC=math.nan if degC is None or np.isnan(degC).all() else float(np.nanmean(degC)),
        full=update.soc_max >= _FULLY_CHARGED_SOC,
    )


class FullDischarge(NamedTuple):
    """The latest discharge that was not broken off, or the charge after it."""

    log: str  #: its name
    soc: float  #: at its end
    given_Ah: Normal  #: charge from full down to there, as the battery's own sensor counts it


class UsedCapacity(NamedTuple):
    """Capacity of a battery as it is used, after an update."""

    latest: FullDischarge | None  #: the discharge that shows it; None where the battery was not emptied yet
    capacity_Ah: Normal  #: of a discharge; the whole capacity while the end of discharges is unknown


def used_capacities(updates: Sequence[LogUpdate]) -> list[UsedCapacity]:
    """Capacity of a discharge after each update."""
    found = []
    latest: FullDischarge | None = None
    for update in updates:
        if latest is None:
            whole = update.soc_min < _EMPTIED_BELOW
        else:
            whole = update.given_Ah.mean >= _WHOLE * latest.given_Ah.mean
        if whole:
            latest = FullDischarge(update.log, max(update.soc_min, 0.0), _as_counted(update))
        given = None if latest is None else latest.given_Ah  # by the next discharge, up to reversible changes
        next_Ah = given and given._replace(std=math.hypot(given.std, REVERSIBLE_STD * given.mean))
        found.append(UsedCapacity(latest, next_Ah or update.capacity_Ah))
    return found


def _as_counted(update: LogUpdate) -> Normal:
    """Charge from full down to the lowest SoC as the sensor counts it, its offset over the log included.

    A charge counts the offset with the opposite sign of a discharge; where a log has both, it cancels.
    """
    turned = (update.soc_end.mean - update.soc_start.mean) / max(update.soc_max - update.soc_min, 1e-3)
    return update.given_Ah._replace(mean=update.given_Ah.mean + turned * update.offset_A.mean * update.hours)
