"""RC model from the edges of the current, by the rule of [P] 2.2.

R_total is the sudden change of voltage over the change of current; R_b = R_s = 0.75 R_total, R_t = R_total - R_b / 2;
the time constant tau of an exponential through the first 500 ms after the edges gives C_s = tau / (2 R_s).

Samples of a log for the identification of the RC model: charge counted, long charges and missing voltages left out.

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
_ZERO_RATE = 1 / 200
#: A charge of more than this share of the capacity is long: no braking of a robot lasts so.
_LONG_CHARGE = 0.05


#: Time after an edge in which [P] looks for the time constant [s].
FIRST_S = 0.5

#: Fewest samples of a window from which a time constant can be told.
_FEWEST_OF_A_WINDOW = 5
#: Smallest change of current that counts as an edge: C/20.
_EDGE_RATE = 1 / 20


class EdgeResponse(NamedTuple):
    """Response of the voltage to a change of current by one ampere, from all edges."""

    edges: int  #: their number
    r_total_ohm: float  #: resistance seen at once, or as soon as the sampling shows (median)
    delay_s: float  #: time from the edge until then (median)
    window_s: float  #: length of the window after the edge: 0.5, or ten samples where the log is slower
    #: (K,) time since the first sample after an edge, and rise of the voltage since, of all edges
    time_s: np.ndarray
    rise_ohm: np.ndarray


class TimeConstant(NamedTuple):
    """Time constant of the exponential r (1 - e^(-t / tau)) through the rises after the edges."""

    tau_s: float  #: tau; the length of the window where the rises show none
    found: bool  #: True where they show one


def find_response(samples: RcSamples, capacity_Ah: float) -> EdgeResponse:
    """Mean response of the voltage to the edges: changes of current by more than C/20 from one sample to the next.

    Raises:
        InputError: there is no such edge.
    """
    change_A = np.diff(samples.current_A)
    edges = np.flatnonzero((np.abs(change_A) > _EDGE_RATE * capacity_Ah) & ~samples.gap[1:])
    if not edges.size:
        raise InputError(
            f"the log has no edge of current above C/20 = {_EDGE_RATE * capacity_Ah:.3g} A, so no resistance can be "
            "found; record a few pulses"
        )
    typical_s = _typical_step_s(samples)
    enough = typical_s * _FEWEST_OF_A_WINDOW <= FIRST_S
    window_s = FIRST_S if enough else 2 * _FEWEST_OF_A_WINDOW * typical_s  # ten samples where the log is slower
    before, after = _around(samples, edges)
    r_total = float(np.median((samples.voltage_V[after] - samples.voltage_V[before]) / change_A[edges]))
    if not r_total > 0:
        raise InputError(
            f"the voltage falls when the current rises (R = {r_total:.3g} ohm at {edges.size} edges); currents must be "
            "> 0 when they charge: turn the sign of the current"
        )
    times, rises = zip(*(_after_edge(samples, int(k) + 1, change_A[k], window_s) for k in edges), strict=True)
    return EdgeResponse(
        edges.size,
        r_total,
        float(np.median(samples.time_s[after] - samples.time_s[before])),
        window_s,
        np.concatenate(times),
        np.concatenate(rises),
    )


def _around(samples: RcSamples, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Last sample a typical step before the new current and first a typical step after the old one, for each edge.

    In a regular log these are the samples of the edge itself. A logger that writes both currents and one voltage at the
    same moment is understood too.
    """
    step_s = 0.99 * _typical_step_s(samples)
    before = np.searchsorted(samples.time_s, samples.time_s[edges + 1] - step_s, "right") - 1
    after = np.searchsorted(samples.time_s, samples.time_s[edges] + step_s, "left")
    return np.maximum(before, 0), np.minimum(after, len(samples.time_s) - 1)


def _after_edge(samples: RcSamples, first: int, change_A: float, window_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Time since sample `first` [s] and rise of the voltage since [ohm], while the current stays, up to a window."""
    last = first + int(np.searchsorted(samples.time_s[first:], samples.time_s[first] + window_s, "right"))
    moved = np.abs(samples.current_A[first:last] - samples.current_A[first]) > 0.1 * abs(change_A)
    stays = slice(first, first + (int(np.argmax(moved)) if moved.any() else last - first))
    rise_ohm = (samples.voltage_V[stays] - samples.voltage_V[first]) / change_A
    return samples.time_s[stays] - samples.time_s[first], rise_ohm


def _typical_step_s(samples: RcSamples) -> float:
    return float(np.median(samples.dt_s[1:]))


def find_time_constant(response: EdgeResponse) -> TimeConstant:
    """Least squares over a grid of tau between a twentieth of the window and ten windows, weighted alike.

    It is not found where the best tau stands at an end of the grid or the exponential explains less than half of the
    rises' scatter about their mean.
    """
    t, y = response.time_s, response.rise_ohm
    taus = response.window_s * np.geomspace(0.05, 10.0, 200)
    costs = [_cost_of(1 - np.exp(-t / tau), y) for tau in taus]
    best = int(np.argmin(costs))
    found = 0 < best < len(taus) - 1 and costs[best] < 0.5 * float(np.sum((y - y.mean()) ** 2))
    return TimeConstant(float(taus[best]) if found else response.window_s, found)


def _cost_of(column: np.ndarray, y: np.ndarray) -> float:
    """Residual sum of squares of the best multiple >= 0 of the column."""
    scale = max(float(column @ y) / max(float(column @ column), 1e-300), 0.0)
    return float(np.sum((y - scale * column) ** 2))


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
    sign = np.sign(current_A) * (np.abs(current_A) > _ZERO_RATE * capacity_Ah)
    last_moving = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
    charging = sign[last_moving] > 0
    run = np.cumsum(np.diff(charging, prepend=charging[:1]))
    long = charging & (np.bincount(run, moved_Ah)[run] > _LONG_CHARGE * capacity_Ah)
    return long, np.cumsum(np.diff(long.astype(int), prepend=int(long[0])) < 0)
