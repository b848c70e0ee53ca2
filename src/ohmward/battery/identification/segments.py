"""Phases of a log: rests, pulses, constant and varying currents, and the kind of test that they make."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from ohmward.battery.identification.charge import ChargeIntegral
from ohmward.errors import InputError
from ohmward.logs.log import Log

#: Rates over 1 C: largest of a rest, largest of a low-rate test, smallest of a pulse.
REST_RATE = 1 / 100
LOW_RATE = 1 / 15
PULSE_RATE = 1 / 20
#: Durations of a pulse and of the rest before it [s].
LONGEST_PULSE_S = 400.0
SHORTEST_REST_S = 10.0
#: Samples of the shortest log that may hold a pulse and its rest.
FEWEST_OF_A_PULSE = 5
#: A current jumps by more than this rate and this share of itself; a constant one stays within the last share.
_JUMP_RATE = 1 / 50
_JUMP_SHARE = 0.05
_CONSTANT_SHARE = 0.1
#: Share of the charge that a low-rate test moves slowly, and that varying currents may move among pulses.
_LOW_RATE_SHARE = 0.6
_VARYING_SHARE = 0.2
#: Fewest pulses of a pulse test.
_FEWEST_PULSES = 3

Test = Literal["low-rate", "pulses", "dynamic"]


class Phase(NamedTuple):
    """Samples first ... last (both included) of one kind of current."""

    kind: Literal["rest", "constant", "varying"]  #: "rest", "constant" or "varying" current
    first: int
    last: int
    current_A: float  #: its mean, > 0 charges
    duration_s: float  #: from the first to the last sample


def find_phases(log: Log, capacity_Ah: float, idle_current_A: float = 0.0) -> tuple[Phase, ...]:
    """The log cut into rests (within C/100 of the idle current), constant and varying currents, on any sampling.

    A current is constant while it jumps by less than 5 % (and C/50) from sample to sample and by 10 % in all.

    Raises:
        InputError: the log is too short to hold a pulse.
    """
    if len(log) < FEWEST_OF_A_PULSE:
        raise InputError(
            f"log {log.name!r} has {len(log)} samples; a pulse and its rest need at least {FEWEST_OF_A_PULSE}"
        )
    current_A = np.nan_to_num(log.current_A)
    rest = np.abs(current_A - idle_current_A) <= REST_RATE * capacity_Ah
    jump = np.abs(np.diff(current_A)) > np.maximum(_JUMP_SHARE * np.abs(current_A[1:]), _JUMP_RATE * capacity_Ah)
    new = (rest[1:] != rest[:-1]) | (jump & ~rest[1:])
    first = np.concatenate([[0], np.flatnonzero(new) + 1])
    last = np.append(first[1:], len(log)) - 1
    return _joined(log.time_s, current_A, rest[first], first, last)


def find_pulses(phases: Sequence[Phase], capacity_Ah: float) -> tuple[Phase, ...]:
    """Phases of constant current over C/20 that last up to 400 s and follow a rest of at least 10 s."""
    pairs = pairwise(phases)
    return tuple(b for a, b in pairs if is_rest(a) and is_pulse(b, capacity_Ah))


def find_rests(phases: Sequence[Phase], shortest_s: float) -> tuple[Phase, ...]:
    """Rests of at least `shortest_s` that follow a current."""
    pairs = pairwise(phases)
    return tuple(b for a, b in pairs if a.kind != "rest" and is_rest(b, shortest_s))


def is_rest(phase: Phase, shortest_s: float = SHORTEST_REST_S) -> bool:
    """True for a rest of at least `shortest_s`."""
    return phase.kind == "rest" and phase.duration_s >= shortest_s


def is_pulse(phase: Phase, capacity_Ah: float) -> bool:
    """True where current and duration are those of a pulse."""
    strong = abs(phase.current_A) >= PULSE_RATE * capacity_Ah
    return phase.kind == "constant" and strong and phase.last > phase.first and phase.duration_s <= LONGEST_PULSE_S


def kind_of_test(log: Log, charge: ChargeIntegral, phases: Sequence[Phase], capacity_Ah: float) -> Test:
    """Low-rate when most charge moved below C/15; pulses when at least 3 stand between rests; else dynamic."""
    moved_Ah = np.abs(charge.moved_Ah)
    slow = np.abs(charge.mean_current_A(log.time_s)) < LOW_RATE * capacity_Ah
    if moved_Ah[slow].sum() > _LOW_RATE_SHARE * moved_Ah.sum():
        return "low-rate"
    varying_Ah = sum(moved_Ah[p.first : p.last + 1].sum() for p in phases if p.kind == "varying")
    pulses = len(find_pulses(phases, capacity_Ah))
    return "pulses" if pulses >= _FEWEST_PULSES and varying_Ah < _VARYING_SHARE * moved_Ah.sum() else "dynamic"


def _joined(
    time_s: np.ndarray, current_A: np.ndarray, rest: np.ndarray, first: np.ndarray, last: np.ndarray
) -> tuple[Phase, ...]:
    """Phases of the runs first ... last (N,); neighbouring runs of varying current are one phase."""
    low, high = np.minimum.reduceat(current_A, first), np.maximum.reduceat(current_A, first)
    steady = (high - low <= _CONSTANT_SHARE * np.maximum(np.abs(high), np.abs(low))) & (last > first)
    varying = ~rest & ~steady
    starts = np.flatnonzero(~(varying & np.concatenate([[False], varying[:-1]])))
    ends = np.append(starts[1:], first.size) - 1
    return tuple(
        Phase(
            "rest" if rest[a] else "varying" if varying[a] else "constant",
            int(first[a]),
            int(last[b]),
            float(current_A[first[a] : last[b] + 1].mean()),
            float(time_s[last[b]] - time_s[first[a]]),
        )
        for a, b in zip(starts, ends, strict=True)
    )
