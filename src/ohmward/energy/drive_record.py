"""A recorded drive in terms of energy: motion, battery power, stretches on one ground, energy balance.

Its key figures are energy per metre and cost of transport, of the drive and of each terrain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.energy.balance import DRIVE_TERMS, DriveEnergy, drive_balance, integrate_drive
from ohmward.energy.consumption import Consumption, begin_drive, energy_demand
from ohmward.energy.cut_drive import BRIDGED_S, Driven, cut_drive
from ohmward.energy.leg import STEEPEST_RAD, Leg, stretch_of
from ohmward.energy.points import Quantiles, normal_points, quantiles
from ohmward.energy.range import DIMENSIONS, needed_J
from ohmward.errors import InputError
from ohmward.logs.columns import given_unit
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Log, Note
from ohmward.logs.units import split_unit, unit_in_name
from ohmward.quantities import FASTEST_M_S
from ohmward.runs import interpolated
from ohmward.traction.drive_checks import mended
from ohmward.traction.dynamics.forces import EnergyBalance, Scene, scene
from ohmward.traction.friction.terrain import Terrain
from ohmward.traction.robot.robot import GRAVITY, Robot, free_sideways
from ohmward.traction.speed_observer.estimator import SlipRun, motion_of, observe
from ohmward.traction.speed_observer.make_observer import make_observer
from ohmward.traction.terrain.floor import travel_speed

#: Columns for the slope of the ground, before their unit (`grade_rad`); the first one present is used.
SLOPES = ("grade", "pitch")


class ObservedWheels(NamedTuple):
    """A drive of wheels and motors, an observer's estimates along it, and the scene that the observer assumes."""

    drive: DriveLog
    track: SlipRun
    scene: Scene


class BodyMotion(NamedTuple):
    """Motion at the samples of the battery's log."""

    speed_m_s: np.ndarray  #: (T,) forward; for an omni-directional robot in any direction
    grade_rad: np.ndarray | None  #: (T,) > 0 where it climbs forward; None on ground assumed level
    #: the observed drive on its own clock; None where speed and grade are columns of the log
    wheels: ObservedWheels | None
    notes: tuple[Note, ...]  #: everything that was assumed


class RecordedBalance(NamedTuple):
    """Energy balance of a recorded drive: power (T,) over time, and the energies of the whole drive."""

    time_s: np.ndarray
    power: EnergyBalance
    energy: DriveEnergy


class DriveRecord(NamedTuple):
    """A recorded drive."""

    log: Log  #: of the battery
    #: (T,) at its samples; the power is > 0 out of the battery
    speed_m_s: np.ndarray
    battery_W: np.ndarray
    driven: list[Driven]  #: stretches of one ground each
    balance: RecordedBalance | None  #: None without wheels and motor currents
    notes: tuple[Note, ...]  #: everything that was assumed


def observe_motion(
    robot: Robot,
    drive: DriveLog,
    terrain: Terrain,
    time_s: np.ndarray,
    progress: Callable[[int, int], None] | None = None,
) -> BodyMotion:
    """Speed and grade at the times of a log, by an observer of wheels, motors and whatever else the drive has.

    Both are nan before and after the drive, and in its gaps longer than `BRIDGED_S`.

    terrain: ground assumed at the start.
    """
    drive = mended(robot, drive)
    chosen = make_observer(robot, drive, terrain)
    track = observe(chosen.observer, drive, progress)
    speed_m_s, grade_rad = track.estimates.speed_m_s, track.estimates.grade_rad
    if robot.freedoms == 3:  # it also travels sideways, and only its forward part climbs
        forward_m_s, speed_m_s = speed_m_s, travel_speed(motion_of(robot, track.estimates))
        grade_rad = grade_rad * forward_m_s / np.maximum(speed_m_s, np.finfo(float).tiny)
    speed, grade = (interpolated(time_s, drive.time_s, values, BRIDGED_S) for values in (speed_m_s, grade_rad))
    level = not track.estimates.grade_std_rad.any() and "pitch_rad" not in drive.channels
    wheels = ObservedWheels(drive, track, scene(free_sideways(robot), terrain))
    return BodyMotion(speed, None if level else grade, wheels, (*drive.notes, *chosen.notes))


def measured_motion(log: Log, speed_column: str = "speed_m_s", speed_unit: str | None = None) -> BodyMotion:
    """Speed and slope from columns of a log, in the units of their names; nan where they are not credible.

    speed_unit: of the speed, where the name is silent (m/s is assumed) or wrong.

    Raises:
        InputError: there is no such column, or the unit is none of a speed.
    """
    if speed_column not in log.extra:
        raise InputError(
            f"{log.name}: there is no speed: neither wheels (give the robot: --robot) nor a column {speed_column!r}; "
            "name it with --column speed=NAME (speed_column='NAME'). It has: "
            f"{', '.join(log.extra) or 'nothing but the battery'}"
        )
    named = unit_in_name(speed_column, ("speed",))
    unit = named if named and not speed_unit else given_unit("speed", speed_unit or "m/s")
    speed_m_s, fast = _credible(unit.in_si(log.extra[speed_column]), FASTEST_M_S, f"speed above {FASTEST_M_S:g} m/s")
    stems = {name: [text.lower().strip(" _") for text, _ in split_unit(name)] for name in log.extra}
    columns = [(unit_in_name(name, ("angle",)), name) for stem in SLOPES for name in stems if stem in stems[name]]
    of_slope, slope = next(((angle, name) for angle, name in columns if angle), (None, ""))
    ground = f"slope from {slope!r} in {of_slope.symbol}" if of_slope else "level ground assumed"
    note = Note(f"speed from column {speed_column!r} in {unit.symbol}, {ground}")
    if of_slope is None:
        return BodyMotion(speed_m_s, None, None, (note, *fast))
    grade_rad, steep = _credible(of_slope.in_si(log.extra[slope]), STEEPEST_RAD, f"slope in {slope!r} above 45 degrees")
    return BodyMotion(speed_m_s, grade_rad, None, (note, *fast, *steep))


def _credible(values: np.ndarray, most: float, what: str) -> tuple[np.ndarray, list[Note]]:
    """(T,) values of at most this size, else nan, with a warning of how many were larger."""
    left_out = int(np.count_nonzero(np.abs(values) > most))
    text = f"{what} in {left_out} of {len(values)} samples: left out; is the unit right?"
    return np.where(np.abs(values) <= most, values, np.nan), [Note(text, "warning")] if left_out else []


def record_drive(
    log: Log, motion: BodyMotion, ground: str | Sequence[str] | np.ndarray, payload_kg: float = 0.0
) -> DriveRecord:
    """Cut a drive into stretches and balance its energy.

    ground: name of the ground under each sample (T,) of the log, or one for all.
    payload_kg: load during the drive.

    Raises:
        InputError: no stretch in which speed and power were both measured.
    """
    battery_W = -log.voltage_V * log.current_A
    driven = cut_drive(log.time_s, motion.speed_m_s, battery_W, ground, motion.grade_rad, payload_kg)
    balance = _balance(motion.wheels, log.time_s, battery_W, driven) if motion.wheels else None
    notes = [*log.notes, *motion.notes]
    if balance is not None and not balance.energy.balance.idle > 0:
        text = "the idle power is not known (robot.idle_W is 0, and the robot never stood): it is part of 'residual'"
        notes.append(Note(text, "warning"))
    return DriveRecord(log, motion.speed_m_s, battery_W, driven, balance, tuple(notes))


def _balance(
    wheels: ObservedWheels, time_s: np.ndarray, battery_W: np.ndarray, driven: Sequence[Driven]
) -> RecordedBalance | None:
    """Energy balance on the clock of the wheels; None without motor currents."""
    drive, track, p = wheels
    if not np.isfinite(drive.motor_current_A).any():
        return None
    at_drive_W = interpolated(drive.time_s, time_s, battery_W, BRIDGED_S)
    standing = [d for d in driven if not d.stretch.terrain]
    standing_s = sum(d.stretch.time_s for d in standing)
    idle_W = sum(d.energy_J for d in standing) / standing_s if standing_s else None
    power = drive_balance(drive, track.estimates, p, at_drive_W, idle_W)
    return RecordedBalance(drive.time_s, power, integrate_drive(drive, power, track.estimates, p.robot))


#: Speed [m/s] assumed on a terrain that has not been driven on.
_UNKNOWN_SPEED_M_S = 0.5
#: Distance [m] over which the energy per metre of another day is predicted.
_PREDICTED_M = 100.0


class RecordFigures(NamedTuple):
    """Key figures of a recorded drive; None where not measured."""

    duration_s: float  #: of the log
    used_s: float  #: of the stretches that were measured
    #: of these
    distance_m: float
    energy_J: float
    energy_J_per_m: float | None
    cost_of_transport: float | None  #: energy over weight and distance
    regenerated_J: float | None  #: that flowed into the battery
    split_J: dict[str, float] | None  #: terms of the energy balance, the battery's first
    split_std_J: dict[str, float] | None  #: standard deviation of the terms that have one


class TerrainFigures(NamedTuple):
    """Key figures of a terrain; None where nothing was driven."""

    #: over all drives there
    drives: int
    distance_m: float
    time_s: float
    energy_J: float
    #: measured
    energy_J_per_m: float | None
    cost_of_transport: float | None
    #: resistance
    force_N: float
    force_std_N: float
    speed_m_s: float  #: usual speed
    #: on level ground at that speed on another day
    expected_J_per_m: Quantiles
    expected_cost_of_transport: Quantiles


def record_figures(record: DriveRecord, c: Consumption) -> RecordFigures:
    """Figures of a recorded drive of the robot with this consumption."""
    energy_J = sum(d.energy_J for d in record.driven)
    distance_m = sum(d.stretch.distance_m for d in record.driven)
    energy = record.balance.energy if record.balance else None
    return RecordFigures(
        duration_s=record.log.duration_s,
        used_s=sum(d.stretch.time_s for d in record.driven),
        distance_m=distance_m,
        energy_J=energy_J,
        energy_J_per_m=energy_J / distance_m if distance_m else None,
        cost_of_transport=cost_of_transport(c, energy_J, distance_m),
        regenerated_J=energy.regenerated_J if energy else None,
        split_J={name: getattr(energy.balance, name) for name in ("battery", *DRIVE_TERMS)} if energy else None,
        split_std_J=energy.std_J if energy else None,
    )


def terrain_figures(c: Consumption, terrain: str) -> TerrainFigures:
    """Figures of a terrain as measured, and as expected on another day."""
    visits = c.visits[c.terrains.index(terrain)]
    k = c.force_index(terrain)
    speed_m_s = usual_speed_m_s(c, terrain)
    expected = expected_J_per_m(c, terrain, speed_m_s)
    return TerrainFigures(
        *visits,
        energy_J_per_m=visits.energy_J / visits.distance_m if visits.distance_m else None,
        cost_of_transport=cost_of_transport(c, visits.energy_J, visits.distance_m),
        force_N=float(c.mean[k]),
        force_std_N=float(c.cov[k, k] ** 0.5),
        speed_m_s=speed_m_s,
        expected_J_per_m=expected,
        expected_cost_of_transport=Quantiles(*(value / _weight_N(c) for value in expected)),
    )


def cost_of_transport(c: Consumption, energy_J: float, distance_m: float) -> float | None:
    """Energy over weight and distance, a number without a unit; None without a distance."""
    return energy_J / (_weight_N(c) * distance_m) if distance_m else None


def usual_speed_m_s(c: Consumption, terrain: str) -> float:
    """Mean speed of all drives on a terrain; 0.5 m/s where there were none."""
    visits = c.visits[c.terrains.index(terrain)]
    return visits.distance_m / visits.time_s if visits.time_s else _UNKNOWN_SPEED_M_S


def expected_J_per_m(c: Consumption, terrain: str, speed_m_s: float) -> Quantiles:
    """P10, P50 and P90 of the energy per metre [J/m] over 100 m of level ground on another day."""
    demand = energy_demand(begin_drive(c), [stretch_of(Leg(_PREDICTED_M, terrain, speed_m_s))])
    energy_J = quantiles(needed_J(demand, normal_points(DIMENSIONS)))
    return Quantiles(*(value / _PREDICTED_M for value in energy_J))


def _weight_N(c: Consumption) -> float:
    return c.prior.mass_kg * GRAVITY
