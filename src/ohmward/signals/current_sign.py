"""The sign of a current that charges the battery, found from the response of the voltage.

With current > 0 charging, an edge of the current moves the voltage the same way at once, because the ohmic resistance
is positive; and a long steady current that charges raises the voltage. Either may decide; if they contradict each
other, the sign is undecidable. If neither is clear, as under a current that is never steady, the regression over all
changes decides.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from ohmward.runs import runs, where_known
from ohmward.signals.checks import Finding, Place
from ohmward.signals.survey import resolution, spread

#: Effect of a positive current in a file; "auto" infers it from the data.
CurrentSign = Literal["auto", "charge", "discharge"]

# Samples of a real log are not independent, so a clear |t| is far above the usual 3, and more so for a few edges.
CLEAR_T = 10.0
CLEAR_T_OF_MANY = 5.0
_MANY = 8
# Of the edges weighted by size at least nine tenths agree: sum(dI dV) is 0.8 of sum(|dI dV|).
CLEAR_AGREEMENT = 0.8
#: Edges that agree by this much have one sign throughout: a fiftieth of them turned would leave less.
_ONE_SIGN = 0.96
#: Fewest edges on each side of the moment at which a sign turns: fewer might be those of a late voltage.
_FEWEST_OF_PART = 4
# Smallest edge, as a fraction of the largest change and of the largest current, and above rounding.
_EDGE = 0.2
_EDGE_OF_LEVEL = 0.02
_LEAST_EDGE_A = 1e-9
# Approximate number of samples, evenly along a log, from which its noise is estimated.
_NOISE_FROM = 10_000
# A current without a sign has at most this share on its other side; a step of it lasts at least this many samples, in
# which the voltage moves on by more than this many times its noise.
_NO_SIGN, _LASTING, _GOES_ON = 0.02, 10, 3.0
# A steady current stays within this fraction of its usual value, long enough for diffusion to raise the voltage.
_STEADY = 0.1
_TREND_PARTS = 5
_TREND_LEAST_S = 300.0
# Regression over all changes: number of parts of a log with equal sums of squared changes; fewest changes, counted as
# of equal size; samples that a change spans: a voltage sampled later than the current responds to the longer one only.
_CHANGE_PARTS, _FEWEST_EQUAL_CHANGES = 10, 6
_CHANGES_OVER = (1, 4)
# Most samples by which a voltage may be older than its current, as when they are polled one after the other.
_LATE_SAMPLES = 3


class EdgeTest(NamedTuple):
    """Regression of dV on dI over the edges of the current."""

    resistance_ohm: float  #: slope [ohm], > 0 when positive current charges; NaN without edges
    edges: int  #: their number
    t_value: float  #: slope over its standard error, from the noise of the voltage between edges
    agreement: float  #: in [-1, 1], sum(dI dV) / sum(|dI dV|): 1 or -1 when all edges agree

    @property
    def sign(self) -> int:
        """1 when positive current clearly charges, -1 when it clearly discharges, else 0."""
        clear_t = CLEAR_T_OF_MANY if self.edges >= _MANY else CLEAR_T
        clear = abs(self.t_value) > clear_t and abs(self.agreement) >= CLEAR_AGREEMENT
        return int(np.sign(self.t_value)) if clear else 0


class SignEvidence(NamedTuple):
    """Effect of a positive current according to the data: verdict "charge", "discharge" or "undecidable"."""

    verdict: str
    edges: EdgeTest  #: the fast test
    trend: int  #: the slow test; 1 charge, -1 discharge, 0 unclear
    changes: int = 0  #: the regression over all changes, where neither is clear; 1 charge, -1 discharge, 0 unclear

    @property
    def likely(self) -> CurrentSign:
        """The verdict, or the sign that the edges suggest if that is undecidable."""
        discharges = self.edges.t_value < 0.0 if self.verdict == "undecidable" else self.verdict == "discharge"
        return "discharge" if discharges else "charge"

    def __str__(self) -> str:
        count = f"{self.edges.edges} edge" + "s" * (self.edges.edges != 1)
        if self.edges.sign:
            return f"{count} with dV/dI = {1e3 * self.edges.resistance_ohm:.3g} mohm (t = {self.edges.t_value:.0f})"
        if self.trend:
            return "the trend of the voltage under a steady current"
        if self.changes:
            return "the regression of the voltage on the current over all changes"
        return f"{count} of the current, t = {self.edges.t_value:.1f}, no clear trend"


def check_current_sign(evidence: SignEvidence, place: Place) -> Iterator[Finding]:
    """A finding on a current of the wrong sign, or of one that the data do not show."""
    if evidence.verdict == "discharge":
        fix = "scale = -1" if place == "setup" else "read the log with the other --current-sign"
        text = f"the voltage answers the current with the wrong sign ({evidence})"
        yield Finding("error", text, f"current > 0 must charge: {fix}")
    elif evidence.verdict == "undecidable":
        how = "drive a little" if place == "setup" else "make sure that current > 0 charges the battery"
        yield Finding("info", f"the data do not show the sign of the current ({evidence})", how)


def sign_evidence(time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> SignEvidence:
    """The sign of the current from the data.

    time_s: (T,) [s] increasing; current_A: (T,) [A] of either sign; voltage_V: (T,) [V]; NaN samples are left out.
    """
    time_s, current_A, voltage_V = where_known(time_s, current_A, voltage_V)
    edges = edge_test(current_A, voltage_V)
    trend = trend_test(time_s, current_A, voltage_V)
    clear = {edges.sign, trend} - {0}
    changes = 0 if clear else change_test(current_A, voltage_V)
    signs = clear or {changes}
    verdict = "charge" if signs == {1} else "discharge" if signs == {-1} else "undecidable"
    return SignEvidence(verdict, edges, trend, changes)


def lost_sign(current_A: np.ndarray, voltage_V: np.ndarray) -> Finding | None:
    """A finding on a current (T,) [A] without a sign, although the battery is charged and discharged.

    Where the current rises abruptly, the voltage steps up or down, and goes on that way while the current stays: the
    direction that is seen less often must be seen like that at least once.
    """
    current_A, voltage_V = where_known(current_A, voltage_V)
    if current_A.size < 2:
        return None
    ends_A = -current_A.min(), current_A.max()
    largest_A = max(ends_A)
    if min(ends_A) > _NO_SIGN * largest_A:
        return None
    size_A = np.abs(current_A)
    dI, dV = np.diff(size_A), np.diff(voltage_V)
    noise_V = max(spread(dV), resolution(voltage_V))
    rises = np.flatnonzero((dI >= _EDGE * largest_A) & (np.abs(dV) > CLEAR_T * noise_V))
    held = [k for k in rises if _goes_on(size_A[k + 1 :], voltage_V[k + 1 :], float(np.sign(dV[k])), noise_V)]
    counts = sorted((np.count_nonzero(way * dV[rises] > 0), np.count_nonzero(way * dV[held] > 0)) for way in (1, -1))
    if counts[0][1] == 0:
        return None
    return Finding(
        "error",
        "the current has lost its sign: where it rises, the voltage steps up and goes on rising in one place, and "
        "steps down in another, so charge and discharge are written alike",
        "let the logger write the sign, or a column beside it that says charge or discharge, or keep one direction "
        "with --from, --to and its --current-sign",
    )


def turned_sign(time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> Finding | None:
    """A finding on a current whose sign turns within the log: the edges before a moment contradict those after it.

    The moment is the one at which the sums of dI dV before and after it differ most.

    time_s: (T,) [s] increasing; current_A: (T,) [A]; voltage_V: (T,) [V]; NaN samples are left out.
    """
    time_s, current_A, voltage_V = where_known(time_s, current_A, voltage_V)
    whole = edge_test(current_A, voltage_V)
    if whole.edges < 2 * _MANY or abs(whole.agreement) >= _ONE_SIGN:
        return None
    edge = np.flatnonzero(_edges_of(np.diff(current_A), float(np.abs(current_A).max())))
    before = np.cumsum(np.diff(current_A)[edge] * np.diff(voltage_V)[edge])
    last = int(np.argmax(np.abs(2.0 * before - before[-1])))
    if last + 1 >= edge.size:
        return None
    stop, start = edge[last] + 1, edge[last + 1] + 1
    parts = [edge_test(current_A[part], voltage_V[part]) for part in (slice(stop + 1), slice(start, None))]
    if min(part.edges for part in parts) < _FEWEST_OF_PART or parts[0].sign * parts[1].sign != -1:
        return None
    ways = ["charges" if part.sign > 0 else "discharges" for part in parts]
    return Finding(
        "error",
        f"the sign of the current turns: positive {ways[0]} the battery up to {time_s[stop]:g} s "
        f"({parts[0].edges} edges) and {ways[1]} it from {time_s[start]:g} s on ({parts[1].edges} edges)",
        f"read each part alone, with --to {time_s[stop]:g} and with --from {time_s[start]:g}",
    )


def _goes_on(size_A: np.ndarray, voltage_V: np.ndarray, way: float, noise_V: float) -> bool:
    """True if the voltage (T,) goes on one way (1 up, -1 down) while the current (T,) stays near its first value."""
    changed = np.abs(size_A - size_A[0]) > _STEADY * size_A[0]
    stop = int(np.argmax(changed)) if changed.any() else size_A.size
    return stop >= _LASTING and way * (voltage_V[stop - 1] - voltage_V[0]) > _GOES_ON * noise_V


def edge_test(current_A: np.ndarray, voltage_V: np.ndarray) -> EdgeTest:
    """Regression of dV on dI, through the origin: R = sum(dI dV) / sum(dI^2) over changes between neighbours.

    An edge is at least a fifth of the largest change, 2 % of the largest current and six times the usual change. The
    error of R comes from the changes of the voltage between edges (noise or slow drift, whichever is larger) or from
    the rounding of two samples, if that is larger.

    current_A, voltage_V: (T,), no NaN.
    """
    dI, dV = np.diff(current_A), np.diff(voltage_V)
    some = slice(None, None, max(dI.size // _NOISE_FROM, 1))
    largest_A = max(-current_A.min(initial=0.0), current_A.max(initial=0.0))
    edge = _edges_of(dI, largest_A)
    if not edge.any():
        return EdgeTest(np.nan, 0, 0.0, 0.0)
    products = dI[edge] * dV[edge]
    squares = float(dI[edge] @ dI[edge])
    between = np.abs(dV[some][~edge[some]])
    drift = float(np.percentile(between, 95)) / 2 if between.size else 0.0
    error = max(spread(dV[some]), drift, resolution(voltage_V[some]) / np.sqrt(6.0)) / np.sqrt(squares)
    slope = float(products.sum()) / squares
    total = float(np.abs(products).sum())
    if total == 0.0 or error == 0.0 or _answers_later(dI, dV, slope):
        return EdgeTest(slope, int(edge.sum()), 0.0, 0.0)
    return EdgeTest(slope, int(edge.sum()), slope / error, float(products.sum()) / total)


def _edges_of(dI: np.ndarray, largest_A: float) -> np.ndarray:
    """Mask (T - 1,) of the changes of the current [A] that are edges, see `edge_test`."""
    size = np.abs(dI)
    least = max(_EDGE * size.max(initial=0.0), _EDGE_OF_LEVEL * largest_A, _LEAST_EDGE_A)
    return (size >= least) & (size > 6.0 * spread(dI[:: max(dI.size // _NOISE_FROM, 1)]))


def _answers_later(dI: np.ndarray, dV: np.ndarray, slope_ohm: float) -> bool:
    """True if the voltage responds to changes of the current some samples later, and with the opposite sign.

    The fit is dV_k = sum over j of R_j dI_{k-j}, all samples k: if a current turns back soon, a late voltage seems to
    respond at once to its way back.
    """
    count = dI.size - _LATE_SAMPLES
    if count <= _LATE_SAMPLES:
        return False
    earlier = [dI[_LATE_SAMPLES - j : _LATE_SAMPLES - j + count] for j in range(_LATE_SAMPLES + 1)]
    products = np.array([[a @ b for b in earlier] for a in earlier])
    answers = np.array([a @ dV[_LATE_SAMPLES:] for a in earlier])
    answers_ohm = np.linalg.lstsq(products, answers, rcond=None)[0]
    clearest_ohm = answers_ohm[np.argmax(np.abs(answers_ohm))]
    return bool(clearest_ohm * slope_ohm < 0.0 and abs(clearest_ohm) >= abs(slope_ohm))


def trend_test(time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> int:
    """1 if a steady current raises the voltage when positive or lowers it when negative, -1 the reverse, 0 unclear.

    The longest steady stretch counts. It must last five minutes, and the voltage must move the same way from each fifth
    of it to the next without dying out: relaxation after a larger current moves it too, but fades.

    time_s, current_A, voltage_V: (T,), no NaN.
    """
    steady = _longest_steady(time_s, current_A)
    if steady is None or time_s[steady][-1] - time_s[steady][0] < _TREND_LEAST_S:
        return 0
    time_s, of_steady_V = time_s[steady], voltage_V[steady]
    part = np.searchsorted(np.linspace(time_s[0], time_s[-1], _TREND_PARTS + 1)[1:-1], time_s, side="right")
    count = np.bincount(part, minlength=_TREND_PARTS)
    if not count.all():
        return 0
    moves = np.diff(np.bincount(part, of_steady_V, _TREND_PARTS) / count)
    noise = max(spread(np.diff(of_steady_V)), resolution(voltage_V))
    one_way = bool(np.all(moves > 0) or np.all(moves < 0))
    if not one_way or abs(moves.sum()) < CLEAR_T * noise or abs(moves[-1]) < 0.5 * abs(moves[1]):
        return 0
    return int(np.sign(moves[0]) * np.sign(np.median(current_A[steady])))


def change_test(current_A: np.ndarray, voltage_V: np.ndarray) -> int:
    """1 if the voltage moves with all changes of the current, -1 if against them, 0 unclear.

    dV = R dI over changes of the current between samples, and over several of them, must give the same clear sign of R,
    and so must its rises and its falls: a charger that tapers off lets the current fall while the voltage still rises.

    current_A, voltage_V: (T,), no NaN.
    """
    signs = set()
    for over in _CHANGES_OVER:
        dI, dV = current_A[over:] - current_A[:-over], voltage_V[over:] - voltage_V[:-over]
        agree = all(np.sign(dI[way] @ dV[way]) == np.sign(dI @ dV) for way in (dI > 0.0, dI < 0.0))
        signs.add(_sign_of_changes(dI, dV) if agree else 0)
    return signs.pop() if len(signs) == 1 else 0


def _sign_of_changes(dI: np.ndarray, dV: np.ndarray) -> int:
    """Sign of R in dV = R dI over changes (N,) where it is clear, else 0.

    The error of R comes from how much the parts of the log disagree, which is valid for dependent samples, too.
    """
    squares = np.cumsum(dI * dI)
    if not squares.size or squares[-1] ** 2 < _FEWEST_EQUAL_CHANGES * np.sum(dI**4) or squares[-1] == 0.0:
        return 0
    part = np.minimum((_CHANGE_PARTS * squares / squares[-1]).astype(int), _CHANGE_PARTS - 1)
    products = np.bincount(part, dI * dV, _CHANGE_PARTS)
    slope = products.sum() / squares[-1]
    left = products - slope * np.bincount(part, dI * dI, _CHANGE_PARTS)
    error = np.sqrt(left @ left * _CHANGE_PARTS / (_CHANGE_PARTS - 1)) / squares[-1]
    return int(np.sign(slope)) if abs(slope) > CLEAR_T_OF_MANY * error and slope != 0.0 else 0


def _longest_steady(time_s: np.ndarray, current_A: np.ndarray) -> slice | None:
    """The longest stretch, in time, in which the current stays within a tenth of its usual value outside rests."""
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
