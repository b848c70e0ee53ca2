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
#: Shortest interval between samples of a time whose unit is a guess: 20 kHz.
SHORTEST_INTERVAL_S = 5e-5
#: Intervals from this on are chosen by people, as full half minutes; others are milliseconds or microseconds.
CHOSEN_FROM_S, HALF_MINUTE_S = 90.0, 30.0
#: Longest interval between samples of the wheels of a drive: slower ones show no slip.
SLOWEST_DRIVE_S = 5.0
#: From this interval on a guessed unit is worth a warning: twenty milliseconds read as seconds look like a slow logger.
DOUBTFUL_FROM_S = 10.0
#: Share of an interval by which loggers are late.
_JITTER = 0.1
_ADVICE = "say its unit with --unit time=ms (units={'time': 'ms'}), us, ns, min, h or d, or, if it is right, time=s"


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
    advice, what = _ADVICE, f"{source}: column {time.name!r}"
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
        and not SHORTEST_INTERVAL_S <= (interval := usual_interval_s(time_s)) <= SLOWEST_DRIVE_S
    ):
        raise InputError(
            f"{source}: column {time.name!r}, which names no unit, gives a drive with a sample every {interval:.3g} s; "
            f"{_ADVICE}"
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


def _is_interval(seconds: float) -> bool:
    """True where people let a logger take a sample so often."""
    if seconds < CHOSEN_FROM_S:
        return seconds >= SHORTEST_INTERVAL_S
    return seconds <= _HOUR_S and abs(seconds / HALF_MINUTE_S - round(seconds / HALF_MINUTE_S)) < _JITTER


def _flow_h(steps: np.ndarray, current_A: np.ndarray) -> float:
    """Range of the charge over the largest current [h]."""
    known = np.nan_to_num(current_A)
    largest = float(np.abs(known).max())
    if largest == 0.0:
        return 0.0
    charge = np.concatenate([[0.0], np.cumsum(known[1:] * steps)])
    return float(np.ptp(charge)) / largest / _HOUR_S
