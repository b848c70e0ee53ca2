"""Packs of four unequal cells, simulated cell by cell under one current: the weakest of them, and what warns of it.

The cells are those of lives, simulated once into build/lives. The string carries one current, so the first cell at a
voltage limit limits all: each cell is simulated with the current of all, until none asks for less of it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from figure import Figure, at_least, at_most, rms
from lives_cells import LABEL, PULSES, START_DEPTH, LifeCell, battery_from, capacity_of, truth_of
from ohmward.battery.battery import Battery
from ohmward.battery.cells.drift import expected_weakest
from ohmward.battery.cells.pack_estimator import PackEstimator, PackRun
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.logs import Log
from ohmward_lab.simulate.electrochemical import CellTruth, ElectrochemicalCell, aged, usual_sensors
from ohmward_lab.simulate.mission import DayPlan, days, first_discharged
from ohmward_lab.simulate.profile import Profile, constant, join

RMSE_BAR, COVERAGE_BAR, SECONDS_BAR = 0.015, 0.90, 5.0
#: The band must hold after the first half hour, as in the table of lives.
SETTLED_S = 1800.0
#: Two days with a full charge between them, which no balancer changes.
PLANS = (DayPlan(25.0, 3.0, charged_fully=True), DayPlan(25.0, 3.0))
#: Passes in which the current of the string settles, and the largest charge left between two cells over the capacity.
_PASSES, _SETTLED_SHARE = 6, 0.002
#: Share of a charge by which the charger stays below what the cells would take, so that none is at its limit alone.
_CHARGER_SHARE = 0.98
#: A charge is over once the fullest cell is as close to its fullest as this, in SoC, after it was this far below.
_FULL_WITHIN, _DRIVEN = 0.002, 0.1
#: Offset of a channel of a cell monitor [V], 1 sigma.
_CHANNEL_V = 0.001
_HOUR_S = 3600.0


class PackCell(NamedTuple):
    """A cell over a new one: ratios of capacity and resistance, and by how much its state of charge is lower."""

    capacity: float
    resistance: float
    lower: float


HEALTHY = (PackCell(1.0, 1.0, 0.0), PackCell(0.99, 1.04, 0.005), PackCell(0.98, 1.05, 0.0), PackCell(0.985, 1.1, 0.01))
WEAK = PackCell(0.85, 1.5, 0.05)
#: Both packs share three cells and the current.
UNEQUAL = (*HEALTHY[:3], WEAK)


class Pack(NamedTuple):
    """The log of a pack with the voltages of its cells, and the state of charge (T, n) and capacity [Ah] of each."""

    log: Log
    cells_V: np.ndarray
    soc: np.ndarray


def rows(cell: LifeCell) -> Iterator[Figure]:
    """The figures of a cell, with a file from pulses and with its label alone."""
    unequal, healthy = (pack(cell, chosen) for chosen in (UNEQUAL, HEALTHY))
    for tested in (PULSES, LABEL):
        file = pack_file(cell, tested)
        bar = RMSE_BAR if tested == PULSES else None
        run = estimate(file, unequal)
        yield from weakest_figures(f"{cell.name}, {tested}", run, unequal, bar)
        yield from warning_figures(f"{cell.name}, {tested}", run, estimate(file, healthy), cycle_s(unequal))
        yield from unseen_figures(f"{cell.name}, {tested}", file, unequal)


def estimate(file: Battery, found: Pack) -> PackRun:
    """Estimates of a pack whose typical cell is known at the start."""
    return PackEstimator(file, float(np.median(found.soc[0]))).run(found.log, found.cells_V)


def weakest_figures(data: str, run: PackRun, found: Pack, bar: float | None) -> Iterator[Figure]:
    """Error and coverage of the weakest of unequal cells."""
    late = run.time_s >= SETTLED_S
    error = (run.cells.soc - found.soc)[late, -1]
    covered = np.mean(np.abs(error) <= 1.96 * run.cells.soc_std[late, -1])
    rmse = rms(error)
    yield at_most(data, "cell voltages", "weakest cell, RMSE [%]", 100 * rmse, bar and 100 * bar, ".2f")
    yield at_least(data, "cell voltages", "weakest cell, covered [%]", 100 * float(covered), 100 * COVERAGE_BAR, ".0f")


def cycle_s(found: Pack) -> float:
    """Time of the first cycle [s]: until the night's charge has filled the first cell, which ends it."""
    fullest = found.soc.max(axis=1)
    driven = int(np.argmax(fullest < fullest.max() - _DRIVEN))
    later = fullest[driven:]
    return float(found.log.time_s[driven + np.argmax(later >= later.max() - _FULL_WITHIN)])


def warning_figures(data: str, unequal: PackRun, healthy: PackRun, limit_s: float) -> Iterator[Figure]:
    """Time of the first warning and its limit, the cells that it names, and false ones of a healthy pack."""
    warned_s = unequal.first_warning_s()
    named = {warning.cell + 1 for warning in unequal.warnings()}
    warned_h = np.inf if warned_s is None else warned_s / _HOUR_S
    yield at_most(data, "cell voltages", "first warning [h], within one cycle", warned_h, limit_s / _HOUR_S, ".2f")
    yield Figure(data, "cell voltages", "cells named", str(sorted(named)), "[4]", named == {4})
    false_s = healthy.first_warning_s()
    when = "none" if false_s is None else f"{false_s / _HOUR_S:.1f} h"
    yield Figure(data, "cell voltages", "healthy pack: first warning", when, "none", false_s is None)


def unseen_figures(data: str, file: Battery, found: Pack) -> Iterator[Figure]:
    """The weakest cell where only the voltage of the pack is known."""
    run = SocEstimator(file, float(np.median(found.soc[0]))).run(found.log)
    late = run.time_s >= SETTLED_S
    weakest = found.soc[late].min(axis=1)
    plain = np.mean(np.abs(run.soc[late] - weakest) <= 1.96 * run.soc_std[late])
    expected = expected_weakest(run.soc[late], run.soc_std[late], file.n_series)
    covered = np.mean(np.abs(expected.mean - weakest) <= 1.96 * expected.std)
    rmse = rms(run.soc[late] - weakest)
    yield at_most(data, "pack voltage", "weakest cell minus the estimate, RMS [%]", 100 * rmse, None, ".1f")
    yield at_least(data, "pack voltage", "weakest cell in the band of the pack [%]", 100 * float(plain), None, ".0f")
    yield at_least(data, "pack voltage", "in the band of an unseen weakest cell [%]", 100 * float(covered), None, ".0f")


def many_cells() -> Iterator[Figure]:
    """Time for a pack of 28 cells over 44 days of telemetry, the compilation included."""
    count, days_, interval_s = 28, 44, 30
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, days_ * 86400.0, interval_s)
    current_A = 20.0 * np.sin(time_s / 7000.0) + rng.standard_normal(time_s.size)
    file = generic_battery("lfp", 100.0, count)
    cells_V = 3.3 + 5e-4 * current_A[:, None] + 0.002 * rng.standard_normal((time_s.size, count))
    log = Log("telemetry", time_s, current_A, cells_V.sum(axis=1), np.full(time_s.size, 25.0))
    began = time.perf_counter()
    PackEstimator(file).run(log, cells_V)
    name = f"{count} cells, {days_} days every {interval_s} s"
    yield at_most(name, "cell voltages", "time [s]", time.perf_counter() - began, SECONDS_BAR, ".1f")


def pack(cell: LifeCell, cells: tuple[PackCell, ...], seed: int = 1) -> Pack:
    """The log that the monitor of a pack of these cells records, every second."""
    rng = np.random.default_rng(seed)
    found = string(cell)
    truths = [found[chosen] for chosen in cells]
    sensors = usual_sensors(cell.label_Ah)
    first = truths[0]
    time_s = first.time_s - first.time_s[0]
    cells_V = np.stack(
        [
            sensors.voltage.measure(truth.voltage_V + _CHANNEL_V * rng.standard_normal(), time_s, rng)
            for truth in truths
        ],
        axis=1,
    )
    current_A = sensors.current.measure(first.current_A, time_s, rng)
    temperature_degC = sensors.temperature.measure(first.temperature_degC, time_s, rng)
    log = Log("pack", time_s, current_A, cells_V.sum(axis=1), temperature_degC)
    return Pack(log, cells_V, np.stack([truth.soc for truth in truths], axis=1))


@cache
def string(cell: LifeCell) -> dict[PackCell, CellTruth]:
    """The truth of each cell of the packs, all under one current, from the end of the rest before the first day."""
    label_Ah = capacity_of(cell.new)
    profile, start_s = first_discharged(days(np.random.default_rng(1), label_Ah, PLANS), label_Ah, START_DEPTH)
    times = np.arange(0.0, profile.time_s[-1], 1.0)
    shared = Profile(
        times,
        np.interp(times, profile.time_s, profile.current_A),
        np.interp(times, profile.time_s, profile.ambient_degC),
    )
    for _ in range(_PASSES):
        truths = {chosen: alone(cell, chosen, shared) for chosen in (*HEALTHY, WEAK)}
        currents = np.stack([truth.current_A for truth in truths.values()], axis=1)
        least = np.take_along_axis(currents, np.abs(currents).argmin(axis=1)[:, None], axis=1)[:, 0]
        apart_Ah = np.abs(currents - least[:, None]).sum(axis=0).max() / _HOUR_S
        if apart_Ah < _SETTLED_SHARE * label_Ah:
            break
        shared = shared._replace(current_A=np.where(least > 0.0, _CHARGER_SHARE, 1.0) * least)
    kept = times >= start_s
    return {chosen: CellTruth(*(values[kept] for values in truth)) for chosen, truth in truths.items()}


def alone(cell: LifeCell, chosen: PackCell, shared: Profile) -> CellTruth:
    """The truth of one cell under the current of the string, after a discharge that puts it lower than the others."""
    before_s = 3.0 * _HOUR_S * chosen.lower * chosen.capacity
    lowered = [constant(before_s, -capacity_of(cell.new) / 3.0)] if before_s else []
    profile = join([*lowered, constant(_HOUR_S, 0.0), shared])
    start_s = profile.time_s[-1] - shared.time_s[-1]
    ambient_degC = np.interp(profile.time_s - start_s, shared.time_s, shared.ambient_degC)
    profile = profile._replace(ambient_degC=ambient_degC)
    return truth_of(aged_single(cell, chosen), profile, shared.time_s + start_s, f"of a pack {chosen}")


@cache
def aged_single(cell: LifeCell, chosen: PackCell) -> ElectrochemicalCell:
    """One cell at its age."""
    single = replace(cell.new, n_series=1)
    return single if chosen.capacity == 1.0 else aged(single, chosen.capacity, chosen.resistance)


def pack_file(cell: LifeCell, tested: str) -> Battery:
    """The battery file of a pack, from tests of one cell."""
    one, count = battery_from(cell, tested), len(UNEQUAL)
    if tested == LABEL:
        return generic_battery(cell.chemistry, cell.label_Ah, count)
    noise = replace(
        one.noise,
        voltage_std_V=count * one.noise.voltage_std_V,
        model_std_V=tuple(count * std_V for std_V in one.noise.model_std_V),
        ocv_std_V_per_K=count * one.noise.ocv_std_V_per_K,
    )
    return replace(
        one, n_series=count, thevenin=one.thevenin.in_series(count), noise=noise,
        voltage_min_V=count * one.voltage_min_V, voltage_max_V=count * one.voltage_max_V,
    )  # fmt: skip
