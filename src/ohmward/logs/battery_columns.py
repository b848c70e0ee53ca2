"""Further columns of a battery: cells, a current for each direction, power, mode, full charge, serial number.

`columns` and `units` of the functions `with_...` are those that the caller named.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.channels import CURRENT, IN, OUT, VOLTAGE, Channel, letters, word_set
from ohmward.logs.columns import Column, find_column, find_columns, has_input_voltage
from ohmward.logs.table import Note, Progress, Table, TableFile, counted, numbers
from ohmward.logs.units import UNITS, Unit, split_unit, unit_in_name
from ohmward.quantities import words_of
from ohmward.runs import repeats, runs, where_known
from ohmward.signals.checks import stuck
from ohmward.signals.current_sign import edge_test
from ohmward.signals.survey import resolution

#: Largest relative difference between the sum of the cells and the voltage of the pack: they are measured by different
#: converters, and the wires between them drop a few millivolts a cell.
SUM_TOLERANCE = 0.01
#: A cell is stuck where its value stays the same over so many changes of the typical cell, and over so many scans of a
#: monitor that reads one cell after the other, ...
_STUCK_CHANGES, _STUCK_SCANS = 20, 3
#: ... if these take the typical cell farther than so many of its own steps.
_STUCK_STEPS = 10.0
#: Cells without a unit in their names are in mV where they show more than this: no cell has 100 V.
_LARGEST_CELL_V = 100.0
_CELL = word_set("zelle zell cellule celda cella célula ячейка ячейки 单体 电芯 セル 셀")
_OTHER_THAN_VOLTAGE = word_set(
    "temperature temp t current i soc charge resistance ohm balance balancing capacity soh fault flag status std sigma"
)


class CellVoltages(NamedTuple):
    """Voltages of the cells of a pack."""

    names: tuple[str, ...]  #: (n,) of the columns, in the order of their numbers
    voltage_V: np.ndarray  #: (T, n); nan where one was not measured


def find_cells(
    columns: Mapping[str, np.ndarray], pack_V: np.ndarray, n_series: int
) -> tuple[CellVoltages | None, tuple[Note, ...]]:
    """The cell voltages among columns, or None; notes on what was used or did not fit.

    columns: name -> (T,), in the units of the file: the `extra` of a log.
    pack_V: (T,) of the pack [V].
    n_series: cells of the pack in series.
    """
    if n_series < 2:
        return None, ()
    notes = []
    for row in sorted(numbered_rows(columns), key=lambda row: not is_named(row)):
        if len(row) != n_series:
            if is_named(row):
                text = (
                    f"{len(row)} cell voltages, {row[0]!r} to {row[-1]!r}, but the battery file has n_series = "
                    f"{n_series}: they are not used"
                )
                notes.append(Note(text, "warning"))
            continue
        table = np.stack([columns[name] for name in row], axis=1)
        cells_V = _unit_of(row, table).in_si(table)
        error = np.abs(cells_V.sum(axis=1) - pack_V) / np.abs(pack_V)
        error = error[np.isfinite(error)]
        if error.size and np.median(error) <= SUM_TOLERANCE:
            note = Note(f"cell voltages from {row[0]!r} to {row[-1]!r}; their sum is the pack's voltage")
            cells_V, stuck_notes = _without_stuck_cells(row, cells_V)
            return CellVoltages(row, cells_V), (note, *stuck_notes)
        if is_named(row) and error.size:
            text = (
                f"the sum of {row[0]!r} to {row[-1]!r} is usually {np.nanmedian(cells_V.sum(axis=1)):.4g} V, the "
                f"voltage of the pack {np.nanmedian(pack_V):.4g} V: they are not used as cell voltages"
            )
            notes.append(Note(text, "warning"))
    return None, tuple(notes)


def _without_stuck_cells(names: Sequence[str], cells_V: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The voltages (T, n) with nan where one repeats its value while the typical cell, which has its current, moves."""
    typical_V = np.full(len(cells_V), np.nan)
    known = np.isfinite(cells_V).any(axis=1)
    typical_V[known] = np.nanmedian(cells_V[known], axis=1)
    changes = np.cumsum(np.abs(np.diff(typical_V, prepend=np.nan)) > 0.0)
    left, notes = cells_V.copy(), []
    for k, name in enumerate(names):
        values_V = cells_V[:, k]
        step_V = resolution(values_V[np.isfinite(values_V)])
        stretches = [
            slice(first, stop)
            for first, stop in runs(repeats(values_V))
            if changes[stop - 1] - changes[first] >= max(_STUCK_CHANGES, _STUCK_SCANS * len(names))
            and np.ptp(typical_V[first:stop][known[first:stop]]) > _STUCK_STEPS * step_V
        ]
        for stretch in stretches:
            left[stretch, k] = np.nan
        if stretches:
            rows = counted(int(np.isnan(left[:, k]).sum() - np.isnan(values_V).sum()), "row")
            found = stuck(f"{name!r} is ", f" in {rows}", "the rest of the pack")
            notes.append(Note(f"{found}; its values there are left out", "warning"))
    return left, tuple(notes)


def cell_names(names: Collection[str]) -> tuple[str, ...]:
    """The columns that may be voltages of cells, by their names alone."""
    return tuple(name for row in numbered_rows(names) for name in row)


def numbered_rows(names: Collection[str]) -> list[tuple[str, ...]]:
    """Groups of two or more names of voltages that differ only in one number, which counts from 0 or 1."""
    rows: dict[str, dict[int, str]] = {}
    for name in filter(_may_be_voltage, names):
        for number in re.finditer(r"\d+", name):
            key = f"{name[: number.start()]}#{name[number.end() :]}"
            rows.setdefault(key, {})[int(number[0])] = name
    found = [
        tuple(row[k] for k in sorted(row))
        for row in rows.values()
        if len(row) > 1 and min(row) in (0, 1) and max(row) - min(row) + 1 == len(row)
    ]
    return sorted(found, key=len, reverse=True)


def is_named(row: Sequence[str]) -> bool:
    """True where the names say that these are cells."""
    return any(word.endswith(("cell", "cells")) or word in _CELL for word in letters(row[0]))


def with_pack_voltage(file: TableFile, columns: Mapping[str, str] | None = None) -> TableFile:
    """The file with the sum of its cell voltages as a column, where it has cells and no voltage of the pack."""
    all_rows = numbered_rows(file.names)
    rows = [row for row in all_rows if is_named(row)]
    # V1, V2, V3 and more, or U1 (V): voltages that have nothing but a number
    bare = [[set(letters(split_unit(name)[0][0])) <= {"v", "u"} for name in row] for row in all_rows]
    rows = rows or [row for row, is_bare in zip(all_rows, bare, strict=True) if len(row) > 2 and all(is_bare)]
    if not rows or "voltage" in (columns or {}) or _has(file, VOLTAGE, columns, cell_names(file.names)):
        return file
    row = rows[0]

    def total(table: Table) -> tuple[np.ndarray, Note]:
        cells = np.stack([numbers(table, cell) for cell in row], axis=1)
        note = Note(f"voltage of the pack: the sum of {row[0]!r} to {row[-1]!r}")
        return _unit_of(row, cells).in_si(cells.sum(axis=1)), note

    return file.with_column("pack voltage [V]", row, total)


def _may_be_voltage(name: str) -> bool:
    """True where neither unit nor words make it another quantity; a `[1]` counts cells and is no unit."""
    units = [unit for _, unit in split_unit(name) if unit is not None and unit.symbol != "1"]
    if units and not any(unit.dimension == "voltage" for unit in units):
        return False
    stem, _ = split_unit(name)[0]
    return not _OTHER_THAN_VOLTAGE & set(letters(stem))


def _unit_of(row: Sequence[str], cells: np.ndarray) -> Unit:
    """The unit in the names of cells; without one, the unit for which the numbers (T, n) are plausible."""
    is_milli = np.isfinite(cells).any() and np.nanmedian(cells) > _LARGEST_CELL_V
    return unit_in_name(row[0], ("voltage",)) or UNITS["mv" if is_milli else "v"]


#: Words that are a current of one direction by themselves.
_CHARGING_CURRENT, _DISCHARGING_CURRENT = word_set("ichg icharge"), word_set("idis idsg idischg idischarge")
_CHARGE_NOUNS = word_set(
    "charge charging charger chg chrg lade laden ladung carga carica ładowania заряда зарядки 充电 充電 충전"
)
_DISCHARGE_NOUNS = word_set(
    "discharge discharging dis dsg dchg dischg dischrg entlade entladen entladung décharge decharge descarga scarica "
    "rozładowania разряда разрядки 放电 放電 방전"
)
_CHARGE = IN | _CHARGING_CURRENT | _CHARGE_NOUNS
_DISCHARGE = OUT | _DISCHARGING_CURRENT | _DISCHARGE_NOUNS
#: What goes in and out may be the two sides of a converter, which flow at once: of a battery, both flow in fewer than
#: this share of the samples, the smaller one at more than this share of the usual size.
_MOST_AT_ONCE = 0.05
_FLOWS = 0.05
_POWER = word_set("power p leistung watts active vermogen 功率 電力 전력")
_POWERS = words_of(*_POWER)
_CURRENT, _POWER_COLUMN = "pack current", "battery power"
#: A current without a sign gets that of the power if the ratio of their sizes varies by less than this share, and if
#: this share of the samples, in which there is more than the last share of the largest current, flows each way.
_SAME_RATIO, _EACH_WAY, _FLOWING = 0.25, 0.01, 0.05


def with_both_ways(file: TableFile, columns: Mapping[str, str] | None = None) -> TableFile:
    """The file with the charging minus the discharging current, or power, as a column, if it has both and no current.

    The magnitude of each is used, whatever its sign: the column gives the direction. What flows in and out at once is
    refused where the columns are read: it may go through a converter.
    """
    for quantity, column, unit in (("current", _CURRENT, CURRENT.default), ("power", _POWER_COLUMN, UNITS["w"])):
        both = [_only([n for n in file.names if _is_one_way(n, way, unit)]) for way in (_CHARGE, _DISCHARGE)]
        names = [name for name in both if name is not None]
        if _are_for_in_and_out(names) and has_input_voltage(file.names):
            continue
        if len(names) == len(both) and not _has(file, CURRENT, columns, names):
            less = partial(_difference, quantity=quantity, names=names, default=unit)
            # without the unit in its name the size of the current is checked
            if all(unit_in_name(name, (unit.dimension,)) for name in names):
                column = f"{column} [{unit.symbol}]"
            return file.with_column(column, names, less)._replace(positive_current="charge")
    return file


def _difference(table: Table, quantity: str, names: Sequence[str], default: Unit) -> tuple[np.ndarray, Note]:
    """The size of the first column less that of the second, (T,) in SI; an empty cell is nothing that way."""
    units = [unit_in_name(name, (default.dimension,)) or default for name in names]
    sizes = np.stack([np.abs(unit.in_si(numbers(table, name))) for unit, name in zip(units, names, strict=True)])
    charge, discharge = np.nan_to_num(sizes)
    if _are_for_in_and_out(names):
        _check_one_way(charge, discharge, quantity, names)
    values = charge - discharge
    values[np.isnan(sizes).all(axis=0)] = np.nan
    return values, Note(f"{quantity}: {names[0]!r} less {names[1]!r}")


def _are_for_in_and_out(names: Sequence[str]) -> bool:
    """True where a column is named for what goes in or out, not for charge or discharge."""
    return any((IN | OUT) & set(letters(name)) for name in names)


def _check_one_way(charge: np.ndarray, discharge: np.ndarray, quantity: str, names: Sequence[str]) -> None:
    """Raise InputError if what goes in and out (T,) flows at once, as through a converter."""
    both = charge + discharge
    usual = np.median(both[both > 0.0]) if both.any() else 0.0
    at_once = np.mean(np.minimum(charge, discharge) > _FLOWS * usual)
    if at_once > _MOST_AT_ONCE:
        raise InputError(
            f"{names[0]!r} and {names[1]!r} flow at once in {at_once:.0%} of the rows: the two sides of a converter, "
            f"not charge and discharge of a battery; write a column with the battery's {quantity} and name it with "
            "--column current=NAME"
        )


def with_power(
    file: TableFile, columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None
) -> TableFile:
    """The file with power divided by voltage as a current column, if it has one battery power and no current."""
    power = power_column(file)
    if power is None or _has(file, CURRENT, columns):
        return file
    voltage = _has(file, VOLTAGE, columns, (), units)
    if voltage is None:
        return file

    unit = unit_in_name(power, ("power",))

    def over(table: Table) -> tuple[np.ndarray, Note]:
        power_W = (unit or UNITS["w"]).in_si(numbers(table, power))
        voltage_V = (voltage.unit or VOLTAGE.default).in_si(numbers(table, voltage.name))
        current_A = np.full(power_W.size, np.nan)
        np.divide(power_W, voltage_V, out=current_A, where=voltage_V > 0.0)
        return current_A, Note(f"current: {power!r} over {voltage.name!r}")

    return file.with_column(f"{_CURRENT} [A]" if unit else _CURRENT, (power, voltage.name), over)


def power_column(file: TableFile) -> str | None:
    """The only column of a battery power; None if there are none or several."""
    return _only(list(filter(_is_power, file.names)))


def with_derived(
    file: TableFile, columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None
) -> TableFile:
    """The file with a voltage of its cells, and a current of both directions or of a power, where it has no other."""
    return with_power(with_both_ways(with_pack_voltage(file, columns), columns), columns, units)


def has_log(names: Sequence[str]) -> bool:
    """True where the names are those of the log of a battery."""
    try:
        find_columns("", with_derived(TableFile("", tuple(filter(None, names)), _no_table)).names)
    except InputError:
        return False
    return True


def _no_table(names: Collection[str], progress: Progress | None = None) -> Table:
    raise NotImplementedError


def _has(
    file: TableFile,
    channel: Channel,
    columns: Mapping[str, str] | None,
    leave: Collection[str] = (),
    units: Mapping[str, str] | None = None,
) -> Column | None:
    """The column of a channel, if there is one, among all columns but those in `leave`."""
    of_channel = {quantity: unit for quantity, unit in (units or {}).items() if quantity == channel.name}
    return find_column(file.source, file.names, channel, file.given(columns), of_channel, leave, optional=True)


def _only(found: Sequence[str]) -> str | None:
    """The only column found; None if there are none or several."""
    return found[0] if len(found) == 1 else None


def _is_power(name: str) -> bool:
    """True where the name is that of a power of the battery; a bare letter needs its unit."""
    for stem, unit in split_unit(name):
        naming = set(letters(stem)) - CURRENT.beside[1]
        if naming and naming <= _POWER and ((unit is not None and unit.dimension == "power") or "p" not in naming):
            return unit is None or unit.dimension == "power"
    return False


def _is_one_way(name: str, direction: Collection[str], of: Unit) -> bool:
    """True where the name has a word of the direction and otherwise those of a battery's current or power."""
    naming = CURRENT.words if of is CURRENT.default else _POWERS
    alone = _CHARGING_CURRENT | _DISCHARGING_CURRENT if of is CURRENT.default else ()
    for stem, unit in split_unit(name):
        if unit is not None and unit.dimension != of.dimension:
            return False
        words = set(letters(stem))
        rest = frozenset(words - set(direction) - CURRENT.beside[1])
        is_named = rest in naming or (not rest and (unit is not None or not words.isdisjoint(alone)))
        if words & set(direction) and is_named:
            return True
    return False


#: Names of the column of a state.
_STATES = words_of("state", "status", "condition", "charge status", "power supply status", "mode", "step type", "md",
                   "step name", "work mode", "direction", "type", "phase", "operation", "modus", "zustand",
                   "betriebsart", "état", "etat", "estado", "modo", "stato", "状态", "режим")  # fmt: skip
#: Words in the name of a column that is 1 while the battery is charged, and the texts of its cells.
_CHARGING, _BESIDE_CHARGING = "charging", word_set("is charging battery batt status state flag")
#: Most numbers of states of which each may be that of a discharge; by how much fewer must agree better.
_MOST_STATES, _BETTER_BY = 6, 0.02
_FLAGS = {"1": 1, "1.0": 1, "true": 1, "0": -1, "0.0": -1, "false": -1}
_DISCHARGE_WORDS = re.compile(
    r"^d(?:\W|$)|dis|dch|dsg|dsch|entlad|ontlad|d[ée]char|descarg|scaric|放电|разряд", re.IGNORECASE
)
_CHARGE_WORDS = re.compile(r"^c(?:\W|$)|ch[aghr]|^cccv|^lad[eu]|carga|caric|充电|заряд", re.IGNORECASE)
#: At rest any small current discharges the battery.
_REST_WORDS = re.compile(r"^r(?:\W|$)|rest|idle|wait|pause|stand ?by|ruhe|repos|ripos|静置|搁置|покой", re.IGNORECASE)


def state_column(file: TableFile) -> str | None:
    """The column whose first cells name charge or discharge, or are flags of charging; else one of numbered states."""
    states = {name: cells for name, cells in file.head.items() if frozenset(letters(name)) in _STATES}
    flags = {name: cells for name, cells in file.head.items() if _is_charging_flag(name)}
    named = [name for name, cells in states.items() if any(map(_direction, cells))]
    named += [name for name, cells in flags.items() if cells and all(cell.strip().lower() in _FLAGS for cell in cells)]
    named += [name for name, cells in states.items() if all(cell.strip().isdecimal() for cell in cells)]
    return next(iter(named), None)


def with_sign(
    current_A: np.ndarray, table: Table, voltage_V: np.ndarray, state: str, power: str
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The current (T,) [A], negative where the state or the power says so, if it has no sign itself; and a note.

    state, power: names of their columns, "" for none; the power in any unit, as large as current times voltage (T,).
    """
    if np.nanmin(current_A, initial=0.0) < 0:
        return current_A, ()
    if state in table.columns and (negative := _discharged(table, state, current_A, voltage_V)).any():
        what = f"state in {state!r}, charge or discharge"
    elif power in table.columns and (negative := _against(numbers(table, power), current_A, voltage_V)).any():
        what = f"power in {power!r}"
    else:
        return current_A, ()
    note = Note(f"the current has no sign: it gets that of the {what}")
    return np.where(negative, 0.0 - current_A, current_A), (note,)


def _discharged(table: Table, name: str, current_A: np.ndarray, voltage_V: np.ndarray) -> np.ndarray:
    """Mask (T,) of the states in the column `name` that are a discharge.

    Numbers of states have no meaning of their own: the voltage shows which of them discharge, if both ways occur.
    """
    states, is_flag = table.columns[name], _is_charging_flag(name)
    if states.dtype != object and not is_flag:
        return np.isin(states, _numbers_of_discharge(*where_known(states, current_A, voltage_V)))
    direction = {state: _FLAGS.get(str(state).lower(), 0) if is_flag else _direction(state) for state in set(states)}
    return np.array([direction[state] < 0 for state in states])


def _numbers_of_discharge(states: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> Sequence[float]:
    """The numbers of states (T,) in which a current without a sign discharges, as the voltage shows; () if it does not.

    Where all of it flows one way, its edges agree as it stands.
    """
    each = np.unique(states).tolist()
    if len(each) > _MOST_STATES:
        return ()
    best: tuple[float, Sequence[float]] = (abs(edge_test(current_A, voltage_V).agreement), ())
    # the largest set first: at rest any small current discharges
    for chosen in chain.from_iterable(combinations(each, count) for count in range(len(each) - 1, 0, -1)):
        test = edge_test(np.where(np.isin(states, chosen), -current_A, current_A), voltage_V)
        if test.sign > 0 and test.agreement > best[0] + _BETTER_BY:
            best = test.agreement, chosen
    return best[1]


def _against(power: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> np.ndarray:
    """Mask (T,) of a negative power that is as large as current times voltage, and flows both ways; else none."""
    flowing = np.isfinite(power) & (np.abs(current_A) > _FLOWING * np.nanmax(np.abs(current_A), initial=0.0))
    if not flowing.any():
        return flowing
    power_W, apparent_W = power[flowing], current_A[flowing] * np.abs(voltage_V[flowing])
    low, usual, high = np.nanquantile(np.abs(power_W) / apparent_W, (0.1, 0.5, 0.9))
    each_way = min(np.count_nonzero(power_W > 0), np.count_nonzero(power_W < 0)) >= _EACH_WAY * power_W.size
    return (power < 0) & each_way & (high - low < _SAME_RATIO * usual)


def _is_charging_flag(name: str) -> bool:
    words = set(letters(name))
    return _CHARGING in words and words <= _BESIDE_CHARGING


def _direction(state: str) -> int:
    """1 for a charge, -1 for a discharge or a rest, 0 for any other state."""
    text = state.strip()
    if _DISCHARGE_WORDS.search(text):
        return -1
    return 1 if _CHARGE_WORDS.search(text) else -1 if _REST_WORDS.search(text) else 0


#: Words of a column that is 1 where the charge is complete and else 0, and words that may stand beside them.
_FULL = (word_set("full"), word_set("fully charged"), word_set("charge complete"), word_set("charge done"))
_BESIDE = word_set("charger charge charging battery batt bat bms flag status state is")
#: `power_supply_status` of `sensor_msgs/BatteryState`, and its constant POWER_SUPPLY_STATUS_FULL.
_STATUS, _STATUS_FULL = word_set("power supply status"), 4.0


def full_charges(extra: Mapping[str, np.ndarray]) -> tuple[tuple[str, int], ...]:
    """Name of the column and sample of each onset of full charge that one of the columns (T,) reports."""
    found = []
    for name, values in extra.items():
        if _is_status(name):
            full = values == _STATUS_FULL
        elif _is_flag(name) and np.isin(values[np.isfinite(values)], (0.0, 1.0)).all():
            full = values == 1.0
        else:
            continue
        found += [(name, int(k)) for k in np.flatnonzero(full[1:] & ~full[:-1]) + 1]
    return tuple(found)


def charger_columns(names: Collection[str]) -> tuple[str, ...]:
    """The columns that may say that the battery is full, by their names alone."""
    return tuple(name for name in names if _is_status(name) or _is_flag(name))


def _is_status(name: str) -> bool:
    return set(letters(name)) >= _STATUS


def _is_flag(name: str) -> bool:
    words = set(letters(name))
    return any(words >= full and words - full <= _BESIDE for full in _FULL)


#: Names of a column of serial numbers, reduced to lower-case letters, without the word for the battery before them.
_SERIAL = frozenset(("serial", "serialnumber", "serialno", "serialnr"))
_OF_BATTERY = re.compile(r"^(battery|batt|bat|pack|accu)(state)?")


def serial_column(names: tuple[str, ...]) -> str | None:
    """The column that holds the serial number of the battery, `battery_serial` or `Serial No.`; None for none."""
    fits = (name for name in names if _OF_BATTERY.sub("", re.sub(r"[^a-z]", "", name.lower())) in _SERIAL)
    return next(fits, None)
