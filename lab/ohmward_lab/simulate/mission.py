"""Load of a battery through a day of a field or warehouse robot: driving, a tool, idling, charging at noon.

Power on the shaft: P = (m a + m g (c_rr cos(grade) + sin(grade))) v; the battery gives P / eta, takes back eta_r P when
braking, and always feeds the electronics. The current is that power over the nominal voltage. `working_day` scales it
with the capacity of the cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.checks import require_between, require_each_not_negative, require_each_positive
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward_lab.simulate.profile import Profile, constant, join

_GRAVITY_M_S2 = 9.81
_GRID_S = 1.0


@dataclass(frozen=True)
class MissionRobot:
    """A 50 kg robot with 12 V drives, of the kind that carries crates or hoes between rows.

    Raises:
        InputError: a value out of its range.
    """

    #: without and with load, which changes from trip to trip
    mass_kg: float = 50.0
    payload_kg: float = 20.0
    rolling: float = 0.045  #: coefficient of rolling resistance; 0.02 on concrete, 0.06 on firm soil
    speed_m_s: tuple[float, float] = (0.3, 0.9)  #: (slowest, fastest) speed of a leg
    acceleration_m_s2: float = 0.5  #: when starting and braking
    grade_std: float = 0.02  #: standard deviation of the slope of a leg
    #: battery to wheel; share of the braking power that comes back
    efficiency: float = 0.65
    regeneration: float = 0.4
    idle_W: float = 9.0  #: computer, lidar, radio
    tool_W: float = 25.0  #: mower or lift while it works, in a third of the legs
    nominal_V: float = 12.5  #: voltage by which power is divided to give current

    def __post_init__(self) -> None:
        require_each_positive("robot.", self, "mass_kg", "speed_m_s", "acceleration_m_s2", "efficiency", "nominal_V")
        require_each_not_negative("robot.", self, "payload_kg", "rolling", "grade_std", "idle_W", "tool_W")
        for name in ("efficiency", "regeneration"):
            require_between(f"robot.{name}", getattr(self, name), 0.0, 1.0)


def robot_day(rng: np.random.Generator, charge_current_A: float, robot: MissionRobot | None = None) -> Profile:
    """Nine and a half hours from 07:30: work, a break, work, charging at noon, work, docked without a load.

    The work takes about 16 Ah, more than a battery of 12 Ah holds: without the charge the day would not end well.
    charge_current_A: of the charger [A] before its constant-voltage phase.
    """
    robot = robot or MissionRobot()
    work = [drive(rng, robot, hours * SECONDS_PER_HOUR) for hours in (1.6, 1.6, 3.2)]
    idle_A = -robot.idle_W / robot.nominal_V
    day = join(
        [
            constant(600.0, 0.0),
            work[0],
            constant(0.4 * SECONDS_PER_HOUR, idle_A),
            work[1],
            constant(1.75 * SECONDS_PER_HOUR, charge_current_A),
            work[2],
            constant(0.7 * SECONDS_PER_HOUR, 0.0),
        ]
    )
    return day._replace(ambient_degC=ambient_degC(day.time_s, 7.5))


def ambient_degC(time_s: np.ndarray, start_hour: float, mean_degC: float = 18.0, swing_K: float = 6.0) -> np.ndarray:
    """Temperature of the air [degC], coldest at 04:00 and warmest at 16:00; the defaults are a day in spring."""
    hour = start_hour + time_s / SECONDS_PER_HOUR
    return mean_degC - swing_K * np.cos(2 * np.pi * (hour - 4.0) / 24.0)


def drive(rng: np.random.Generator, robot: MissionRobot, duration_s: float) -> Profile:
    """Legs of 5 to 40 m with stops between them, on ground of changing slope and roughness."""
    time_s = np.arange(0.0, duration_s, _GRID_S)
    speed, grade, mass, tool = np.zeros((4, time_s.size))
    start = 0
    payload_kg = 0.0
    while start < time_s.size:
        leg = leg_speed(rng, robot)
        rows = slice(start, start + leg.size)
        if rng.random() < 0.1:
            payload_kg = robot.payload_kg * rng.integers(0, 2)
        speed[rows] = leg[: speed[rows].size]
        grade[rows] = rng.normal(0.0, robot.grade_std)
        mass[rows] = robot.mass_kg + payload_kg
        tool[rows] = robot.tool_W * (rng.random() < 1 / 3)
        start += leg.size
    rough = 1.0 + 0.25 * rng.standard_normal(time_s.size)
    power = shaft_power_W(speed, mass, grade, robot.rolling * rough)
    battery = np.where(power > 0.0, power / robot.efficiency, power * robot.regeneration) + tool * (speed > 0.0)
    return Profile(time_s, -(battery + robot.idle_W) / robot.nominal_V, np.zeros(time_s.size))


def leg_speed(rng: np.random.Generator, robot: MissionRobot) -> np.ndarray:
    """Speed [m/s] each second of one leg: a ramp up, a cruise, a ramp down, a stop of 2 to 30 s."""
    cruise = rng.uniform(*robot.speed_m_s)
    ramp_s = cruise / robot.acceleration_m_s2
    moving_s = rng.uniform(5.0, 40.0) / cruise + ramp_s
    t = np.arange(0.0, moving_s + rng.uniform(2.0, 30.0), _GRID_S)
    return cruise * np.clip(np.minimum(t, moving_s - t) / ramp_s, 0.0, 1.0)


def shaft_power_W(speed_m_s: np.ndarray, mass_kg: np.ndarray, grade: np.ndarray, rolling: np.ndarray) -> np.ndarray:
    """Power [W] at the wheels, < 0 when they brake; grade is the slope's tangent, all (T,)."""
    angle = np.arctan(grade)
    acceleration = np.gradient(speed_m_s, _GRID_S)
    resistance = _GRAVITY_M_S2 * (rolling * np.cos(angle) + np.sin(angle))
    return mass_kg * (acceleration + resistance) * speed_m_s


#: The robot of `mission` draws this capacity [Ah] in five hours of work: currents scale with the cell's capacity.
_MISSION_AH = 12.0
#: Charger's current over the capacity [1/h]: C/3 overnight, C/2 in between.
_CHARGER_C, _OPPORTUNITY_C, _OPPORTUNITY_S = 1 / 3, 1 / 2, 1800.0
#: Data sheets of lithium cells allow the full charging current from 15 degC, and 0.3 of it or less at -10 degC; an
#: opportunity charge then takes proportionally longer.
_CHARGING_DEGC, _CHARGING_SHARE = (-10.0, 15.0), (0.3, 1.0)


class DayPlan(NamedTuple):
    """Temperatures and charges of a working day."""

    ambient_degC: float = ROOM_DEGC  #: mean over the day
    #: half the distance from the coldest hour, 04:00, to the warmest, 16:00; 0 for a constant temperature
    swing_K: float = 0.0
    load: float = 1.0  #: factor on the currents of driving
    #: after the second and the fourth drive, a quarter of the capacity each; slower in the cold
    opportunity_charges: bool = True
    charged_fully: bool = False  #: in the night after, for four and a half hours; longer in the cold


def working_day(rng: np.random.Generator, capacity_Ah: float, plan: DayPlan | None = None) -> Profile:
    """Eight hours from 08:00, more in the cold: five drives, idle draw in pauses, rests without it, two charges."""
    plan = plan or DayPlan()
    robot = MissionRobot()
    idle_A = -robot.idle_W / robot.nominal_V * capacity_Ah / _MISSION_AH
    share = float(np.interp(plan.ambient_degC, _CHARGING_DEGC, _CHARGING_SHARE))
    charge = constant(_OPPORTUNITY_S / share, share * _OPPORTUNITY_C * capacity_Ah * plan.opportunity_charges)
    legs = [drive(rng, robot, hours * SECONDS_PER_HOUR) for hours in (1.3, 1.1, 1.2, 1.1, 1.0)]
    legs = [leg._replace(current_A=plan.load * capacity_Ah / _MISSION_AH * leg.current_A) for leg in legs]
    parts = [
        constant(900.0, 0.0),
        legs[0],
        constant(1200.0, idle_A),
        legs[1],
        charge,
        constant(600.0, idle_A),
        legs[2],
        constant(900.0, 0.0),
        legs[3],
        charge,
        legs[4],
        constant(900.0, 0.0),
    ]
    if plan.charged_fully:
        parts += [constant(4.5 * SECONDS_PER_HOUR / share, _CHARGER_C * share * capacity_Ah), constant(1200.0, 0.0)]
    day = join(parts)
    return day._replace(ambient_degC=ambient_degC(day.time_s, 8.0, plan.ambient_degC, plan.swing_K))


def first_discharged(profile: Profile, capacity_Ah: float, depth: float) -> tuple[Profile, float]:
    """The profile after a discharge of the full cell by `depth` of the capacity and an hour of rest; its start [s].

    Both run at the profile's first temperature: this way a cell starts a day at a known charge.
    """
    rate_A = -capacity_Ah / 3.0
    before = [constant(600.0, 0.0)]
    if depth > 0.0:
        before += [constant(3.0 * SECONDS_PER_HOUR * depth, rate_A), constant(SECONDS_PER_HOUR, 0.0)]
    joined = join([*before, profile])
    start = joined.time_s[-1] - profile.time_s[-1]
    return joined._replace(ambient_degC=np.interp(joined.time_s - start, profile.time_s, profile.ambient_degC)), start


def days(rng: np.random.Generator, capacity_Ah: float, plans: Sequence[DayPlan]) -> Profile:
    """One working day after the other, without the nights between them."""
    return join([working_day(rng, capacity_Ah, plan) for plan in plans])
