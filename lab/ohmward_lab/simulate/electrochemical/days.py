"""Days of a robot on a simulated electrochemical cell: drives, idle draw, rests, charges, changing temperature."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward_lab.simulate.mission import MissionRobot, drive
from ohmward_lab.simulate.profile import Profile, join

_HOUR_S = 3600.0
#: The robot of `mission` draws this capacity [Ah] in five hours of work: currents scale with the cell's capacity.
_MISSION_AH = 12.0
#: Charger's current over the capacity [1/h]: C/3 overnight, C/2 in between.
_CHARGER_C, _OPPORTUNITY_C, _OPPORTUNITY_S = 1 / 3, 1 / 2, 1800.0
#: Data sheets of lithium cells allow the full charging current from 15 degC, and 0.3 of it or less at -10 degC; an
#: opportunity charge then takes so much longer.
_CHARGING_DEGC, _CHARGING_SHARE = (-10.0, 15.0), (0.3, 1.0)


class DayPlan(NamedTuple):
    """Temperatures and charges of a working day."""

    ambient_degC: float = ROOM_DEGC  #: mean over the day
    #: half the distance from the coldest hour, 04:00, to the warmest, 16:00; 0 for a constant temperature
    swing_K: float = 0.0
    load: float = 1.0  #: factor on the currents of driving
    #: after the second and the fourth drive, a quarter of the capacity each; slower in the cold
    opportunity_charges: bool = True
    charged_fully: bool = False  #: in the night after, for four hours


def working_day(rng: np.random.Generator, capacity_Ah: float, plan: DayPlan | None = None) -> Profile:
    """Eight hours from 08:00, more in the cold: five drives, idle draw in pauses, rests without it, two charges."""
    plan = plan or DayPlan()
    robot = MissionRobot()
    idle_A = -robot.idle_W / robot.nominal_V * capacity_Ah / _MISSION_AH
    share = float(np.interp(plan.ambient_degC, _CHARGING_DEGC, _CHARGING_SHARE))
    charge = _constant(_OPPORTUNITY_S / share, share * _OPPORTUNITY_C * capacity_Ah * plan.opportunity_charges)
    legs = [_driven(rng, robot, hours, plan.load * capacity_Ah / _MISSION_AH) for hours in (1.3, 1.1, 1.2, 1.1, 1.0)]
    parts = [
        _constant(900.0, 0.0),
        legs[0],
        _constant(1200.0, idle_A),
        legs[1],
        charge,
        _constant(600.0, idle_A),
        legs[2],
        _constant(900.0, 0.0),
        legs[3],
        charge,
        legs[4],
        _constant(900.0, 0.0),
    ]
    if plan.charged_fully:
        parts += [_constant(4.5 * _HOUR_S / share, _CHARGER_C * share * capacity_Ah), _constant(1200.0, 0.0)]
    day = join(parts)
    return day._replace(ambient_degC=ambient(day.time_s, plan, start_hour=8.0))


def first_discharged(profile: Profile, capacity_Ah: float, depth: float) -> tuple[Profile, float]:
    """The profile after a discharge of the full cell by `depth` of the capacity and an hour of rest; its start [s].

    Both run at the profile's first temperature: that is how a cell comes to a day with its charge known.
    """
    rate_A = -capacity_Ah / 3.0
    before = [_constant(600.0, 0.0)]
    if depth > 0.0:
        before += [_constant(3.0 * _HOUR_S * depth, rate_A), _constant(_HOUR_S, 0.0)]
    joined = join([*before, profile])
    start = joined.time_s[-1] - profile.time_s[-1]
    return joined._replace(ambient_degC=np.interp(joined.time_s - start, profile.time_s, profile.ambient_degC)), start


def ambient(time_s: np.ndarray, plan: DayPlan, start_hour: float) -> np.ndarray:
    """Temperature of the air [degC]: coldest at 04:00."""
    hour = start_hour + time_s / _HOUR_S
    return plan.ambient_degC - plan.swing_K * np.cos(2 * np.pi * (hour - 4.0) / 24.0)


def days(rng: np.random.Generator, capacity_Ah: float, plans: Sequence[DayPlan]) -> Profile:
    """One working day after the other, without the nights between them."""
    return join([working_day(rng, capacity_Ah, plan) for plan in plans])


def _driven(rng: np.random.Generator, robot: MissionRobot, hours: float, scale: float) -> Profile:
    """A drive whose currents are held for a second each, as the controller of a motor holds them."""
    one = drive(rng, robot, hours * _HOUR_S)
    return one._replace(current_A=scale * one.current_A)


def _constant(duration_s: float, current_A: float) -> Profile:
    return Profile(np.array([0.0, duration_s]), np.full(2, current_A), np.zeros(2))
