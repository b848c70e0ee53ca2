"""A part of a log between two times, given as seconds, as h:mm:ss or as dates."""

from __future__ import annotations

import math

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.dates import duration_s, read_dates
from ohmward.logs.hints import FileHints
from ohmward.logs.zones import to_utc


def window_s(name: str, start_unix_s: float | None, hints: FileHints) -> tuple[float, float] | None:
    """From and until [s] on the clock of a log; None where all of it is wanted.

    name: of the log, for messages.  start_unix_s: Unix time of the clock's zero, None where it is not known.

    Raises:
        InputError: no time, or a date for a log whose date is not known.
    """
    if hints.start is None and hints.stop is None:
        return None
    start = -math.inf if hints.start is None else _on_clock(name, "--from", hints.start, start_unix_s, hints)
    stop = math.inf if hints.stop is None else _on_clock(name, "--to", hints.stop, start_unix_s, hints)
    if start >= stop:
        raise InputError(f"--from {hints.start} must be before --to {hints.stop}")
    return start, stop


def _on_clock(name: str, option: str, text: str, start_unix_s: float | None, hints: FileHints) -> float:
    for read in (float, duration_s):
        try:
            if math.isfinite(value := read(text)):
                return value
        except ValueError:
            pass
    try:
        dates = read_dates([text], hints.time_format)
    except ValueError:
        raise InputError(
            f"{option} must be seconds of the log (3600), h:mm:ss, or a date (2026-01-31T12:00); got {text!r}"
        ) from None
    if start_unix_s is None:
        raise InputError(f"{option} {text}: log {name!r} names no date; give seconds from its start, or h:mm:ss")
    seconds = dates.seconds
    if hints.timezone and not dates.is_utc:
        seconds = to_utc(np.asarray(seconds), hints.timezone)
    return float(seconds[0]) - start_unix_s
