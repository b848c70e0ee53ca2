"""Battery, log, truth and estimator as the options of a command name them."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.cells.pack_estimator import FILTERS, PackEstimator, PackRun
from ohmward.battery.file import load_battery
from ohmward.battery.log_check import check_log
from ohmward.battery.soc.augmented_thevenin import SOC
from ohmward.battery.soc.estimator import SocEstimator, SocRun, samples_of
from ohmward.battery.soc.reference import SocReference, soc_reference
from ohmward.battery.soc.registry import EstimatorSettings, make_estimator
from ohmward.battery.soc.sample import SocSample
from ohmward.cli.options import UNKNOWN, file_hints
from ohmward.cli.parser import selected_name, split_selection
from ohmward.cli.progress import Report, counting
from ohmward.errors import InputError
from ohmward.logs import DriveLog, Log, read_log
from ohmward.logs.cell_columns import CellVoltages, cell_names, find_cells
from ohmward.logs.charger_flag import charger_columns
from ohmward.logs.columns import guess, listed
from ohmward.logs.read import open_table
from ohmward.logs.table import TableFile


def read_soc_truth(log: Log, text: str, capacity_Ah: float, start_soc: float | None = None) -> SocReference:
    """Reference state of charge in a column; `a - b` is the difference of two, as of a counter for each direction.

    capacity_Ah, start_soc: of a counter of ampere hours, see `soc_reference`.

    Raises:
        InputError: there is no such column, it has no value, or its range is not that of a state of charge.
    """
    first, minus, second = (part.strip() for part in text.partition(" - "))
    if minus:
        values = truth_column(log, first) - truth_column(log, second)
    else:
        values = truth_column(log, text)
    return soc_reference(log, text, values, capacity_Ah, start_soc)


def truth_column(log: Log | DriveLog, name: str) -> np.ndarray:
    """(T,) a column in its own unit.

    Raises:
        InputError: there is no such column.
    """
    if name in log.extra:
        return log.extra[name]
    names = list(log.extra)
    there = f"it has: {listed(names)}" if names else "it has no further numeric columns"
    raise InputError(f"{log.name}: there is no column {name!r} for --truth{guess(name, names)}; {there}")


def with_sensor(battery: Battery, args: argparse.Namespace) -> tuple[Battery, list[str]]:
    """The battery with the sensor of the options, and a sentence for each that contradicts the battery.

    Raises:
        InputError: the offset is larger than the current that empties the battery in an hour.
    """
    known = battery.sensor
    offset_A = known.offset_std_A if args.sensor_offset is None else args.sensor_offset
    gain = known.gain_std if args.sensor_gain is None else args.sensor_gain
    if args.sensor_offset is not None and offset_A > battery.capacity_Ah:
        raise InputError(
            f"--sensor-offset must be below 1 C, {battery.capacity_Ah:g} A, got {offset_A:g} A; for milliamperes write "
            f"{offset_A / 1000:g}"
        )
    said = "was used; the battery file says"
    contradictions = []
    if offset_A != known.offset_std_A:
        contradictions.append(f"--sensor-offset {offset_A:g} A {said} {known.offset_std_A:g} A")
    if gain != known.gain_std:
        contradictions.append(f"--sensor-gain {gain:g} {said} {known.gain_std:g}")
    return replace(battery, sensor=replace(known, offset_std_A=offset_A, gain_std=gain)), contradictions


def load_battery_with_sensor(path: str, args: argparse.Namespace) -> tuple[Battery, list[str]]:
    """The battery in a file with the sensor of the options, and a sentence for each that contradicts the file."""
    return with_sensor(load_battery(path), args)


class SocTask(NamedTuple):
    """One log to estimate: its battery, the truth and the cell voltages if there are any, options that contradict."""

    battery: Battery
    log: Log
    truth: SocReference | None
    contradictions: tuple[str, ...] = ()
    cells: CellVoltages | None = None

    @property
    def notes(self) -> list[str]:
        """Everything that was assumed while reading, and what the battery file does not know."""
        truth = [f"info: {self.truth.note}"] if self.truth else []
        battery = [f"info: battery file: {text}" for text in self.battery.not_identified]
        contradictions = [f"warning: {text}" for text in self.contradictions]
        return [str(note) for note in self.log.notes] + contradictions + truth + battery


def read_battery_log(
    text: str,
    args: argparse.Namespace,
    extra: Collection[str] | None = None,
    report: Report | None = None,
    file: TableFile | None = None,
) -> Log:
    """The log that an argument names, read as the options of `add_log_options` say.

    text: a file, or a file and the rows wanted from it, `ocv.parquet:script=1,temp_C=25`, then part of the log's name.
    extra: further columns to keep; None keeps every numeric one.
    file: the same file where it is open already.

    Raises:
        InputError: the file cannot be read as a log.
    """
    path, where = split_selection(text)
    log = read_log(
        file or path,
        current_sign=args.current_sign,
        columns=dict(args.column),
        units=dict(args.unit),
        where=dict(args.where) | where,
        extra=extra,
        sort_time=args.sort_time,
        progress=counting(report, f"reading {path.name}"),
        hints=file_hints(args),
    )
    return replace(log, name=selected_name(log.name, where))


def make_soc_task(args: argparse.Namespace, report: Report | None = None) -> SocTask:
    """Battery, log and truth that the options of `add_soc_options` name."""
    battery, of_sensor = load_battery_with_sensor(args.battery, args)
    path, where = split_selection(args.log)
    file = open_table(path, file_hints(args)).part("battery", dict(args.where) | where)
    cells_too = cell_names(file.names) if battery.n_series > 1 else ()
    extra = None if args.truth else (*cells_too, *charger_columns(file.names))
    log = check_log(read_battery_log(args.log, args, extra, report, file), battery)
    cells, notes = find_cells(log.extra, log.voltage_V, int(battery.n_series))
    log = log.with_notes(*notes)
    contradictions = (*of_sensor, *_rest_current(battery, args), *_start(battery, log, args))
    if not args.truth:
        return SocTask(battery, log, None, contradictions, cells)
    start_soc = args.initial_soc if args.truth_start is None else args.truth_start
    truth = read_soc_truth(log, args.truth, battery.capacity_Ah, start_soc)
    return SocTask(battery, log, truth, contradictions, cells)


def _rest_current(battery: Battery, args: argparse.Namespace) -> list[str]:
    """The rest current, where the battery file says another one."""
    given, known_A = args.rest_current, battery.idle_current_A
    if given is None or known_A is None or given == known_A:
        return []
    word = given if given == UNKNOWN else f"{given:g} A"
    return [f"--rest-current {word} was used; the battery file says {known_A:g} A"]


def _start(battery: Battery, log: Log, args: argparse.Namespace) -> list[str]:
    """The initial SoC, where the first voltage contradicts it."""
    if battery.thevenin is None or args.initial_soc is None:
        return []
    state = make_estimator("ekf", battery).init(
        SocSample(*(float(column[0]) for column in samples_of(log))), args.initial_soc, args.initial_soc_std
    )
    start = float(state.belief.mean[SOC])
    if abs(start - args.initial_soc) < 2 * args.initial_soc_std:
        return []
    return [
        f"--initial-soc {args.initial_soc:g} contradicts the first voltage, {log.voltage_V[0]:.4g} V; the Thevenin "
        f"filters start at {100 * start:.0f} %"
    ]


def estimate(task: SocTask, name: str, args: argparse.Namespace, report: Report | None = None) -> SocRun:
    """Run the estimator of this name over the log."""
    estimator = make_estimator(name, task.battery, EstimatorSettings(idle_current_A=_idle_A(task, args)))
    return SocEstimator(estimator, args.initial_soc, args.initial_soc_std).run(task.log, counting(report, name))


def estimate_cells(task: SocTask, name: str, args: argparse.Namespace, report: Report | None = None) -> PackRun | None:
    """Run the filter of this name over the cells of the log; None without cells, or a filter that has none."""
    if task.cells is None or name not in FILTERS:
        return None
    battery = replace(task.battery, idle_current_A=_idle_A(task, args))
    estimator = PackEstimator(battery, args.initial_soc, args.initial_soc_std, filter=name)
    return estimator.run(task.log, task.cells.voltage_V, counting(report, f"{name}, cells"), task.cells.names)


def _idle_A(task: SocTask, args: argparse.Namespace) -> float | None:
    """True current of a rest [A]: that of the option, else that of the battery file."""
    rest_A = task.battery.idle_current_A if args.rest_current is None else args.rest_current
    return None if rest_A == UNKNOWN else rest_A
