"""Measured cells: the tests that identify a battery of each, and the recordings to estimate with their truth.

Which tests a user had is the name of the battery; the recordings are never among them, unless the name says so.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as parquet

from figure import data_file
from ohmward.battery.battery import Battery
from ohmward.battery.identification import identify
from ohmward.battery.identification.record import count_charge
from ohmward.battery.models.ocv import OcvCurve
from ohmward.logs import Log, read_log
from ohmward_lab.reproduce.measured import by_soc, first_soc, gitt_voltage

HOUR = 3600.0
A123_AH, PANASONIC_AH, ORNL_AH, VRLA_AH, I3_AH, NASA_AH = 2.03, 2.9, 30.34, 19.5, 61.7, 2.0
I3_CELLS, VRLA_CELLS = 96, 6

#: Hours between which the telemetry of the lead-acid battery discharges it from full to its cut-off.
VRLA_DISCHARGES_H = ((0.2, 7.6), (23.0, 31.9), (47.0, 57.5), (88.5, 102.15))

#: A pouch cell that rests above this voltage is full.
ORNL_FULL_V = 4.1

#: A full discharge of an ageing cell starts above this voltage and moves at least this charge; others were broken off.
NASA_FULL_V, NASA_LEAST_AH = 4.15, 1.2

#: Trips of the i3 that identify its battery: summer and winter, 15 to 89 % of charge. Others are estimated.
I3_KNOWN = ("TripA01", "TripA03", "TripA05", "TripA15", "TripA17", "TripB17", "TripB25", "TripB31")
I3_DRIVEN = ("TripA07", "TripA11", "TripA21", "TripB03", "TripB23", "TripB27", "TripB29", "TripB37")


class Recording(NamedTuple):
    """A log and its true state of charge (T,), nan where it is not known."""

    log: Log
    truth: np.ndarray


@lru_cache(maxsize=8)
def _table(path: str, **where: float | str) -> Log:
    return read_log(data_file(path), where=where or None)


def _at(log: Log, degC: float) -> Log:
    """The log with its chamber's temperature, where the cell's own was not recorded."""
    return replace(log, temperature_degC=np.full(len(log.time_s), degC))


# A123 26650, LFP: G. Plett's tests at eight temperatures.


def a123_battery(*degC: int) -> Battery:
    """LFP from the tests at these temperatures: low rate both ways, and the first half of the drive there."""
    tests = [test for temperature in degC for test in _a123_tests(temperature)]
    return identify(tests, capacity_Ah=A123_AH, chemistry="lfp")


def _a123_tests(degC: int) -> list[Log]:
    slow = [_table("plett_a123_lfp/a123_ocv.parquet", temp_C=degC, script=script) for script in (1, 3)]
    drive = _a123_drive(degC, 1)
    half = drive.between(drive.time_s[0], drive.time_s[len(drive.time_s) // 2])
    return [replace(_at(log, degC), name=f"{log.name} {degC} degC, {k}") for k, log in enumerate((*slow, half))]


def a123(degC: int) -> Recording:
    """Ten hours of drives with rests, from full to empty; the charge counters of the cycler are the truth."""
    drive, rest = _a123_drive(degC, 1), _a123_drive(degC, 2)
    capacity_Ah = discharged_Ah(drive)[-1] + discharged_Ah(rest)[-1]
    return Recording(_at(drive, degC), 1 - discharged_Ah(drive) / capacity_Ah)


def a123_charge(degC: int) -> Recording:
    """From empty to full at 25 degC with a dither at the end, after the drive at this temperature."""
    charge = _a123_drive(degC, 3)
    moved_Ah = -discharged_Ah(charge)
    return Recording(_at(charge, 25.0), 1 + (moved_Ah - moved_Ah[-1]) / A123_AH)


def _a123_drive(degC: int, script: int) -> Log:
    return _table("plett_a123_lfp/a123_dyn.parquet", temp_C=degC, script=script)


def discharged_Ah(log: Log) -> np.ndarray:
    """Net charge taken out, by the cycler's own counters [Ah]."""
    return log.extra["dis_Ah"] - log.extra["chg_Ah"]


# Panasonic NCR18650PF, NCA: P. Kollmeyer's tests and drive cycles.


def panasonic_battery(*degC: int, low_rate: bool = True, counter: bool = True) -> Battery:
    """NCA from pulses at these temperatures; with the C/20 test at 25 degC, and with the tester's charge counter."""
    names = ["25degC_C20_OCV"] * low_rate + [f"{t}degC_HPPC" for t in degC]
    tests = [_table(f"panasonic_18650pf/{name}.parquet") for name in names]
    if not counter:
        tests = [replace(test, extra={k: v for k, v in test.extra.items() if k != "ah"}) for test in tests]
    return identify(tests, capacity_Ah=PANASONIC_AH, chemistry="nca")


def panasonic(name: str) -> Recording:
    """A drive cycle from full to its cut-off; the tester's counter is the truth."""
    log = _table(f"panasonic_18650pf/{name}.parquet")
    return Recording(log, 1 + log.extra["ah"] / PANASONIC_AH)


# Three cells of TU Eindhoven: NMC, LFP, and NMC from 0 to 41 degC.


class TueCell(NamedTuple):
    """A cell: its chemistry, its capacity [Ah] and what precedes the names of its files."""

    name: str
    chemistry: str
    capacity_Ah: float


TUE = {
    cell.name: cell
    for cell in (
        TueCell("nmc", "nmc", 3440.05372 / HOUR),
        TueCell("lfp", "lfp", 13270.180265768407 / HOUR),
        TueCell("nmc_with_temperature", "nmc", 10344.169 / HOUR),
    )
}


def tue_battery(cell: str, *tests: str) -> Battery:
    """From these records and the open-circuit voltage that comes with the data."""
    known, logs = TUE[cell], [tue_log(cell, test) for test in tests]
    starts = {log.name: tue_start(cell, test) for log, test in zip(logs, tests, strict=True)}
    return identify(
        logs, capacity_Ah=known.capacity_Ah, chemistry=known.chemistry, initial_soc=starts, ocv=tue_ocv(cell)
    )


def tue(cell: str, test: str) -> Recording:
    """A record; the precision cycler's current from the start that the authors give is the truth."""
    log = tue_log(cell, test)
    return Recording(log, tue_start(cell, test) + log.charge_Ah() / TUE[cell].capacity_Ah)


@lru_cache(maxsize=8)
def tue_log(cell: str, test: str) -> Log:
    chosen = [("cell", "=", cell), ("test", "=", test)]
    table = parquet.read_table(data_file("tue_cells/records.parquet"), filters=chosen)
    time_s, current_A, voltage_V, degC = (_floats(table, c) for c in ("t_s", "current_A", "voltage_V", "temp_C"))
    return Log(f"{cell} {test}", time_s, current_A, voltage_V, degC if np.isfinite(degC).any() else None)


def tue_start(cell: str, test: str) -> float:
    """State of charge at the start of a record as the authors give it; without one the cell was full."""
    return first_soc(data_file("tue_cells/index.csv").parent, cell, test)


def tue_ocv(cell: str) -> OcvCurve:
    """The open-circuit voltage as the authors give it: with hysteresis for LFP, with dV/dT for the third cell."""
    grid = np.linspace(0.0, 1.0, 401)

    def column(file: str, k: int) -> np.ndarray:
        soc, values = tue_table(file)[:, [0, k]].T
        return np.interp(grid, soc, values)

    def values(column: np.ndarray) -> tuple[float, ...]:
        return tuple(column.tolist())

    if cell == "lfp":
        mean_V, half_V = column("ocv_lfp_quasi_emf.csv", 1), column("ocv_lfp_hysteresis_data.csv", 1)
        return OcvCurve(values(np.maximum.accumulate(mean_V)), values(half_V))
    file = f"ocv_{cell}_gitt_data.csv"
    mean = gitt_voltage(tue_table(file), grid)
    if cell == "nmc":
        return OcvCurve(mean)
    return OcvCurve(mean, (), values(column(file, 2)), float(tue_table(file)[0, 3]))


def tue_table(file: str) -> np.ndarray:
    """Columns of one of the authors' tables, sorted by state of charge."""
    return by_soc(data_file(f"tue_cells/{file}"))


def _floats(table: parquet.Table, column: str) -> np.ndarray:
    return table[column].to_numpy(zero_copy_only=False).astype(float)


# Nissan Leaf pouch cell (ORNL), sealed lead-acid battery (BBOXX).


def ornl_battery(*degC: int) -> Battery:
    """From the pulses at these temperatures."""
    return identify([_ornl_log(t) for t in degC], capacity_Ah=ORNL_AH, chemistry="nmc")


def ornl(degC: int) -> Recording:
    """Pulses and steps of a tenth, from the rest after the full charge on; the cycler's counter is the truth."""
    log = _ornl_log(degC)
    rests_full = (log.current_A == 0.0) & (log.voltage_V > ORNL_FULL_V)
    full = int(np.argmax(rests_full))
    counted_Ah = count_charge(log).total_Ah
    truth = 1 + (counted_Ah - counted_Ah[full]) / ORNL_AH
    return Recording(log.between(log.time_s[full], np.inf), truth[full:])


def _ornl_log(degC: int) -> Log:
    repeat = {10: "", 25: "-2", 40: "-1"}[degC]
    return _at(_table(f"ornl_nissan_leaf_cell/cell-low-current-hppc-{degC}c{repeat}.parquet"), degC)


def vrla_battery() -> Battery:
    """Sealed lead-acid from its first two discharges and the charge between."""
    return identify([_vrla_log(0.0, 47.0)], capacity_Ah=VRLA_AH, chemistry="lead-acid", n_series=VRLA_CELLS)


def vrla() -> Recording:
    """The third discharge: counted from full to the cut-off at its lowest voltage."""
    return vrla_discharges()[2]


def _vrla_log(from_h: float, to_h: float) -> Log:
    return vrla_telemetry().between(from_h * HOUR, to_h * HOUR)


def vrla_telemetry() -> Log:
    """All five days."""
    return _table("bboxx_vrla_12v_17ah/telemetry_2017-03-25_2017-03-29.csv")


def vrla_discharges() -> list[Recording]:
    """Every discharge from full to the cut-off, with an hour of rest before it where there is one."""
    found = []
    for from_h, to_h in VRLA_DISCHARGES_H:
        log = _vrla_log(from_h, to_h)
        charge_Ah = log.charge_Ah()
        found.append(Recording(log, np.minimum(1 - charge_Ah / charge_Ah[np.argmin(log.voltage_V)], 1.0)))
    return found


# Cells over their life (NASA), an electric car (BMW i3), and a cell that was never tested (CALCE).


@lru_cache(maxsize=4)
def nasa_table(cell: str) -> tuple[Log, np.ndarray, np.ndarray]:
    """Weeks of charges and discharges; the operation and its kind, (T,) each."""
    table = parquet.read_table(data_file(f"nasa_ageing/{cell}.parquet"))
    start_s = table["start"].to_numpy().astype("datetime64[ms]").astype(np.int64) / 1e3
    time_s = start_s + _floats(table, "t_s")
    order = np.argsort(time_s, kind="stable")
    order = order[np.diff(time_s[order], prepend=-np.inf) > 0]
    columns = (_floats(table, c)[order] for c in NASA_COLUMNS)
    log = Log(cell, time_s[order] - time_s[order[0]], *columns, start_unix_s=float(time_s[order[0]]))
    return log, table["op"].to_numpy()[order], np.array(table["kind"].to_pylist())[order]


@lru_cache(maxsize=4)
def nasa(cell: str) -> Recording:
    """The truth of a full discharge is the share of its own charge that is left."""
    log, operation, kind = nasa_table(cell)
    truth = np.full(len(log), np.nan)
    for one in np.unique(operation[kind == "discharge"]):
        at = np.flatnonzero((operation == one) & (kind == "discharge"))
        truth[at] = full_discharge(Log(cell, log.time_s[at], log.current_A[at], log.voltage_V[at]))
    return Recording(log, truth)


NASA_COLUMNS = ("current_A", "voltage_V", "temp_C")


def full_discharge(log: Log) -> np.ndarray:
    """Share of the charge that is left on the way to the lowest voltage; nan where the discharge is not a full one."""
    moved_Ah, empty = -log.charge_Ah(), int(np.argmin(log.voltage_V))
    if log.voltage_V[0] < NASA_FULL_V or moved_Ah[empty] < NASA_LEAST_AH:
        return np.full(len(moved_Ah), np.nan)
    return np.where(np.arange(len(moved_Ah)) <= empty, 1 - moved_Ah / moved_Ah[empty], np.nan)


def i3_battery() -> Battery:
    """From trips alone, whose first state of charge is the car's."""
    logs = [i3(trip) for trip in I3_KNOWN]
    starts = {log.name: float(truth[0]) for log, truth in logs}
    return identify([log for log, _ in logs], capacity_Ah=I3_AH, chemistry="nmc", n_series=I3_CELLS, initial_soc=starts)


@lru_cache(maxsize=16)
def i3(trip: str) -> Recording:
    """A trip at 10 Hz. The truth is what the car shows, which is itself an estimate."""
    table = parquet.read_table(data_file("bmw_i3_trips/trips_odd.parquet"), filters=[("trip", "=", trip)])
    columns = ("t_s", "current_A", "voltage_V", "batt_temp_C")
    return Recording(Log(trip, *(_floats(table, c) for c in columns)), _floats(table, "soc_pct") / 100)


def calce() -> Recording:
    """DST profile from 80 %; the authors' count is the truth."""
    log = _table("calce_inr18650_20r/DST_25C_80SOC.parquet")
    return Recording(log, log.extra["soc"])
