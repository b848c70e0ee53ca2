"""From the columns of a file to the samples of a log: text, missing values, several sampling rates, gaps.

Impossible durations, intervals and charges are refused: they show that the unit of the time is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.channels import BATTERY, TIME
from ohmward.logs.columns import Column, listed
from ohmward.logs.hints import FileHints
from ohmward.logs.table import Note, Table, counted, held, numbers
from ohmward.logs.units import UNITS
from ohmward.quantities import DAY_S, QUANTITIES, SECONDS_PER_HOUR, Quantity
from ohmward.runs import from_to, long_runs, repeats, where_known
from ohmward.signals.checks import beyond_limits, no_numbers, stuck
from ohmward.signals.current_sign import edge_test
from ohmward.signals.current_size import charge_of_no_battery, not_in_amperes
from ohmward.signals.survey import find_gaps, resolution, spread, usual_interval_s

#: Larger than any reading of an instrument in any unit; its square is finite.
LARGEST_READING = 1e18
#: A negative number of 64 bits that was written without its sign is so close to this.
_RANGE_OF_64_BITS, _WRAPPED_WITHIN = 2.0**64, 1e-6
#: A voltage spike lasts less than half of this many samples, and is farther from the samples around it than this
#: fraction of the usual voltage: pulses of a cold cell move it less.
_AROUND, _SPIKE_SHARE = 7, 1 / 3
#: Digits of numbers that stand for a missing value, whatever the unit: 0, nines, and the ends of 16 and 32 bits.
_CODES = frozenset(("", "999", "9999", "99999", "32767", "32768", "65535", "2147483647", "2147483648", "4294967295"))
#: A temperature spike is farther than this [K] from the samples around it: pulses warm a cell by only a few kelvins.
_FAR_K = 20.0
#: A temperature that never changes and lies outside these limits [degC] is an error code: -127, -40, 85, 127.
COLDEST_CHAMBER_DEGC, HOTTEST_CHAMBER_DEGC = -35.0, 80.0
#: Fewest samples to call a temperature constant.
_SAMPLES_OF_A_CONSTANT = 50
#: A suspected current spike is larger than this many times the 99th percentile; it is real if the voltage responds with
#: at least this fraction of resistance times current step.
_HUGE, _ANSWERS = 3.0, 0.2
#: A current that stays the same for this time [s] and this many rows is stuck if large moves of the voltage reverse at
#: least this many times, and at this fraction of the rate of large moves elsewhere; under a load that flickers
#: elsewhere, once is enough: nothing but a sensor that rounds small currents to 0 is that still.
_STUCK_CURRENT_S, _STUCK_ROWS, _STUCK_TURNS, _STUCK_TURNS_SHARE = 60.0, 30, 6, 0.25
_STUCK_TURNS_OF_A_LOAD = 1
#: A voltage move is large above this fraction of that at the largest current edge, this many times the noise, and this
#: many of its smallest steps: a voltage of few digits flickers between two of them.
_LARGE_MOVE, _BEYOND_NOISE, _BEYOND_STEP = 0.1, 6.0, 1.5
#: A reading that stays the same for as long flickers elsewhere if it stays the same in at most this share of the other
#: rows between which the current moves by less than this share of its largest, of which there are at least so many.
_MOST_REPEATS, _UNMOVED_SHARE, _FEWEST_STEADY = 0.3, 0.01, 100
# If fewer than this fraction of the currents have a voltage in their row, the two have different sampling rates.
_TOGETHER_FRACTION = 0.5
# Silences of a recorder of changes are filled up to this duration [s], each with at most this many rows.
_UNCHANGED_S, _MOST_COPIES = 60.0, 600
# Fewest values of a column of changes, and the largest fraction of them that are distinct.
_FEWEST_CHANGES, _DIFFERENT = 30, 0.25
# This fraction of a column is sorted first: in most columns it has more distinct values than that.
_SORTED_SHARE = 0.3
# Current and voltage alternate if this fraction of the rows, of at least this many, follow one of the other kind.
_IN_TURN, _FEWEST_IN_TURN = 0.9, 20


def to_si(table: Table, chosen: Mapping[str, Column]) -> Table:
    """Convert every channel but the time to the unit of its quantity, as float64; infinite values become NaN.

    Raises:
        InputError: text where a number is expected (names the line), or no value of the current or voltage at all.
    """
    for channel in BATTERY:
        if channel is TIME or channel.name not in chosen:
            continue
        name, unit = chosen[channel.name]
        values = numbers(table, name)
        largest = np.fmax.reduce(values, initial=0.0)
        if largest > LARGEST_READING and (wrapped := np.isclose(values, _RANGE_OF_64_BITS, rtol=_WRAPPED_WITHIN).sum()):
            raise InputError(
                f"{table.source}: column {name!r} has {counted(wrapped, 'number')} near 2^64: negative ones of 64 "
                "bits, written without their sign; write them with it"
            )
        values, infinite = finite(name, values)
        if channel.required and not np.isfinite(values).any():
            raise InputError(f"{table.source}: column {name!r} has no value; a log needs a measured {channel.name}")
        taken = f" in {unit.symbol}" if unit else f", which names no unit: assumed to be {channel.default.symbol}"
        note = Note(f"{channel.name} from {name!r}{taken}")
        table = table.with_columns({name: (unit or channel.default).in_si(values)}, *infinite, note)
    return table


def finite(name: str, values: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The values (T,) of a column with NaN in place of infinite and of huge ones, and a note on their number."""
    if not ((values > LARGEST_READING).any() or (values < -LARGEST_READING).any()):
        return values, ()
    infinite = np.abs(values) > LARGEST_READING
    note = Note(f"{counted(infinite.sum(), 'infinite value')} of {name!r} treated as missing", "warning")
    return np.where(infinite, np.nan, values), (note,)


def without_faults(
    time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[Note, ...]]:
    """The currents [A] and voltages [V] (T,) with NaN for those that no sensor measured, and notes on them."""
    current_A, voltage_V, empty = without_rows_of_zeros(current_A, voltage_V)
    voltage_V, spikes = without_spikes(QUANTITIES["battery_voltage_V"], voltage_V)
    current_A, silent = without_silent_spikes(current_A, voltage_V)
    current_A, voltage_V, repeated = without_repeated_rows(time_s, current_A, voltage_V)
    current_A, dead = without_stuck_current(time_s, current_A, voltage_V)
    return current_A, voltage_V, (*empty, *spikes, *silent, *repeated, *dead)


def without_spikes(quantity: Quantity, values: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """Voltages or temperatures (T,), isolated impossible values, such as -40 degC, set to NaN, and a note on them.

    Voltages of 0, as before a battery is connected, and of 65.535 V are no measurement however long they last.
    """
    low, high = np.fmin.reduce(values), np.fmax.reduce(values)
    if high - low <= (_FAR_K if quantity.unit == "degC" else _SPIKE_SHARE * low):
        return values, ()  # none is that far from the median, wherever that lies
    usual = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
    far = _FAR_K if quantity.unit == "degC" else _SPIKE_SHARE * abs(usual)
    rows = _alone(values, usual, far)
    if quantity.unit == "V" and usual > 0.0:
        rows = np.union1d(rows, np.flatnonzero(_are_codes(values) & (np.abs(values - usual) > far)))
    return without_rows(quantity, values, rows, "no measurement, far from the rows around")


def without_silent_spikes(current_A: np.ndarray, voltage_V: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The currents (T,) [A] with huge values to which the voltage (T,) [V] does not respond set to NaN, and a note.

    A disturbed bus gives 32.767 or 655.35 A, for example, in single rows or for as long as it lasts. A current that
    flows moves the voltage across the resistance at once, or in the next row if the voltage is sampled later.
    """
    codes, size_A = _are_codes(current_A), np.abs(current_A)
    if not codes.any() and np.count_nonzero(_HUGE * size_A >= np.fmax.reduce(size_A)) >= 0.01 * size_A.size + 2:
        return current_A, ()  # so many are as large as a third of the largest that the quantile is
    known = np.isfinite(current_A)
    measured = known & ~codes
    huge_A = _HUGE * float(np.quantile(size_A[measured], 0.99)) if measured.any() else np.inf
    rows = np.union1d(_alone(current_A, 0.0, huge_A), np.flatnonzero(codes & (size_A > huge_A)))
    if not rows.size:
        return current_A, ()
    others = known & np.isfinite(voltage_V)
    others[rows] = False
    ohm = abs(edge_test(current_A[others], voltage_V[others]).resistance_ohm)
    beside_V = voltage_V[np.clip(rows[:, None] + np.array([-1, 0, 1]), 0, voltage_V.size - 1)]
    answer_V = np.abs(beside_V[:, 1:] - beside_V[:, :1])
    expected_V = ohm * np.abs(current_A[rows])
    silent = np.isnan(beside_V[:, 1]) | (
        np.where(np.isnan(answer_V), 0.0, answer_V).max(axis=1) < _ANSWERS * expected_V
    )
    of_codes = codes[rows]  # which all are measured, or none: one of them may stand beside a load that changes
    silent[of_codes] = 2 * np.count_nonzero(silent[of_codes]) > np.count_nonzero(of_codes)
    current = QUANTITIES["battery_current_A"]
    return without_rows(current, current_A, rows[silent], "no measurement, the voltage does not answer")


def without_stuck_current(
    time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The currents (T,) [A] with NaN where they freeze to the last digit although the load goes on, with a note each.

    At rest or under a steady load the voltage relaxes; a load that is no longer measured still moves it back and forth.
    """
    same = repeats(current_A)
    steady = long_runs(same, time_s, _STUCK_CURRENT_S, _STUCK_ROWS)
    if not steady:
        return current_A, ()
    flickers = _flickers(same, current_A, steady)
    known_A, known_V = where_known(current_A, voltage_V)
    edge_V = edge_test(known_A, known_V).resistance_ohm * np.abs(np.diff(known_A)).max(initial=0.0)
    moves_V = np.diff(voltage_V, prepend=np.nan)
    noise_V = spread(moves_V[np.isfinite(moves_V)])
    step_V = resolution(voltage_V[np.isfinite(voltage_V)])
    large = np.abs(moves_V) > max(_LARGE_MOVE * abs(edge_V), _BEYOND_NOISE * noise_V, _BEYOND_STEP * step_V)
    elsewhere = np.isfinite(moves_V)
    for first, stop in steady:
        elsewhere[first:stop] = False
    usual = large[elsewhere].mean() if large[elsewhere].any() else np.inf
    rest_A = current_A
    notes: list[Note] = []
    for first, stop in steady:
        upwards = moves_V[first:stop][large[first:stop]] > 0.0
        turns = np.count_nonzero(upwards[1:] != upwards[:-1])
        fewest = _STUCK_TURNS_OF_A_LOAD if flickers and current_A[first] != 0.0 else _STUCK_TURNS
        if turns >= fewest and turns >= _STUCK_TURNS_SHARE * usual * (stop - first):
            rest_A = rest_A if notes else current_A.copy()
            rest_A[first:stop] = np.nan
            when = f" {from_to(time_s[first:stop])}"
            what = f"the current of {current_A[first]:g} A is "
            notes.append(Note(f"{stuck(what, when, 'the voltage')}; its values there are left out", "warning"))
    return rest_A, tuple(notes)


def without_repeated_rows(
    time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[Note, ...]]:
    """The currents and voltages (T,) with NaN where a logger repeats its last row, and a note on each stretch.

    A sensor that is heard flickers in its last digit, also under a steady current; a battery at rest read in coarse
    digits, and a test at constant current, repeat their rows everywhere.
    """
    each = [repeats(values) for values in (current_A, voltage_V)]
    repeated = long_runs(each[0] & each[1], time_s, _STUCK_CURRENT_S, _STUCK_ROWS)
    if not all(_flickers(same, current_A, repeated) for same in each):
        return current_A, voltage_V, ()
    current_A, voltage_V = current_A.copy(), voltage_V.copy()
    notes: list[Note] = []
    for first, stop in repeated:
        text = (
            f"{current_A[first]:g} A and {voltage_V[first]:g} V repeated to the last digit "
            f"{from_to(time_s[first:stop])}, which elsewhere flicker: the logger did not hear the sensor; its values "
            "there are left out"
        )
        notes.append(Note(text, "warning"))
        current_A[first:stop] = voltage_V[first:stop] = np.nan
    return current_A, voltage_V, tuple(notes)


def _flickers(same: np.ndarray, current_A: np.ndarray, stretches: Sequence[tuple[int, int]]) -> bool:
    """True if a reading that stays the same along the stretches changes elsewhere, also while the current is steady.

    same: (T,), the reading is that of the row before.
    """
    if not stretches:
        return False
    move_A = np.abs(np.diff(current_A, prepend=np.nan))
    steady = move_A <= _UNMOVED_SHARE * float(np.nanquantile(np.abs(current_A), 0.99))
    for first, stop in stretches:
        steady[first:stop] = False
    return bool(np.count_nonzero(steady) >= _FEWEST_STEADY and same[steady].mean() <= _MOST_REPEATS)


def battery_temperature(
    hints: FileHints, column: Column | None, measured: np.ndarray | None, samples: int
) -> tuple[np.ndarray | None, tuple[Note, ...]]:
    """The measured temperature (T,) [degC], else the one given by the user, else None; and notes.

    column: of the temperature, if there is one.
    """
    quantity = QUANTITIES["battery_temperature_degC"]
    given_degC = hints.temperature_degC
    notes: tuple[Note, ...] = ()
    if column is not None and measured is not None and _is_of_no_sensor(column, measured):
        advice = "" if given_degC is not None else "; if it is right, or to give another, say --temperature 25"
        text = f"temperature {np.nanmax(measured):g} degC throughout, without any change: no sensor, left out{advice}"
        measured, notes = None, (Note(text, "warning"),)
    elif measured is not None and (scale := _wrong_scale(quantity, measured)):
        measured, notes = None, (Note(f"temperature left out: {scale}", "warning"),)
    elif measured is not None:
        measured, impossible = without_impossible(quantity, measured)
        measured, spikes = without_spikes(quantity, measured)
        notes = impossible + spikes
    if given_degC is None:
        return measured, notes
    if measured is None:
        text = f"temperature of {given_degC:g} degC throughout, as given"
        return np.full(samples, given_degC), (*notes, Note(text))
    text = f"temperature of {given_degC:g} degC not used: the log has its own"
    return measured, (*notes, Note(text, "warning"))


def _wrong_scale(quantity: Quantity, measured: np.ndarray) -> str:
    """A finding on values (T,) of a quantity of which most are impossible: their unit is another one; else ""."""
    known = measured[np.isfinite(measured)]
    if not known.size or quantity.limits.lowest <= np.median(known) <= quantity.limits.highest:
        return ""
    return "; ".join(map(str, beyond_limits(quantity, known.min(), known.max(), quantity.limits, "log", "it ")))


def _is_of_no_sensor(column: Column, measured: np.ndarray) -> bool:
    """True for a constant temperature (T,) [degC] that is zero, in degC or the column's unit, or beyond any chamber's.

    A constant 25 degC may be the set point of a chamber.
    """
    known = measured[np.isfinite(measured)]
    if known.size < _SAMPLES_OF_A_CONSTANT or known.min() < known.max():
        return False
    zero_degC = column.unit.in_si(np.zeros(1))[0] if column.unit else 0.0
    return (
        bool(np.isclose(known[0], (zero_degC, 0.0)).any()) or not COLDEST_CHAMBER_DEGC < known[0] < HOTTEST_CHAMBER_DEGC
    )


def without_impossible(
    quantity: Quantity, values: np.ndarray, unit_known: bool = False
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The values (T,) of a quantity with those impossible for a battery set to NaN, and a note on them.

    If most of them are impossible and the unit is not certain, the unit is wrong, and all values are kept.
    """
    with np.errstate(invalid="ignore"):
        wrong = (values < quantity.limits.lowest) | (values > quantity.limits.highest)
    if not unit_known and 2 * np.count_nonzero(wrong) > np.count_nonzero(np.isfinite(values)):
        return values, ()
    return without_rows(quantity, values, np.flatnonzero(wrong), "no battery has them")


def without_rows_of_zeros(
    current_A: np.ndarray, voltage_V: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[Note, ...]]:
    """The currents and voltages (T,) with NaN where both are 0, as of a logger without its sensor, and a note."""
    empty = (current_A == 0.0) & (voltage_V == 0.0)
    if not empty.any():
        return current_A, voltage_V, ()
    note = Note(f"{counted(empty.sum(), 'row')} of 0 A and 0 V left out: no measurement", "warning")
    return np.where(empty, np.nan, current_A), np.where(empty, np.nan, voltage_V), (note,)


def _are_codes(values: np.ndarray) -> np.ndarray:
    """Mask (T,) of the lowest and highest values, where these are 0 or a number that stands for a missing one."""
    ends = (np.fmin.reduce(values), np.fmax.reduce(values))
    digits = [f"{abs(end):.9e}".partition("e")[0].replace(".", "").strip("0") for end in ends]
    return np.isin(values, [end for end, of_end in zip(ends, digits, strict=True) if of_end in _CODES])


def _alone(values: np.ndarray, usual: float, far: float) -> np.ndarray:
    """Rows of values (T,) farther than `far` from `usual` and from the median of those around."""
    rows = np.flatnonzero(np.isfinite(values) & (np.abs(values - usual) > far))
    known = np.flatnonzero(np.isfinite(values)) if rows.size else rows  # a long log without any takes no more memory
    if known.size < _AROUND:
        return np.empty(0, int)
    apart = np.searchsorted(known, rows)
    first = np.clip(apart - _AROUND // 2, 0, known.size - _AROUND)
    around = np.median(values[known[first[:, None] + np.arange(_AROUND)]], axis=1)
    spike = np.abs(values[known[apart]] - around) > far
    return known[apart[spike]]


def without_rows(
    quantity: Quantity, values: np.ndarray, rows: np.ndarray, fault: str
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The values (T,) of a quantity with NaN in the rows, and a note with their number, range and fault."""
    if not rows.size:
        return values, ()
    low, high = values[rows].min(), values[rows].max()
    seen = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    rest = values.copy()
    rest[rows] = np.nan
    text = f"{counted(rows.size, quantity.channel)} of {seen} {quantity.unit} left out: {fault}"
    return rest, (Note(text, "warning"),)


def drop_untimed(table: Table, time: str) -> Table:
    """The rows whose time is finite; InputError where there is none."""
    known = np.isfinite(table.columns[time])
    if not known.any():
        raise InputError(f"{table.source}: column {time!r} has no value; a log needs the time of its samples")
    if known.all():
        return table
    note = Note(f"{counted((~known).sum(), 'row')} without a time: dropped", "warning")
    return table.pick(known).with_notes(note)


def drop_text(table: Table) -> Table:
    """The numeric columns with at least one value, as float64."""
    numeric = {name: numbers(table, name) for name, values in table.columns.items() if values.dtype.kind in "fium"}
    measured = {name: values for name, values in numeric.items() if np.isfinite(values).any()}
    left_out = {"text": table.columns.keys() - numeric.keys(), "empty": numeric.keys() - measured.keys()}
    notes = [Note(f"{kind} columns left out: {listed(sorted(names))}") for kind, names in left_out.items() if names]
    return table._replace(columns=measured).with_notes(*notes)


def merge_rates(table: Table, chosen: Mapping[str, Column]) -> Table:
    """Rows that have a current or a voltage; channels sampled on rows of their own are interpolated onto them.

    The temperature and all further battery channels are always interpolated linearly over rows that lack them. The
    current is interpolated only if the file samples it on other rows than the voltage; if the two alternate, as from
    one sensor, rows with a current alone are dropped. Single missing values of both stay NaN. If the recorder writes
    changes only, a value holds until the next one.
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
        if turns.size >= _FEWEST_IN_TURN and turns.mean() >= _IN_TURN:
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
    """The table with these columns held from one change to the next, if only changes were written.

    A silence in which nothing has changed is not a gap: rows are added in it at the usual interval.
    """
    columns = {name: table.columns[name] for name in names}
    sparse = {name: values for name, values in columns.items() if not np.isfinite(values).all()}
    if not sparse or any(repeats(values[np.isfinite(values)]).any() for values in columns.values()):
        return table
    if not any(_are_changes(values) for values in columns.values()):
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
    """True for few distinct values among many: sampled regularly, a sensor of that resolution would repeat itself."""
    known = values[np.isfinite(values)]
    if known.size < _FEWEST_CHANGES:
        return False
    most = _DIFFERENT * known.size
    beginning = known[: int(_SORTED_SHARE * known.size)]
    return bool(np.unique(beginning).size <= most and np.unique(known).size <= most)


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
    """Values (N,) at times (N,), linear between samples (T,); NaN within gaps, before the first and after the last."""
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


YEAR_S = 365.25 * DAY_S
#: Longest plausible log.
LONGEST_S = 50.0 * YEAR_S
#: Longest plausible time for the largest current to flow one way: it would move a thousandth of the capacity an hour,
#: slower than any test or robot, but typical of milliseconds read as seconds.
LONGEST_FLOW_H = 1000.0
#: The same if the unit of the time is a guess: tests of the open-circuit voltage take 50 h.
LONGEST_FLOW_GUESSED_H = 60.0
#: Shortest plausible sampling interval of batteries and of drives if the unit of the time is a guess: hours and minutes
#: read as seconds are shorter.
SHORTEST_INTERVAL_S, SHORTEST_DRIVE_S = 1e-3, 5e-4
#: Intervals of times in minutes and in hours that are read as seconds: 1, 5 and 10 s are 1/60 to 1/6 of a minute, and
#: 5 s to a minute are 1/720 to 1/60 of an hour. As sampling rates these are not round numbers; 30 and 120 Hz are left
#: out because cameras use them.
_IN_MINUTES_S = (1 / 720, 1 / 360, 1 / 180, 1 / 60, 1 / 12, 1 / 6)
_ALIKE = 0.004
#: The same of drives: 10, 20 and 50 Hz.
_DRIVES_IN_MINUTES_S = (1 / 600, 1 / 1200, 1 / 3000)
#: From this interval on people choose multiples of half a minute; other intervals are milliseconds or microseconds.
CHOSEN_FROM_S, HALF_MINUTE_S = 90.0, 30.0
#: Longest sampling interval of wheels: slower sampling shows no slip.
SLOWEST_DRIVE_S = 5.0
#: From this interval on a guessed unit is worth a warning: 20 ms read as 20 s look like a slow logger.
DOUBTFUL_FROM_S = 10.0
#: Largest deviation from a multiple of half a minute, in half minutes: loggers are a little late.
_JITTER = 0.1
_UNITS = ("ms", "us", "ns", "min", "h", "d")


def require_plausible(
    source: str, time: Column, time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray, guessed: bool
) -> tuple[Note, ...]:
    """Refuse an impossible duration, interval or charge; warn of seconds where milliseconds are likelier.

    time: its column.  time_s: (T,) [s], increasing.  current_A, voltage_V: (T,), nan where not known.
    guessed: the unit of the time is a guess.
    """
    if time_s.size < 2:
        return ()
    interval, duration = usual_interval_s(time_s), float(time_s[-1] - time_s[0])
    likely = _likely_unit(interval)
    option = ("--unit", f"time={likely}")
    advice, what = _advice(likely), f"{source}: column {time.name!r}"
    if duration > LONGEST_S:
        raise InputError(f"{what} gives a log of {duration / YEAR_S:,.0f} years; {advice}", option)
    if guessed and not _is_interval(interval):
        text = f"{what}, which names no unit, gives a sample every {interval:.3g} s; {advice}"
        raise InputError(text, option)
    most_h = LONGEST_FLOW_GUESSED_H if guessed else LONGEST_FLOW_H
    longest_h = _flow_h(np.diff(time_s), current_A) if duration > most_h * SECONDS_PER_HOUR else 0.0
    if longest_h > most_h:
        largest = float(np.nanmax(np.abs(current_A)))
        text = (
            f"{what} gives a charge of {longest_h * largest:,.4g} Ah one way at {largest:.4g} A at most, "
            f"{longest_h:,.0f} h of it; {advice}"
        )
        raise InputError(text, option)
    if interval < DOUBTFUL_FROM_S or not (guessed or time.unit is UNITS["s"]):
        return ()
    if guessed:
        why = f"names no unit; as seconds it gives one sample every {interval:.3g} s"
    elif impossible := charge_of_no_battery(time_s, current_A, voltage_V):
        why = f"in s gives {impossible}"
    else:
        return ()
    text = f"column {time.name!r} {why}: if these are {likely}, say {' '.join(option)}"
    return (Note(text, "warning", option),)


def require_voltage(table: Table, voltage: Column, current: Column) -> None:
    """Refuse a voltage that is usually more than that of any battery, with the options that give its unit.

    table: with the columns of voltage [V] and current [A].
    """
    voltage_V = table.columns[voltage.name]
    known = np.abs(voltage_V[np.isfinite(voltage_V)])
    highest_V = QUANTITIES["battery_voltage_V"].limits.highest
    if known.max(initial=0.0) <= highest_V or (usual_V := float(np.median(known))) <= highest_V:
        return
    unit = UNITS["mv" if usual_V <= highest_V / UNITS["mv"].scale else "uv"]
    units = {"voltage": unit.symbol}
    other = not_in_amperes(table.columns[current.name], unit.in_si(voltage_V)) if current.unit is None else None
    if other and other.scale:
        units["current"] = other.scale.symbol
    options = [word for quantity, symbol in units.items() for word in ("--unit", f"{quantity}={symbol}")]
    raise InputError(
        f"{table.source}: column {voltage.name!r} is usually {usual_V:.5g} V, more than the {highest_V:g} V of any "
        f"battery; say its unit with {' '.join(options)} (units={units}), or, if it is right, voltage=V",
        options,
    )


def require_plausible_drive(source: str, time: Column, time_s: np.ndarray, guessed: bool) -> None:
    """Refuse a drive with an implausible interval if the unit of its time is a guess; see `require_plausible`."""
    interval = usual_interval_s(time_s) if guessed and time_s.size > 1 else SLOWEST_DRIVE_S
    in_minutes = any(abs(interval - other) < _ALIKE * other for other in _DRIVES_IN_MINUTES_S)
    if in_minutes or not SHORTEST_DRIVE_S <= interval <= SLOWEST_DRIVE_S:
        raise InputError(
            f"{source}: column {time.name!r}, which names no unit, gives a drive with a sample every {interval:.3g} s; "
            f"{_advice(_likely_unit(interval, min(_DRIVES_IN_MINUTES_S) / 2))}"
        )


def _likely_unit(interval_s: float, shortest_s: float = SHORTEST_INTERVAL_S) -> str:
    """The likeliest unit of a time with this interval if read as seconds: the first that gives a usual one."""
    if interval_s <= 1.0:
        return "min" if interval_s >= shortest_s else "h"
    return next((unit for unit in ("ms", "us") if _is_interval(UNITS[unit].scale * interval_s)), "ns")


def _advice(first: str) -> str:
    """Advice to give the unit of a time, the likeliest one first."""
    others = ", ".join(unit for unit in _UNITS if unit != first)
    return f"say its unit with --unit time={first} (units={{'time': '{first}'}}), {others}, or, if it is right, time=s"


def _is_interval(seconds: float) -> bool:
    """True for a sampling interval [s] that people would choose for a logger."""
    if seconds < CHOSEN_FROM_S:
        in_minutes = any(abs(seconds - other) < _ALIKE * other for other in _IN_MINUTES_S)
        return seconds >= SHORTEST_INTERVAL_S and not in_minutes
    return seconds <= SECONDS_PER_HOUR and abs(seconds / HALF_MINUTE_S - round(seconds / HALF_MINUTE_S)) < _JITTER


def _flow_h(steps: np.ndarray, current_A: np.ndarray) -> float:
    """Range of the charge divided by the largest current [h]."""
    known = np.nan_to_num(current_A)
    largest = float(np.abs(known).max())
    if largest == 0.0:
        return 0.0
    charge = np.concatenate([[0.0], np.cumsum(known[1:] * steps)])
    return float(np.ptp(charge)) / largest / SECONDS_PER_HOUR
