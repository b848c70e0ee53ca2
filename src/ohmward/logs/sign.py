"""The sign of the current in a file: as told, as its format defines it, or from the data."""

from __future__ import annotations

from typing import get_args

import numpy as np

from ohmward.errors import InputError
from ohmward.logs import bdf
from ohmward.logs.table import Note, TableFile
from ohmward.signals.current_sign import CurrentSign, SignEvidence, lost_sign, sign_evidence


class UnknownSignError(InputError):
    """The data do not tell whether a positive current charges the battery; `likely` is what most of them say."""

    def __init__(self, text: str, likely: CurrentSign, is_lost: bool = False) -> None:
        super().__init__(text, () if is_lost else ("--current-sign", likely))
        self.likely = likely
        self.is_lost = is_lost  #: charge and discharge are written alike: no sign is right


def charging_current(
    file: TableFile, wanted: CurrentSign, time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray
) -> tuple[np.ndarray, Note]:
    """The current (T,) [A] of a file, > 0 charging, and a note: as told, as the format defines it, or from the data.

    Raises:
        UnknownSignError: nothing tells the sign, or the current has lost it.
        InputError: `wanted` is none of the three.
    """
    if wanted not in get_args(CurrentSign):
        raise InputError(f"current_sign must be 'auto', 'charge' or 'discharge', not {wanted!r}")
    evidence = sign_evidence(time_s, current_A, voltage_V)
    directions = lost_sign(current_A, voltage_V)
    sign: str
    if wanted != "auto":
        sign = wanted
        note = _given_note(sign, "given", evidence, directions)
    elif bdf.is_bdf(file.source):
        sign = "charge"
        note = _given_note(sign, "by definition of BDF", evidence, directions)
    elif directions:
        raise UnknownSignError(f"{file.stem}: {directions}", evidence.likely, is_lost=True)
    elif evidence.verdict != "undecidable":
        sign = evidence.verdict
        note = Note(f"positive current {sign}s the battery, as the data show: {evidence}")
    elif bdf.has_columns(file.names):
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
            f"{file.stem}: the data do not tell whether a positive current charges or discharges the battery "
            f"({evidence}); say it with --current-sign charge or --current-sign discharge (current_sign='charge')",
            evidence.likely,
        )
    return -current_A if sign == "discharge" else current_A, note


def _given_note(given: str, by: str, evidence: SignEvidence, directions: str) -> Note:
    """A note on a sign that somebody told; a warning where the data say the opposite."""
    text = f"positive current {given}s the battery ({by})"
    if directions:
        return Note(f"{text}, but {directions}", "warning")
    if evidence.verdict in (given, "undecidable"):
        return Note(text)
    return Note(f"{text}, but the data say the opposite: {evidence}; check the sign", "warning")
