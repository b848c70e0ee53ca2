"""The battery's current where no column has it: from a column for each direction, or from power and voltage."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from ohmward.logs.channels import CURRENT, VOLTAGE, Channel, letters, word_set
from ohmward.logs.columns import Column, find_column
from ohmward.logs.note import Note
from ohmward.logs.table import Progress, Table, TableFile, numbers
from ohmward.logs.units import UNITS, split_unit, unit_in_name

_CHARGE = word_set("charge charging charger chg chrg lade ladestrom")
_DISCHARGE = word_set("discharge discharging dis dsg dchg dischg dischrg entlade entladestrom")
#: Words that are a current by themselves.
_CURRENTS = word_set("ladestrom entladestrom")
_POWER = word_set("power p leistung watts")
_NAME = "pack current [A]"


def with_both_ways(file: TableFile, columns: Mapping[str, str] | None = None) -> TableFile:
    """The file with the charging less the discharging current as a column, where it has both and no other current.

    The size of each is taken, whatever its sign: the column says the direction.

    columns: those that the caller named.
    """
    charge, discharge = (_only(file.names, _is_current, words) for words in (_CHARGE, _DISCHARGE))
    if charge is None or discharge is None or _has(file, CURRENT, columns, (charge, discharge)):
        return file

    def less(table: Table) -> tuple[np.ndarray, Note]:
        sizes = np.stack([np.abs(_amperes(table, name)) for name in (charge, discharge)])
        current_A = np.nan_to_num(sizes[0]) - np.nan_to_num(sizes[1])
        current_A[np.isnan(sizes).all(axis=0)] = np.nan
        return current_A, Note(f"current: {charge!r} less {discharge!r}")

    return _with_current(file, (charge, discharge), less)._replace(positive_current="charge")


def with_power(
    file: TableFile, columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None
) -> TableFile:
    """The file with the power over the voltage as a column, where it has one power of the battery and no current.

    columns, units: those that the caller named.
    """
    power = _only(file.names, _is_power, _POWER)
    if power is None or _has(file, CURRENT, columns):
        return file
    voltage = _has(file, VOLTAGE, columns, (), units)
    if voltage is None:
        return file

    def over(table: Table) -> tuple[np.ndarray, Note]:
        power_W = (unit_in_name(power, ("power",)) or UNITS["w"]).in_si(numbers(table, power))
        voltage_V = (voltage.unit or VOLTAGE.default).in_si(numbers(table, voltage.name))
        current_A = np.full(power_W.size, np.nan)
        np.divide(power_W, voltage_V, out=current_A, where=voltage_V > 0.0)
        return current_A, Note(f"current: {power!r} over {voltage.name!r}")

    return _with_current(file, (power, voltage.name), over)


def _has(
    file: TableFile,
    channel: Channel,
    columns: Mapping[str, str] | None,
    leave: Collection[str] = (),
    units: Mapping[str, str] | None = None,
) -> Column | None:
    """The column of a channel among all but those to leave, where there is one."""
    optional = channel._replace(required=False)
    of_channel = {quantity: unit for quantity, unit in (units or {}).items() if quantity == channel.name}
    return find_column(file.source, file.names, optional, file.given(columns), of_channel, leave)


def _with_current(
    file: TableFile, sources: Sequence[str], current: Callable[[Table], tuple[np.ndarray, Note]]
) -> TableFile:
    """The file with a current as a column, computed from other columns."""

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        table = file.load([*names, *(sources if _NAME in names else ())], progress)
        if _NAME not in names:
            return table
        current_A, note = current(table)
        return table.with_columns({_NAME: current_A}, note)

    return file._replace(names=(*file.names, _NAME), load=load)


def _only(names: Sequence[str], fits: Callable[[str, Collection[str]], bool], words: Collection[str]) -> str | None:
    """The one column that fits the words; None where there is none, or are several."""
    found = [name for name in names if fits(name, words)]
    return found[0] if len(found) == 1 else None


def _is_power(name: str, words: Collection[str]) -> bool:
    """True where the name is that of a power of the battery; a bare letter needs its unit."""
    for stem, unit in split_unit(name):
        naming = set(letters(stem)) - CURRENT.beside[1]
        if naming and naming <= {*words} and ((unit is not None and unit.dimension == "power") or "p" not in naming):
            return unit is None or unit.dimension == "power"
    return False


def _is_current(name: str, direction: Collection[str]) -> bool:
    """True where the name has a word of the direction and otherwise those of a battery's current."""
    for stem, unit in split_unit(name):
        if unit is not None and unit.dimension not in CURRENT.dimensions:
            return False
        words = set(letters(stem))
        rest = frozenset(words - set(direction) - CURRENT.beside[1])
        is_current = rest in CURRENT.words or (not rest and (unit is not None or bool(words & _CURRENTS)))
        if words & set(direction) and is_current:
            return True
    return False


def _amperes(table: Table, name: str) -> np.ndarray:
    """The column (T,) [A]; NaN where it has no value."""
    unit = unit_in_name(name, CURRENT.dimensions) or CURRENT.default
    return unit.in_si(numbers(table, name))
