"""The size of a current, checked against the voltage: a number that wrapped, a forgotten unit, a hidden charge."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from ohmward.quantities import QUANTITIES, SECONDS_PER_HOUR
from ohmward.runs import long_runs, where_known
from ohmward.signals.checks import Finding, Scale, rescale, scales_of
from ohmward.signals.current_sign import edge_test
from ohmward.signals.survey import running_median, spread

#: Bits of the numbers; those of whose range a current with a sign may use half; smallest share of that half used.
_BITS, _BITS_OF_SIGNED, _USED = (16, 32), 16, 0.5
#: Last digits [A] that are tried, the smallest first.
_LAST_DIGITS_A = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
#: Smallest edge of the voltage as a share of the largest; most edges examined.
_EDGE, _MOST_EDGES = 0.2, 300
#: Fewest edges that wrapped, and that did not; largest sum of their squared residuals as a share of that as logged. The
#: same for a few that wrapped, as of a charge that begins and ends once. Steps above the last share of the range show
#: the resistance.
_FEWEST_OF_EACH, _LEFT = 5, 0.1
_FEW, _LEFT_BY_FEW = 2, 0.01
#: A current whose ends both lie within the last 1 % of the range has wrapped where it leaves much of the voltage's
#: squares unexplained, and adding the range explains most of that: steps may then exceed the range.
_FULL, _LEFT_BY_FULL = 0.99, 0.3
#: Of currents that wrapped several times: the largest edges in ranges of the number, how many resistances are tried,
#: the smallest coherence of all edges, and the fewest that wrapped. As logged, they leave this share of the voltage's
#: squares unexplained.
_RANGES, _COHERENT, _FEWEST_WRAPPED, _UNEXPLAINED_SHARE = np.linspace(0.8, 4.0, 400), 0.8, 25, 0.25
_LARGE = 0.02
#: Tolerance with which a number is whole in its last digit. One without a sign, read with it, must leave less than this
#: share of what the voltage's steps leave otherwise.
_WHOLE_NUMBER_WITHIN, _BETTER = 1e-3, 0.2
#: Edges with squared residuals up to this many times those of the noise contradict nothing. Most resistances tried.
_NOISE, _MOST_OHMS = 4.0, 100
#: A cell has more than this resistance [ohm], except those of hundreds of ampere-hours, and at most this voltage [V].
LEAST_CELL_OHM, HIGHEST_CELL_V = 3e-4, 4.3
#: Cells that are logged have less than this resistance [ohm].
_MOST_CELL_OHM = 0.5
#: A name that gives the unit is doubted where the resistance is beyond those of cells by this factor: cells of
#: hundreds of ampere-hours in parallel and cold small ones keep their names, a thousandth or thousandfold does not.
_NAMED = 4.0
#: A resistance times the charge one way, the voltage lost at 1 C, is less than this many times the voltage: 0.02 to 0.1
#: of a cell, 0.4 where edges include relaxation, 0.7 where the charges between are not logged.
_MOST_LOST = 2.0
#: A resistance is too small if it is by this many standard errors; smallest peak current [A] that is questioned.
_CERTAIN, _DOUBTFUL_FROM_A = 3.0, 20.0
#: A current whose smallest size is more than this share of the largest is never near 0.
_NEVER_SMALL = 0.5

#: Largest factor between the resistance that a current shows and the battery file's, and between that and the one it
#: showed before: of measured cells in windows of half a minute up to 9 and 7, cold, sampled late and nearly empty.
_FROM_FILE, _FROM_BEFORE = 50.0, 6.5
#: The same from the file's at the measured temperature, where it lasts: 0.15 to 1.8 over labels, of six cells.
_FROM_FILE_LASTING = 10.0


#: A charge that the current sensor does not show.
HIDDEN_CHARGE = "shows a discharge or none where the voltage rises as by a charge (does the charger bypass it?)"
#: Without a battery file: share of the largest current from which a battery is charged, and below which it is idle;
#: width of the median filter; time [s] after a load in which its voltage relaxes, to rise no further by the last share.
_CHARGES, _IDLE, _MEDIAN_OF, RELAXED_S, _HIDDEN = 0.005, 0.1, 5, 1200.0, 0.03


def check_hidden_charge(time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> Iterator[Finding]:
    """A finding on the first stretch without a charging current in which the voltage rises as in a charge.

    time_s: (T,) [s] increasing; current_A: (T,), > 0 charges; voltage_V: (T,); nan where not known.
    """
    time_s, current_A, voltage_V = where_known(time_s, current_A, voltage_V)
    if current_A.size < _MEDIAN_OF:
        return
    usual_A = running_median(current_A, _MEDIAN_OF)  # noise ends no rest
    largest_A = np.abs(usual_A).max()
    idle = (usual_A < _CHARGES * largest_A) & (usual_A > -_IDLE * largest_A)
    for first, stop in long_runs(idle, time_s, 2 * RELAXED_S):
        late = np.flatnonzero(time_s[first:stop] > time_s[first] + RELAXED_S) + first
        at_first_V = voltage_V[late[: late.size // 5]].max(initial=0.0)  # small loads dip below it, and come back
        if np.count_nonzero(voltage_V[late] - at_first_V > _HIDDEN * np.median(voltage_V)) > late.size // 10:
            from_h, to_h = time_s[[first, stop - 1]] / SECONDS_PER_HOUR
            text = f"in the {to_h - from_h:.2g} h from {from_h:.2g} h on the current sensor {HIDDEN_CHARGE}"
            yield Finding("warning", text, "let the sensor see all current of the battery, or keep another part")
            return


def check_wrapped(current_A: np.ndarray, voltage_V: np.ndarray) -> Iterator[Finding]:
    """A finding on a current that wrapped: the range of the number, and how often.

    current_A, voltage_V: (T,) of the battery, of either sign; nan where not known.
    """
    current_A, voltage_V = where_known(current_A, voltage_V)
    largest_A = float(np.abs(current_A).max(initial=0.0))
    for bits, digit_A in product(_BITS, _LAST_DIGITS_A):
        range_A = digit_A * 2**bits
        count = 0
        if range_A / 2 < largest_A <= range_A:
            fault = "without a sign, in which one wrapped below 0"
            count = _count_below_zero(current_A, voltage_V, range_A, digit_A)
        elif bits == _BITS_OF_SIGNED and _USED * range_A / 2 <= largest_A <= range_A / 2:
            fault = f"that wrapped beyond {range_A / 2:g} A"
            is_full = min(current_A.max(), -current_A.min()) >= _FULL * range_A / 2
            count = count_wraps(np.diff(current_A), np.diff(voltage_V), range_A, is_full)
        if count:
            text = (
                f"the voltage contradicts {count} steps of the current unless {range_A:.10g} A are added: a {bits}-bit "
                f"number of {1e3 * digit_A:g} mA {fault}"
            )
            yield Finding("error", text, "let its sender write more bits, or another unit")
            return


def _count_below_zero(current_A: np.ndarray, voltage_V: np.ndarray, range_A: float, digit_A: float) -> int:
    """Number of edges at which a current without a sign (T,) crossed zero; 0 if it is explained as well as logged.

    Values in the upper half of the range are taken as negative. That must leave far less of the steps of the voltage
    (T,) than the current as it stands, and than a current that has lost its sign.
    """
    counts = current_A / digit_A
    if current_A.min() < 0.0 or np.abs(counts - np.rint(counts)).max() > _WHOLE_NUMBER_WITHIN:
        return 0
    dI, dV = np.diff(current_A), np.diff(voltage_V)
    edge = _voltage_edges(dI, dV)
    if edge.size < _FEWEST_OF_EACH:
        return 0
    dI_signed = np.diff(np.where(current_A > range_A / 2, current_A - range_A, current_A))[edge]
    difference_A, sum_A = dI[edge], current_A[edge] + current_A[edge + 1]
    without_sign_A = np.stack([difference_A, -difference_A, sum_A, -sum_A], axis=1)
    left_V2 = _squares_of_choices(without_sign_A, dV[edge], range_A).min(axis=2).sum(axis=1)
    other_V2 = min(_unexplained(difference_A, dV[edge]), left_V2.min(initial=np.inf))
    is_better = _unexplained(dI_signed, dV[edge]) < _BETTER * other_V2
    return int(np.count_nonzero(difference_A != dI_signed)) if is_better else 0


def _voltage_edges(dI: np.ndarray, dV: np.ndarray) -> np.ndarray:
    """Indices of the large steps of the voltage (T - 1,) at which the current changes, at most about `_MOST_EDGES`."""
    size = np.abs(dV)
    edge = np.flatnonzero((size >= _EDGE * size.max(initial=0.0)) & (size > 6.0 * spread(dV)) & (dI != 0.0))
    return edge[:: max(edge.size // _MOST_EDGES, 1)]


def _unexplained(dI: np.ndarray, dV: np.ndarray) -> float:
    """Sum of the squares [V2] that dV = R dI leaves, over edges (n,)."""
    return float(dV @ dV) - float(dI @ dV) ** 2 / max(float(dI @ dI), 1e-300)


def _squares_of_choices(steps_A: np.ndarray, dV: np.ndarray, range_A: float) -> np.ndarray:
    """Squares [V2] left (resistances, n, k) by each of the possible steps (n, k) of the current at each edge (n,)."""
    large = np.abs(steps_A) > _LARGE * range_A
    ohms = np.sort(np.broadcast_to(dV[:, None], steps_A.shape)[large] / steps_A[large])
    ohms = ohms[:: max(ohms.size // _MOST_OHMS, 1)]
    return (dV[:, None] - ohms[:, None, None] * steps_A) ** 2


def count_wraps(dI: np.ndarray, dV: np.ndarray, range_A: float, is_full: bool = False) -> int:
    """Number of edges at which the current wrapped; 0 if the edges as logged are explained equally well.

    dI, dV: (T - 1,) steps of current [A] and voltage [V].  is_full: the current reaches both ends of the range.
    """
    noise_V = spread(dV)
    edge = _voltage_edges(dI, dV)
    if edge.size < _FEWEST_OF_EACH:
        return 0
    dI, dV = dI[edge], dV[edge]
    as_logged = _unexplained(dI, dV)
    if as_logged <= _NOISE * edge.size * noise_V**2:
        return 0
    is_unexplained = as_logged > _UNEXPLAINED_SHARE * float(dV @ dV)
    is_full = is_full and is_unexplained
    missing_A = range_A * np.sign(dI)
    steps_A = np.stack([dI, dI - missing_A, dI + missing_A][: 2 + is_full], axis=1)
    left_V2 = _squares_of_choices(steps_A, dV, range_A)
    left = left_V2.min(axis=2).sum(axis=1)
    if not left.size or left.min() > (_LEFT_BY_FULL if is_full else _LEFT) * as_logged:
        return _count_by_phase(dI, dV, range_A) if is_unexplained else 0
    is_wrapped = np.argmin(left_V2[np.argmin(left)], axis=1) > 0
    count = int(is_wrapped.sum())
    fewest = _FEW if left.min() <= _LEFT_BY_FEW * as_logged else _FEWEST_OF_EACH
    return count if count >= fewest and is_wrapped.size - count >= _FEWEST_OF_EACH else 0


def _count_by_phase(dI: np.ndarray, dV: np.ndarray, range_A: float) -> int:
    """Number of edges (n,) at which the current wrapped once or several times; 0 if the edges are not coherent.

    Whatever multiple of the range a step lacks, its phase 2 pi dI / range is that of dV / R, R > 0 or < 0.
    """
    per_V = 2.0 * np.pi * np.concatenate([_RANGES, -_RANGES]) / np.quantile(np.abs(dV), 0.9)
    phase = 2.0 * np.pi * dI / range_A
    coherence = np.cos(phase - per_V[:, None] * dV).mean(axis=1)
    best = np.argmax(coherence)
    wraps = np.rint(per_V[best] * dV / (2.0 * np.pi) - dI / range_A)
    count = int(np.count_nonzero(wraps))
    # edges of one size would be coherent by chance, and those that the current shows later
    if np.abs(np.exp(1j * phase).mean()) >= _COHERENT or np.unique(np.abs(wraps)).size < 2:
        return 0
    return count if coherence[best] >= _COHERENT and count >= _FEWEST_WRAPPED else 0


def check_size(measured_ohm: float, file_ohm: float, usual_ohm: float, lasts: bool = False) -> Iterator[Finding]:
    """A finding on a current that is a power of ten too large or too small.

    measured_ohm: dV/dI of the last samples [ohm], nan if they do not show it.  file_ohm: by the battery file.
    usual_ohm: dV/dI of the samples before [ohm], nan if unknown.  lasts: True where it has been that for minutes, and
        file_ohm is that at the measured temperature.
    """
    for most, other_ohm, whose in (
        (_FROM_BEFORE, usual_ohm, "what it was before"),
        (_FROM_FILE_LASTING if lasts else _FROM_FILE, file_ohm, "that of the battery file"),
    ):
        ratio = measured_ohm / other_ohm
        if not 1.0 / most <= ratio <= most and np.isfinite(ratio):
            factor = 10.0 ** np.rint(np.log10(ratio))
            quantity = QUANTITIES["battery_current_A"]
            unit = [rescale(quantity, s, "setup") for s in scales_of(quantity) if np.isclose(s.factor, factor)]
            text = f"the voltage answers it with dV/dI = {1e3 * measured_ohm:.2g} mohm, {ratio:.2g} times {whose}"
            yield Finding("error", text, unit[0] if unit else f"another unit? then scale = {factor:g}")
            return


class NoAmperes(NamedTuple):
    """A current that cannot be in amperes."""

    reason: str  #: a clause
    scale: Scale | None  #: the likely unit; None for a larger one


def not_in_amperes(current_A: np.ndarray, voltage_V: np.ndarray, is_named: bool = False) -> NoAmperes | None:
    """The reason why a current is not in amperes: the resistance would be less than cells have, or more; else None.

    It would be more for a power in kilowatts that is read in watts.

    current_A, voltage_V: (T,), nan where not known.  is_named: the log gives the unit, which is seldom wrong.
    """
    beyond = _NAMED if is_named else 1.0
    current_A, voltage_V = where_known(current_A, voltage_V)
    edges = edge_test(current_A, voltage_V)
    if edges.t_value == 0.0:
        return None
    largest_A, ohm = float(np.abs(current_A).max()), abs(edges.resistance_ohm)
    error_ohm = ohm * _CERTAIN / abs(edges.t_value)
    fewest_cells = max(float(np.median(voltage_V)) / HIGHEST_CELL_V, 1.0)
    least_ohm = LEAST_CELL_OHM / beyond * fewest_cells
    seen = f"it goes to {largest_A:.3g} A at dV/dI ="
    if largest_A >= _DOUBTFUL_FROM_A and ohm + error_ohm <= least_ohm:
        factor = 1e-3 if 1e3 * (ohm + error_ohm) > least_ohm else 1e-6
        scale = next(scale for scale in scales_of(QUANTITIES["battery_current_A"]) if scale.factor == factor)
        is_small = np.abs(current_A).min() <= _NEVER_SMALL * largest_A
        counts = "" if is_small else ", and is never near 0 (raw counts of a converter? convert them)"
        return NoAmperes(f"{seen} {1e3 * ohm:.2g} mohm, less than cells have{counts}", scale)
    if edges.sign and ohm - error_ohm >= _MOST_CELL_OHM * beyond * fewest_cells:
        return NoAmperes(f"{seen} {ohm:.2g} ohm, more than cells have", None)
    return None


def charge_of_no_battery(time_s: np.ndarray, current_A: np.ndarray, voltage_V: np.ndarray) -> str:
    """What no battery has at once, the charge that went one way and the resistance; "" for a possible pair.

    time_s: (T,) [s]; current_A, voltage_V: (T,), nan where not known.
    """
    time_s, current_A, voltage_V = where_known(time_s, current_A, voltage_V)
    edges = edge_test(current_A, voltage_V)
    if not edges.sign:
        return ""
    flowed_Ah = np.ptp(np.cumsum(current_A[1:] * np.diff(time_s))) / SECONDS_PER_HOUR
    ohm = abs(edges.resistance_ohm)
    if flowed_Ah * ohm <= _MOST_LOST * np.median(voltage_V):
        return ""
    return f"a charge of {flowed_Ah:,.4g} Ah one way at dV/dI = {1e3 * ohm:.3g} mohm, which no battery has at once"
