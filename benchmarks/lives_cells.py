"""Simulated cells of the table of lives: their bench tests and days, computed once and stored in the build folder."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from figure import HERE
from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.identification import identify
from ohmward.logs import Log
from ohmward_lab.simulate.electrochemical import (
    FINE_V,
    CellTruth,
    ElectrochemicalCell,
    aged,
    capacity_Ah,
    log_of,
    simulate_cell,
    until_cut_off,
    usual_sensors,
)
from ohmward_lab.simulate.mission import DayPlan, days, first_discharged
from ohmward_lab.simulate.profile import Profile, bench_times, low_rate_profile, pulse_profile
from ohmward_lab.simulate.sensors import BatterySensors

STORE = HERE.parent / "build" / "lives"
#: Share of its capacity that a day starts without: no day starts where the voltage alone gives the charge away.
START_DEPTH = 0.1
#: A night's charge ends the day: what identification learns from everyday records is between two of these.
_EVERYDAY = (DayPlan(22.0, 4.0, charged_fully=True), DayPlan(20.0, 4.0, load=1.2, charged_fully=True))
#: Step [s] of a charger that counts.
_CHARGER_S = 10.0
_HOUR_S = 3600.0
#: Resistance of a cell that has kept this share of its capacity, over a new one's, and days since the tests.
RESISTANCE_AT = {1.0: 1.0, 0.9: 1.2, 0.8: 1.5}
DAYS_AFTER = {1.0: 1.0, 0.9: 730.0, 0.8: 1461.0}
#: Unix time [s] of the tests.
_TESTED_UNIX_S = 1.7e9


class LifeCell(NamedTuple):
    """A cell of the table; kept_out: settings were never chosen on it."""

    name: str
    chemistry: str
    new: ElectrochemicalCell
    kept_out: bool = False

    @property
    def slow(self) -> bool:
        """Its days take minutes to simulate: the table has few of them."""
        return self.new.model == "DFN"

    @property
    def label_Ah(self) -> float:
        """Capacity that the user knows [Ah]: that of the new cell, to three digits."""
        return float(f"{capacity_of(self.new):.3g}")


class Life(NamedTuple):
    """A life to simulate; see `DayPlan`.

    plans: of the days, one after the other; capacity_ratio: of the aged cell, one of RESISTANCE_AT.
    """

    plans: tuple[DayPlan, ...]
    capacity_ratio: float = 1.0
    seed: int = 1


CELLS = (
    LifeCell("Prada2013, SPMe", "lfp", ElectrochemicalCell("Prada2013")),
    LifeCell("ORegan2022, SPMe", "nmc", ElectrochemicalCell("ORegan2022", voltage_max_V=4.2)),
    LifeCell("Ecker2015, SPMe", "nmc", ElectrochemicalCell("Ecker2015"), kept_out=True),
    LifeCell("NCA_Kim2011, SPMe", "nca", ElectrochemicalCell("NCA_Kim2011")),
    LifeCell("Marquis2019, SPMe", "lipo", ElectrochemicalCell("Marquis2019"), kept_out=True),
    LifeCell("Sulzer2019, full model", "lead-acid", ElectrochemicalCell("Sulzer2019", "lead-acid", n_series=6)),
    LifeCell("Prada2013, DFN", "lfp", ElectrochemicalCell("Prada2013", "DFN")),
    LifeCell("ORegan2022, DFN", "nmc", ElectrochemicalCell("ORegan2022", "DFN", voltage_max_V=4.2)),
    LifeCell("NCA_Kim2011, DFN", "nca", ElectrochemicalCell("NCA_Kim2011", "DFN")),
    LifeCell("Marquis2019, DFN", "lipo", ElectrochemicalCell("Marquis2019", "DFN"), kept_out=True),
)

#: Names of what was tested.
PULSES, PULSES_SLOW, TWO_TEMPERATURES = "pulses at 25", "pulses and low rate at 25", "pulses at 25 and 0"
EVERYDAY, LABEL = "everyday drives", "the label only"


def test_logs(cell: LifeCell) -> Mapping[str, Callable[[], list[Log]]]:
    """By what was tested: the function that makes the logs."""
    return {
        PULSES: lambda: [bench_log(cell, "pulses", 25.0)],
        PULSES_SLOW: lambda: [bench_log(cell, "low rate", 25.0), bench_log(cell, "pulses", 25.0)],
        TWO_TEMPERATURES: lambda: [bench_log(cell, "pulses", 25.0), bench_log(cell, "pulses", 0.0)],
        EVERYDAY: lambda: [everyday_log(cell)],
    }


@cache
def battery_from(cell: LifeCell, tested: str) -> Battery:
    """The battery file that a user of this cell has; InputError where identification refuses the logs."""
    if tested == LABEL:
        return generic_battery(cell.chemistry, cell.label_Ah, cell.new.n_series)
    logs = test_logs(cell)[tested]()
    return identify(logs, capacity_Ah=cell.label_Ah, chemistry=cell.chemistry, n_series=cell.new.n_series)


def bench_log(cell: LifeCell, test: str, temperature_degC: float) -> Log:
    """Log of a bench test of the new cell, with the sensors of a bench."""
    make = {"pulses": pulse_profile, "low rate": low_rate_profile}[test]
    profile = make(capacity_of(cell.new), temperature_degC)
    times = bench_times(profile) if test == "pulses" else np.arange(0.0, profile.time_s[-1], 10.0)
    name = f"{test} {temperature_degC:g} degC"
    return measured(until_cut_off(truth_of(cell.new, profile, times, name), cell.new), cell, name)


def within_full(profile: Profile, cell: LifeCell) -> Profile:
    """The profile from full whose charger stops when the charge is back: the model of lead-acid makes no gas.

    Cells of lithium are full at their voltage limit, and their profiles are left as they are.
    """
    if cell.chemistry != "lead-acid":
        return profile
    time_s = np.union1d(profile.time_s, np.arange(0.0, profile.time_s[-1], _CHARGER_S))
    current_A, charge_As = np.interp(time_s, profile.time_s, profile.current_A), 0.0
    for k, step_s in enumerate(np.diff(time_s), start=1):
        if charge_As + 0.5 * (current_A[k - 1] + current_A[k]) * step_s > 0.0:
            current_A[k] = min(current_A[k], 0.0)
        charge_As += 0.5 * (current_A[k - 1] + current_A[k]) * step_s
    return Profile(time_s, current_A, np.interp(time_s, profile.time_s, profile.ambient_degC))


def everyday_log(cell: LifeCell) -> Log:
    """Two working days of the new cell, from full to full."""
    profile = days(np.random.default_rng(2), capacity_of(cell.new), _EVERYDAY)
    profile = within_full(first_discharged(profile, capacity_of(cell.new), 0.0)[0], cell)
    truth = truth_of(cell.new, profile, np.arange(0.0, profile.time_s[-1], 1.0), "everyday")
    return measured(truth, cell, "everyday")


@cache
def truth_of_life(cell: LifeCell, life: Life, interval_s: float = 1.0, hours: float = np.inf) -> CellTruth:
    """The truth of a life or its first hours, from a rest of an hour after START_DEPTH was discharged."""
    profile = days(np.random.default_rng(life.seed), capacity_of(cell.new), life.plans)
    profile, start_s = first_discharged(profile, capacity_of(cell.new), START_DEPTH)
    profile = within_full(profile, cell) if any(plan.charged_fully for plan in life.plans) else profile
    older = aged_cell(cell.new, life.capacity_ratio)
    end_s = min(start_s + _HOUR_S * hours, profile.time_s[-1])
    return truth_of(older, profile, np.arange(start_s, end_s, interval_s), f"life {life}")


def measured(
    truth: CellTruth, cell: LifeCell, name: str, sensors: BatterySensors | None = None, days_after: float = 0.0
) -> Log:
    """Log of the truth, its time from 0, its noise drawn by the names; with the sensors of a bench by default.

    days_after: since the tests.
    """
    rng = np.random.default_rng(int(hashlib.sha256(f"{cell.name} {name}".encode()).hexdigest()[:8], 16))
    log = log_of(truth, sensors or make_sensors(cell), rng, name)
    return replace(log, start_unix_s=_TESTED_UNIX_S + 86400.0 * days_after)


def make_sensors(
    cell: LifeCell, offset: float = 0.0, gain: float = 0.0, voltage_step_V: float = FINE_V
) -> BatterySensors:
    """Sensors of a robot; see `usual_sensors`."""
    return usual_sensors(cell.label_Ah, cell.new.n_series, offset, gain, voltage_step_V)


@cache
def aged_cell(new: ElectrochemicalCell, capacity_ratio: float) -> ElectrochemicalCell:
    """The cell with this share of its capacity left, and the resistance that goes with it."""
    return new if capacity_ratio == 1.0 else aged(new, capacity_ratio, RESISTANCE_AT[capacity_ratio])


@cache
def capacity_of(cell: ElectrochemicalCell) -> float:
    """Capacity [Ah] at the cell's age, stored."""
    return float(_stored(f"capacity {cell}", lambda: {"capacity_Ah": np.array(capacity_Ah(cell))})["capacity_Ah"])


def truth_of(cell: ElectrochemicalCell, profile: Profile, times: np.ndarray, name: str) -> CellTruth:
    """The truth of a run, stored; name: for people who look into the store."""
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in (*profile, times))).hexdigest()
    return CellTruth(**_stored(f"{cell} {name} {digest}", lambda: simulate_cell(cell, profile, times)._asdict()))


def _stored(key: str, make: Callable[[], Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Arrays from the build folder, made first where they are not there."""
    path = STORE / f"{hashlib.sha256(key.encode()).hexdigest()[:24]}.npz"
    if not path.exists():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            arrays = make()
        STORE.mkdir(parents=True, exist_ok=True)
        partial = Path(f"{path}.part.npz")
        np.savez_compressed(partial, **arrays)
        partial.replace(path)
    with np.load(path) as stored:
        return {name: stored[name] for name in stored.files}
