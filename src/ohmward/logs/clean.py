"""From the columns of a file to the samples of a log: text, missing values, several sampling rates, gaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.channels import BATTERY, TIME
from ohmward.logs.columns import Column, listed
from ohmward.logs.table import Note, Table, counted, held, numbers
from ohmward.runs import from_to, long_runs
from ohmward.signals.checks import no_numbers, stuck
from ohmward.signals.current_sign import edge_test
from ohmward.signals.survey import find_gaps, spread

#: No instrument shows a larger number, in whatever unit; squares of it are finite.
LARGEST_READING = 1e18
#: A voltage of no battery stands alone, for less than half of so many samples, and so far from those around it, as a
#: share of the usual one: pulses of a cold cell move it less.
_AROUND, _FAR = 7, 1 / 3
#: A temperature that stands alone, so far [K] from those around it, is no battery's: pulses warm a cell by a few.
_FAR_K = 20.0
#: A current that may be none stands alone and is larger than so many times all but the largest hundredth; the voltage
#: answers one that flows by this share of the resistance at least.
_HUGE, _ANSWERS = 3.0, 0.2
#: A current that stays the same for this time [s] and so many rows is stuck where the voltage makes large moves that
#: turn back so often, and by this share as often as elsewhere.
_STUCK_S, _STUCK_ROWS, _STUCK_TURNS, _STUCK_SHARE = 60.0, 30, 6, 0.25
#: A move is large that is by this share that of the largest edge of the current, and by so many times the noise.
_LARGE_MOVE, _BEYOND_NOISE = 0.1, 6.0
_ALONE = "no measurement, far from the rows around"
# Where fewer than this fraction of the currents have a voltage in their row, each has a rate of its own.
_TOGETHER_FRACTION = 0.5
# Silences of a recorder of changes up to so long [s] are filled, with so many rows at most.
_UNCHANGED_S, _MOST_COPIES = 60.0, 600
# Fewest values of a column of changes, and the most different ones among them, over their number.
_FEWEST_CHANGES, _DIFFERENT = 30, 0.25
# Current and voltage come in turn where this fraction of so many rows or more follow one of the other.
_IN_TURN, _TURNS = 0.9, 20


def to_si(table: Table, chosen: Mapping[str, Column]) -> Table:
    """Every channel but the time in the unit of its quantity, as float64; infinite values become NaN.

    Raises:
        InputError: text where a number must stand (names the line), or no value of the current or voltage at all.
    """
    for channel in BATTERY:
        if channel is TIME or channel.name not in chosen:
            continue
        name, unit = chosen[channel.name]
        values, infinite = finite(name, numbers(table, name))
        if channel.required and not np.isfinite(values).any():
            raise InputError(f"{table.source}: column {name!r} has no value; a log needs a measured {channel.name}")
        taken = f" in {unit.symbol}" if unit else f", which names no unit: taken as {channel.default.symbol}"
        note = Note(f"{channel.name} from {name!r}{taken}")
        table = table.with_columns({name: (unit or channel.default).in_si(values)}, *infinite, note)
    return table


def finite(name: str, values: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The values (T,) of a column with NaN in place of infinite and of huge ones, and a note on their number."""
    if not ((values > LARGEST_READING).any() or (values < -LARGEST_READING).any()):
        return values, ()
    infinite = np.abs(values) > LARGEST_READING
    note = Note(f"{counted(infinite.sum(), 'infinite value')} of {name!r} taken as missing", "warning")
    return np.where(infinite, np.nan, values), (note,)


def without_spikes(voltage_V: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The voltages (T,) [V] with NaN in single rows that no battery shows, as 0 or 65.535 V, and a note on them."""
    usual_V = _usual(voltage_V)
    rows, _ = _alone(voltage_V, usual_V, _FAR * abs(usual_V))
    return without_rows(voltage_V, rows, "voltage", "V", _ALONE)


def without_temperature_spikes(degC: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The temperatures (T,) [degC] with NaN in single rows that no battery shows, as -40 or 0, and a note on them."""
    rows, _ = _alone(degC, _usual(degC), _FAR_K)
    return without_rows(degC, rows, "temperature", "degC", _ALONE)


def _usual(values: np.ndarray) -> float:
    """Median of the values (T,) that are known; 0 where none is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else 0.0


def without_silent_spikes(current_A: np.ndarray, voltage_V: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The currents (T,) [A] with NaN in single huge ones that the voltage (T,) [V] does not answer, and a note on them.

    32.767 or 655.35 A of a bus that was disturbed are such; one that flows moves the voltage by the resistance at once,
    or in the next row where that is sampled later.
    """
    known = np.isfinite(current_A)
    usual_A = float(np.quantile(np.abs(current_A[known]), 0.99)) if known.any() else 0.0
    rows, around_A = _alone(current_A, 0.0, _HUGE * usual_A)
    if not rows.size:
        return current_A, ()
    others = known & np.isfinite(voltage_V)
    others[rows] = False
    ohm = abs(edge_test(current_A[others], voltage_V[others]).resistance_ohm)
    beside_V = voltage_V[np.clip(rows[:, None] + np.array([-1, 0, 1]), 0, voltage_V.size - 1)]
    answer_V = np.abs(beside_V[:, 1:] - beside_V[:, :1])
    expected_V = ohm * np.abs(current_A[rows] - around_A)
    silent = np.isnan(beside_V[:, 1]) | (
        np.where(np.isnan(answer_V), 0.0, answer_V).max(axis=1) < _ANSWERS * expected_V
    )
    return without_rows(current_A, rows[silent], "current", "A", "no measurement, the voltage does not answer")


def without_stuck_current(
    time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The currents (T,) [A] with NaN where they stay the same to the last digit and the load goes on, with a note each.

    In a rest or at a steady load the voltage relaxes; a load that goes on unseen moves it back and forth as before.
    """
    steady = long_runs(np.diff(current_A, prepend=np.nan) == 0.0, time_s, _STUCK_S, _STUCK_ROWS)
    if not steady:
        return current_A, ()
    known = np.isfinite(current_A) & np.isfinite(voltage_V)
    largest_A = np.abs(np.diff(current_A[known])).max(initial=0.0)
    edge_V = edge_test(current_A[known], voltage_V[known]).resistance_ohm * largest_A
    moves_V = np.diff(voltage_V, prepend=np.nan)
    large = np.abs(moves_V) > max(_LARGE_MOVE * abs(edge_V), _BEYOND_NOISE * spread(moves_V[np.isfinite(moves_V)]))
    elsewhere = np.isfinite(moves_V)
    for first, stop in steady:
        elsewhere[first:stop] = False
    usual = large[elsewhere].mean() if large[elsewhere].any() else np.inf
    rest_A = current_A
    notes: list[Note] = []
    for first, stop in steady:
        upwards = moves_V[first:stop][large[first:stop]] > 0.0
        turns = np.count_nonzero(upwards[1:] != upwards[:-1])
        if turns >= _STUCK_TURNS and turns >= _STUCK_SHARE * usual * (stop - first):
            rest_A = rest_A if notes else current_A.copy()
            rest_A[first:stop] = np.nan
            when = f" {from_to(time_s[first:stop])}"
            what = f"the current of {current_A[first]:g} A is "
            notes.append(Note(f"{stuck(what, when, 'the voltage')}; its values there are left out", "warning"))
    return rest_A, tuple(notes)


def _alone(values: np.ndarray, usual: float, far: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the values (T,) farther than `far` from the usual one and the median of those around; and the medians."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size < _AROUND:
        return np.empty(0, int), np.empty(0)
    apart = np.flatnonzero(np.abs(values[known] - usual) > far)
    first = np.clip(apart - _AROUND // 2, 0, known.size - _AROUND)
    around = np.median(values[known[first[:, None] + np.arange(_AROUND)]], axis=1)
    spike = np.abs(values[known[apart]] - around) > far
    return known[apart[spike]], around[spike]


def without_rows(
    values: np.ndarray, rows: np.ndarray, quantity: str, unit: str, fault: str
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The values (T,) with NaN in the rows, and a note with their number, range and fault."""
    if not rows.size:
        return values, ()
    low, high = values[rows].min(), values[rows].max()
    seen = f"{low:g} {unit}" if low == high else f"{low:g} to {high:g} {unit}"
    rest = values.copy()
    rest[rows] = np.nan
    return rest, (Note(f"{counted(rows.size, quantity)} of {seen} left out: {fault}", "warning"),)


def drop_untimed(table: Table, time: str) -> Table:
    """The rows whose time is finite.

    Raises:
        InputError: no row has a time.
    """
    known = np.isfinite(table.columns[time])
    if not known.any():
        raise InputError(f"{table.source}: column {time!r} has no value; a log needs the time of its samples")
    if known.all():
        return table
    note = Note(f"{counted((~known).sum(), 'row')} without a time: dropped", "warning")
    return table.pick(known).with_notes(note)


def drop_text(table: Table) -> Table:
    """The numeric columns that have a value at all, as float64."""
    numeric = {name: numbers(table, name) for name, values in table.columns.items() if values.dtype.kind in "fium"}
    measured = {name: values for name, values in numeric.items() if np.isfinite(values).any()}
    left_out = {"text": table.columns.keys() - numeric.keys(), "empty": numeric.keys() - measured.keys()}
    notes = [Note(f"{kind} columns left out: {listed(sorted(names))}") for kind, names in left_out.items() if names]
    return table._replace(columns=measured).with_notes(*notes)


def merge_rates(table: Table, chosen: Mapping[str, Column]) -> Table:
    """Rows that have a current or a voltage; what was sampled on rows of its own is interpolated onto them.

    The temperature, and whatever else the battery has, is always interpolated linearly over rows that lack it. The
    current is, where the file samples it on other rows than the voltage; where the two come in turn, from one sensor,
    rows of the current alone go. Single missing values of both stay NaN. Where the recorder writes changes alone, a
    value holds until the next one.
    """
    time = chosen["time"].name
    current = chosen["current"].name
    table = _hold_changes(table, time, [chosen[quantity].name for quantity in ("current", "voltage")])
    has_current = np.isfinite(table.columns[current])
    has_voltage = np.isfinite(table.columns[chosen["voltage"].name])
    measured = has_current | has_voltage
    if (has_current & has_voltage).sum() < _TOGETHER_FRACTION * min(has_current.sum(), has_voltage.sum()):
        table = _interpolate(table, time, current, has_voltage & ~has_current)
        turns = np.diff(has_voltage[measured].astype(int)) != 0
        if turns.size >= _TURNS and turns.mean() >= _IN_TURN:
            alone = has_current & ~has_voltage
            table = table.with_notes(
                Note(f"{counted(alone.sum(), 'row')} of a current alone: joined with the voltages")
            )
            measured = has_voltage
    for name in [column.name for quantity, column in chosen.items() if quantity not in ("time", "current", "voltage")]:
        if name in table.columns:
            table = _interpolate(table, time, name, measured & ~np.isfinite(table.columns[name]))
    if measured.all():
        return table
    if nothing := (~has_current & ~has_voltage).sum():
        table = table.with_notes(Note(f"{counted(nothing, 'row')} with neither current nor voltage: dropped"))
    return table.pick(measured)


def _hold_changes(table: Table, time: str, names: Sequence[str]) -> Table:
    """The table with these columns held from change to change, where changes are all that was written.

    A silence in which nothing has changed is no gap: rows are added in it, as often as usual.
    """
    columns = {name: table.columns[name] for name in names}
    sparse = {name: values for name, values in columns.items() if not np.isfinite(values).all()}
    repeated = any((np.diff(values[np.isfinite(values)]) == 0.0).any() for values in columns.values())
    if not sparse or repeated or not any(_are_changes(values) for values in columns.values()):
        return table
    text = f"{listed(sorted(sparse))}: only changes are written, each value holds until the next one"
    table = table.with_columns({name: held(values) for name, values in sparse.items()}, Note(text))
    time_s = table.columns[time]
    steps = np.diff(time_s, append=np.nan)
    usual_s = float(np.nanmedian(steps))
    silent = (steps > usual_s) & (steps <= _UNCHANGED_S) if usual_s > 0.0 else np.zeros(steps.size, dtype=bool)
    copies = np.where(silent, np.ceil(steps / max(usual_s, _UNCHANGED_S / _MOST_COPIES)), 1.0).astype(int)
    which = np.repeat(np.arange(time_s.size), copies)
    nth = np.arange(which.size) - np.repeat(np.cumsum(copies) - copies, copies)
    share = nth / copies[which]
    times = time_s[which] + np.where(nth > 0, share * steps[which], 0.0)
    return table.pick(which).with_columns({time: times})


def _are_changes(values: np.ndarray) -> bool:
    """True of few different values, none of which comes twice in a row: a sensor of that resolution repeats itself."""
    known = values[np.isfinite(values)]
    return known.size >= _FEWEST_CHANGES and bool(np.unique(known).size <= _DIFFERENT * known.size)


def _interpolate(table: Table, time: str, name: str, rows: np.ndarray) -> Table:
    """Interpolate a column linearly in time at `rows` (mask), the ends held."""
    if not rows.any():
        return table
    time_s = table.columns[time]
    values = table.columns[name].copy()
    known = np.isfinite(values)
    values[rows] = np.interp(time_s[rows], time_s[known], values[known])
    text = f"{name!r} is interpolated at {counted(rows.sum(), 'sample')} from {counted(known.sum(), 'value')}"
    return table.with_columns({name: values}, Note(text))


def missing_notes(table: Table, chosen: Mapping[str, Column]) -> list[Note]:
    """Notes on the number of samples that lack their current or voltage."""
    counts = {q: int(np.isnan(table.columns[chosen[q].name]).sum()) for q in ("current", "voltage")}
    found = [one for q, count in counts.items() for one in no_numbers(count, table.line.size, f"{q}: ")]
    return [Note(finding.text, "warning") for finding in found]


def on_lines(at_s: np.ndarray, time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (N,) at times (N,) on straight lines between samples (T,); NaN within gaps and outside of them."""
    found = np.interp(at_s, time_s, values, left=np.nan, right=np.nan)
    for gap in find_gaps(time_s):
        found[(at_s > time_s[gap]) & (at_s < time_s[gap + 1])] = np.nan
    return found


def gap_notes(time_s: np.ndarray) -> tuple[Note, ...]:
    """A note on the gaps in the time (T,) [s] and the longest of them, if there are any."""
    gaps = find_gaps(time_s)
    if not gaps.size:
        return ()
    longest = gaps[np.argmax(np.diff(time_s)[gaps])]
    length = time_s[longest + 1] - time_s[longest]
    return (Note(f"{counted(gaps.size, 'gap')}, the longest {length:g} s after {time_s[longest]:g} s", "warning"),)
