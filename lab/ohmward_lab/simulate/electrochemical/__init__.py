"""Cells of porous electrodes, simulated with PyBaMM: batteries that no model of this package describes exactly."""

from ohmward_lab.simulate.electrochemical.cell import ElectrochemicalCell
from ohmward_lab.simulate.electrochemical.days import DayPlan, working_day
from ohmward_lab.simulate.electrochemical.records import record_cell
from ohmward_lab.simulate.electrochemical.run import CellTruth, aged, capacity_Ah, simulate_cell

__all__ = [
    "CellTruth",
    "DayPlan",
    "ElectrochemicalCell",
    "aged",
    "capacity_Ah",
    "record_cell",
    "simulate_cell",
    "working_day",
]
