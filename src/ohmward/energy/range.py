"""Range, the distance and time left with the battery, as P10, P50 and P90; and the forecast of a mission.

Over a distance D of ground like the given stretches, the robot takes  e D + s z sqrt(D)  with the energy per metre e,
itself uncertain, and a scatter that averages out; the battery gives E. Each of 4096 evenly spread points of
(battery, consumption) has its own e, s, z and E, and so its own distance:

sqrt(D) = [ -s z + sqrt(s^2 z^2 + 4 e E) ] / (2 e).

The forecast of a plan: probability of completing it with the reserve left, state on the way, point of return.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.checks import require_between
from ohmward.energy.consumption import (
    SHORTEST_M,
    Consumption,
    EnergyDemand,
    design_row,
    energy_demand,
    energy_demands,
    start,
    with_ground,
)
from ohmward.energy.leg import Leg, Stretch, part_of, stretch_of, total_distance_m, total_time_s, way_back
from ohmward.energy.peaks import PeakRatio, peaks_of_way
from ohmward.energy.points import Quantiles, normal_points, quantiles, student
from ohmward.energy.usable_energy import BATTERY_DIMENSIONS, BatteryState, discharge, soc_after, usable_at, usable_J
from ohmward.errors import InputError
from ohmward.quantities import SECONDS_PER_HOUR

#: Dimensions of the points: those of the battery; then, of the consumption, coefficients, day effects and scatter.
DIMENSIONS = BATTERY_DIMENSIONS + 3
BATTERY, COEFFICIENTS, DAY_EFFECTS, SCATTER = slice(0, BATTERY_DIMENSIONS), *range(BATTERY_DIMENSIONS, DIMENSIONS)
#: Smallest energy [J] and distance [m] used as a divisor.
_LEAST_J = _LEAST_M = 1e-9
#: Level ground takes more than this share of what was expected before the first drive, or the power was not measured.
_CREDIBLE_SHARE = 0.03
#: Least energy per metre of level ground, relative to the mean.
_LEAST_ENERGY_SHARE = 0.1


class Range(NamedTuple):
    """Distance, time and energy that are left."""

    distance_m: Quantiles  #: until the reserve
    time_s: Quantiles
    usable_J: Quantiles  #: energy above the reserve
    energy_J_per_m: Quantiles  #: consumption on the way ahead
    power_W: float  #: mean power on the way ahead


def range_left(
    c: Consumption, ahead: Sequence[Stretch], battery: Battery, state: BatteryState, is_known: bool = True
) -> Range:
    """Distance and time left over ground like `ahead`, of any length above zero, without its mean slope.

    is_known: True where `ahead` is the ground ahead itself; False where these are recent stretches, and the ground
        ahead is another sample of the same kind.

    Raises:
        InputError: no distance ahead, or a terrain that is not known.
    """
    length_m, time_s = total_distance_m(ahead), total_time_s(ahead)
    if not length_m > 0:
        raise InputError("the way ahead has no distance; give stretches that are driven")
    ahead = level(ahead)
    whole = way_demand(c, ahead, is_known).at(-1)
    power_W = whole.mean_J / time_s
    z = normal_points(DIMENSIONS)
    usable = usable_at(battery, with_peaks(state, c, ahead), power_W, z[BATTERY])
    per_m = spent_J(whole, z) / length_m
    scatter = scattered_part(whole, z) / np.sqrt(length_m)
    distance = distances(per_m, scatter, usable)
    return Range(
        quantiles(distance),
        quantiles(distance * time_s / length_m),
        quantiles(usable),
        quantiles(per_m + scatter / np.sqrt(length_m)),
        power_W,
    )


#: Number of places along a plan at which the energy is evaluated, and of parts of the ground beyond its end.
_LOOKED_AT, _GROUND_PARTS = 65, 8


def range_along(
    c: Consumption,
    plan: Sequence[Stretch],
    then: Sequence[Stretch],
    battery: Battery,
    state: BatteryState,
    ratio: PeakRatio = PeakRatio(),  # noqa: B008, a tuple
) -> Range:
    """Distance and time left along a plan, and beyond its end over unknown ground like `then` without its mean slope.

    Each sample point ends where the energy that it needs first exceeds what its battery gives.

    ratio: of peak to mean power, over the stretches driven so far.

    Raises:
        InputError: no distance in `then`, or a terrain that is not known.
    """
    z, then = normal_points(DIMENSIONS), level(then)
    way = planned_way(c, plan, then, battery, state)
    length_m, time_s = (np.cumsum(column) for column in zip(*((s.distance_m, s.time_s) for s in way), strict=True))
    unknown_J = ground_std(c, then) * np.maximum(length_m - total_distance_m(plan), 0.0)
    demand = energy_demands(c, way)
    demand = demand._replace(learned_J2=demand.learned_J2 + unknown_J**2)
    power_W = float(demand.mean_J[-1] / time_s[-1])
    usable = usable_at(battery, replace(state, peaks=peaks_of_way(c, way, ratio), end=c.end), power_W, z[BATTERY])
    looked_at = np.unique(np.linspace(0, len(way) - 1, _LOOKED_AT).astype(int))
    needed = np.maximum.accumulate(np.vstack([np.zeros(usable.shape), needed_J(demand.at(looked_at), z)]), axis=0)
    place = places(needed, usable)
    distance, seconds = (
        np.interp(place, np.arange(len(looked_at) + 1), [0.0, *values[looked_at]]) for values in (length_m, time_s)
    )
    least_J = max(_LEAST_ENERGY_SHARE * float(demand.mean_J[-1]), _LEAST_J)
    beyond = np.maximum(usable / np.maximum(needed[-1], least_J), 1.0)  # where the battery gives more than that
    return Range(
        quantiles(distance * beyond),
        quantiles(seconds * beyond),
        quantiles(usable),
        quantiles(needed[-1] / max(float(length_m[-1]), _LEAST_M)),
        power_W,
    )


def level(ground: Sequence[Stretch]) -> list[Stretch]:
    """The stretches without their mean slope: no ground climbs or descends for ever."""
    slope = sum(s.climb_m - s.descent_m for s in ground) / max(total_distance_m(ground), _LEAST_M)
    down, up = max(slope, 0.0), max(-slope, 0.0)
    return [
        s._replace(climb_m=s.climb_m + up * s.distance_m, descent_m=s.descent_m + down * s.distance_m) for s in ground
    ]


def credible(c: Consumption, ground: Sequence[Stretch]) -> Consumption:
    """The belief; that of before the first drive where such ground, made level, would take next to nothing.

    A current with the wrong sign, one that is always zero, or a descent that was not measured teaches that.
    """
    fresh = replace(with_ground(start(c.prior), ground), end=c.end)
    mean_J, expected_J = (sum(float(design_row(b, s) @ b.mean) for s in level(ground)) for b in (c, fresh))
    return c if mean_J > _CREDIBLE_SHARE * expected_J else fresh


def planned_way(
    c: Consumption, plan: Sequence[Stretch], then: Sequence[Stretch], battery: Battery, state: BatteryState
) -> list[Stretch]:
    """The plan as far as the battery can reach; if that is beyond its end, then parts of ground like `then`."""
    full_V = battery.thevenin.ocv.voltage_V[-1]
    most_J = SECONDS_PER_HOUR * battery.capacity_Ah * state.soh_capacity * state.soc * full_V
    mean_J = np.cumsum([design_row(c, s) @ c.mean + s.task_J for s in plan])
    reached = int(np.searchsorted(np.maximum.accumulate(mean_J), most_J))
    if reached < len(plan):
        return list(plan[: reached + 1])
    of_then = energy_demand(c, then).mean_J
    share = max((most_J - float(mean_J[-1])) / max(of_then, _LEAST_J), 1.0) / _GROUND_PARTS
    return [*plan, *(part_of(stretch, share) for _ in range(_GROUND_PARTS) for stretch in then)]


def places(needed: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """(N,) number of stretches that each sample point completes, plus the share of the one in which it ends.

    needed: (K + 1, N) energy up to the end of each stretch, from 0, never falling; usable: (N,) energy available.
    """
    ends = np.minimum(np.sum(needed <= usable, axis=0), len(needed) - 1)
    low, high = (np.take_along_axis(needed, rows[None], axis=0)[0] for rows in (ends - 1, ends))
    share = (usable - low) / np.where(high > low, high - low, np.inf)
    return ends - 1 + np.where(high > usable, share, 1.0)


def way_demand(c: Consumption, way: Sequence[Stretch], is_known: bool) -> EnergyDemand:
    """Energy (K,) from the start of a route to the end of each of its stretches; is_known: as for `range_left`."""
    demand = energy_demands(c, way)
    if is_known:
        return demand
    driven_m = np.cumsum([s.distance_m for s in way])
    return demand._replace(learned_J2=demand.learned_J2 + (driven_m * ground_std(c, way)) ** 2)


#: Prior of the standard deviation of the energy per metre from stretch to stretch, relative to its mean, and its weight
#: in stretches.
_GROUND_SHARE, _GROUND_COUNT = 0.3, 3.0


def ground_std(c: Consumption, recent: Sequence[Stretch]) -> float:
    """Standard deviation [J/m] of the difference in mean energy between the ground ahead and the recent stretches.

    Both are samples of the same ground: with the variance s^2 from stretch to stretch and n stretches of equal length,
    s sqrt(2 / n). Stretches are weighted by their length; starts and stops are no sample of the ground, unless there is
    nothing else: then all of them are one.
    """
    driven = [s for s in recent if s.distance_m > 0.0]
    if not driven:
        return 0.0
    parts = [[s] for s in driven if s.distance_m >= SHORTEST_M] or [driven]
    length_m = np.array([total_distance_m(part) for part in parts])
    per_m = np.array([sum(float(design_row(c, s) @ c.mean) for s in part) for part in parts]) / length_m
    share = length_m / length_m.sum()
    mean, count = float(share @ per_m), 1.0 / float(share @ share)
    seen = count * float(share @ (per_m - mean) ** 2)
    variance = (seen + _GROUND_COUNT * (_GROUND_SHARE * mean) ** 2) / (count + _GROUND_COUNT)
    return float(np.sqrt(2.0 * variance / count))


def with_peaks(state: BatteryState, c: Consumption, way: Sequence[Stretch]) -> BatteryState:
    """The battery state with the peaks of power of this route, unless it already has some."""
    peaks = state.peaks if state.peaks is not None else peaks_of_way(c, way, PeakRatio())
    return replace(state, peaks=peaks, end=c.end)


def distances(per_m: np.ndarray, scatter: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """(N,) distance [m] at which e D + s sqrt(D) = E; infinite for e <= 0.

    per_m: (N,) e [J/m].  scatter: (N,) s [J/sqrt(m)].  usable: (N,) E [J].
    """
    costs = per_m > 0
    e = np.where(costs, per_m, 1.0)
    root = (np.sqrt(scatter**2 + 4 * e * usable) - scatter) / (2 * e)
    return np.where(costs, root**2, np.inf)


def spent_J(n: EnergyDemand, z: np.ndarray) -> np.ndarray:
    """(N,) energy [J] of level ground at the points, without the scatter; at least a tenth of the mean."""
    return np.maximum(certain_part(n, z), _LEAST_ENERGY_SHARE * n.mean_J)


def certain_part(n: EnergyDemand, z: np.ndarray) -> np.ndarray:
    """(N,) energy [J] at the points, without the scatter, which averages out on the way; (K, N) for a demand (K,)."""
    of_day = np.multiply.outer(np.sqrt(n.day_J2), student(z[DAY_EFFECTS], n.day_dof))
    learned = np.multiply.outer(np.sqrt(n.learned_J2), z[COEFFICIENTS])
    return np.multiply.outer(n.mean_J, np.ones(z.shape[1])) + learned + of_day


def scattered_part(n: EnergyDemand, z: np.ndarray) -> np.ndarray:
    """(N,) deviation [J] at the points due to the scatter; (K, N) for a demand (K,)."""
    return np.multiply.outer(np.sqrt(n.scatter_J2), student(z[SCATTER], n.scatter_dof))


def needed_J(n: EnergyDemand, z: np.ndarray) -> np.ndarray:
    """(N,) energy [J] at the points; (K, N) for a demand (K,)."""
    return certain_part(n, z) + scattered_part(n, z)


#: Bisection steps in the search for the latest point of return.
_HALVINGS = 20


class Milestone(NamedTuple):
    """Forecast for the end of a leg."""

    #: since the start of the plan
    distance_m: float
    time_s: float
    energy_J: Quantiles  #: taken since the start
    soc: Quantiles  #: state of charge; where the battery does not reach this far, that at the end of its discharge
    probability: float  #: of getting here with the reserve left


class MissionForecast(NamedTuple):
    """Forecast for a plan."""

    probability: float  #: of driving all of it with the reserve left
    milestones: tuple[Milestone, ...]  #: one for each leg
    usable_J: Quantiles  #: energy above the reserve at the start
    power_W: float  #: mean power of the plan
    #: farthest distance along the plan from which the way back, over the same ground, can still be driven with the
    #: requested confidence; 0 where there is none
    point_of_return_m: float


def get_home(
    c: Consumption, plan: Sequence[Leg], battery: Battery, state: BatteryState, confidence: float = 0.95
) -> MissionForecast:
    """Forecast for a plan, driven as part of the drive under way; call `begin_drive` first for a new drive.

    Raises:
        InputError: a plan that is empty or takes no time, a terrain that is not known, a confidence outside 0.5 to
            0.999.
    """
    if not plan:
        raise InputError("the plan has no leg; add at least one [[leg]]")
    return forecast_of(c, [stretch_of(leg) for leg in plan], battery, state, confidence)


def forecast_of(
    c: Consumption,
    stretches: Sequence[Stretch],
    battery: Battery,
    state: BatteryState,
    confidence: float = 0.95,
    is_known: bool = True,
) -> MissionForecast:
    """As `get_home`, of stretches; is_known: as for `range_left`."""
    require_between("confidence", confidence, 0.5, 0.999)
    z = normal_points(DIMENSIONS)
    if not (duration_s := total_time_s(stretches)) > 0.0:
        raise InputError("the plan takes no time: no leg has a distance or a stop; give one of them")
    demands = way_demand(c, stretches, is_known)
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


def summary_of(forecast: MissionForecast) -> dict[str, Any]:
    """A forecast as one object: `plan` of `ohmward mission --json`, and the answer of a robot that is asked."""
    last = forecast.milestones[-1]
    return {
        "distance_m": last.distance_m,
        "time_s": last.time_s,
        "energy_J": last.energy_J,
        "probability": forecast.probability,
        "point_of_return_m": forecast.point_of_return_m,
        "milestones": forecast.milestones,
    }


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
    """The first `distance_m` metres of a plan, never empty."""
    taken = []
    left_m = distance_m
    for s in plan:
        share = 1.0 if s.distance_m <= left_m else left_m / s.distance_m
        taken.append(part_of(s, share))
        left_m -= share * s.distance_m
        if share < 1.0:
            break
    return taken
