"""Cells of porous electrodes, simulated with PyBaMM: batteries that no model of this package describes exactly."""

from ohmward_lab.simulate.electrochemical.cell import ElectrochemicalCell
from ohmward_lab.simulate.electrochemical.run import CellTruth, aged, capacity_Ah, record_cell, simulate_cell
from ohmward_lab.simulate.mission import DayPlan, working_day

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
