"""Columns by which a charger or a battery management says that the battery is full, found by their names."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from ohmward.logs.channels import letters, word_set

#: Words of a column that is 1 where the charge is complete and else 0, and words that may stand beside them.
_FULL = (word_set("full"), word_set("fully charged"), word_set("charge complete"), word_set("charge done"))
_BESIDE = word_set("charger charge charging battery batt bat bms flag status state is")
#: `power_supply_status` of `sensor_msgs/BatteryState`, and its constant POWER_SUPPLY_STATUS_FULL.
_STATUS, _STATUS_FULL = word_set("power supply status"), 4.0


def full_charges(extra: Mapping[str, np.ndarray]) -> tuple[tuple[str, int], ...]:
    """Name of the column and sample of each charge that one of the columns (T,) begins to call complete."""
    found = []
    for name, values in extra.items():
        full = _says_full(name, values)
        found += [(name, int(k)) for k in np.flatnonzero(full[1:] & ~full[:-1]) + 1]
    return tuple(found)


def charger_columns(names: Collection[str]) -> tuple[str, ...]:
    """The columns that may say that the battery is full, by their names alone."""
    return tuple(name for name in names if _is_status(name) or _is_flag(name))


def _says_full(name: str, values: np.ndarray) -> np.ndarray:
    """(T,) bool, True where the column says that the battery is full."""
    if _is_status(name):
        return values == _STATUS_FULL
    flags = bool(np.isin(values[np.isfinite(values)], (0.0, 1.0)).all())
    return (values == 1.0) & (_is_flag(name) and flags)


def _is_status(name: str) -> bool:
    return set(letters(name)) >= _STATUS


def _is_flag(name: str) -> bool:
    words = set(letters(name))
    return any(words >= full and words - full <= _BESIDE for full in _FULL)
