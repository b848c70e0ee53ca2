"""Energy balance, consumption, usable energy, range and mission forecast; see docs/energy.md."""

from ohmward.energy.balance import DriveEnergy, EnergyBalance, drive_balance, integrate_drive
from ohmward.energy.consumption import Consumption, EnergyDemand, begin_drive, energy_demand, learn, start, with_terrain
from ohmward.energy.consumption_file import load_consumption, save_consumption
from ohmward.energy.consumption_prior import ConsumptionPrior, prior_from_mass, prior_from_robot
from ohmward.energy.get_home import Milestone, MissionForecast, get_home
from ohmward.energy.leg import Leg, Stretch, stretch_of
from ohmward.energy.points import Quantiles
from ohmward.energy.range import Range, range_left, time_left
from ohmward.energy.range_estimator import RangeEstimator, RangeRun
from ohmward.energy.range_step import RangeEstimate, RangeFlag
from ohmward.energy.recorded import Cut, Driven, cut_drive
from ohmward.energy.speed_advice import SpeedAdvice, speed_advice
from ohmward.energy.usable_energy import BatteryState, usable_energy

__all__ = [
    "BatteryState",
    "Consumption",
    "ConsumptionPrior",
    "Cut",
    "DriveEnergy",
    "Driven",
    "EnergyBalance",
    "EnergyDemand",
    "Leg",
    "Milestone",
    "MissionForecast",
    "Quantiles",
    "Range",
    "RangeEstimate",
    "RangeEstimator",
    "RangeFlag",
    "RangeRun",
    "SpeedAdvice",
    "Stretch",
    "begin_drive",
    "cut_drive",
    "drive_balance",
    "energy_demand",
    "get_home",
    "integrate_drive",
    "learn",
    "load_consumption",
    "prior_from_mass",
    "prior_from_robot",
    "range_left",
    "save_consumption",
    "speed_advice",
    "start",
    "stretch_of",
    "time_left",
    "usable_energy",
    "with_terrain",
]
