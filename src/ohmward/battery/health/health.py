"""State of health over months, from what single logs show: the trend, sudden changes, and the time left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal
from ohmward.battery.health.ageing import (
    DAY_S,
    WORN_SHARE,
    AgeingFit,
    CapacityUncertainty,
    HealthPoint,
    LifeAhead,
    Track,
    ageing_laws,
    fit_ageing,
    life_ahead,
    no_law,
)
from ohmward.battery.health.changes import Outlier, SuddenChange, find_change, outliers, without_change

#: Steps that are looked for, the most evident first.
_MOST_CHANGES = 3
#: Cells of one type leave the factory within this of each other (1 sigma); a label promises the least of them.
NEW_CAPACITY_STD = 0.03
#: Resistance of one log to the next that comes and goes: other currents and another range of SoC.
_RESISTANCE_REVERSIBLE_STD = 0.05


class Health(NamedTuple):
    """Health of a battery over its logs."""

    points: tuple[HealthPoint, ...]  #: every log in order of time
    #: trends of ln(capacity) and ln(resistance) over those when new
    capacity: AgeingFit
    resistance: AgeingFit
    #: what is no ageing, or may not be
    changes: tuple[SuddenChange, ...]
    outliers: tuple[Outlier, ...]
    ahead: LifeAhead  #: what may become of the capacity, and when the battery will be worn out

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
    """Health over the logs that these points are of.

    battery: its chemistry, and how its capacity and resistance may walk.
    points: at least one, in any order.
    share: of the capacity when new, to which the time left counts.
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
    """Trend of the capacity without its sudden changes, and these."""
    laws, uncertainty = ageing_laws(battery.chemistry), _uncertainty(battery, common_std)
    track = Track.of(points, "log_capacity")
    changes: list[SuddenChange] = []
    fit = fit_ageing(laws, track, uncertainty)
    while len(changes) < _MOST_CHANGES and (change := find_change(fit, usable)):
        changes.append(change)
        track = without_change(track, change)
        fit = fit_ageing(laws, track, uncertainty)
    return fit, sorted(changes, key=lambda change: change.days)


def _uncertainty(battery: Battery, common_std: float | None) -> CapacityUncertainty:
    """Doubt about the capacity that no log settles."""
    noise = battery.noise
    if common_std is None:
        common_std = math.hypot(battery.sensor.gain_std, noise.soc_axis_std)
    return CapacityUncertainty(NEW_CAPACITY_STD, common_std, noise.capacity_walk)


def _resistance(battery: Battery, points: Sequence[HealthPoint]) -> AgeingFit:
    """Trend of the resistance: no law, a random walk."""
    noise = battery.noise
    # the filter's walk in 100 hours is most of it what comes and goes; what stays takes ten times as long
    uncertainty = CapacityUncertainty(noise.resistance_std, battery.sensor.gain_std, noise.resistance_walk)
    return fit_ageing(no_law(), Track.of(points, "log_resistance"), uncertainty, _RESISTANCE_REVERSIBLE_STD)


def _at(fit: AgeingFit, days: float, cycles: float) -> Normal:
    band = fit.band(np.array([days]), np.array([cycles]))
    return Normal(float(band.mean[0]), float(band.std[0]))
