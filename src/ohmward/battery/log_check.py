"""Check that a log can be of the battery that it is estimated with, and under conditions that its tests cover.

The number of cells in series follows from the shape of the voltage. With N cells the mean voltage of one is

    v / N = OCV(soc_0 + q / Q) + R_0 i + R_1 i_slow,

with q the charge counted in the log; a wrong N puts it on a part of the curve whose shape does not match that charge.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import chemistry
from ohmward.battery.models.temperature import ROOM_DEGC, coldness_per_K
from ohmward.battery.soc.anchor_rule import REST_C
from ohmward.battery.soc.clean_sample import CURRENT_GAP_S, WEATHER_STD_K, sample_limits
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.logs.log import SECONDS_PER_HOUR, Log, Note, Progress, ReadOptions, TableFile, UnknownSignError
from ohmward.runs import long_runs, where_known, window_starts
from ohmward.signals.current_sign import CurrentSign
from ohmward.signals.current_size import HIDDEN_CHARGE, RELAXED_S
from ohmward.signals.survey import running_median

#: Share by which voltages lie outside the range of the tests behind a battery file: usual ones of another battery,
OTHER_BATTERY = 0.2
#: and single ones that are worth a warning.
BEYOND_TESTS = 0.02
#: No battery carries this current, in multiples of the capacity per hour, for a hundredth of a log.
_IMPOSSIBLE_C, _USUALLY_BELOW = 100.0, 0.99
#: A charger holds a battery above its open-circuit voltage, but not by this share for most of a log.
ABOVE_FULL = 0.1
#: A load pulls a battery below its open-circuit voltage. More than this share above that of a full battery it gives
#: less than this share of its capacity under a load of this many capacities per hour; fewest samples.
_ABOVE_UNDER_LOAD, _AFTER_CHARGE, _UNDER_LOAD_C, _FEWEST_LOADED = 0.03, 0.05, 0.05, 30
#: Relative standard deviation of the resistance at a temperature of the log above which a warning is given.
DOUBTFUL_RESISTANCE = 0.1

#: Numbers of cells tried besides the file's: up to this many more and fewer.
_CELLS_APART = 2
#: Another number of cells explains a log better where the voltage error of a cell with the file's number is larger than
#: this [V], and than this multiple of the error with the other number. With correct files on measured cells, cold and
#: aged ones included, it is at most 1.6 times as large.
_CELL_ERROR_V, _TIMES_BETTER = 0.03, 2.5
#: Another capacity, relative to the file's, explains a log better where the best of those near the file's leaves an
#: error of a cell larger than this [V], than this share of the error of the file's curve, whose level and slope the fit
#: takes up, and than this multiple of the error with the other one, over windows that move this share of the capacity.
#: With right files it is at most 1.3 times as large, on batteries aged to 80 % as well.
_AGED, _OTHERS = (1.0, 0.85, 1.15), (0.5, 0.58, 0.67, 0.75, 1.32, 1.5, 1.75, 2.0)
_WELL_V, _OF_CURVE, _BETTER_CAPACITY, _SHOWS_CAPACITY = 0.005, 0.25, 1.5, 0.2
#: One sign of the current explains a log better where the error with the other one is this many times larger, and
#: larger than this [V].
_TIMES_WORSE, _WRONG_V = 2.0, 0.003
#: A log is explained in windows: their longest length [s] and largest number; the largest charge that the offset of the
#: current sensor moves in one, over the capacity; multiples of that offset, and capacities over the file's, that are
#: tried.
_LONGEST_WINDOW_S, _MOST_WINDOWS = 6 * SECONDS_PER_HOUR, 12
_OFFSET_CHARGE, _OFFSETS, _CAPACITIES = 0.15, (0.0, -0.5, 0.5, -1.0, 1.0), (1.0, 0.85, 1.15, 0.75, 1.3, 0.67)
#: Rows of a window and samples in one, fewest rows, starting SoCs that are tried, and share of the rows that are free
#: of spikes.
_WINDOW_ROWS, _ROW_SAMPLES, _FEWEST_WINDOW_ROWS, _STARTS, _WITHOUT_SPIKES = 60, 15, 30, 30, 0.95
#: Resistances r times the file's weigh as much as an error of the cell voltage of r times this [V]: without a prior a
#: steady current would explain any number of cells.
_PER_RATIO_V = 0.003
#: Time constant of the slow part of the overpotential [s].
_SLOW_S = 1000.0

#: A battery that delivers less than this current, in multiples of the capacity per hour, is idle; one noisy sample does
#: not end a rest. After `RELAXED_S` its voltage has relaxed to within a few millivolts. Self-discharge, idle current
#: and late relaxation then move it by no more than this voltage a cell, this state of charge by the curve, and this
#: state of charge more with every hour.
_IDLE_LOAD_C = 0.1
_HIDDEN_V, _HIDDEN_SOC, _HIDDEN_SOC_PER_HOUR = 0.05, 0.1, 0.02
#: A change of an idle current moves the voltage through at most this multiple of the file's steady-state resistance.
_IDLE_RESISTANCE = 2.0
#: Samples of a median.
MEDIAN_OF = 5

#: Advice where a battery file does not explain a log.
OTHER_FILE = (
    "are the given chemistry, capacity and n_series those of this battery, and are sign and unit of the current right?"
)


def check_log(log: Log, battery: Battery) -> Log:
    """The log, with a warning where its voltage leaves the range of the battery's tests by more than 2 %.

    Likewise where the resistance at its temperatures is uncertain.

    Raises:
        InputError: see `require_log_of`.
    """
    require_log_of(log, battery)
    log = _check_temperature(log, battery)
    low_V, high_V = battery.voltage_min_V, battery.voltage_max_V
    outside = (log.voltage_V < (1 - BEYOND_TESTS) * low_V) | (log.voltage_V > (1 + BEYOND_TESTS) * high_V)
    if not outside.any():
        return log
    text = f"{outside.mean():.2%} of the voltages lie outside the battery's tests, {low_V:g} to {high_V:g} V"
    return log.with_notes(Note(text, "warning"))


def require_log_of(log: Log, battery: Battery) -> None:
    """Raise InputError for a log that cannot be of this battery: another battery, or another unit.

    Its median voltage is more than 20 % outside the tests, or no battery of this capacity carries its current.
    """
    limit_A = _IMPOSSIBLE_C * battery.capacity_Ah
    (current_A,) = where_known(log.current_A)
    most_A = float(np.abs(current_A).max(initial=0.0))
    if most_A > limit_A:
        most_A = float(np.quantile(np.abs(current_A), _USUALLY_BELOW))
    if most_A > limit_A:
        raise InputError(
            f"{log.name}: its current reaches {most_A:.4g} A, {most_A / battery.capacity_Ah:.0f} times the capacity of "
            f"battery {battery.name!r}, {battery.capacity_Ah:g} Ah, an hour; is it a log of another battery, or in "
            "another unit (--unit current=mA, units={'current': 'mA'})?"
        )
    low_V, high_V = battery.voltage_min_V, battery.voltage_max_V
    if not _is_usually_within(log.voltage_V, (1 - OTHER_BATTERY) * low_V, (1 + OTHER_BATTERY) * high_V):
        raise InputError(
            f"{log.name}: its voltage is usually {np.nanmedian(log.voltage_V):.4g} V, but battery {battery.name!r} was "
            f"seen between {low_V:g} and {high_V:g} V; is it a log of another battery, of one of its cells, or in "
            "another unit (--unit voltage=mV, units={'voltage': 'mV'})?"
        )


def other_cells(log: Log, battery: Battery) -> str:
    """Contradiction of the level or the shape of the voltage with the file's number of cells; "" for none."""
    own, curve_V = int(battery.n_series), battery.thevenin.ocv.voltage_V
    if not _is_usually_within(log.voltage_V, curve_V[0], (1 + ABOVE_FULL) * curve_V[-1]):
        return (
            f"its usual voltage, {np.nanmedian(log.voltage_V):.4g} V, contradicts the battery file, {curve_V[0]:.4g} V "
            f"(empty) to {curve_V[-1]:.4g} V (full) with n_series = {own}: another number of cells in series?"
        )
    windows = _windows(log, battery) if own > 1 else []
    if not windows or cell_error_V(windows, battery, own, _CELL_ERROR_V) <= _CELL_ERROR_V:
        return ""
    tried = range(max(own - _CELLS_APART, 1), own + _CELLS_APART + 1)
    error_V = {cells: cell_error_V(windows, battery, cells) for cells in tried}
    best = min(error_V, key=lambda cells: error_V[cells])
    if error_V[own] < _TIMES_BETTER * error_V[best]:
        return ""
    number = f"{best} cells" if best > 1 else "1 cell"
    return (
        f"{number} in series explain its voltage better than {own}, the n_series of the battery file: "
        f"{1e3 * error_V[best]:.0f} against {1e3 * error_V[own]:.0f} mV RMS a cell; correct n_series?"
    )


def other_capacity(log: Log, battery: Battery) -> str:
    """Contradiction of the counted charge with the capacity of the battery file, also of an aged one; "" for none.

    The voltage shows how far along the curve the charge has moved the battery.
    """
    cells = int(battery.n_series)
    enough_V = max(_WELL_V, _OF_CURVE * float(np.median(battery.noise.model_std_V)) / cells)
    windows = [rows for rows in _windows(log, battery) if np.ptp(rows.charge) > _SHOWS_CAPACITY]
    if not windows or (own_V := cell_error_V(windows, battery, cells, enough_V, capacities=_AGED)) <= enough_V:
        return ""
    error_V = {other: cell_error_V(windows, battery, cells, capacities=(other,)) for other in _OTHERS}
    best = min(error_V, key=lambda other: error_V[other])
    if own_V < _BETTER_CAPACITY * error_V[best]:
        return ""
    return (
        f"{best:g} times the file's capacity explains its voltage better than that, or than that of an aged battery: "
        f"{1e3 * error_V[best]:.0f} against {1e3 * own_V:.0f} mV RMS a cell; is the capacity that of this battery?"
    )


def _is_usually_within(values: np.ndarray, low: float, high: float) -> bool:
    """True where the median of the values (T,) lies within the limits, as it does if all or none do; nan left out."""
    none_known = np.isnan(least := np.fmin.reduce(values))
    all_within = low <= least and np.fmax.reduce(values) <= high
    return bool(none_known or all_within or low <= np.nanmedian(values) <= high)


class _WindowMeans(NamedTuple):
    """Means over the parts of a window, (T,) each."""

    charge: np.ndarray  #: counted since the start of the window, as a share of the capacity
    offset_charge: np.ndarray  #: (O, T) the same for the offsets that are tried
    voltage_V: np.ndarray  #: of the battery
    overpotentials: np.ndarray  #: (T, 2) fast and slow overpotential of a cell by the file's resistances [V]


def sign_by_model(log: Log, battery: Battery) -> CurrentSign | None:
    """Effect of a positive current in a log of unknown sign, by the curve and the resistances of the battery file.

    None where both signs explain the voltage about as well, or neither does.
    """
    error_V: dict[CurrentSign, float] = {}
    signs: tuple[CurrentSign, CurrentSign] = ("charge", "discharge")
    for sign, factor in zip(signs, (1.0, -1.0), strict=True):
        signed = Log(log.name, log.time_s, factor * log.current_A, log.voltage_V)
        if not (windows := _windows(signed, battery)):
            return None
        error_V[sign] = cell_error_V(windows, battery, int(battery.n_series), resistance_ratio=1.0)
    likely: CurrentSign = min(error_V, key=lambda sign: error_V[sign])
    least_V, other_V = sorted(error_V.values())
    return likely if least_V < _CELL_ERROR_V and other_V > max(_TIMES_WORSE * least_V, _WRONG_V) else None


def read_log_of(
    battery: Battery | None,
    text: str,
    reading: ReadOptions,
    extra: Collection[str] | None = None,
    progress: Progress | None = None,
    file: TableFile | None = None,
) -> Log:
    """Read the log of a battery by `ReadOptions.read`; if its data do not show the sign, the battery file does.

    Other logs never do: a log has the same current whatever is read with it.

    battery: of the log; None if it is not known.

    Raises:
        UnknownSignError: neither shows the sign.
        InputError, OhmwardError: as in `ReadOptions.read`.
    """
    try:
        return reading.read(text, extra, progress, file)
    except UnknownSignError as error:
        if error.is_lost or battery is None:
            raise
        log = replace(reading, current_sign="charge").read(text, extra, progress, file)
        sign = sign_by_model(log, battery)
        if sign is None:
            raise
        by = "according to the battery file: the other sign explains the voltage worse"
        note = Note(f"positive current {sign}s the battery, {by}; its own data do not show it")
        notes = tuple(note for note in log.notes if not note.text.startswith("positive current "))
        return replace(log, current_A=log.current_A if sign == "charge" else 0.0 - log.current_A, notes=(*notes, note))


def cell_error_V(
    windows: Sequence[_WindowMeans],
    battery: Battery,
    cells: int,
    enough_V: float = 0.0,
    resistance_ratio: float = 0.0,
    capacities: Sequence[float] = _CAPACITIES,
) -> float:
    """RMS error [V] of the mean cell voltage with this number of cells of the file, each window at its best start.

    enough_V: error at which a search ends.  resistance_ratio: prior mean of the resistances over the file's.
    capacities: over the file's, of which the best is taken in each window.
    """
    curve_V, squares_V2 = np.asarray(battery.thevenin.ocv.voltage_V) / battery.n_series, []
    for rows in windows:
        grid, least_V2 = np.linspace(0.0, 1.0, curve_V.size), np.inf
        least_rows = max(int(_WITHOUT_SPIKES * rows.charge.size), 1)
        C = rows.overpotentials
        by_file_V = resistance_ratio * C.mean(axis=1)  # half of the resistance to a steady current at once, half slowly
        to_ratios = C @ np.linalg.inv(C.T @ C + rows.charge.size * _PER_RATIO_V**2 * np.eye(2))
        for capacity, offset_charge in product(capacities, rows.offset_charge):
            moved = rows.charge / capacity - offset_charge
            room = 1.0 - np.ptp(moved)
            first = -moved.min() + (np.linspace(0.0, room, _STARTS) if room > 0.0 else np.array([0.5 * room]))
            left_V = rows.voltage_V / cells - np.interp(first[:, None] + moved, grid, curve_V) - by_file_V
            ratios = left_V @ to_ratios
            left_V -= ratios @ C.T
            all_V2 = np.sort(left_V**2, axis=1)[:, :least_rows].mean(axis=1) + _PER_RATIO_V**2 * (ratios**2).sum(axis=1)
            least_V2 = min(least_V2, float(all_V2.min()))
            if least_V2 <= enough_V**2:
                break
        squares_V2.append(least_V2)
    return float(np.sqrt(np.average(squares_V2, weights=[rows.voltage_V.size for rows in windows])))


def _windows(log: Log, battery: Battery) -> list[_WindowMeans]:
    """Windows of the log without gaps, spread over it, of the samples with a credible current and voltage."""
    limits = sample_limits(battery.thevenin)
    credible = limits.is_current(log.current_A) & limits.is_voltage(log.voltage_V)
    credible &= log.voltage_V < limits.highest_ocv_V  # a charger holds its voltage above, whatever the charge
    known = np.flatnonzero(credible)
    if known.size < _FEWEST_WINDOW_ROWS:
        return []
    time_s = log.time_s[known]
    after_gaps = 1 + np.flatnonzero(np.diff(time_s) > CURRENT_GAP_S)
    starts = window_starts(time_s, _LONGEST_WINDOW_S, time_s[0])
    edges = np.unique(np.concatenate([starts, after_gaps, [known.size]]))
    long = np.flatnonzero(np.diff(edges) >= _FEWEST_WINDOW_ROWS)
    chosen = long[np.unique(np.linspace(0, long.size - 1, min(_MOST_WINDOWS, long.size)).astype(int))]
    samples = (known[edges[k] : edges[k + 1]] for k in chosen)
    windows = (Log(log.name, log.time_s[at], log.current_A[at], log.voltage_V[at]) for at in samples)
    return [rows for window in windows if (rows := _rows(window, battery))]


def _rows(window: Log, battery: Battery) -> _WindowMeans | None:
    """Means over the parts of a window; None where they are too few or no charge flows in it."""
    counted_Ah = window.charge_Ah()
    some = slice(None, None, max(len(window) // (_WINDOW_ROWS * _ROW_SAMPLES), 1))
    time_s, current_A = window.time_s[some], window.current_A[some]
    voltage_V = running_median(window.voltage_V[some], MEDIAN_OF)
    duration_s = float(time_s[-1] - time_s[0])
    if duration_s <= 0.0:
        return None
    part = np.minimum((_WINDOW_ROWS * (time_s - time_s[0]) / duration_s).astype(int), _WINDOW_ROWS - 1)
    count = np.bincount(part, minlength=_WINDOW_ROWS)
    if np.count_nonzero(count) < _FEWEST_WINDOW_ROWS:
        return None

    def means(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.bincount(part, weights=values, minlength=_WINDOW_ROWS)[count > 0] / count[count > 0])

    hours = means(time_s - time_s[0]) / SECONDS_PER_HOUR
    most_A = min(battery.sensor.offset_std_A, _OFFSET_CHARGE * battery.capacity_Ah * SECONDS_PER_HOUR / duration_s)
    offsets_A = most_A * np.array(_OFFSETS)
    current = means(current_A)
    slow, decays = current.copy(), np.exp(-np.diff(hours) * SECONDS_PER_HOUR / _SLOW_S)
    for k, decay in enumerate(decays):
        slow[k + 1] = decay * slow[k] + (1 - decay) * current[k + 1]
    overpotentials_V = _steady_ohm(battery) / battery.n_series * np.column_stack([current, slow])
    charge = means(counted_Ah[some]) / battery.capacity_Ah
    return _WindowMeans(charge, np.outer(offsets_A, hours) / battery.capacity_Ah, means(voltage_V), overpotentials_V)


def contradictions(log: Log, battery: Battery, of_capacity: bool = True) -> tuple[str, ...]:
    """Contradictions of the log itself with the battery file, a sentence each; of_capacity: with its capacity too."""
    found = [other_cells(log, battery), full_under_load(log, battery), unmeasured_charge(log, battery)]
    if of_capacity:
        found.append(other_capacity(log, battery))
    return tuple(text for text in found if text)


def full_under_load(log: Log, battery: Battery) -> str:
    """Contradiction of the voltage under load with the curve of the battery file; "" for none."""
    limits, full_V = sample_limits(battery.thevenin), float(battery.thevenin.ocv.voltage_V[-1])
    if battery.chemistry:  # a charger of the file may have stopped below the others
        full_V = max(full_V, battery.n_series * chemistry(battery.chemistry).ocv_V[-1])
    loaded = limits.is_current(log.current_A) & (log.current_A < -_UNDER_LOAD_C * battery.capacity_Ah)
    above = loaded & limits.is_voltage(log.voltage_V) & (log.voltage_V > (1.0 + _ABOVE_UNDER_LOAD) * full_V)
    lasts_s = np.minimum(np.diff(log.time_s, append=log.time_s[-1]), CURRENT_GAP_S)
    given_As = -float(log.current_A[above] @ lasts_s[above])
    if np.count_nonzero(above) < _FEWEST_LOADED or given_As < _AFTER_CHARGE * battery.capacity_Ah * SECONDS_PER_HOUR:
        return ""
    return (
        f"under load its voltage is up to {np.quantile(log.voltage_V[above], 0.99):.4g} V, above the {full_V:.4g} V "
        "of a full battery at rest by the file: another chemistry, or another number of cells in series?"
    )


def with_contradictions(log: Log, battery: Battery) -> Log:
    """The log with a warning of each contradiction with the battery file."""
    return log.with_notes(*(Note(text, "warning") for text in contradictions(log, battery)))


def unmeasured_charge(log: Log, battery: Battery) -> str:
    """Contradiction of the voltage with a current that shows rest or discharge; "" for none."""
    if not (hidden := hidden_charges(log, battery)):
        return ""
    first, stop = hidden[0]
    start_h, hours = log.time_s[first] / SECONDS_PER_HOUR, (log.time_s[stop - 1] - log.time_s[first]) / SECONDS_PER_HOUR
    return f"in the {hours:.2g} h from {start_h:.2g} h on the current sensor {HIDDEN_CHARGE}"


def moving_rests(log: Log, battery: Battery) -> list[tuple[int, int]]:
    """First and end index of rests in which the voltage moves further than a resting battery's does."""
    at_rest = np.abs(log.current_A - battery.sensor.offset_A) < REST_C * battery.capacity_Ah
    found = []
    for run, late in _relaxed(log, battery, at_rest):
        smooth_V = medians(log.voltage_V[late])
        if _is_far(smooth_V.min(), smooth_V.max(), 0.0, log, late, battery):
            found.append(run)
    return found


def hidden_charges(log: Log, battery: Battery) -> list[tuple[int, int]]:
    """First and end index of stretches without a charging current in which the voltage rises as in a charge.

    That is, by more than relaxation and changes of the idle current explain.
    """
    excess_A = log.current_A - battery.sensor.offset_A
    idle = (excess_A < REST_C * battery.capacity_Ah) & (excess_A > -_IDLE_LOAD_C * battery.capacity_Ah)
    found = []
    for run, late in _relaxed(log, battery, idle):
        smooth_V = medians(log.voltage_V[late])
        lowest_V = np.minimum.accumulate(smooth_V)
        top = int(np.argmax(smooth_V - lowest_V))
        change_A = float(np.ptp(medians(np.nan_to_num(log.current_A[late]))))
        by_current_V = _IDLE_RESISTANCE * _steady_ohm(battery) * change_A
        if _is_far(lowest_V[top], smooth_V[top], by_current_V, log, late, battery):
            found.append(run)
    return found


def _relaxed(log: Log, battery: Battery, condition: np.ndarray) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
    """First and end index of the runs of a condition that are long enough, without gaps of the log in them.

    With each come the indices of its samples with a voltage after relaxation. Single noisy samples do not end a run.
    """
    ended = ~condition & np.isfinite(log.current_A)
    alone = ended & ~np.append(False, ended[:-1]) & ~np.append(ended[1:], False)
    gaps = 1 + np.flatnonzero(np.diff(log.time_s) > CURRENT_GAP_S)
    for begin, end in long_runs(condition | alone, log.time_s, 2 * RELAXED_S):
        for first, stop in pairwise((begin, *gaps[(gaps > begin) & (gaps < end)].tolist(), end)):
            since_s = log.time_s[first:stop] - log.time_s[first]
            late = first + np.flatnonzero((since_s > RELAXED_S) & np.isfinite(log.voltage_V[first:stop]))
            if since_s[-1] > 2 * RELAXED_S and late.size >= 2 * MEDIAN_OF:
                yield (first, stop), late


def _steady_ohm(battery: Battery) -> float:
    """Resistance [ohm] of the file to a steady current, at its temperature."""
    model = battery.thevenin
    return float(np.median(model.r0_discharge_ohm) + np.sum([np.median(r) for r in model.r_ohm]))


def _is_far(low_V: float, high_V: float, by_current_V: float, log: Log, late: np.ndarray, battery: Battery) -> bool:
    """True where two voltages are further apart than relaxation, self-discharge and by_current_V [V] explain."""
    curve_V = battery.thevenin.ocv.voltage_V
    low_soc, high_soc = np.interp([low_V, high_V - by_current_V], curve_V, np.linspace(0.0, 1.0, len(curve_V)))
    hours = (log.time_s[late[-1]] - log.time_s[late[0]] + RELAXED_S) / SECONDS_PER_HOUR
    moved_soc = high_soc - low_soc - _HIDDEN_SOC_PER_HOUR * hours
    return bool(high_V - low_V - by_current_V > _HIDDEN_V * battery.n_series and moved_soc > _HIDDEN_SOC)


def medians(values: np.ndarray) -> np.ndarray:
    """Medians of `MEDIAN_OF` neighbours, which a spike does not move."""
    count = values.size // MEDIAN_OF
    return np.median(values[: count * MEDIAN_OF].reshape(count, MEDIAN_OF), axis=1)


def _check_temperature(log: Log, battery: Battery) -> Log:
    """The log, with a warning where the resistance at its temperatures is uncertain, and a note where it has none."""
    if log.temperature_degC is None or not np.isfinite(log.temperature_degC).any():
        text = (
            f"no temperature: the battery is taken to be at {ROOM_DEGC:g} ± {WEATHER_STD_K:g} degC (one standard "
            "deviation), which widens the band; where you know it, give it with --temperature 5 "
            "(FileHints(temperature_degC=5))"
        )
        return log.with_notes(Note(text))
    degC, reference_degC = log.temperature_degC, battery.thevenin.reference_degC
    spread = battery.noise.activation_std_K * np.abs(coldness_per_K(degC, reference_degC))
    worst = int(np.nanargmax(spread))
    if spread[worst] < DOUBTFUL_RESISTANCE:
        return log
    text = (
        f"the log goes to {degC[worst]:z.0f} degC, where the resistance follows from {reference_degC:z.0f} degC within "
        f"± {BAND_95 * spread[worst]:.0%} only (95 %); the band is wider there"
    )
    return log.with_notes(Note(text, "warning"))
