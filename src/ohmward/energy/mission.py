"""Mission analysis: consumption learned from a recorded drive, range left, and the forecast of a plan.

A plan is a TOML file written by hand: units are part of the names, unknown keys are errors.


log, drive = read_log("drive.csv"), read_drive("drive.csv", wheels, driven)
result = analyse(battery, start(prior_from_robot(robot)), log, drive=drive, robot=robot, ground="grass", plan=plan)
result.range.distance_m.p50, result.forecast.probability, result.advice["grass"].speed_m_s
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.log_check import check_log, with_contradictions
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import DEFAULT, EstimatorSettings, make_estimator
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate
from ohmward.checks import require_between, require_each_not_negative
from ohmward.energy.consumption import Consumption, begin_drive, learn, standing_work_J, with_terrain
from ohmward.energy.discharge_end import end_along
from ohmward.energy.drive_record import DriveRecord, measured_motion, observe_motion, record_drive
from ohmward.energy.leg import Leg, Stretch, stretch_of
from ohmward.energy.range import MissionForecast, Range, credible, get_home, range_along, range_left
from ohmward.energy.range_estimator import soc_now
from ohmward.energy.range_step import RangeSettings, SocNow, battery_state
from ohmward.energy.sag import NO_SAG, sag_along
from ohmward.energy.speed_advice import SpeedAdvice, speed_advice
from ohmward.energy.usable_energy import BatteryState, require_cutoff
from ohmward.errors import InputError
from ohmward.filters.estimator import row_of
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Log, Note
from ohmward.quantities import COLDEST_DEGC, HOTTEST_DEGC
from ohmward.toml_file import TomlFile
from ohmward.traction.friction.terrain import DEFAULT_TERRAIN, Terrain, hard_terrain
from ohmward.traction.robot.robot import Robot

FORMAT = "ohmward-plan/1"

EXAMPLE = f"""\
# A mission as ohmward plans it. Units are part of the names. Legs are driven in this order.
format = "{FORMAT}"
reserve_soc = 0.1          # state of charge that must be left at the end, 0 to 1
# cutoff_V = 21.0          # terminal voltage at which the robot stops
# temperature_degC = 15.0  # of the battery
# payload_kg = 0.0         # on every leg, on top of the leg's own

[[leg]]
distance_m = 400.0
terrain = "grass"          # a name of the consumption table
speed_m_s = 0.5
grade_rad = 0.02           # mean slope, > 0 uphill; 0.01745 is one degree
stop_s = 120.0             # standing time at the end of the leg
task_J = 20000.0           # energy of a tool or an arm on the way

[[leg]]
distance_m = 400.0
terrain = "grass"
speed_m_s = 0.5
grade_rad = -0.02
"""


@dataclass(frozen=True)
class Plan:
    """A mission plan, as in its file."""

    leg: tuple[Leg, ...]  #: legs in the order of driving; at least one
    reserve_soc: float | None = None  #: SoC that must be left at the end, in [0, 1); default 0.1
    cutoff_V: float = 0.0  #: terminal voltage at which the robot stops; 0 if nothing monitors it
    temperature_degC: float = ROOM_DEGC  #: temperature of the battery
    payload_kg: float = 0.0  #: on every leg, in addition to the leg's own

    def __post_init__(self) -> None:
        if not self.leg:
            raise InputError("the plan has no leg; add at least one [[leg]]")
        if self.reserve_soc is not None:
            require_between("reserve_soc", self.reserve_soc, 0.0, 0.99)
        require_between("temperature_degC", self.temperature_degC, COLDEST_DEGC, HOTTEST_DEGC)
        require_each_not_negative("", self, "cutoff_V", "payload_kg")

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The legs with their whole payload."""
        return tuple(replace(leg, payload_kg=leg.payload_kg + self.payload_kg) for leg in self.leg)


PLAN_FILE = TomlFile(Plan, FORMAT, "# A mission as ohmward plans it.")


#: State of charge that must be left where neither settings nor plan give it.
DEFAULT_RESERVE = RangeSettings.reserve_soc
#: Limits of the advised speed, relative to the present one.
_SLOWEST_ADVISED, _FASTEST_ADVISED = 0.5, 1.5


@dataclass(frozen=True)
class MissionSettings:
    """Settings of a mission analysis."""

    soc: float | None = None  #: state of charge now; None runs an estimator along the log
    soc_std: float = INITIAL_SOC_STD  #: standard deviation of `soc`
    initial_soc: float | None = None  #: state of charge at the start of the log; None takes it from the voltage
    initial_soc_std: float = INITIAL_SOC_STD  #: standard deviation of `initial_soc`
    filter: str = DEFAULT  #: estimator of the state of charge, see `make_estimator`
    reserve_soc: float | None = None  #: state of charge that must be left; None takes the plan's, else 0.1
    #: terminal voltage at which the robot stops; 0 if nothing monitors it; None takes the plan's
    cutoff_V: float | None = None
    payload_kg: float = 0.0  #: load during the log
    speed_column: str = "speed_m_s"  #: column of the log's speed, used without wheels
    speed_unit: str | None = None  #: its unit, where its name is silent (m/s is assumed) or wrong
    terrain: Terrain | None = None  #: ground that the observer of the wheels assumes at first; None is dry asphalt
    confidence: float = 0.95  #: probability with which the robot must come back from the latest point of return


class MissionResult(NamedTuple):
    """Result of a mission analysis."""

    battery: Battery  #: the battery file's
    record: DriveRecord | None  #: the recorded drive; None without a log
    plan: Plan | None  #: the mission ahead, if there is one
    consumption: Consumption  #: updated from the log
    state: BatteryState  #: of the battery at the end of the log, or as given
    range: Range  #: along the plan and over ground like it, else over ground like the log's
    forecast: MissionForecast | None  #: of the plan
    advice: dict[str, SpeedAdvice]  #: speed of least energy per metre, by terrain
    notes: tuple[Note, ...]  #: everything that was assumed


def analyse(
    battery: Battery,
    before: Consumption,
    log: Log | None = None,
    *,
    drive: DriveLog | None = None,
    robot: Robot | None = None,
    ground: str | Sequence[str] | np.ndarray = "ground",
    plan: Plan | None = None,
    settings: MissionSettings | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> MissionResult:
    """Learn the consumption from a drive, and look ahead along a plan or over ground like that of the drive.

    before: consumption as known before the drive.
    log: of the battery; without one a plan and `settings.soc` are needed.
    drive: wheels and motors of the same drive, of `robot`; without them the speed is a column of the log.
    ground: name of the ground under each sample (T,) of the log, or one for all.
    progress: callback of the observer, called now and then with (steps done, T).

    Raises:
        InputError: neither log nor plan, no state of charge, a log of another battery, no speed.
    """
    settings = settings or MissionSettings()
    if log is None and plan is None:
        raise InputError("a mission analysis needs a log, a plan, or both; got neither")
    ground, plan = _as_spelled_before(before.terrains, ground, plan)
    estimates: SocEstimate | None = None
    record: DriveRecord | None = None
    if log is not None:
        log = with_contradictions(check_log(log, battery), battery)
        estimates = _estimates(battery, log, settings) if settings.soc is None else None
        if robot is None or drive is None:
            motion = measured_motion(log, settings.speed_column, settings.speed_unit)
        else:
            terrain = settings.terrain or hard_terrain(DEFAULT_TERRAIN)
            motion = observe_motion(robot, drive, terrain, log.time_s, progress)
        record = record_drive(log, motion, ground, settings.payload_kg)
    learned, notes = learn_drive(before, record)
    consumption, guessed = _with_plan(learned, plan)
    ahead = _stretches_ahead(consumption, plan, record)
    known = credible(consumption, ahead)
    if known is not consumption:
        text = (
            "the drive seems to take next to nothing: the forecast is that before the first drive; is the sign of the "
            "current right, and was every descent measured?"
        )
        guessed.append(Note(text, "warning"))
    if log is not None and estimates is not None:
        end = end_along(log, estimates.soc, estimates.soc_std, cutoff_of(settings, plan))
        consumption = replace(consumption, end=end or consumption.end)
    state, assumed = battery_at_end(battery, settings, plan, log, estimates)
    left = range_along(known, ahead, ahead, battery, state) if plan else range_left(known, ahead, battery, state, False)
    return MissionResult(
        battery,
        record,
        plan,
        consumption,
        state,
        left,
        get_home(known, plan.legs, battery, state, settings.confidence) if plan else None,
        advice_for(consumption, ahead),
        (*notes, *(record.notes if record else ()), *guessed, *assumed),
    )


def _as_spelled_before(
    terrains: Sequence[str], ground: str | Sequence[str] | np.ndarray, plan: Plan | None
) -> tuple[str | list[str], Plan | None]:
    """Ground and plan with the names of the terrains: `Grass` and ` grass ` are called as the first of them was."""

    def folded(name: str) -> str:
        return " ".join(name.split()).casefold()

    known_as = {folded(name): name for name in terrains}

    def spelling(name: str) -> str:
        return known_as.setdefault(folded(name), name)

    driven_on = spelling(ground) if isinstance(ground, str) else [spelling(name) for name in ground]
    legs = tuple(replace(leg, terrain=spelling(leg.terrain)) for leg in plan.leg) if plan else ()
    return driven_on, replace(plan, leg=legs) if plan else None


def _estimates(battery: Battery, log: Log, settings: MissionSettings) -> SocEstimate:
    """Estimates of the battery along the log."""
    estimator = make_estimator(settings.filter, battery, EstimatorSettings(idle_current_A=battery.idle_current_A))
    return SocEstimator(estimator, settings.initial_soc, settings.initial_soc_std).run(log).estimates


def _stretches_ahead(c: Consumption, plan: Plan | None, record: DriveRecord | None) -> list[Stretch]:
    """Stretches of the plan, else those of the drive again, with the work that was done at standstill."""
    if plan or record is None:
        return [stretch_of(leg) for leg in plan.legs] if plan else []
    work_J = [standing_work_J(c, d.stretch, d.energy_J) for d in record.driven]
    return [d.stretch._replace(task_J=J) for d, J in zip(record.driven, work_J, strict=True)]


def learn_drive(before: Consumption, record: DriveRecord | None) -> tuple[Consumption, list[Note]]:
    """Consumption after a new drive, with a note of the days since the last one where both had a wall clock."""
    if record is None:
        return begin_drive(before), []
    days = before.days_until(record.log.begin_unix_s)
    notes = [] if days is None else [Note(f"{days:.1f} days since the last drive that was learned from")]
    c = begin_drive(before, days or 0.0)
    for driven in record.driven:
        c = learn(c, driven.stretch, driven.energy_J)
    return replace(c, last_drive_unix_s=record.log.end_unix_s or c.last_drive_unix_s), notes


def battery_at_end(
    battery: Battery,
    settings: MissionSettings,
    plan: Plan | None = None,
    log: Log | None = None,
    estimates: SocEstimate | None = None,
) -> tuple[BatteryState, list[Note]]:
    """State of the battery as estimated at the end of the log, else as given, with notes of what was assumed.

    Raises:
        InputError: no state of charge, or one below the reserve; a cutoff that the full battery does not reach.
    """
    of_log_degC = ROOM_DEGC if log is None else float(log.temperature_along(ROOM_DEGC)[-1])
    temperature_degC = plan.temperature_degC if plan else of_log_degC
    if estimates is not None:
        now = soc_now(row_of(estimates, -1), temperature_degC)
    elif settings.soc is not None:
        now = SocNow(settings.soc, settings.soc_std, temperature_degC=temperature_degC)
    else:
        raise InputError("settings.soc is needed with a plan alone: the state of charge now, 0 to 1")
    reserve_soc, notes = _reserve(settings, plan, log, now.soc)
    cutoff_V = cutoff_of(settings, plan)
    require_cutoff(battery, cutoff_V)
    sag_ohm = sag_along(log).ohm if log is not None and estimates is not None else NO_SAG
    state = battery_state(battery, now, sag_ohm, reserve_soc=reserve_soc, cutoff_V=cutoff_V)
    return state, notes


def cutoff_of(settings: MissionSettings, plan: Plan | None) -> float:
    """Voltage at which the robot stops, from the settings or the plan; 0 if nothing monitors it."""
    if settings.cutoff_V is not None:
        return settings.cutoff_V
    return plan.cutoff_V if plan else 0.0


def advice_for(c: Consumption, ahead: Sequence[Stretch]) -> dict[str, SpeedAdvice]:
    """Speed advice for each ground ahead, against the mean speed there."""
    advice = {}
    for name in sorted({s.terrain for s in ahead if s.distance_m > 0}):
        there = [s for s in ahead if s.terrain == name]
        speed_m_s = sum(s.speed_distance_m2_s for s in there) / sum(s.distance_m for s in there)
        advice[name] = speed_advice(c, name, speed_m_s, (_SLOWEST_ADVISED * speed_m_s, _FASTEST_ADVISED * speed_m_s))
    return advice


def _with_plan(c: Consumption, plan: Plan | None) -> tuple[Consumption, list[Note]]:
    """Consumption with the plan's terrains, and a warning for each that has not been driven on."""
    notes = []
    for leg in plan.legs if plan else ():
        if leg.terrain not in c.terrains:
            known = f"; the table knows {', '.join(c.terrains)}" if c.terrains else ""
            text = f"nobody has driven on {leg.terrain!r}: its resistance is a broad guess{known}"
            notes.append(Note(text, "warning"))
            c = with_terrain(c, leg.terrain)
    return c, notes


def _reserve(settings: MissionSettings, plan: Plan | None, log: Log | None, soc: float) -> tuple[float, list[Note]]:
    """Reserve state of charge; 0 where none is given and the log ends below the usual reserve."""
    reserve_soc = plan.reserve_soc if plan and settings.reserve_soc is None else settings.reserve_soc
    if reserve_soc is not None:
        return reserve_soc, []
    if log is not None and 0.0 < soc <= DEFAULT_RESERVE:
        text = f"the log ends below the usual reserve of {DEFAULT_RESERVE:.0%}: range is that to empty"
        return 0.0, [Note(text, "warning")]
    return DEFAULT_RESERVE, []
