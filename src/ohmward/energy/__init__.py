"""Energy balance, consumption, usable energy, range and mission forecast; see docs/energy.md."""

from ohmward.energy.consumption import Consumption, begin_drive, energy_demand, learn, start, with_terrain
from ohmward.energy.consumption_file import load_consumption, save_consumption
from ohmward.energy.consumption_prior import prior_from_mass, prior_from_robot
from ohmward.energy.cut_drive import cut_drive
from ohmward.energy.leg import Leg, stretch_of
from ohmward.energy.range import MissionForecast, Range, get_home, range_left
from ohmward.energy.range_estimator import RangeEstimator
from ohmward.energy.range_step import RangeFlag
from ohmward.energy.speed_advice import speed_advice
from ohmward.energy.usable_energy import BatteryState, usable_energy

__all__ = [
    "BatteryState",
    "Consumption",
    "Leg",
    "MissionForecast",
    "Range",
    "RangeEstimator",
    "RangeFlag",
    "begin_drive",
    "cut_drive",
    "energy_demand",
    "get_home",
    "learn",
    "load_consumption",
    "prior_from_mass",
    "prior_from_robot",
    "range_left",
    "save_consumption",
    "speed_advice",
    "start",
    "stretch_of",
    "usable_energy",
    "with_terrain",
]
