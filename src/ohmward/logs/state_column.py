"""Cyclers that write the size of a current, and beside it whether it charges or discharges."""

from __future__ import annotations

import re

import numpy as np

from ohmward.logs.channels import letters
from ohmward.logs.note import Note
from ohmward.logs.table import TableFile

#: Names of the column.
_NAMES = (frozenset(("state",)), frozenset(("status",)), frozenset(("mode",)), frozenset(("step", "type")),
          frozenset(("md",)), frozenset(("step", "name")), frozenset(("work", "mode")))  # fmt: skip
_DISCHARGE = re.compile(r"^d(?:\W|$)|dis|dch|dsg|dsch|entlad|放电", re.IGNORECASE)
_CHARGE = re.compile(r"^c(?:\W|$)|ch[aghr]|^cccv|^laden|充电", re.IGNORECASE)


def state_column(file: TableFile) -> str | None:
    """The column of texts that name charge or discharge among its first cells; None where there is none."""
    for name, cells in file.head.items():
        if frozenset(letters(name)) in _NAMES and any(_direction(cell) for cell in cells):
            return name
    return None


def with_direction(current: np.ndarray, states: np.ndarray, name: str) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The current (T,), > 0 charging by the state beside it, where it is never negative and discharges at all."""
    if np.nanmin(current, initial=0.0) < 0 or states.dtype != object:
        return current, ()
    direction = {state: _direction(str(state)) for state in set(states.tolist())}
    signs = np.array([direction[state] for state in states.tolist()])
    if not (signs < 0).any():
        return current, ()
    note = Note(f"the current has no sign: that of the state in {name!r}, charge or discharge, taken")
    return np.where(signs < 0, 0.0 - current, current), (note,)


def _direction(state: str) -> int:
    """1 for a charge, -1 for a discharge, 0 for any other state."""
    text = state.strip()
    return -1 if _DISCHARGE.search(text) else 1 if _CHARGE.search(text) else 0
