"""Filters of [T] chapter 3 along a measured log, beside the results on the simulated pack; and on a measured NMC cell.

The cell is one of TU Eindhoven, whose records are not part of this package: A. M. A. Sheikh, M. C. F. Donkers, H. J.
Bergveld, Journal of Energy Storage 2024, doi 10.1016/j.est.2024.112581; the records are those of
github.com/muizabdul29/PyBatteryID, see docs/data.md.
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
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.figures.battery import current_figure, voltage_figure
from ohmward.logs import read_log
from ohmward.logs.log import SECONDS_PER_HOUR, Log
from ohmward.report import TIME, Figure, Series
from ohmward_lab.published.rc import rc_of_thevenin
from ohmward_lab.published.scheme_by_method import METHODS
from ohmward_lab.reproduce.row import Item, Result, ResultRow, error_rows, errors
from ohmward_lab.reproduce.thesis_battery import SOC_PERCENT, START_STD, VOLTAGE_V, run_along

_WHY = (
    "another battery and another drive than those printed; the state of charge is compared with the count of the log's "
    "own current from the given start, as in [T]"
)


def measured_item(log: Log, battery: Battery, start_soc: float) -> Item:
    """Voltage and state of charge by the four filters along this log, from this start."""
    return Item(("measured",), f"{battery.name} along {log.name}", partial(measured, log, battery, start_soc))


def measured(log: Log, battery: Battery, start_soc: float, why: str = _WHY) -> Result:
    """Rows as in tables 3.2 and 3.3; voltage errors are those before the sample.

    why: reason of the difference from the printed numbers.
    """
    model = rc_of_thevenin(battery.thevenin)
    counted = start_soc + log.charge_Ah() / battery.capacity_Ah
    there = np.isfinite(log.voltage_V) & (log.voltage_V > 0.0)
    if missing := int(np.sum(~there)):
        why += (
            f"; {missing} of {len(log)} samples have no voltage: the filters predict over them, and the errors leave "
            "them out"
        )
    default = SocEstimator(battery, initial_soc=start_soc, initial_soc_std=START_STD).run(log)
    default_V = errors((log.voltage_V - default.voltage_V)[there & np.isfinite(default.voltage_V)])
    default_soc = errors(100.0 * (default.soc - counted)[there])

    rows: list[ResultRow] = []
    lines = []
    for method in METHODS:
        printed, corrected = (run_along(log, model, method, form, start_soc) for form in (False, True))
        name = method.upper()
        printed_V, corrected_V = ([errors(found.innovation_V[there])] for found in (printed, corrected))
        what = f"Voltage before the sample, {name}"
        rows += error_rows(what, "V", VOLTAGE_V[method], printed_V, corrected_V, [default_V])
        printed_soc, corrected_soc = ([errors(100.0 * (found.soc - counted)[there])] for found in (printed, corrected))
        rows += error_rows(f"SoC, {name}", "%", SOC_PERCENT[method], printed_soc, corrected_soc, [default_soc])
        lines.append(Series(log.time_s, 1e3 * corrected.innovation_V, name))
    rows[0] = rows[0]._replace(why=why)
    drawn = Figure("Voltage error before the sample", TIME, "Error [mV]", lines)
    return Result(tuple(rows), (current_figure(log), voltage_figure(log), drawn))


#: Folder of the records inside the folder of measured data.
FOLDER = "tue_cells"

_CELL, _IDENTIFIES, _DRIVE = "nmc", "identification_data", "drive_cycle_data"
_GRID = np.linspace(0.0, 1.0, 401)  # steps of 0.25 %: finer than the authors' table
_WHY_NMC = (
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

    def along_drive() -> Result:
        return measured(_record(folder, _DRIVE), _identified(folder), first_soc(folder, _CELL, _DRIVE), _WHY_NMC)

    return Item(("nmc",), "A measured NMC cell along a drive cycle", along_drive)


def _identified(folder: Path) -> Battery:
    """The battery from the record made for identification and the authors' open-circuit voltage."""
    log = _record(folder, _IDENTIFIES)
    return identify(
        [log],
        capacity_Ah=_scalars(folder, _CELL, _IDENTIFIES)["battery_capacity"] / SECONDS_PER_HOUR,
        chemistry="nmc",
        initial_soc={log.name: first_soc(folder, _CELL, _IDENTIFIES)},
        ocv=OcvCurve(gitt_voltage(by_soc(folder / f"ocv_{_CELL}_gitt_data.csv"), _GRID)),
    )


def _record(folder: Path, test: str) -> Log:
    return read_log(folder / "records.parquet", where={"cell": _CELL, "test": test})


def first_soc(folder: Path, cell: str, test: str) -> float:
    """State of charge at the start of a record as the authors give it; full where they give none."""
    return _scalars(folder, cell, test).get("initial_soc", 1.0)


def _scalars(folder: Path, cell: str, test: str) -> dict[str, float]:
    """Numbers that come with a record: initial state of charge, capacity [A s]."""
    with (folder / "index.csv").open(encoding="utf-8") as file:
        found = {(row["cell"], row["test"]): row["scalars"] for row in csv.DictReader(file)}
    return {name: float(value) for name, value in ast.literal_eval(found[cell, test]).items()}


def by_soc(file: Path) -> np.ndarray:
    """Columns of one of the authors' tables, sorted by the first, the state of charge."""
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    return table[np.argsort(table[:, 0])]


def gitt_voltage(table: np.ndarray, grid: np.ndarray) -> tuple[float, ...]:
    """Open-circuit voltage [V] on a grid of the state of charge, made non-decreasing."""
    return tuple(np.maximum.accumulate(np.interp(grid, table[:, 0], table[:, 1])).tolist())
