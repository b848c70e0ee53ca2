"""Samples of a log for the identification of the RC model: charge counted, long charges and missing voltages left out.

A linear model does not follow a battery through a full charge: the voltage limit, gassing, a charge that is not all
stored, an open-circuit voltage above that of discharge. Short charges, a robot's braking, stay. What lies between two
long charges is a part with an open-circuit voltage of its own at the start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.charge import count_charge, find_gaps, known_current_A
from ohmward.errors import InputError
from ohmward.logs.log import SECONDS_PER_HOUR, Log

#: Currents below this rate neither charge nor discharge.
_REST_RATE = 1 / 200
#: A charge of more than this share of the capacity is long: no braking of a robot lasts so.
_LONG_CHARGE = 0.05


class RcSamples(NamedTuple):
    """The samples with a voltage, (T,) each.

    time_s, dt_s: time and step [s].
    current_A, mean_A: current at the sample and its mean over the step.
    charge_As: since the start.
    gap: True where the step is a gap in the recording, or the first of a part.
    part: number of the part, 0 for the first.
    """

    time_s: np.ndarray
    dt_s: np.ndarray
    current_A: np.ndarray
    charge_As: np.ndarray
    mean_A: np.ndarray
    voltage_V: np.ndarray
    gap: np.ndarray
    part: np.ndarray


def outside_long_charges(log: Log, capacity_Ah: float) -> RcSamples:
    """The samples with a voltage that stand outside long charges; the charge of the others counts all the same."""
    moved_Ah, current_A = count_charge(log).moved_Ah, known_current_A(log)
    charging, part = _long_charges(current_A, moved_Ah, capacity_Ah)
    used = np.isfinite(log.voltage_V) & ~charging
    if not used.any():
        raise InputError(f"log {log.name!r} holds nothing but a long charge; an RC model needs a discharge or pulses")
    part = part[used] - part[used][0]
    time_s = log.time_s[used]
    charge_As = SECONDS_PER_HOUR * np.cumsum(moved_Ah)[used]
    dt_s = np.diff(time_s, prepend=time_s[:1])
    mean_A = np.diff(charge_As, prepend=charge_As[:1]) / np.where(dt_s > 0, dt_s, 1.0)
    gap = find_gaps(time_s) | (np.diff(part, prepend=-1) > 0)
    return RcSamples(time_s, dt_s, current_A[used], charge_As, mean_A, log.voltage_V[used], gap, part)


def _long_charges(current_A: np.ndarray, moved_Ah: np.ndarray, capacity_Ah: float) -> tuple[np.ndarray, np.ndarray]:
    """True inside a charge of more than 5 % of the capacity, and the number of such charges before a sample.

    A charge lasts until the next discharge: after it the voltage falls for hours, and no linear model says how.
    """
    sign = np.sign(current_A) * (np.abs(current_A) > _REST_RATE * capacity_Ah)
    last_moving = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
    charging = sign[last_moving] > 0
    run = np.cumsum(np.diff(charging, prepend=charging[:1]))
    long = charging & (np.bincount(run, moved_Ah)[run] > _LONG_CHARGE * capacity_Ah)
    return long, np.cumsum(np.diff(long.astype(int), prepend=int(long[0])) < 0)
