"""Battery, logs, truth and estimator, from the options of a command."""

from __future__ import annotations

import argparse
import glob
import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.battery.battery import Battery
from ohmward.battery.cells.pack_estimator import FILTERS, PackEstimator, PackRun
from ohmward.battery.file import load_battery
from ohmward.battery.learning.charger_limit import full_at_charger_limit, limit_sentence
from ohmward.battery.log_check import check_log, read_log_of
from ohmward.battery.soc.anchors import Anchor, scan_anchors
from ohmward.battery.soc.augmented_thevenin import SOC
from ohmward.battery.soc.estimator import SocEstimator, SocRun, samples_of
from ohmward.battery.soc.registry import EstimatorSettings, make_estimator
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.score import SocReference, soc_reference
from ohmward.battery.soc.voltage_faults import START_SETTLED_S, wrong_starts
from ohmward.cli.options import HINTS, UNKNOWN
from ohmward.cli.outcome import Report, counting
from ohmward.errors import InputError
from ohmward.filters.estimator import row_of
from ohmward.logs import FileHints, Log
from ohmward.logs.bags.bag_table import METADATA, parts_of
from ohmward.logs.battery_columns import CellVoltages, cell_names, charger_columns, find_cells
from ohmward.logs.channels import BATTERY, TIME
from ohmward.logs.hints import TOPIC
from ohmward.logs.log import ReadOptions
from ohmward.logs.read import open_table, with_streams_stored
from ohmward.logs.selection import split_selection
from ohmward.logs.table import LOG_ENDINGS, RECORDING_ENDINGS, TableFile

#: Kinds of --column and --unit that belong to a battery; all others, and the time, belong to a drive.
_BATTERY_KINDS = tuple(channel.name for channel in BATTERY)


def with_sensor(battery: Battery, args: argparse.Namespace) -> tuple[Battery, list[str]]:
    """The battery with the sensors of `add_sensor_options`, and a warning for each that contradicts the battery.

    Raises:
        InputError: the offset is larger than the current that empties the battery in an hour.
    """
    sensor, noise = battery.sensor, battery.noise
    offset_A = sensor.offset_std_A if args.sensor_offset is None else args.sensor_offset
    gain = sensor.gain_std if args.sensor_gain is None else args.sensor_gain
    voltage_gain = noise.voltage_gain_std if args.voltage_gain is None else args.voltage_gain
    if args.sensor_offset is not None:
        _require_below_one_C("--sensor-offset", offset_A, battery)
    warnings = []
    if offset_A != sensor.offset_std_A:
        warnings.append(_contradiction(f"--sensor-offset {offset_A:g} A", f"{sensor.offset_std_A:g} A"))
    if gain != sensor.gain_std:
        warnings.append(_contradiction(f"--sensor-gain {gain:g}", f"{sensor.gain_std:g}"))
    if voltage_gain != noise.voltage_gain_std:
        warnings.append(_contradiction(f"--voltage-gain {voltage_gain:g}", f"{noise.voltage_gain_std:g}"))
    with_options = replace(
        battery,
        sensor=replace(sensor, offset_std_A=offset_A, gain_std=gain),
        noise=replace(noise, voltage_gain_std=voltage_gain),
    )
    return with_options, warnings


def _require_below_one_C(option: str, current_A: float, battery: Battery) -> None:
    """Raise InputError where an offset or a rest current is larger than what empties the battery in an hour."""
    if abs(current_A) > battery.capacity_Ah:
        raise InputError(
            f"{option} must be below 1 C, {battery.capacity_Ah:g} A, got {current_A:g} A; for milliamperes write "
            f"{current_A / 1000:g}"
        )


def _contradiction(option: str, in_file: str) -> str:
    return f"warning: {option} was used; the battery file says {in_file}"


def load_with_sensor(path: str, args: argparse.Namespace) -> tuple[Battery, list[str]]:
    """The battery of a file with the sensors that the options name; see `with_sensor`."""
    return with_sensor(load_battery(path), args)


def given_start(args: argparse.Namespace) -> dict[str, Any]:
    """The state of charge at the start and its standard deviation as arguments, where the options name them."""
    given = {"soc": args.initial_soc, "soc_std": args.initial_soc_std}
    return {word: value for word, value in given.items() if value is not None}


class SocTask(NamedTuple):
    """One log to estimate, from the options of `add_soc_options`."""

    battery: Battery
    log: Log
    truth: SocReference | None  #: None if there is no truth
    cells: CellVoltages | None  #: voltages of the cells, if the log has them
    rest_current_A: float | None  #: true current of a rest, from the option or else the battery file
    initial_soc: float | None
    initial_soc_std: float
    anchors: tuple[Anchor, ...] | None = None  #: in the log; None where they have not been looked for
    warnings: tuple[str, ...] = ()  #: about options that contradict the battery file or the log

    @property
    def notes(self) -> list[str]:
        """Everything that was assumed while reading, and what the battery file does not know."""
        truth = [f"info: {self.truth.note}"] if self.truth else []
        battery = [f"info: battery file: {text}" for text in self.battery.not_identified]
        return [str(note) for note in self.log.notes] + [*self.warnings, *truth, *battery]

    def start_contradicted(self) -> list[str]:
        """A warning for first voltages that are not the battery's, and where the next contradicts the initial SoC."""
        samples, first_V = samples_of(self.log), self.log.voltage_V[0]
        waits_s = math.inf if self.initial_soc is None else START_SETTLED_S
        again, _ = wrong_starts(samples, self.battery.thevenin, waits_s=waits_s)
        begin = max(again, default=0)
        why = f"the first voltage, {first_V:.4g} V, is not the battery's: another one follows and lasts"
        why = "the log begins without a voltage" if math.isnan(first_V) else why
        begins_s = self.log.time_s[begin] - self.log.time_s[0]
        wrong = [f"warning: {why}; the estimates start again after {begins_s:.3g} s"] if again else []
        return wrong + self._initial_soc_contradicted(samples, begin)

    def _initial_soc_contradicted(self, samples: SocSample, begin: int) -> list[str]:
        """A warning where the voltage of the start, in the row `begin`, contradicts the initial SoC."""
        if self.initial_soc is None:
            return []
        first = row_of(samples, begin)
        state = make_estimator("ekf", self.battery).init(first, self.initial_soc, self.initial_soc_std)
        start = float(state.belief.mean[SOC])
        if abs(start - self.initial_soc) < 2 * self.initial_soc_std:
            return []
        return [
            f"warning: --initial-soc {self.initial_soc:g} contradicts the first voltage, {first.voltage_V:.4g} "
            f"V; the Thevenin filters start at {100 * start:.0f} %"
        ]

    def estimate(self, name: str, report: Report | None = None, learnt_along: bool = True) -> SocRun:
        """Run the estimator of this name over the log; learnt_along: as for `SocEstimator.run`."""
        estimator = make_estimator(name, self.battery, EstimatorSettings(self.rest_current_A))
        soc_estimator = SocEstimator(estimator, self.initial_soc, self.initial_soc_std)
        return soc_estimator.run(self.log, counting(report, name), learnt_along)

    def estimate_cells(self, name: str, report: Report | None = None) -> PackRun | None:
        """Run the filter of this name over the cells of the log; None without cells or if it takes no cells."""
        if self.cells is None or name not in FILTERS:
            return None
        battery = replace(self.battery, idle_current_A=self.rest_current_A)
        estimator = PackEstimator(battery, self.initial_soc, self.initial_soc_std, filter=name)
        return estimator.run(self.log, self.cells.voltage_V, counting(report, f"{name}, cells"), self.cells.names)


def read_options(args: argparse.Namespace) -> ReadOptions:
    """How to read logs, from the options of `add_log_options` or `add_drive_options`."""
    names = tuple(name.strip() for name in args.names.split(",")) if args.names else None
    hints = FileHints(**{field: getattr(args, field, None) for field in HINTS.values()})._replace(names=names)
    sign = vars(args).get("current_sign", "auto")
    return ReadOptions(sign, tuple(args.column), tuple(args.unit), tuple(args.where), args.sort_time, hints)


def reading_words(reading: ReadOptions) -> list[str]:
    """The words of a command line that `read_options` turns into these options."""
    names = reading.hints.names and ",".join(reading.hints.names)
    hints = reading.hints._replace(names=names)
    repeated = {"--column": reading.columns, "--unit": reading.units, "--where": reading.where}
    words: list[str] = []
    for option, pairs in repeated.items():
        for pair in pairs:
            words += ["--topic", pair[1]] if pair[0] == TOPIC else [option, "=".join(pair)]
    once = {"--current-sign": None if reading.current_sign == "auto" else reading.current_sign}
    once |= {option: getattr(hints, field) for option, field in HINTS.items()}
    for option, value in once.items():
        if value is not None:
            words += [option, str(value)]
    return [*words, "--sort-time"] if reading.sort_time else words


def of_kinds(reading: ReadOptions, of_battery: bool) -> ReadOptions:
    """The options of the battery alone, or of the drive; the time belongs to both."""

    def chosen_of(pairs: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
        return tuple(pair for pair in pairs if pair[0] == TIME.name or (pair[0] in _BATTERY_KINDS) == of_battery)

    chosen = replace(reading, columns=chosen_of(reading.columns), units=chosen_of(reading.units))
    if of_battery:
        return chosen
    return replace(chosen, current_sign="auto", hints=reading.hints._replace(temperature_degC=None))


def read_battery_log(
    text: str,
    reading: ReadOptions,
    extra: Collection[str] | None = None,
    report: Report | None = None,
    file: TableFile | None = None,
    battery: Battery | None = None,
) -> Log:
    """The log that an argument names, see `read_log_of`; report: called with the share that is read."""
    progress = counting(report, f"reading {split_selection(text)[0].name}")
    return read_log_of(battery, text, reading, extra, progress, file)


def make_soc_task(args: argparse.Namespace, report: Report | None = None) -> SocTask:
    """Battery, log and truth that the options of `add_soc_options` name."""
    battery, warnings = load_with_sensor(args.battery, args)
    reading = read_options(args)
    path, where = split_selection(args.log)
    file = open_table(path, reading.hints).part("battery", dict(reading.where) | where)
    cells_too = cell_names(file.names) if battery.n_series > 1 else ()
    extra = None if args.truth else (*cells_too, *charger_columns(file.names))
    log = check_log(read_battery_log(args.log, reading, extra, report, file, battery), battery)
    cells, notes = find_cells(log.extra, log.voltage_V, int(battery.n_series))
    log = log.with_notes(*notes)
    lowered, anchors = battery, None
    if battery.noise.full_soc_std:
        own, known = scan_anchors(log, battery)
        lowered, anchors = full_at_charger_limit(battery, log, known), own.anchors
    if moved := limit_sentence(battery, lowered):
        warnings.append(f"info: {moved}capacities are relative to {lowered.capacity_Ah:.3g} Ah (see ohmward learn)")
        anchors = None
    given, idle_A = args.rest_current, battery.idle_current_A
    if isinstance(given, float):
        _require_below_one_C("--rest-current", given, battery)
    rest_A = {None: idle_A, UNKNOWN: None}.get(given, given)
    if given is not None and idle_A is not None and given != idle_A:
        word = given if given == UNKNOWN else f"{given:g} A"
        warnings.append(_contradiction(f"--rest-current {word}", f"{idle_A:g} A"))
    truth = None
    if args.truth:
        start_soc = args.initial_soc if args.truth_start is None else args.truth_start
        truth = soc_reference(log, args.truth, battery.capacity_Ah, start_soc)
    used = lowered if moved else battery
    task = SocTask(used, log, truth, cells, rest_A, args.initial_soc, args.initial_soc_std, anchors)
    return task._replace(warnings=(*warnings, *task.start_contradicted()))


#: Endings of logs in a folder.
_ENDINGS = (*LOG_ENDINGS, *RECORDING_ENDINGS)


def log_files(words: Sequence[str]) -> list[str]:
    """The logs that the words name, each once; those of a pattern or a folder are sorted by name.

    A folder without logs is named as it is beside others, which it shall not stop: reading it says what is wrong.

    Raises:
        InputError: a word names nothing.
    """
    return list(dict.fromkeys(text for word in words for text in _named(word, is_alone=len(words) == 1)))


def _named(word: str, is_alone: bool) -> list[str]:
    """The word itself for a file, a recording's folder or rows of either; else the files of the folder or pattern.

    Of standard input or a pipe a copy, which can be read several times.
    """
    path = split_selection(word)[0]
    if (stored := with_streams_stored(path)) != path:
        return [str(stored)]
    if _is_file(path) or (path.is_dir() and parts_of(path)):
        return [word]
    if path.is_dir():
        files = [file for file in sorted(path.rglob("*")) if file.name.lower().endswith(_ENDINGS)]
        if not files and not is_alone:
            return [word]
        if not files:
            raise InputError(f"the folder {word!r} holds no log ({', '.join(_ENDINGS)}); name the files")
        return list(dict.fromkeys(_recording_of(file, path) for file in files))
    found = sorted(name for name in glob.glob(word, recursive=True) if _is_file(Path(name)))  # noqa: PTH207 absolute too
    if not found:
        raise InputError(f"no file matches {word!r}; check the path, and quote a pattern for the shell")
    return found


def _is_file(path: Path) -> bool:
    """True also for a link that leads nowhere: the log behind it is refused, not all those beside it."""
    return path.is_file() or (path.is_symlink() and not path.exists())


def _recording_of(file: Path, folder: Path) -> str:
    """The folder of the recording that a file is a part of, else the file."""
    if file.parent == folder or not file.name.endswith((*RECORDING_ENDINGS, METADATA)):
        return str(file)
    parts = parts_of(file.parent)
    return str(file.parent if file in parts or (parts and file.name == METADATA) else file)
