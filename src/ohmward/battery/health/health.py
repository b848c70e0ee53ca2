"""Health of a battery over months: learn from each of its logs in order of time, then judge the trend.

The result is the trend, sudden changes, and the time left. Where the logs do not show the capacity, it is that of the
filter over all logs, as on board, or not known; there is no trend and no time left then.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.chemistries import Normal
from ohmward.battery.health.ageing import (
    WORN_SHARE,
    AgeingFit,
    CapacityUncertainty,
    HealthPoint,
    LifeAhead,
    Track,
    ageing_laws,
    fit_ageing,
    life_ahead,
    logarithm,
    no_law,
)
from ohmward.battery.health.capacity_over_logs import capacity_over_logs, shows_capacity
from ohmward.battery.health.changes import Outlier, SuddenChange, find_change, outliers, without_change
from ohmward.battery.health.history import (
    DatedLogs,
    Newness,
    common_error,
    in_order_of_time,
    newness,
    points_of,
    unlearnt,
)
from ohmward.battery.learning.learn import learn
from ohmward.battery.learning.log_update import LogUpdate
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError
from ohmward.logs.log import LogSource, as_logs
from ohmward.quantities import DAY_S
from ohmward.rich_display import RichDisplay

#: Seed of the batteries that are simulated for the time left: equal logs give equal answers.
_SEED = 1
#: Largest number of steps that are searched for, the most evident first.
_MOST_CHANGES = 3
#: Relative spread of the capacity of new cells of one type (1 sigma); a label promises the least of them.
NEW_CAPACITY_STD = 0.03
#: Reversible change of the resistance from one log to the next: other currents and another range of SoC.
_RESISTANCE_REVERSIBLE_STD = 0.05


class Health(NamedTuple):
    """Health of a battery over its logs."""

    points: tuple[HealthPoint, ...]  #: every log in order of time
    #: trends of ln(capacity) and ln(resistance) over those when new
    capacity: AgeingFit
    resistance: AgeingFit
    #: steps and single logs that ageing does not explain, or may not
    changes: tuple[SuddenChange, ...]
    outliers: tuple[Outlier, ...]
    ahead: LifeAhead  #: distribution of the future capacity, and of when the battery will be worn out

    @property
    def now(self) -> tuple[float, float]:
        """Days and full cycles at the last log, since the first."""
        return _span(self.points)

    @property
    def capacity_now(self) -> Normal:
        """ln(capacity over that when new) at the last log."""
        return _at(self.capacity, *self.now)

    @property
    def resistance_now(self) -> Normal:
        """ln(resistance over that when new) at the last log."""
        return _at(self.resistance, *self.now)


def health_of(
    battery: Battery,
    points: Sequence[HealthPoint],
    rng: np.random.Generator,
    share: float = WORN_SHARE,
    common_std: float | None = None,
) -> Health:
    """Health over the logs that these points come from.

    battery: for its chemistry, and the random walk of its capacity and resistance.
    points: at least one, in any order.
    share: of the capacity when new, at which the battery counts as worn out.
    common_std: relative error of the capacity that all logs share; by default that of the sensor's gain and of the
        ends of the curve.
    """
    points = tuple(sorted(points, key=lambda point: point.time_s))
    usable = [point for point in points if point.shows_capacity]
    capacity, changes = _without_changes(battery, usable, points, common_std)
    resistance = _resistance(battery, points)
    ahead = life_ahead(capacity, *_span(points), rng, share)
    return Health(points, capacity, resistance, tuple(changes), tuple(outliers(capacity, usable)), ahead)


def _span(points: Sequence[HealthPoint]) -> tuple[float, float]:
    """Days and full cycles from the first log to the last."""
    return (points[-1].time_s - points[0].time_s) / DAY_S, sum(point.cycles for point in points)


def _without_changes(
    battery: Battery, usable: Sequence[HealthPoint], points: Sequence[HealthPoint], common_std: float | None
) -> tuple[AgeingFit, list[SuddenChange]]:
    """Trend of the capacity without its sudden changes, and the changes."""
    common_std = common_error(battery, ()) if common_std is None else common_std
    uncertainty = CapacityUncertainty(NEW_CAPACITY_STD, common_std, battery.noise.capacity_walk)
    laws = ageing_laws(battery.chemistry)
    track = Track.of(points, "log_capacity")
    changes: list[SuddenChange] = []
    fit = fit_ageing(laws, track, uncertainty)
    while len(changes) < _MOST_CHANGES and (change := find_change(fit, usable)):
        changes.append(change)
        track = without_change(track, change)
        fit = fit_ageing(laws, track, uncertainty)
    return fit, sorted(changes, key=lambda change: change.days)


def _resistance(battery: Battery, points: Sequence[HealthPoint]) -> AgeingFit:
    """Trend of the resistance: a random walk without an ageing law."""
    noise = battery.noise
    # most of the filter's walk in 100 hours is reversible; the change that stays takes ten times as long
    uncertainty = CapacityUncertainty(noise.resistance_std, battery.sensor.gain_std, noise.resistance_walk)
    return fit_ageing(no_law(), Track.of(points, "log_resistance"), uncertainty, _RESISTANCE_REVERSIBLE_STD)


def _at(fit: AgeingFit, days: float, cycles: float) -> Normal:
    mean, std = fit.band(np.array([days]), np.array([cycles]))
    return Normal(float(mean[0]), float(std[0]))


@dataclass(frozen=True, eq=False, repr=False)
class BatteryHealth(RichDisplay):
    """Logs of a battery, what was learnt from each, and the health that follows."""

    battery: Battery
    new: Newness  #: capacity and resistance that the health is measured against
    dated: DatedLogs  #: the logs in order of time
    updates: Sequence[LogUpdate]  #: one for each log
    health: Health  #: trends, sudden changes, and the time left
    #: ln(capacity over that when new) at the last log; None where it is not known
    capacity: Normal | None
    #: "logs" if these show the capacity and its trend, "filter" if only the filter over all logs does
    capacity_by: Literal["logs", "filter"] | None

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions about the time of the logs and about the battery when new."""
        return (*self.dated.notes, *self.new.notes)

    def __repr__(self) -> str:
        capacity = "not known" if self.capacity is None else f"{100 * np.exp(self.capacity.mean):.0f} %"
        return (
            f"BatteryHealth({self.battery.name!r}, {len(self.updates)} logs, capacity {capacity}, resistance "
            f"{100 * np.exp(self.health.resistance_now.mean):.0f} % of those when new)"
        )


def health(
    battery: Battery,
    logs: LogSource | Sequence[LogSource],
    *,
    new_capacity_Ah: float | None = None,
    worn: float = WORN_SHARE,
    progress: Callable[[str, float], None] | None = None,
) -> BatteryHealth:
    """Capacity and resistance relative to new over months of logs, sudden changes, and the time left.

    >>> found = ow.health(ow.load_battery("battery.toml"), ["day.csv", "next-day.csv"])
    >>> found.plot().save("health.html")

    battery: as it was when new.
    logs: in any order if they have clocks; or paths or DataFrames of them.
    new_capacity_Ah: of the battery when new; by default the battery file's.
    worn: share of the capacity when new, at which the battery counts as worn out.
    progress: called with the name of a log and the share of the work that is done.

    Raises:
        InputError: some logs have a clock and some have none, or no log shows the health of this battery.
    """
    require_battery(battery)
    require_between("worn", worn, 0.05, 0.99)
    if new_capacity_Ah is not None:
        require_positive("new_capacity_Ah", new_capacity_Ah)
    dated = in_order_of_time(as_logs(logs))
    learnt = learn(unlearnt(battery), dated.logs, progress=progress)
    if not any(update.verdict == "learnt" for update in learnt.updates):  # the health would be that of the label
        first = learnt.updates[0]
        raise InputError(
            f"no log shows the health of this battery ({len(learnt.updates)} given); {first.log}: {first.reason}"
        )
    new = newness(battery, learnt.updates, new_capacity_Ah)
    points = points_of(dated, learnt.updates, new)
    common = common_error(learnt.battery, learnt.updates)
    found = health_of(battery, points, np.random.default_rng(_SEED), worn, common)
    of_logs = BatteryHealth(battery, new, dated, learnt.updates, found, found.capacity_now, "logs")
    if any(point.shows_capacity for point in points) and shows_capacity(battery, found.capacity_now):
        return of_logs
    on_board = _capacity_on_board(battery, dated, learnt.updates)
    if not shows_capacity(battery, logarithm(on_board, 1.0)):
        return replace(of_logs, capacity=None, capacity_by=None)
    over_new = logarithm(on_board, new.capacity_Ah / battery.capacity_Ah)
    return replace(of_logs, capacity=over_new, capacity_by="filter")


def _capacity_on_board(battery: Battery, dated: DatedLogs, updates: Sequence[LogUpdate]) -> Normal:
    """Capacity over the battery file's as a filter finds it that runs through the logs one after the other."""
    estimator, found = SocEstimator(battery), [(-math.inf, 1.0, math.inf)]
    for log, start_s, update in zip(dated.logs, dated.start_s.tolist(), updates, strict=True):
        if update.verdict != "learnt" or start_s < found[-1][0]:
            continue
        estimates = estimator.run(replace(log, time_s=log.time_s - log.time_s[0] + start_s)).estimates
        capacity = float(estimates.soh_capacity[-1]), float(estimates.soh_capacity_std[-1])
        found.append((start_s + log.duration_s, *capacity))
    over_logs = capacity_over_logs(battery, *zip(*found[1:], strict=True))
    return Normal(float(over_logs.mean[-1]), float(over_logs.std[-1]))
