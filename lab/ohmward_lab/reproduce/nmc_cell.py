"""Filters of [T] chapter 3 on a measured NMC cell of TU Eindhoven, whose records are not part of this package.

Source: A. M. A. Sheikh, M. C. F. Donkers, H. J. Bergveld, Journal of Energy Storage 2024,
doi 10.1016/j.est.2024.112581; the records are those of github.com/muizabdul29/PyBatteryID, see docs/data.md.
"""

from __future__ import annotations

import ast
import csv
from functools import partial
from pathlib import Path

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.identification import identify
from ohmward.battery.models.ocv import OcvCurve
from ohmward.logs import read_log
from ohmward.logs.log import Log
from ohmward_lab.reproduce.measured import measured
from ohmward_lab.reproduce.row import Item, Result

#: Folder of the records inside the folder of measured data.
FOLDER = "tue_cells"

_CELL, _IDENTIFIES, _DRIVE = "nmc", "identification_data", "drive_cycle_data"
_SECONDS_PER_HOUR = 3600.0
_GRID = np.linspace(0.0, 1.0, 401)  # steps of 0.25 %: finer than the authors' table
_WHY = (
    "one measured NMC cell of 0.96 Ah instead of ten lithium polymer cells of 8 Ah in series (the voltage error of the "
    "pack is that of ten cells), a drive cycle of four hours from 95 to 4 % instead of a joystick's from 98 to 90 %; "
    "the cell is identified from another record; the state of charge is compared with the count of the cycler's "
    "current from the start that the authors give"
)


def nmc_item(data: Path) -> Item:
    """Voltage and state of charge by the four filters along the drive cycle of the NMC cell.

    data: the folder that holds `tue_cells`.

    Raises:
        FileNotFoundError: the records are not there.
    """
    folder = data / FOLDER
    if not (records := folder / "records.parquet").is_file():
        raise FileNotFoundError(records)
    return Item(("nmc",), "A measured NMC cell along a drive cycle", partial(_along_drive, folder))


def _along_drive(folder: Path) -> Result:
    battery = _identified(folder)
    return measured(_record(folder, _DRIVE), battery, first_soc(folder, _CELL, _DRIVE), _WHY)


def _identified(folder: Path) -> Battery:
    """The battery from the record made for identification and the authors' open-circuit voltage."""
    log = _record(folder, _IDENTIFIES)
    return identify(
        [log],
        capacity_Ah=_scalars(folder, _CELL, _IDENTIFIES)["battery_capacity"] / _SECONDS_PER_HOUR,
        chemistry="nmc",
        initial_soc={log.name: first_soc(folder, _CELL, _IDENTIFIES)},
        ocv=OcvCurve(gitt_voltage(ocv_table(folder, _CELL), _GRID)),
    )


def _record(folder: Path, test: str) -> Log:
    return read_log(folder / "records.parquet", where={"cell": _CELL, "test": test})


def first_soc(folder: Path, cell: str, test: str) -> float:
    """State of charge at the start of a record as the authors give it; without one the cell was full."""
    return _scalars(folder, cell, test).get("initial_soc", 1.0)


def _scalars(folder: Path, cell: str, test: str) -> dict[str, float]:
    """Numbers that come with a record: initial state of charge, capacity [A s]."""
    with (folder / "index.csv").open(encoding="utf-8") as file:
        found = {(row["cell"], row["test"]): row["scalars"] for row in csv.DictReader(file)}
    return {name: float(value) for name, value in ast.literal_eval(found[cell, test]).items()}


def ocv_table(folder: Path, cell: str) -> np.ndarray:
    """Open-circuit voltage of a cell by titration (GITT): state of charge, voltage [V], sorted by the first."""
    table = np.loadtxt(folder / f"ocv_{cell}_gitt_data.csv", delimiter=",", skiprows=1)
    return table[np.argsort(table[:, 0])]


def gitt_voltage(table: np.ndarray, grid: np.ndarray) -> tuple[float, ...]:
    """Open-circuit voltage on a grid of the state of charge, made to rise [V]."""
    return tuple(np.maximum.accumulate(np.interp(grid, table[:, 0], table[:, 1])).tolist())
