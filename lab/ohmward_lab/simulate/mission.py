"""Load of a battery through a day of a field or warehouse robot: driving, a tool, idling, charging at noon.

Power on the shaft: P = (m a + m g (c_rr cos(grade) + sin(grade))) v; the battery gives P / eta, takes back eta_r P when
braking, and always feeds the electronics. The current is that power over the nominal voltage. `working_day` scales it
with the capacity of the cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward_lab.simulate.profile import Profile, constant, join

_GRAVITY_M_S2 = 9.81
_GRID_S = 1.0

#: A 50 kg robot with 12 V drives, of the kind that carries crates or hoes between rows: without and with a load, which
#: changes from trip to trip.
_MASS_KG, _PAYLOAD_KG = 50.0, 20.0
#: Coefficient of rolling resistance; 0.02 on concrete, 0.06 on firm soil.
_ROLLING_RESISTANCE = 0.045
#: Slowest and fastest speed of a leg, acceleration when starting and braking, standard deviation of the slope of a leg.
_SPEED_M_S, _ACCELERATION_M_S2, _GRADE_STD = (0.3, 0.9), 0.5, 0.02
#: Battery to wheel; share of the braking power that comes back.
_EFFICIENCY, _REGENERATION = 0.65, 0.4
#: Computer, lidar and radio; mower or lift while it works, in a third of the legs.
_IDLE_W, _TOOL_W = 9.0, 25.0
#: Voltage by which power is divided to give current.
_NOMINAL_V = 12.5
#: Current of the robot that stands.
_IDLE_A = -_IDLE_W / _NOMINAL_V


def robot_day(rng: np.random.Generator, charge_current_A: float) -> Profile:
    """Nine and a half hours from 07:30: work, a break, work, charging at noon, work, docked without a load.

    The work takes about 16 Ah, more than a battery of 12 Ah holds: without the charge the day would not end well.
    charge_current_A: of the charger [A] before its constant-voltage phase.
    """
    work = [drive(rng, hours * SECONDS_PER_HOUR) for hours in (1.6, 1.6, 3.2)]
    day = join(
        [
            constant(600.0, 0.0),
            work[0],
            constant(0.4 * SECONDS_PER_HOUR, _IDLE_A),
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


def drive(rng: np.random.Generator, duration_s: float) -> Profile:
    """Legs of 5 to 40 m with stops between them, on ground of changing slope and roughness."""
    time_s = np.arange(0.0, duration_s, _GRID_S)
    speed, grade, mass, tool = np.zeros((4, time_s.size))
    start = 0
    payload_kg = 0.0
    while start < time_s.size:
        leg = leg_speed(rng)
        rows = slice(start, start + leg.size)
        if rng.random() < 0.1:
            payload_kg = _PAYLOAD_KG * rng.integers(0, 2)
        speed[rows] = leg[: speed[rows].size]
        grade[rows] = rng.normal(0.0, _GRADE_STD)
        mass[rows] = _MASS_KG + payload_kg
        tool[rows] = _TOOL_W * (rng.random() < 1 / 3)
        start += leg.size
    rough = 1.0 + 0.25 * rng.standard_normal(time_s.size)
    power = shaft_power_W(speed, mass, grade, _ROLLING_RESISTANCE * rough)
    battery = np.where(power > 0.0, power / _EFFICIENCY, power * _REGENERATION) + tool * (speed > 0.0)
    return Profile(time_s, -(battery + _IDLE_W) / _NOMINAL_V, np.zeros(time_s.size))


def leg_speed(rng: np.random.Generator) -> np.ndarray:
    """Speed [m/s] each second of one leg: a ramp up, a cruise, a ramp down, a stop of 2 to 30 s."""
    cruise = rng.uniform(*_SPEED_M_S)
    ramp_s = cruise / _ACCELERATION_M_S2
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
    idle_A = _IDLE_A * capacity_Ah / _MISSION_AH
    share = float(np.interp(plan.ambient_degC, _CHARGING_DEGC, _CHARGING_SHARE))
    charge = constant(_OPPORTUNITY_S / share, share * _OPPORTUNITY_C * capacity_Ah * plan.opportunity_charges)
    legs = [drive(rng, hours * SECONDS_PER_HOUR) for hours in (1.3, 1.1, 1.2, 1.1, 1.0)]
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
