"""Logs whose data do not show the sign of the current, read with the sign of similar logs or by the battery file."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from ohmward.battery.battery import Battery
from ohmward.battery.log_check import sign_by_model
from ohmward.errors import OhmwardError
from ohmward.logs.log import Log, ReadOptions, UnknownSignError
from ohmward.logs.read import open_table
from ohmward.logs.selection import split_selection
from ohmward.logs.table import Note, Progress, TableFile, counted
from ohmward.signals.current_sign import CurrentSign, sign_evidence

#: Most other logs examined.
_MOST_OTHERS = 9
T = TypeVar("T")


def read_one_of(
    text: str,
    reading: ReadOptions,
    others: Sequence[str] = (),
    battery: Battery | None = None,
    extra: Collection[str] | None = None,
    progress: Progress | None = None,
    file: TableFile | None = None,
) -> Log:
    """Read the log of this name by `ReadOptions.read`; if its data do not show the sign, other logs or the battery do.

    others: names of logs, of which those with equal columns are assumed to have the same sign.
    battery: of the log, if it is known.

    Raises:
        UnknownSignError: nothing shows the sign.
        InputError, OhmwardError: as in `ReadOptions.read`.
    """
    try:
        return reading.read(text, extra, progress, file)
    except UnknownSignError as error:
        if error.is_lost:
            raise
        log = replace(reading, current_sign="charge").read(text, extra, progress, file)
        sign, by = _sign_of_others(text, tuple(others), reading)
        if sign is None and battery is not None:
            sign, by = sign_by_model(log, battery), "the battery file: the other sign explains the voltage worse"
        if sign is None:
            raise
        note = Note(f"positive current {sign}s the battery, according to {by}; its own data do not show it")
        notes = tuple(note for note in log.notes if not note.text.startswith("positive current "))
        return replace(log, current_A=log.current_A if sign == "charge" else 0.0 - log.current_A, notes=(*notes, note))


def _sign_of_others(text: str, others: tuple[str, ...], reading: ReadOptions) -> tuple[CurrentSign | None, str]:
    """The sign on which all other logs with equal columns agree if they show one, and a phrase that names them."""
    names = _columns(text, reading)
    alike = [other for other in others if other != text and _columns(other, reading) == names]
    verdicts = [_own_sign(other, reading) for other in some_of(alike)]
    return unanimous(verdicts), f"{counted(len(verdicts) - verdicts.count(None), 'other log')} with the same columns"


def some_of(others: Sequence[T]) -> Sequence[T]:
    """The others that are examined, spread over all of them."""
    return others[:: max(len(others) // _MOST_OTHERS, 1)][:_MOST_OTHERS]


def unanimous(verdicts: Sequence[CurrentSign | None]) -> CurrentSign | None:
    """The sign on which all verdicts but None agree; None if there are none, or they contradict each other."""
    signs = set(verdicts) - {None}
    return signs.pop() if len(signs) == 1 else None


def sign_in_data(log: Log) -> CurrentSign | None:
    """The sign that the data of a log show; None if they show none."""
    verdict = sign_evidence(log.time_s, log.current_A, log.voltage_V).verdict
    return "charge" if verdict == "charge" else "discharge" if verdict == "discharge" else None


@lru_cache(maxsize=1024)
def _columns(text: str, reading: ReadOptions) -> tuple[str, ...] | None:
    """Names of the columns of a log; None where it cannot be opened."""
    try:
        return open_table(Path(split_selection(text)[0]), reading.hints).names
    except OhmwardError:
        return None


@lru_cache(maxsize=1024)
def _own_sign(text: str, reading: ReadOptions) -> CurrentSign | None:
    """The sign that the data of a log show; None if they show none, or the log cannot be read."""
    try:
        return sign_in_data(replace(reading, current_sign="charge").read(text, ()))
    except OhmwardError:
        return None
