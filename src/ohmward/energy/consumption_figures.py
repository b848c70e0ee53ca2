"""Consumption in figures: energy per metre and cost of transport of a drive and of each terrain."""

from __future__ import annotations

from typing import NamedTuple

from ohmward.energy.balance import DRIVE_TERMS
from ohmward.energy.consumption import Consumption, begin_drive, energy_demand
from ohmward.energy.drive_record import DriveRecord
from ohmward.energy.leg import Leg, stretch_of
from ohmward.energy.points import Quantiles, normal_points, quantiles
from ohmward.energy.range import DIMENSIONS, needed_J
from ohmward.traction.robot.robot import GRAVITY

#: Speed [m/s] of a terrain that has not been driven on.
_UNKNOWN_SPEED_M_S = 0.5
#: Distance [m] over which the energy per metre of another day is predicted.
_PREDICTED_M = 100.0


class RecordFigures(NamedTuple):
    """A recorded drive in figures; None where it was not measured."""

    duration_s: float  #: of the log
    used_s: float  #: of the stretches that were measured
    #: of these
    distance_m: float
    energy_J: float
    energy_J_per_m: float | None
    cost_of_transport: float | None  #: energy over weight and distance
    regenerated_J: float | None  #: that flowed into the battery
    split_J: dict[str, float] | None  #: terms of the energy balance, the battery's first
    split_std_J: dict[str, float] | None  #: standard deviation of those that have one


class TerrainFigures(NamedTuple):
    """A terrain in figures; None where nothing was driven."""

    #: of all that was driven there
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
    """Mean speed of all that was driven there; half a metre a second where nothing was."""
    visits = c.visits[c.terrains.index(terrain)]
    return visits.distance_m / visits.time_s if visits.time_s else _UNKNOWN_SPEED_M_S


def expected_J_per_m(c: Consumption, terrain: str, speed_m_s: float) -> Quantiles:
    """P10, P50 and P90 of the energy per metre [J/m] over 100 m of level ground on another day."""
    demand = energy_demand(begin_drive(c), [stretch_of(Leg(_PREDICTED_M, terrain, speed_m_s))])
    energy_J = quantiles(needed_J(demand, normal_points(DIMENSIONS)))
    return Quantiles(*(value / _PREDICTED_M for value in energy_J))


def _weight_N(c: Consumption) -> float:
    return c.prior.mass_kg * GRAVITY
