"""The sign of a current that charges the battery, told from the response of the voltage.

With current > 0 charging, an edge of the current moves the voltage the same way at once, because the ohmic resistance
is positive; and a long steady current that charges raises the voltage. Either may decide; where they contradict each
other, or neither is clear, the answer is that the data do not tell.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import numpy as np

from ohmward.errors import InputError
from ohmward.logs import bdf
from ohmward.logs.note import Note, counted
from ohmward.logs.table import TableFile
from ohmward.runs import runs

#: A current of the other sign, and what to do about it in a log.
WRONG_SIGN = "the voltage answers the current with the wrong sign"
OTHER_SIGN = "current > 0 must charge; read the log with the other --current-sign"

#: What a positive current in a file does; "auto" tells it from the data.
CurrentSign = Literal["auto", "charge", "discharge"]

# Samples of a real log are not independent, so a clear |t| is far above the usual 3, and more so for a few edges.
CLEAR_T = 10.0
CLEAR_T_OF_MANY = 5.0
_MANY = 8
# Of the edges weighted by size at least nine tenths agree: sum(dI dV) is 0.8 of sum(|dI dV|).
CLEAR_AGREEMENT = 0.8
# An edge, as a fraction of the largest change and of the largest current, and above rounding.
_EDGE = 0.2
_EDGE_OF_LEVEL = 0.02
_LEAST_EDGE_A = 1e-9
# A steady current stays within this fraction of its usual value, long enough for diffusion to raise the voltage.
_STEADY = 0.1
_TREND_PARTS = 5
_TREND_LEAST_S = 300.0


class EdgeTest(NamedTuple):
    """Regression of dV on dI over the edges of the current."""

    resistance_ohm: float  #: slope [ohm], > 0 when positive current charges; NaN without edges
    edges: int  #: their number
    t_value: float  #: slope over its standard error, from the noise of the voltage between edges
    agreement: float  #: in [-1, 1], sum(dI dV) / sum(|dI dV|): 1 or -1 when every edge says the same

    @property
    def sign(self) -> int:
        """1 when positive current clearly charges, -1 when it clearly discharges, else 0."""
        clear_t = CLEAR_T_OF_MANY if self.edges >= _MANY else CLEAR_T
        clear = abs(self.t_value) > clear_t and abs(self.agreement) >= CLEAR_AGREEMENT
        return int(np.sign(self.t_value)) if clear else 0


class SignEvidence(NamedTuple):
    """Effect of a positive current according to the data: verdict "charge", "discharge" or "undecidable"."""

    verdict: str
    edges: EdgeTest  #: the fast test. trend: the slow test; 1 charge, -1 discharge, 0 unclear.
    trend: int

    def __str__(self) -> str:
        count = counted(self.edges.edges, "edge")
        if self.edges.sign:
            return f"{count} with dV/dI = {1e3 * self.edges.resistance_ohm:.3g} mohm (t = {self.edges.t_value:.0f})"
        if self.trend:
            return "the trend of the voltage under a steady current"
        return f"{count} of the current, t = {self.edges.t_value:.1f}, no clear trend"


def sign_evidence(time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> SignEvidence:
    """The sign of the current from the data.

    time_s: (T,) [s] increasing; current_A: (T,) [A] of either sign; voltage_V: (T,) [V]; NaN samples are left out.
    """
    known = np.isfinite(current_A) & np.isfinite(voltage_V)
    edges = edge_test(current_A[known], voltage_V[known])
    trend = trend_test(time_s[known], current_A[known], voltage_V[known])
    signs = {edges.sign, trend}
    verdict = "undecidable" if signs == {1, -1} or signs == {0} else "charge" if 1 in signs else "discharge"
    return SignEvidence(verdict, edges, trend)


def charging_current(
    file: TableFile, wanted: CurrentSign, time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray
) -> tuple[np.ndarray, Note]:
    """The current (T,) [A] of a file, > 0 charging, and a note: as told, as the format defines it, or from the data.

    Raises:
        InputError: `wanted` is none of the three, or nothing tells the sign.
    """
    if wanted not in get_args(CurrentSign):
        raise InputError(f"current_sign must be 'auto', 'charge' or 'discharge', not {wanted!r}")
    evidence = sign_evidence(time_s, current_A, voltage_V)
    sign: str
    if wanted != "auto":
        sign = wanted
        note = _told_note(sign, "given", evidence)
    elif bdf.is_bdf(file.source):
        sign = "charge"
        note = _told_note(sign, "by definition of BDF", evidence)
    elif evidence.verdict != "undecidable":
        sign = evidence.verdict
        note = Note(f"positive current {sign}s the battery, told from the data: {evidence}")
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
        raise InputError(
            f"{file.stem}: the data do not tell whether a positive current charges or discharges the battery "
            f"({evidence}); say it with --current-sign charge or --current-sign discharge (current_sign='charge')"
        )
    return -current_A if sign == "discharge" else current_A, note


def _told_note(told: str, by: str, evidence: SignEvidence) -> Note:
    """A note on a sign that somebody told; a warning where the data say the opposite."""
    text = f"positive current {told}s the battery ({by})"
    if evidence.verdict in (told, "undecidable"):
        return Note(text)
    return Note(f"{text}, but the data say the opposite: {evidence}; check the sign", "warning")


def edge_test(current_A: np.ndarray, voltage_V: np.ndarray) -> EdgeTest:
    """Regression of dV on dI, through the origin: R = sum(dI dV) / sum(dI^2) over changes between neighbours.

    An edge is at least a fifth of the largest change, 2 % of the largest current and six times the usual change. The
    error of R comes from what the voltage does between edges (noise or slow drift, whichever is larger) and from the
    rounding of two samples.

    current_A, voltage_V: (T,), no NaN.
    """
    dI, dV = np.diff(current_A), np.diff(voltage_V)
    size = np.abs(dI)
    least = max(_EDGE * size.max(initial=0.0), _EDGE_OF_LEVEL * np.abs(current_A).max(initial=0.0), _LEAST_EDGE_A)
    edge = (size >= least) & (size > 6.0 * spread(dI))
    if not edge.any():
        return EdgeTest(np.nan, 0, 0.0, 0.0)
    products = dI[edge] * dV[edge]
    squares = float(dI[edge] @ dI[edge])
    drift = float(np.percentile(np.abs(dV[~edge]), 95)) / 2 if (~edge).any() else 0.0
    error = max(spread(dV), drift, resolution(voltage_V) / np.sqrt(6.0)) / np.sqrt(squares)
    slope = float(products.sum()) / squares
    total = float(np.abs(products).sum())
    if total == 0.0 or error == 0.0:
        return EdgeTest(slope, int(edge.sum()), 0.0, 0.0)
    return EdgeTest(slope, int(edge.sum()), slope / error, float(products.sum()) / total)


def trend_test(time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> int:
    """1 if a steady current raises the voltage when positive or lowers it when negative, -1 the reverse, 0 unclear.

    The longest steady stretch counts. It must last five minutes, and the voltage must move the same way from each fifth
    of it to the next without dying out: relaxation after a larger current moves it too, but fades.

    time_s, current_A, voltage_V: (T,), no NaN.
    """
    steady = _longest_steady(time_s, current_A)
    if steady is None or time_s[steady][-1] - time_s[steady][0] < _TREND_LEAST_S:
        return 0
    means = _part_means(time_s[steady], voltage_V[steady])
    moves = np.diff(means)
    noise = max(spread(np.diff(voltage_V[steady])), resolution(voltage_V))
    one_way = bool(np.all(moves > 0) or np.all(moves < 0))
    if not one_way or abs(moves.sum()) < CLEAR_T * noise or abs(moves[-1]) < 0.5 * abs(moves[1]):
        return 0
    return int(np.sign(moves[0]) * np.sign(np.median(current_A[steady])))


def spread(values: np.ndarray) -> float:
    """Robust standard deviation, 1.4826 times the median absolute deviation; 0 for an empty array."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values)))) if values.size else 0.0


def resolution(values: np.ndarray) -> float:
    """Smallest step between distinct values (T,), no NaN; 0 where they are all equal.

    Steps below 1e-6 of the range are rounding of a float32 or of a sum, not of the instrument.
    """
    distinct = np.unique(values)
    steps = np.diff(distinct)
    real = steps[steps > 1e-6 * max(np.ptp(distinct), abs(distinct).max())] if steps.size else steps
    return float(real.min()) if real.size else 0.0


def _longest_steady(time_s: np.ndarray, current_A: np.ndarray) -> slice | None:
    """The longest stretch, in time, in which the current stays within a tenth of its usual value that is not rest."""
    size = np.abs(current_A)
    flowing = current_A[size > 0.01 * size.max(initial=0.0)]
    if not flowing.size:
        return None
    usual = np.median(flowing)
    inside = np.abs(current_A - usual) <= _STEADY * abs(usual)
    stretches = runs(inside)
    if not stretches:
        return None
    return slice(*max(stretches, key=lambda stretch: time_s[stretch[1] - 1] - time_s[stretch[0]]))


def _part_means(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Means of the parts of equal duration; a part without samples repeats its neighbour, which is no trend."""
    edges = np.linspace(time_s[0], time_s[-1], _TREND_PARTS + 1)[1:-1]
    part = np.searchsorted(edges, time_s, side="right")
    count = np.bincount(part, minlength=_TREND_PARTS)
    means = np.bincount(part, weights=values, minlength=_TREND_PARTS) / np.maximum(count, 1)
    return means if count.all() else np.zeros(_TREND_PARTS)
