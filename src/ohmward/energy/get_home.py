"""Mission forecast: probability of driving a plan with the reserve left, state on the way, point of return."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.checks import require_between
from ohmward.energy.consumption import Consumption, energy_demand, energy_demands
from ohmward.energy.leg import Leg, Stretch, part_of, stretch_of, total_distance_m, total_time_s, way_back
from ohmward.energy.points import Quantiles, normal_points, quantiles
from ohmward.energy.range import BATTERY, DIMENSIONS, needed_J, with_peaks
from ohmward.energy.usable_energy import BatteryState, discharge, soc_after, usable_J
from ohmward.errors import InputError

#: Halvings of the way out when the latest point of return is looked for.
_HALVINGS = 20


class Milestone(NamedTuple):
    """Forecast for the end of a leg."""

    #: since the start of the plan
    distance_m: float
    time_s: float
    energy_J: Quantiles  #: taken since the start
    soc: Quantiles  #: state of charge; that of the end of the discharge where the battery does not reach
    probability: float  #: of getting here with the reserve left


class MissionForecast(NamedTuple):
    """Forecast for a plan."""

    probability: float  #: of driving all of it with the reserve left
    milestones: tuple[Milestone, ...]  #: one for each leg
    usable_J: Quantiles  #: energy above the reserve at the start
    power_W: float  #: mean power of the plan
    #: farthest distance along the plan from which the way back, over the same ground, can still be driven with the
    #: confidence asked for; 0 where not even that is
    point_of_return_m: float


def get_home(
    c: Consumption, plan: Sequence[Leg], battery: Battery, state: BatteryState, confidence: float = 0.95
) -> MissionForecast:
    """Forecast for a plan, driven as part of the drive under way; call `begin_drive` first for a drive of its own.

    Raises:
        InputError: a plan that is empty or takes no time, a terrain that is not known, a confidence outside 0.5 to
            0.999.
    """
    require_between("confidence", confidence, 0.5, 0.999)
    if not plan:
        raise InputError("the plan has no leg; add at least one [[leg]]")
    stretches = [stretch_of(leg) for leg in plan]
    z = normal_points(DIMENSIONS)
    if not (duration_s := total_time_s(stretches)) > 0.0:
        raise InputError("the plan takes no time: no leg has a distance or a stop; give one of them")
    demands = energy_demands(c, stretches)
    power_W = float(demands.mean_J[-1]) / duration_s
    battery_points = discharge(battery, with_peaks(state, c, stretches), power_W, z[BATTERY])
    usable = usable_J(battery_points)

    def milestone(distance_m: float, time_s: float, energy: np.ndarray) -> Milestone:
        soc = soc_after(battery_points, np.maximum(energy, 0.0))
        return Milestone(distance_m, time_s, quantiles(energy), quantiles(soc), float(np.mean(energy <= usable)))

    lengths, times = accumulate(s.distance_m for s in stretches), accumulate(s.time_s for s in stretches)
    milestones = tuple(map(milestone, lengths, times, needed_J(demands, z)))
    turn_m = point_of_return(c, stretches, usable, confidence)
    return MissionForecast(milestones[-1].probability, milestones, quantiles(usable), power_W, turn_m)


def point_of_return(c: Consumption, plan: Sequence[Stretch], usable: np.ndarray, confidence: float) -> float:
    """Farthest distance [m] along the plan from which the robot comes back over the same ground, by bisection.

    usable: (N,) energy [J] that the battery gives, at the points of `normal_points`.
    """
    z = normal_points(DIMENSIONS)
    length_m = total_distance_m(plan)

    def returns(distance_m: float) -> bool:
        out = beginning(plan, distance_m)
        energy = needed_J(energy_demand(c, [*out, *map(way_back, out)]), z)
        return float(np.mean(energy <= usable)) >= confidence

    if returns(length_m):
        return length_m
    near_m, far_m = 0.0, length_m
    for _ in range(_HALVINGS):
        middle_m = (near_m + far_m) / 2
        if returns(middle_m):
            near_m = middle_m
        else:
            far_m = middle_m
    return near_m


def beginning(plan: Sequence[Stretch], distance_m: float) -> list[Stretch]:
    """The first metres of a plan, never empty."""
    taken = []
    left_m = distance_m
    for s in plan:
        share = 1.0 if s.distance_m <= left_m else left_m / s.distance_m
        taken.append(part_of(s, share))
        left_m -= share * s.distance_m
        if share < 1.0:
            break
    return taken
