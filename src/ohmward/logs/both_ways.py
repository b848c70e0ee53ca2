"""Currents of charge and discharge in a column each, and no column of the battery's current."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ohmward.logs.channels import CURRENT, letters, word_set
from ohmward.logs.columns import find_column
from ohmward.logs.note import Note
from ohmward.logs.table import Progress, Table, TableFile, numbers
from ohmward.logs.units import split_unit, unit_in_name

_CHARGE = word_set("charge charging charger chg chrg lade ladestrom")
_DISCHARGE = word_set("discharge discharging dis dsg dchg dischg dischrg entlade entladestrom")
#: Words that are a current by themselves.
_CURRENTS = word_set("ladestrom entladestrom")
_NAME = "pack current [A]"


def with_both_ways(file: TableFile, columns: Mapping[str, str] | None = None) -> TableFile:
    """The file with the charging less the discharging current as a column, where it has both and no other current.

    The size of each is taken, whatever its sign: the column says the direction.

    columns: those that the caller named.
    """
    charge, discharge = (_only(file.names, words) for words in (_CHARGE, _DISCHARGE))
    if charge is None or discharge is None or "current" in (columns or {}):
        return file
    optional = CURRENT._replace(required=False)
    if find_column(file.source, file.names, optional, file.given(columns), {}, (charge, discharge)):
        return file

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        table = file.load([*names, *((charge, discharge) if _NAME in names else ())], progress)
        if _NAME not in names:
            return table
        sizes = np.stack([np.abs(_amperes(table, name)) for name in (charge, discharge)])
        current_A = np.nan_to_num(sizes[0]) - np.nan_to_num(sizes[1])
        current_A[np.isnan(sizes).all(axis=0)] = np.nan
        return table.with_columns({_NAME: current_A}, Note(f"current: {charge!r} less {discharge!r}"))

    return file._replace(names=(*file.names, _NAME), load=load, positive_current="charge")


def _only(names: Sequence[str], direction: Collection[str]) -> str | None:
    """The one column of the current in a direction; None where there is none, or are several."""
    found = [name for name in names if _is_current(name, direction)]
    return found[0] if len(found) == 1 else None


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
