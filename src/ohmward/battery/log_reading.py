"""Logs whose data do not show the sign of the current, read with the sign by the battery file."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from ohmward.battery.battery import Battery
from ohmward.battery.log_check import sign_by_model
from ohmward.logs.log import Log, Note, Progress, ReadOptions, TableFile, UnknownSignError


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
