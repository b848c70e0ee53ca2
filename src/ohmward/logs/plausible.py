"""Durations, intervals and charges that no log has: a wrong unit of the time."""

from __future__ import annotations

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.columns import Column
from ohmward.logs.table import Note
from ohmward.signals.survey import usual_interval_s

YEAR_S = 365.25 * 86400.0
_HOUR_S = 3600.0
#: No battery logs for longer.
LONGEST_S = 50.0 * YEAR_S
#: A battery that lets its largest current flow one way for longer than this is emptied by a thousandth of its capacity
#: in an hour: no test and no robot is so slow, but milliseconds read as seconds are.
LONGEST_FLOW_H = 1000.0
#: The same where the unit of the time is a guess: curves of open-circuit voltage are taken in 50 h.
LONGEST_FLOW_GUESSED_H = 60.0
#: Shortest interval between samples of a time whose unit is a guess, of batteries and of drives: hours and minutes read
#: as seconds are shorter.
SHORTEST_INTERVAL_S, SHORTEST_DRIVE_S = 1e-3, 5e-4
#: Intervals of times in minutes and in hours that are read as seconds: 1, 5 and 10 s are 1/60 to 1/6 of a minute, and
#: 5 s to a minute are 1/720 to 1/60 of an hour. So many samples a second are no round number; 30 and 120 are those of
#: cameras.
_IN_MINUTES_S = (1 / 720, 1 / 360, 1 / 180, 1 / 60, 1 / 12, 1 / 6)
_ALIKE = 0.004
#: Intervals from this on are chosen by people, as full half minutes; others are milliseconds or microseconds.
CHOSEN_FROM_S, HALF_MINUTE_S = 90.0, 30.0
#: Longest interval between samples of the wheels of a drive: slower ones show no slip.
SLOWEST_DRIVE_S = 5.0
#: From this interval on a guessed unit is worth a warning: twenty milliseconds read as seconds look like a slow logger.
DOUBTFUL_FROM_S = 10.0
#: Share of an interval by which loggers are late.
_JITTER = 0.1
_UNITS = ("ms", "us", "ns", "min", "h", "d")


def require_plausible(source: str, time: Column, time_s: np.ndarray, current_A: np.ndarray, guessed: bool) -> None:
    """Refuse a log that cannot be.

    time: its column.  time_s: (T,) [s], increasing.  current_A: (T,) [A], nan where it is not known.
    guessed: nothing told the unit of the time.

    Raises:
        InputError: names the duration, the interval or the charge, and the options that set it right.
    """
    if time_s.size < 2:
        return
    interval, duration = usual_interval_s(time_s), float(time_s[-1] - time_s[0])
    advice, what = _advice(interval), f"{source}: column {time.name!r}"
    if duration > LONGEST_S:
        raise InputError(f"{what} gives a log of {duration / YEAR_S:,.0f} years; {advice}")
    if guessed and not _is_interval(interval):
        raise InputError(f"{what}, which names no unit, gives a sample every {interval:.3g} s; {advice}")
    most_h = LONGEST_FLOW_GUESSED_H if guessed else LONGEST_FLOW_H
    longest_h = _flow_h(np.diff(time_s), current_A) if duration > most_h * _HOUR_S else 0.0
    if longest_h > most_h:
        largest = float(np.nanmax(np.abs(current_A)))
        raise InputError(
            f"{what} gives a charge of {longest_h * largest:,.4g} Ah one way at {largest:.4g} A at most, "
            f"{longest_h:,.0f} h of it; {advice}"
        )


def require_plausible_drive(source: str, time: Column, time_s: np.ndarray, guessed: bool) -> None:
    """Refuse a drive whose wheels are sampled too seldom by a clock whose unit is a guess.

    time: its column.  time_s: (T,) [s], increasing.  guessed: nothing told the unit of the time.

    Raises:
        InputError: names the interval and the options that set it right.
    """
    if (
        guessed
        and time_s.size > 1
        and not SHORTEST_DRIVE_S <= (interval := usual_interval_s(time_s)) <= SLOWEST_DRIVE_S
    ):
        raise InputError(
            f"{source}: column {time.name!r}, which names no unit, gives a drive with a sample every {interval:.3g} s; "
            f"{_advice(interval)}"
        )


def guess_notes(time: Column, time_s: np.ndarray, guessed: bool) -> tuple[Note, ...]:
    """A warning where seconds are a guess and the samples lie as far apart as if milliseconds were meant."""
    if not guessed or time_s.size < 2 or (interval := usual_interval_s(time_s)) < DOUBTFUL_FROM_S:
        return ()
    return (
        Note(
            f"column {time.name!r} names no unit; as seconds it gives one sample every {interval:.3g} s: if these are "
            "milliseconds, say --unit time=ms",
            "warning",
            ("--unit", "time=ms"),
        ),
    )


def _advice(interval_s: float) -> str:
    """How to say the unit of a time that gives this interval in seconds, the likeliest first."""
    first = "ms" if interval_s > 1.0 else "min" if interval_s >= SHORTEST_INTERVAL_S else "h"
    others = ", ".join(unit for unit in _UNITS if unit != first)
    return f"say its unit with --unit time={first} (units={{'time': '{first}'}}), {others}, or, if it is right, time=s"


def _is_interval(seconds: float) -> bool:
    """True where people let a logger take a sample so often."""
    if seconds < CHOSEN_FROM_S:
        in_minutes = any(abs(seconds - other) < _ALIKE * other for other in _IN_MINUTES_S)
        return seconds >= SHORTEST_INTERVAL_S and not in_minutes
    return seconds <= _HOUR_S and abs(seconds / HALF_MINUTE_S - round(seconds / HALF_MINUTE_S)) < _JITTER


def _flow_h(steps: np.ndarray, current_A: np.ndarray) -> float:
    """Range of the charge over the largest current [h]."""
    known = np.nan_to_num(current_A)
    largest = float(np.abs(known).max())
    if largest == 0.0:
        return 0.0
    charge = np.concatenate([[0.0], np.cumsum(known[1:] * steps)])
    return float(np.ptp(charge)) / largest / _HOUR_S
