"""Range left during a drive: one pure step for each sample.

Battery power, speed and slope are cut into stretches (`cut_drive`); each finished one updates what this robot takes
on this ground today (`consumption`); from time to time that is compared with the energy left in the battery (`range`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.chemistries import Normal
from ohmward.checks import require_between, require_each_not_negative, require_positive
from ohmward.energy.consumption import Consumption, learn, moving_time_s, standing_work_J, with_ground, with_terrain
from ohmward.energy.cut_drive import DriveMeter, DriveSample, advance
from ohmward.energy.discharge_end import DischargeMeter
from ohmward.energy.leg import (
    STRETCH_S,
    Leg,
    Stretch,
    joined,
    part_of,
    stretch_of,
    total_distance_m,
    total_time_s,
    way_back,
)
from ohmward.energy.peaks import PEAKED_S, PeakRatio, mean_power_W, peaks_of_way
from ohmward.energy.points import Quantiles, normal_points
from ohmward.energy.range import (
    BATTERY,
    DIMENSIONS,
    MissionForecast,
    credible,
    forecast_of,
    needed_J,
    range_along,
    range_left,
    way_demand,
)
from ohmward.energy.sag import NO_SAG, Sag
from ohmward.energy.usable_energy import BatteryState, discharge_curves, require_cutoff, usable_at
from ohmward.errors import InputError
from ohmward.filters.estimator import LateSamples, clock_after
from ohmward.filters.flags import SampleFlag

#: Time [s] of the recent drive that the ground ahead is assumed to resemble.
RECENT_S = 3600.0

#: Weight of everything ever driven, as a further time [s] of driving.
USUAL_GROUND_S = 1800.0

#: Flat way ahead of a robot that has hardly moved yet, with the consumption and band of its table.
FIRST_LEG_M, FIRST_SPEED_M_S = 100.0, 0.5

#: Shortest drive that predicts the way ahead: a shorter one is a start from rest, at a tenth of the later speed.
LEAST_DRIVEN_M = 5.0

#: Relative standard deviation of the resistance towards empty, predicted from the resistance measured before.
RESISTANCE_SHARE = 0.15

#: Way home: its length [m] over ground like the recent one, or its legs; None where it is not known.
WayHome = float | Sequence[Leg] | None

_UNKNOWN = Quantiles(math.nan, math.nan, math.nan)
_NOTHING = Quantiles(0.0, 0.0, 0.0)


class RangeFlag(SampleFlag):
    """Conditions of a sample; none of them stops the estimator.

    >>> ow.RangeFlag(3)
    RangeFlag.NO_SOC|NO_POWER
    """

    NO_SOC = 1  # no number in [0, 1]: the last one is held; before the first there is no forecast
    NO_POWER = 2  # current or voltage is missing; where it is for longer than `BRIDGED_S`, nothing is learned
    NO_SPEED = 4  # likewise
    BAD_TIME = 8  # no number, or late: not used for the drive
    RESERVE = 16  # nothing above the reserve is left
    STOOD = 32  # hardly driven in the last hour: the way ahead is assumed as before the first drive
    NO_COST = 64  # driving seems to take next to nothing (sign of the current?): assumed as before the first drive


class SocNow(NamedTuple):
    """State of the battery from its estimator; nan where that has no estimate."""

    soc: float = math.nan
    soc_std: float = 0.0
    soh_capacity: float = math.nan
    soh_capacity_std: float = math.nan
    resistance_ratio: float = math.nan
    resistance_ratio_std: float = math.nan
    temperature_degC: float = math.nan


class RangeSample(NamedTuple):
    """Drive, battery and way home at an instant."""

    drive: DriveSample
    soc: SocNow
    home: WayHome = None
    current_A: float = math.nan  #: of the battery; > 0 charges
    voltage_V: float = math.nan
    plan: Sequence[Leg] = ()  #: the legs ahead, nearest first, as far as they are known


class RangeEstimate(NamedTuple):
    """Range after a sample; the first four are `Quantiles`, of which P10 is reached with 90 % probability.

    >>> estimator = ow.RangeEstimator(ow.load_battery("battery.toml"), ow.load_consumption("table.toml"))
    >>> estimate = estimator.update(0.0, soc=0.8, speed_m_s=0.5, current_A=-2.1, voltage_V=13.1)
    >>> estimate.distance_m.p10 < estimate.distance_m.p50
    True
    """

    #: until the reserve, along the plan and then over ground like the recent one
    distance_m: Any
    duration_s: Any
    usable_J: Any  #: energy above the reserve
    energy_J_per_m: Any  #: of the ground ahead
    home_probability: Any  #: of coming home with the reserve left; nan where the way is not known
    driven_m: Any  #: since the start
    flags: Any  #: sum of `RangeFlag` values; 0 is a sample without incident

    @property
    def assumed(self) -> Any:
        """True while too little was driven to predict the way ahead: it is assumed flat, at a usual speed."""
        flags = np.asarray(self.flags, dtype=int)
        return (self.driven_m < LEAST_DRIVEN_M) | (flags & (RangeFlag.STOOD | RangeFlag.NO_COST) > 0)


class RangeState(NamedTuple):
    """State of the estimator between samples."""

    consumption: Consumption  #: as learned so far
    meter: DriveMeter  #: of the drive
    recent: tuple[Stretch, ...]  #: stretches of the last hour
    finished_m: float  #: length of all finished stretches
    soc: SocNow  #: last one known
    forecast: RangeEstimate  #: last one
    forecast_s: float  #: its time; -inf before the first
    peak_W: float = 0.0  #: highest power of the stretch under way that was sustained for some seconds
    peak_ratio: PeakRatio = PeakRatio()  #: of the stretches of this drive
    discharge: DischargeMeter = DischargeMeter()  #: since the highest state of charge on this drive
    sag: Sag = Sag()  #: of the battery under its loads
    began_s: float = math.nan  #: time of the first sample
    late: LateSamples = LateSamples()  #: samples earlier than the last one


@dataclass(frozen=True)
class RangeSettings:
    """Settings; `init` and `step` are pure functions of them."""

    battery: Battery  #: identified or generic
    terrain: str = "floor"  #: ground where a sample does not name it
    reserve_soc: float = 0.1  #: state of charge that must be left
    cutoff_V: float = 0.0  #: terminal voltage at which the robot stops; 0 if nothing monitors it
    payload_kg: float = 0.0  #: on top of the robot's mass
    refresh_s: float = 60.0  #: time between two forecasts

    def __post_init__(self) -> None:
        require_battery(self.battery)
        require_between("reserve_soc", self.reserve_soc, 0.0, 1.0)
        require_each_not_negative("", self, "cutoff_V", "payload_kg")
        require_cutoff(self.battery, self.cutoff_V)
        require_positive("refresh_s", self.refresh_s)
        if not self.terrain:
            raise InputError("terrain must be the name of a ground, got an empty text")

    def init(self, consumption: Consumption) -> RangeState:
        """State before the first sample; consumption: at the start of the drive."""
        known = with_terrain(consumption, self.terrain)
        nothing = RangeEstimate(_UNKNOWN, _UNKNOWN, _UNKNOWN, _UNKNOWN, math.nan, 0.0, RangeFlag(0))
        return RangeState(known, DriveMeter(), (), 0.0, SocNow(), nothing, -math.inf)

    def step(self, state: RangeState, sample: RangeSample) -> tuple[RangeState, RangeEstimate]:
        """State and estimate after a sample."""
        time_s, drive = sample.drive.time_s, sample.drive
        values = {
            RangeFlag.NO_SOC: sample.soc.soc,
            RangeFlag.NO_POWER: drive.battery_W,
            RangeFlag.NO_SPEED: drive.speed_m_s,
        }
        flags = RangeFlag(sum(flag for flag, value in values.items() if not math.isfinite(value)))
        last_s = state.meter.last.time_s if state.meter.last else math.nan
        clock_s, late = clock_after(last_s, time_s, state.late)
        state = state._replace(late=late)
        if math.isfinite(sample.soc.soc):
            counted = state.discharge.with_soc(sample.soc.soc, sample.soc.soc_std)
            state = state._replace(soc=sample.soc, discharge=counted)
        if clock_s == time_s:
            state = self.drive(state, sample)
        else:
            flags |= RangeFlag.BAD_TIME
        is_due = not state.forecast_s <= time_s < state.forecast_s + self.refresh_s
        has_time = clock_s == time_s or state.forecast_s == -math.inf
        if is_due and has_time and math.isfinite(state.soc.soc):
            state = state._replace(forecast=self.forecast(state, sample), forecast_s=time_s)
        moving_m = state.meter.moving.stretch.distance_m if state.meter.moving else 0.0
        if state.soc.soc <= self.reserve_soc:
            flags |= RangeFlag.RESERVE
        driven_m = state.finished_m + moving_m
        if total_distance_m(state.recent) + moving_m < LEAST_DRIVEN_M <= driven_m:
            flags |= RangeFlag.STOOD
        return state, state.forecast._replace(driven_m=driven_m, flags=flags | state.forecast.flags)

    def drive(self, state: RangeState, sample: RangeSample) -> RangeState:
        """The state after a sample of the drive; each finished stretch updates the consumption."""
        meter, finished = advance(state.meter, sample.drive)
        since_s = sample.drive.time_s - state.meter.last.time_s if state.meter.last else math.nan
        discharge = state.discharge.with_sample(since_s, sample.current_A, sample.voltage_V)
        rises = discharge.held_W >= state.discharge.held_W  # what falls may be left of work at standstill
        peak_W = max(state.peak_W, discharge.held_W) if rises else state.peak_W
        consumption, recent, finished_m, ratio = state.consumption, state.recent, state.finished_m, state.peak_ratio
        if end := discharge.end(self.cutoff_V, _known(state.soc.temperature_degC, BatteryState.temperature_degC)):
            consumption = replace(consumption, end=end)
        for part in finished:
            work_J = standing_work_J(consumption, part.stretch, part.energy_J)
            stretch = part.stretch._replace(payload_kg=self.payload_kg, task_J=work_J)
            consumption = learn(consumption, stretch, part.energy_J)
            recent = last_stretches((*recent, stretch), RECENT_S)
            finished_m += stretch.distance_m
            if not stretch.terrain:
                peak_W = 0.0
            elif moving_time_s(stretch) >= PEAKED_S:
                ratio, peak_W = ratio.with_stretch(peak_W, mean_power_W(consumption, stretch)), discharge.held_W
        return state._replace(
            consumption=consumption,
            meter=meter,
            recent=recent,
            finished_m=finished_m,
            peak_W=peak_W,
            peak_ratio=ratio,
            discharge=discharge,
            sag=state.sag.with_sample(since_s, sample.current_A, sample.voltage_V),
            began_s=state.began_s if state.began_s <= sample.drive.time_s else sample.drive.time_s,
        )

    def forecast(self, state: RangeState, sample: RangeSample) -> RangeEstimate:
        """Range from here on; flags and distance driven are filled in for each sample."""
        if state.soc.soc <= self.reserve_soc:
            home = math.nan if sample.home is None else 0.0
            return RangeEstimate(_NOTHING, _NOTHING, _NOTHING, _UNKNOWN, home, 0.0, RangeFlag(0))
        battery_now = self.battery_now(state, self.reserve_soc)
        ahead, plan, flags = self.ahead(state), tuple(map(stretch_of, sample.plan)), RangeFlag(0)
        home_m = self.way_home(tuple(map(way_back, self.ahead(state, stays=False))), sample.home)
        learned = with_ground(state.consumption, ahead)
        known = credible(learned, ahead)
        if known is not learned:
            ahead, flags = self.first_ground(), RangeFlag.NO_COST
        known = with_ground(known, (*ahead, *plan, *home_m))
        driven_s = _known(sample.drive.time_s - state.began_s, math.inf)
        if plan:
            left = range_along(known, plan, ahead, self.battery, battery_now, state.peak_ratio)
        else:
            of_ahead = replace(battery_now, peaks=peaks_of_way(known, ahead, state.peak_ratio))
            left = range_left(known, ahead, self.battery, of_ahead, is_known=False)
        probability = math.nan
        if home_m:
            demand, home_s = way_demand(known, home_m, isinstance(sample.home, Sequence)).at(-1), total_time_s(home_m)
            of_home = replace(
                battery_now,
                peaks=peaks_of_way(known, home_m, state.peak_ratio),
                loaded_s=driven_s + home_s,
                end=known.end,
            )
            z = normal_points(DIMENSIONS)
            usable = usable_at(self.battery, of_home, demand.mean_J / home_s if home_s > 0.0 else 0.0, z[BATTERY])
            probability = float(np.mean(needed_J(demand, z) <= usable))
        return RangeEstimate(left.distance_m, left.time_s, left.usable_J, left.energy_J_per_m, probability, 0.0, flags)

    def battery_now(self, state: RangeState, reserve_soc: float) -> BatteryState:
        """The battery for a forecast that leaves this reserve."""
        since_full = 1.0 - min(state.soc.soc, 1.0)  # where SoC was corrected on the way, soc_std is the smaller bound
        return battery_state(
            self.battery,
            state.soc,
            state.sag.ohm,
            counted=since_full,
            reserve_soc=reserve_soc,
            cutoff_V=self.cutoff_V,
            began_soc=state.discharge.start_soc,
        )

    def mission(
        self, state: RangeState, way: float | Sequence[Leg], task_J: float = 0.0, reserve_soc: float | None = None
    ) -> MissionForecast:
        """Forecast of a mission that begins now.

        way: its legs, or its length [m] over ground like the recent one, > 0.
        task_J: energy of its tasks beside those of the legs.
        reserve_soc: state of charge that must be left at its end; None for the usual one.

        Raises:
            InputError: the charge is not known, nothing above the reserve is left, or the way takes no time.
        """
        if not math.isfinite(state.soc.soc):
            raise InputError("the charge is not known: wait for current and voltage of the battery")
        ahead = self.ahead(state)
        ground = [*self.way_home(ahead, way)]
        ground[-1:] = [last._replace(task_J=last.task_J + task_J) for last in ground[-1:]]
        known = with_ground(credible(with_ground(state.consumption, ahead), ahead), ground)
        reserve = self.reserve_soc if reserve_soc is None else reserve_soc
        battery_now = replace(self.battery_now(state, reserve), peaks=peaks_of_way(known, ground, state.peak_ratio))
        return forecast_of(known, ground, self.battery, battery_now, is_known=isinstance(way, Sequence))

    def ahead(self, state: RangeState, stays: bool = True) -> tuple[Stretch, ...]:
        """Stretches like those to come: the recent ones, and the usual ground of the robot.

        stays: with standing of `STRETCH_S` and longer, which is work or waiting and no stop on a way.
        """
        recent = [s for s in state.recent if stays or s.terrain or s.time_s < STRETCH_S]
        recent += [state.meter.moving.stretch] if state.meter.moving else []
        if total_distance_m(recent) >= LEAST_DRIVEN_M:
            driven = [s for s in recent if s.terrain]
            usual = usual_ground(state.consumption)
            stops = reduce(joined, (s for s in recent if not s.terrain), Stretch("", 0.0))
            stops = part_of(stops, 1.0 + total_distance_m(usual) / total_distance_m(driven))
            return (*driven, *usual, stops)
        return self.first_ground()

    def first_ground(self) -> tuple[Stretch, ...]:
        """The way ahead before the first drive."""
        return (stretch_of(Leg(FIRST_LEG_M, self.terrain, FIRST_SPEED_M_S, payload_kg=self.payload_kg)),)

    def way_home(self, ahead: Sequence[Stretch], home: WayHome) -> tuple[Stretch, ...]:
        """Stretches of the way home; none where it is not known."""
        if home is None:
            return ()
        if isinstance(home, Sequence):
            return tuple(map(stretch_of, home))
        share = max(home, 0.0) / total_distance_m(ahead)
        return tuple(part_of(stretch, share) for stretch in ahead)


def battery_state(battery: Battery, now: SocNow, sag_ohm: Normal = NO_SAG, **limits: Any) -> BatteryState:
    """The battery for a forecast; values missing from its estimator are those of the battery file.

    sag_ohm: resistance measured under short loads.
    limits: further fields of `BatteryState`, the robot's limits among them.
    """
    noise = battery.noise
    resistance_ratio = _known(now.resistance_ratio, 1.0)
    of_level = _known(now.resistance_ratio_std, noise.resistance_std)
    temperature_degC = _known(now.temperature_degC, BatteryState.temperature_degC)
    _, _, file_ohm = discharge_curves(battery, np.array([min(now.soc, 1.0)]), temperature_degC)
    measured = Normal(*(value / float(file_ohm[0]) for value in sag_ohm)) if file_ohm[0] > 0.0 else NO_SAG
    of_peaks = both(Normal(resistance_ratio, of_level), measured)
    return BatteryState(
        soc=min(now.soc, 1.0),
        soc_std=now.soc_std,
        soh_capacity=_known(now.soh_capacity, 1.0),
        capacity_std=_known(now.soh_capacity_std, noise.capacity_std),
        resistance_ratio=resistance_ratio,
        resistance_std=math.hypot(of_level, RESISTANCE_SHARE * resistance_ratio),
        peak_resistance_ratio=of_peaks.mean,
        peak_resistance_std=math.hypot(of_peaks.std, RESISTANCE_SHARE * of_peaks.mean),
        temperature_degC=temperature_degC,
        **limits,
    )


def both(one: Normal, other: Normal) -> Normal:
    """Combine two independent estimates of a quantity; the other may have an infinite standard deviation."""
    share = one.std**2 / (one.std**2 + other.std**2) if one.std > 0.0 else 0.0
    return Normal(one.mean + share * (other.mean - one.mean), one.std * math.sqrt(1.0 - share))


def last_stretches(stretches: tuple[Stretch, ...], time_s: float) -> tuple[Stretch, ...]:
    """The fewest last stretches that together last this long; all where they are shorter."""
    left_s, first = time_s, len(stretches)
    while first > 0 and left_s > 0.0:
        first -= 1
        left_s -= stretches[first].time_s
    return stretches[first:]


def usual_ground(c: Consumption) -> list[Stretch]:
    """Usual ground of the robot, for as long as it counts beside the recent one.

    The ground ahead is like the recent one, and like everything ever driven: the conditions of the last hour will not
    last for ever.
    """
    usual_s = sum(v.time_s for v in c.visits)
    if not usual_s > 0.0:
        return []
    share = USUAL_GROUND_S / usual_s
    return [
        Stretch(name, share * v.time_s, share * v.distance_m, share * v.distance_m**2 / v.time_s)
        for name, v in zip(c.terrains, c.visits, strict=True)
        if v.distance_m > 0.0 and v.time_s > 0.0
    ]


def _known(value: float, otherwise: float) -> float:
    return value if math.isfinite(value) else otherwise
