"""The log of a battery: a recording of current, voltage and temperature in SI units, and its reader."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from os import PathLike
from typing import Any, TypeAlias, get_args

import numpy as np

from ohmward.checks import require_mappings
from ohmward.errors import InputError
from ohmward.logs import clean
from ohmward.logs.battery_columns import (
    full_charges,
    power_column,
    state_column,
    with_derived,
    with_sign,
)
from ohmward.logs.channels import CURRENT
from ohmward.logs.clean import without_impossible
from ohmward.logs.clock import with_joined_time
from ohmward.logs.columns import BDF_NAMES, Column, UnclearColumnsError, find_columns, has_bdf_columns, is_bdf
from ohmward.logs.dates import window_s
from ohmward.logs.frame import UNNAMED, is_frame, to_frame
from ohmward.logs.hints import FileHints
from ohmward.logs.read import RecordedTable, Wanted, open_table, read_recording
from ohmward.logs.selection import selected_name, split_selection
from ohmward.logs.table import Note, Progress, Table, TableFile, counted, with_sample_time
from ohmward.logs.time_series import TimeSeries
from ohmward.logs.units import UNITS
from ohmward.quantities import COLDEST_DEGC, HOTTEST_DEGC, QUANTITIES, SECONDS_PER_HOUR
from ohmward.signals.checks import Finding
from ohmward.signals.current_sign import CurrentSign, SignEvidence, lost_sign, sign_evidence, turned_sign
from ohmward.signals.current_size import check_wrapped, not_in_amperes

#: A current whose resistance is too large may be in the next larger unit, amperes for milliamperes.
_LARGER = 1e3
#: Quantities of the battery that have an array of their own; others are among `extra`.
_COLUMNS = tuple(
    quantity.field
    for quantity in QUANTITIES.values()
    if quantity.owner == "battery" and quantity.estimated_from and quantity.words
)

#: A `Log`, or a path or DataFrame of one.
LogSource: TypeAlias = "Log | str | PathLike[str] | Any"


@dataclass(frozen=True, eq=False, repr=False)
class Log(TimeSeries):
    """A recording: current, voltage and temperature over time. Arrays are read-only float64.

    >>> log = ow.Log("desk", time_s=[0, 1, 2], current_A=[0.0, -2.0, -2.0], voltage_V=[13.2, 13.1, None])
    >>> len(log), log.duration_s
    (3, 2.0)

    Any array-like of numbers will do; None and NaN are missing. Times given as dates or durations become seconds.

    Raises:
        InputError: no samples, shapes that differ, time that is not finite or does not increase, non-numeric values.
    """

    name: str  #: usually the file's stem
    #: (T,) [s], finite and strictly increasing; zero is that of the file, or its first sample if it has a wall clock
    time_s: np.ndarray
    current_A: np.ndarray  #: (T,) [A], > 0 charges; NaN where it was not measured
    voltage_V: np.ndarray  #: (T,) [V] of the whole pack; NaN where it was not measured
    temperature_degC: np.ndarray | None = None  #: (T,) [degC], or None when the file has no temperature
    #: (T,) each: further quantities of the battery by name, and other numeric columns under the names and in the units
    #: of the file
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()  #: everything that was assumed, converted or dropped while reading
    start_unix_s: float | None = None  #: Unix time [s] of time_s = 0, or None when the file has no wall clock
    time_zone: str = "UTC"  #: of the wall clock in the file; "" where its dates name none and are assumed to be UTC

    def __post_init__(self) -> None:
        self._freeze(_COLUMNS)
        self._require_lengths(_COLUMNS)

    @classmethod
    def from_pandas(cls, frame: Any, **options: Any) -> Log:
        """The log in a DataFrame; the same as `read_log(frame, **options)`."""
        return read_log(frame, **options)

    def to_pandas(self) -> Any:
        """A DataFrame of the measured and the extra columns, units in their names, indexed by `time_s` [s]."""
        return to_frame({**self.measured(), **self.extra}, self.name)

    def measured(self) -> dict[str, np.ndarray]:
        """Time and measured channels (T,) under ohmward's own names; with a wall clock also `unix_time_s`."""
        columns = {"time_s": self.time_s, "current_A": self.current_A, "voltage_V": self.voltage_V}
        if self.temperature_degC is not None:
            columns["temperature_degC"] = self.temperature_degC
        if self.start_unix_s is not None:
            columns["unix_time_s"] = self.start_unix_s + self.time_s
        return columns

    @property
    def begin_unix_s(self) -> float | None:
        """Unix time [s] of the first sample, None without a wall clock."""
        return None if self.start_unix_s is None else self.start_unix_s + float(self.time_s[0])

    @property
    def end_unix_s(self) -> float | None:
        """Unix time [s] of the last sample, None without a wall clock."""
        return None if self.start_unix_s is None else self.start_unix_s + float(self.time_s[-1])

    def throughput_Ah(self) -> float:
        """Charge [Ah] in and out, added up; an interval that ends without a current counts as zero."""
        return float(np.nansum(np.abs(self.current_A[1:]) * self.dt_s)) / SECONDS_PER_HOUR

    def charge_Ah(self) -> np.ndarray:
        """(T,) [Ah], the integral of the current from the first sample, > 0 when charge went in.

        The current is linear between samples (trapezoids); where it is missing it is interpolated.
        """
        known = np.isfinite(self.current_A)
        if not known.any():
            return np.full(len(self), np.nan)
        current_A = self.current_A
        if not known.all():
            current_A = current_A.copy()
            current_A[~known] = np.interp(self.time_s[~known], self.time_s[known], self.current_A[known])
        charge = np.zeros(len(self))  # of one long log at a time: one array takes all steps
        np.add(current_A[1:], current_A[:-1], out=charge[1:])
        charge[1:] *= self.dt_s
        np.cumsum(charge, out=charge)
        charge /= 2.0 * SECONDS_PER_HOUR
        return charge

    def temperature_along(self, otherwise_degC: float) -> np.ndarray:
        """(T,) [degC], straight lines where there is no credible one; `otherwise_degC` where the log has none."""
        if self.temperature_degC is None:
            return np.full(len(self), otherwise_degC)
        known = (self.temperature_degC >= COLDEST_DEGC) & (self.temperature_degC <= HOTTEST_DEGC)
        if not known.any():
            return np.full(len(self), otherwise_degC)
        return np.interp(self.time_s, self.time_s[known], self.temperature_degC[known])

    def full_charges(self) -> tuple[tuple[str, int], ...]:
        """Column and sample of each onset of full charge that a charger's column among `extra` reports."""
        return full_charges(self.extra)

    def describe(self) -> str:
        """Summary of the log in a few lines, followed by its notes."""
        interval = f"median interval {np.median(self.dt_s):g} s" if len(self) > 1 else "one sample"
        lines = [f"{self.name}: {counted(len(self), 'sample')}, {self.duration_s:g} s, {interval}"]
        lines += [_range("current", self.current_A, "A (> 0 charges)"), _range("voltage", self.voltage_V, "V")]
        if self.temperature_degC is not None:
            lines.append(_range("temperature", self.temperature_degC, "degC"))
        if self.extra:
            lines.append(f"  also: {', '.join(self.extra)}")
        return "\n".join(lines + [f"  {note}" for note in self.notes])


def read_log(
    source: str | PathLike[str] | Any,
    *,
    current_sign: CurrentSign = "auto",
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    where: Mapping[str, float | str] | None = None,
    extra: Collection[str] | None = None,
    sort_time: bool = False,
    progress: Progress | None = None,
    hints: FileHints | None = None,
) -> Log:
    """Read a log from a text table, Parquet, BDF, Excel, MATLAB, HDF5, JSON, a ROS recording, a ULog, or a DataFrame.

    >>> log = ow.read_log("day.csv")
    >>> len(log), round(log.duration_s / 3600, 1), list(log.extra)
    (33744, 9.4, ['soc_true'])
    >>> log = ow.read_log("day.csv", current_sign="charge", columns={"current": "current_A"}, units={"current": "A"})

    source: path of a file in any of these formats, whatever its name; `-` for standard input; a folder whose files make
        up one log; a DataFrame of pandas, polars, Arrow or DuckDB; or a dict of columns.
    current_sign: effect of a positive current in the file: "charge", "discharge", or "auto" to infer it from the data.
    columns: quantity -> column name, where the names are not clear enough: {"current": "I_batt"}.
    units: quantity -> unit, where the column names give none or a wrong one: {"current": "mA"}.
    where: column -> value, to choose one of several recordings: {"script": 1}; "recording" counts clock restarts.
        For a ROS recording, {"topic": "/battery"} names the topics, separated by commas.
    extra: further columns to keep; None keeps every numeric one.
    sort_time: sort rows that are out of order, whatever the reason.
    progress: called now and then with the amount read and the total.
    hints: names, encoding, date format, time zone and the like, where the file does not give them.

    If a file has cell voltages (`cell_voltage_1_V`, ...) but no pack voltage, their sum is used. If it has
    `charge_current` and `discharge_current` but no other current, the first minus the second is used; if it has a power
    but no current, power divided by voltage.

    Raises:
        InputError: the file cannot be read as a log; the message names the file, the place and the fix.
        OhmwardError: Parquet without pyarrow, a ROS recording without rosbags.
    """
    require_mappings(columns=columns, units=units, where=where)
    opened = open_table(source, hints)
    file = opened.part("battery", where)
    file = with_derived(file, columns, units)
    file = with_joined_time(with_sample_time(file))
    try:
        chosen = find_columns(file.source, file.names, file.given(columns), {**file.units, **(units or {})}, file.head)
    except UnclearColumnsError as error:
        again = partial(read_log, opened, current_sign=current_sign, units=units, where=where, sort_time=sort_time)
        raise _with_further(error, columns or {}, again) from None
    state = (state_column(file) or "") if current_sign != "discharge" else ""
    power = (power_column(file) or "") if current_sign == "auto" else ""
    columns_beside = extra if extra is None else {*extra, *filter(None, (state, power))}
    wanted = Wanted(where or {}, columns_beside, sort_time, progress, "time" in file.given(columns))

    def to_numbers(table: Table) -> Table:
        table = clean.to_si(table, chosen)
        if "voltage" not in (units or {}):
            clean.require_voltage(table, chosen["voltage"], chosen["current"])
        name = chosen["current"].name
        voltage_V = table.columns[chosen["voltage"].name]
        current_A, notes = with_sign(table.columns[name], table, voltage_V, state, power)
        return table.with_columns({name: current_A}, *notes)

    left_out = {*wanted.where} if extra is None else set(file.names) - set(extra)
    # no name here: what is merged is no longer in memory as it was read
    return _as_log(file, read_recording(file, chosen, wanted, to_numbers), current_sign, left_out).part(file.hints)


def _with_further(error: UnclearColumnsError, columns: Mapping[str, str], read: Callable[..., Log]) -> InputError:
    """The error, extended by the sign and the units that its suggested columns leave unclear as well.

    columns: those that the caller named.  read: reads the log with other options.
    """
    suggested = {quantity: name for quantity, name in error.choice.items() if name}
    if len(suggested) < len(error.choice):
        return error
    texts, options = [str(error)], [*error.options]
    try:
        try:
            log = read(columns={**columns, **suggested})
        except UnknownSignError as unknown:
            texts.append(str(unknown))
            options += unknown.options
            log = read(columns={**columns, **suggested}, current_sign=unknown.likely)
        mendable = [note for note in log.notes if note.options]
    except InputError:
        mendable = []
    texts += [note.text for note in mendable]
    options += [word for note in mendable for word in note.options]
    return InputError("; then: ".join(texts), options) if len(texts) > 1 else error


@dataclass(frozen=True)
class ReadOptions:
    """Options of `read_log`, the same for every log."""

    current_sign: CurrentSign = "auto"  #: "auto", "charge" or "discharge"
    #: pairs of quantity and column, of quantity and unit, and of column and value to select rows by
    columns: tuple[tuple[str, str], ...] = ()
    units: tuple[tuple[str, str], ...] = ()
    where: tuple[tuple[str, str], ...] = ()
    sort_time: bool = False  #: sort rows that are out of order
    hints: FileHints = field(default_factory=FileHints)  #: facts that the files do not contain

    def read(
        self,
        text: str,
        extra: Collection[str] | None = None,
        progress: Progress | None = None,
        file: TableFile | None = None,
    ) -> Log:
        """Read the log of this name, with the errors of `read_log`.

        text: a file, or a file and a selection of rows, `ocv.parquet:script=1,temp_C=25`, kept in the log's name.
        extra, progress: as in `read_log`.
        file: the same file if it is already open.
        """
        path, where = split_selection(text)
        log = read_log(
            file or path,
            current_sign=self.current_sign,
            columns=dict(self.columns),
            units=dict(self.units),
            where=dict(self.where) | where,
            extra=extra,
            sort_time=self.sort_time,
            progress=progress,
            hints=self.hints,
        )
        return replace(log, name=selected_name(log.name, where)) if where else log


def as_log(source: LogSource) -> Log:
    """The log itself, or the one that `read_log` reads from a path or DataFrame without further options."""
    return source if isinstance(source, Log) else read_log(source)


def as_logs(sources: LogSource | Sequence[LogSource]) -> tuple[Log, ...]:
    """The logs of one source or of several, see `as_log`; several DataFrames without a name are numbered from 1."""
    if isinstance(sources, Log | str | PathLike) or is_frame(sources) or not isinstance(sources, Iterable):
        return (as_log(sources),)
    sources = list(sources)
    logs = list(map(as_log, sources))
    unnamed = [k for k, source in enumerate(sources) if is_frame(source) and logs[k].name == UNNAMED]
    if len(unnamed) > 1:
        for number, k in enumerate(unnamed, start=1):
            logs[k] = replace(logs[k], name=f"{UNNAMED} {number}")
    return tuple(logs)


def _as_log(file: TableFile, rows: RecordedTable, current_sign: CurrentSign, left_out: set[str]) -> Log:
    """Build the log from the rows of one recording, without the columns in `left_out`."""
    chosen = rows.columns
    rows = rows._replace(table=clean.merge_rates(rows.table, chosen))
    table = rows.table
    measured = {q: table.columns[column.name] for q, column in chosen.items() if column.name in table.columns}
    time_s, start_unix_s = _from_start(table, measured["time"], rows.start_unix_s)
    current_A, voltage_V, faults = clean.without_faults(time_s, measured["current"], measured["voltage"])
    if np.isnan(voltage_V).all():
        why = "; ".join(note.text for note in faults)
        raise InputError(f"{file.source}: no measured voltage is left ({why}); was the sensor connected?")
    warnings = clean.require_plausible(file.source, chosen["time"], time_s, current_A, voltage_V, rows.guessed_unit)
    warnings += _other_than_amperes(chosen["current"], current_A, voltage_V)
    for finding in check_wrapped(current_A, voltage_V):
        raise InputError(f"{file.source}: {finding}")
    window = window_s(file.stem, start_unix_s, file.hints)
    part = slice(None) if window is None else slice(*np.searchsorted(time_s, window))
    current_A, sign_note = charging_current(file, current_sign, time_s, current_A, voltage_V, part)
    own = {*rows.own, *BDF_NAMES["unix_time_s"], *left_out}
    further, impossible = _further(measured)
    warnings += impossible
    degC = measured.get("temperature")
    temperature, of_temperature = clean.battery_temperature(file.hints, chosen.get("temperature"), degC, time_s.size)
    return Log(
        name=file.stem,
        time_s=time_s,
        current_A=current_A,
        voltage_V=voltage_V,
        temperature_degC=temperature,
        extra={**further, **{name: column for name, column in table.columns.items() if name not in own}},
        notes=(
            *table.notes,
            *warnings,
            *faults,
            *of_temperature,
            *clean.missing_notes(table, chosen),
            *clean.gap_notes(time_s),
            sign_note,
        ),
        start_unix_s=start_unix_s,
        time_zone=rows.time_zone,
    )


def _from_start(table: Table, time_s: np.ndarray, start_unix_s: float | None) -> tuple[np.ndarray, float | None]:
    """The time (T,) [s], of a wall clock from the first sample, and the Unix time of its zero, None if unknown."""
    if start_unix_s is not None:
        return time_s - time_s[0], start_unix_s + float(time_s[0])
    wall_clock = next((table.columns[name] for name in BDF_NAMES["unix_time_s"] if name in table.columns), None)
    return time_s, None if wall_clock is None else float(wall_clock[0] - time_s[0])


def _other_than_amperes(column: Column, current_A: np.ndarray, voltage_V: np.ndarray) -> tuple[Note, ...]:
    """A warning of a current that cannot be in the unit of its column, or in amperes without one; the likely unit."""
    if (other := not_in_amperes(current_A, voltage_V, is_named=column.unit is not None)) is None:
        return ()
    unit = column.unit or CURRENT.default
    likely = unit.scale * (other.scale.factor if other.scale else _LARGER)
    symbol = next((u.symbol for u in UNITS.values() if u.dimension == "current" and np.isclose(u.scale, likely)), "")
    if column.unit is None and other.scale is None:
        symbol, fix = "", "name the unit, as in power_kW"
    elif symbol:
        fix = f"if these are {symbol}, say --unit current={symbol}"
    else:
        fix = "check the unit"
    named = "names no unit; as amperes" if column.unit is None else f"is read in {unit.symbol};"
    option = ("--unit", f"current={symbol}") if symbol else ()
    return (Note(f"column {column.name!r} {named} {other.reason}: {fix}", "warning", option),)


class UnknownSignError(InputError):
    """The data do not show whether a positive current charges the battery; `likely` is the more likely sign."""

    def __init__(self, text: str, likely: CurrentSign, is_lost: bool = False) -> None:
        super().__init__(text, () if is_lost else ("--current-sign", likely))
        self.likely = likely
        self.is_lost = is_lost  #: the current has no sign, or turns it: neither choice is right


def charging_current(
    file: TableFile,
    wanted: CurrentSign,
    time_s: np.ndarray,
    current_A: np.ndarray,
    voltage_V: np.ndarray,
    part: slice,
) -> tuple[np.ndarray, Note]:
    """Current (T,) [A] of a file, > 0 charging, and a note; the sign is given, set by the format, or found in the data.

    part: the wanted rows, whose own sign counts where the whole file has none.

    Raises:
        UnknownSignError: the sign cannot be determined, or the current has lost it.
        InputError: `wanted` is not one of the three choices.
    """
    if wanted not in get_args(CurrentSign):
        raise InputError(f"current_sign must be 'auto', 'charge' or 'discharge', not {wanted!r}")
    evidence, directions = _sign_in(time_s, current_A, voltage_V)
    if directions:
        evidence, directions = _sign_in(time_s[part], current_A[part], voltage_V[part])
    sign: str
    if wanted != "auto":
        sign = wanted
        note = _given_note(sign, "given", evidence, directions)
    elif is_bdf(file.source):
        sign = "charge"
        note = _given_note(sign, "by definition of BDF", evidence, directions)
    elif directions:
        raise UnknownSignError(f"{file.stem}: {directions}", evidence.likely, is_lost=True)
    elif evidence.verdict != "undecidable":
        sign = evidence.verdict
        note = Note(f"positive current {sign}s the battery, as the data show: {evidence}")
    elif has_bdf_columns(file.names):
        sign = "charge"
        note = Note("positive current charges the battery (by definition of BDF, whose column names these are)")
    elif file.positive_current:
        sign = file.positive_current
        note = Note(f"positive current {sign}s the battery (by definition of the recorded messages)")
    elif not np.nan_to_num(current_A).any():
        sign = "charge"
        note = Note("the current is zero throughout: its sign does not matter", "warning")
    else:
        raise UnknownSignError(
            f"{file.stem}: the data do not show whether a positive current charges or discharges the battery "
            f"({evidence}); say it with --current-sign charge or --current-sign discharge (current_sign='charge')",
            evidence.likely,
        )
    return -current_A if sign == "discharge" else current_A, note


def _sign_in(time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> tuple[SignEvidence, Finding | None]:
    """The evidence of the sign of a current (T,) [A], and a finding on one that has no sign or turns it."""
    directions = lost_sign(current_A, voltage_V) or turned_sign(time_s, current_A, voltage_V)
    return sign_evidence(time_s, current_A, voltage_V), directions


def _given_note(given: str, by: str, evidence: SignEvidence, directions: Finding | None) -> Note:
    """Note on a sign that was given; a warning where the data contradict it."""
    text = f"positive current {given}s the battery ({by})"
    if directions:
        return Note(f"{text}, but {directions}", "warning")
    if evidence.verdict in (given, "undecidable"):
        return Note(text)
    return Note(f"{text}, but the data say the opposite: {evidence}; check the sign", "warning")


def _further(measured: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[Note, ...]]:
    """Quantities of the battery (T,) that have no array of their own in a log, by field name, and notes on them.

    measured: channel -> (T,), in the unit of its quantity.
    """
    found: dict[str, np.ndarray] = {}
    notes: tuple[Note, ...] = ()
    for quantity in QUANTITIES.values():
        if quantity.owner == "battery" and quantity.channel in measured and quantity.field not in _COLUMNS:
            found[quantity.field], impossible = without_impossible(quantity, measured[quantity.channel])
            notes += impossible
    return found, notes


def _range(name: str, values: np.ndarray, unit: str) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return f"  {name}: never measured"
    missing = values.size - known.size
    return f"  {name}: {known.min():.6g} to {known.max():.6g} {unit}" + (f", {missing} missing" if missing else "")
