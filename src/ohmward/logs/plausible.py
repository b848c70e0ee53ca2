"""Durations, intervals, charges, resistances and steps that no log has: a wrong unit, or a number that wrapped."""

from __future__ import annotations

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.columns import Column
from ohmward.logs.table import Note
from ohmward.signals.current_sign import edge_test
from ohmward.signals.survey import resolution, spread, usual_interval_s

#: Range of a 16-bit number, in its last digit; of its half the current uses this share at least.
_RANGE, _USED = 65_536, 0.5
#: Last digits [A] that are tried, the smallest first.
_LAST_DIGITS_A = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
#: An edge of the voltage is this share of the largest; so many edges are looked at.
_EDGE, _MOST_EDGES = 0.2, 300
#: So many edges wrapped at least, and so many did not; they leave this share of the squares that they leave as logged.
#: Fewer that wrapped leave this share: a charge that begins and ends once. Steps above this share of the range tell the
#: resistance.
_FEWEST, _LEFT = 5, 0.1
_FEW, _LEFT_BY_FEW = 2, 0.01
_LARGE = 0.02


def require_not_wrapped(source: str, current_A: np.ndarray, voltage_V: np.ndarray) -> None:
    """Refuse a current that wrapped.

    current_A, voltage_V: (T,) of the battery, of either sign; nan where not known.

    Raises:
        InputError: names the range of the number, and how often the current wrapped.
    """
    known = np.isfinite(current_A) & np.isfinite(voltage_V)
    if not known.any():
        return
    largest_A = float(np.abs(current_A[known]).max())
    for digit_A in _LAST_DIGITS_A:
        range_A = digit_A * _RANGE
        if not _USED * range_A / 2 <= largest_A <= range_A:  # to the half with a sign, to the whole without
            continue
        if largest_A > range_A / 2 and not np.isclose(resolution(current_A[known]), digit_A, rtol=0.01):
            continue
        count = count_wraps(np.diff(current_A[known]), np.diff(voltage_V[known]), range_A)
        if count:
            signed = largest_A <= range_A / 2
            fault = (
                f"that wrapped beyond {range_A / 2:g} A" if signed else "without a sign, in which one wrapped below 0"
            )
            raise InputError(
                f"{source}: the voltage contradicts {count} steps of the current unless {range_A:g} A are added: a "
                f"16-bit number of {1e3 * digit_A:g} mA {fault}; let the logger write more bits, or another unit"
            )


def count_wraps(dI: np.ndarray, dV: np.ndarray, range_A: float) -> int:
    """Number of edges at which the current wrapped; 0 where the edges as logged are explained as well.

    dI, dV: (T - 1,) steps of current [A] and voltage [V].
    """
    size = np.abs(dV)
    edge = np.flatnonzero((size >= _EDGE * size.max(initial=0.0)) & (size > 6.0 * spread(dV)) & (dI != 0.0))
    edge = edge[:: max(edge.size // _MOST_EDGES, 1)]
    if edge.size < _FEWEST:
        return 0
    dI, dV = dI[edge], dV[edge]
    as_logged = float(dV @ dV) - float(dI @ dV) ** 2 / max(float(dI @ dI), 1e-300)
    steps_A = np.stack([dI, dI - range_A * np.sign(dI)], axis=1)
    large = np.abs(steps_A) > _LARGE * range_A
    ohms = np.broadcast_to(dV[:, None], steps_A.shape)[large] / steps_A[large]
    left_V2 = (dV[:, None] - ohms[:, None, None] * steps_A) ** 2
    left = left_V2.min(axis=2).sum(axis=1)
    if not ohms.size or left.min() > _LEFT * as_logged:
        return 0
    is_wrapped = np.argmin(left_V2[np.argmin(left)], axis=1)
    count = int(is_wrapped.sum())
    fewest = _FEW if left.min() <= _LEFT_BY_FEW * as_logged else _FEWEST
    return count if count >= fewest and is_wrapped.size - count >= _FEWEST else 0


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
#: A cell has more than this resistance [ohm], but for those of hundreds of ampere-hours, and at most this voltage.
LEAST_CELL_OHM, HIGHEST_CELL_V = 3e-4, 4.3
#: A resistance is below that where it is with so many standard errors, and currents from this on [A] are doubtful.
_CERTAIN, _DOUBTFUL_FROM_A = 3.0, 20.0
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


def milliampere_notes(current: Column, current_A: np.ndarray, voltage_V: np.ndarray) -> tuple[Note, ...]:
    """A warning where amperes are a guess and give a resistance by a thousand or a million too small.

    current: its column.  current_A, voltage_V: (T,), nan where not known.
    """
    known = np.isfinite(current_A) & np.isfinite(voltage_V)
    if current.unit is not None or not known.any():
        return ()
    largest_A = float(np.abs(current_A[known]).max())
    edges = edge_test(current_A[known], voltage_V[known])
    cells = max(float(np.median(voltage_V[known])) / HIGHEST_CELL_V, 1.0)
    if largest_A < _DOUBTFUL_FROM_A or edges.t_value == 0.0:
        return ()
    most_ohm = abs(edges.resistance_ohm) * (1.0 + _CERTAIN / abs(edges.t_value))
    if most_ohm > LEAST_CELL_OHM * cells:
        return ()
    unit, named = ("mA", "milliamperes") if 1e3 * most_ohm > LEAST_CELL_OHM * cells else ("uA", "microamperes")
    text = (
        f"column {current.name!r} names no unit; as amperes it goes to {largest_A:.3g} A at dV/dI = "
        f"{1e3 * abs(edges.resistance_ohm):.2g} mohm, less than cells have: if these are {named}, say "
        f"--unit current={unit}"
    )
    return (Note(text, "warning", ("--unit", f"current={unit}")),)


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
