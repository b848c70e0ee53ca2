"""Results of the identification along one log: edges, relaxations ([P] 2.2, 2.3), its residual, and what does not fit.

At an edge of the current the voltage jumps by R_0 di; in a rest it is V_inf + a_1 e^(-t/tau_1) + a_2 e^(-t/tau_2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import LogFit
from ohmward.battery.chemistries import CHEMISTRIES, chemistry_contradiction
from ohmward.battery.identification.fit_samples import COARSEST_S, FitSamples
from ohmward.battery.identification.ocv_from_logs import OcvBranch, RestPoint, rest_points
from ohmward.battery.identification.record import Phase, Record, find_pulses, find_rests
from ohmward.battery.identification.soc_axis import COLDEST_EMPTY_DEGC, SocAxis
from ohmward.battery.log_check import OTHER_FILE
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import Thevenin
from ohmward.filters.consistency import BAND_95
from ohmward.logs.log import Note

#: Longest interval across an edge [s], unless the log is slower.
SLOWEST_EDGE_S = 2.0
#: Smallest edge: C/10.
_SMALLEST_RATE = 1 / 10
#: Fewest edges for a resistance with a standard error.
_FEWEST_EDGES = 3
#: A log from full to empty: largest distance from either, and SoC whose voltage it reaches.
_WHOLE_WITHIN, _EMPTIED_SOC = 0.03, 0.02


class Edge(NamedTuple):
    """One jump of the current from one sample to the next."""

    soc: float
    step_A: float  #: change of the current
    current_A: float  #: the larger of both in magnitude, whose sign is the direction
    resistance_ohm: float  #: dV / dI


class EdgeResistance(NamedTuple):
    """R_0 of one direction from all its edges: weighted mean [ohm], its standard error, the number of edges."""

    ohm: float
    std_ohm: float
    edges: int


def find_edges(record: Record, soc: np.ndarray, capacity_Ah: float) -> tuple[Edge, ...]:
    """Jumps of the current of more than C/10 within 2 s (or the log's own interval, if that is longer).

    Within dt the RC pairs move as well: the resistance is R_0 and about dt/tau_1 of r_1.
    soc: (T,) state of charge along the record.
    """
    before_A, after_A = record.current_A[:-1], record.current_A[1:]
    step_A, step_V = after_A - before_A, np.diff(record.log.voltage_V)
    dt_s = np.diff(record.log.time_s)
    longest_s = max(SLOWEST_EDGE_S, 1.5 * float(np.median(dt_s)))
    sharp = (np.abs(step_A) > _SMALLEST_RATE * capacity_Ah) & (dt_s <= longest_s) & np.isfinite(step_V)
    larger_A = np.where(np.abs(after_A) > np.abs(before_A), after_A, before_A)
    columns = np.column_stack([soc[1:], step_A, larger_A, step_V])[sharp]
    return tuple(Edge(s, step, larger, step_of_V / step) for s, step, larger, step_of_V in columns.tolist())


def edge_resistance(edges: Sequence[Edge], direction: int) -> EdgeResistance | None:
    """R_0 in discharge (direction -1) or charge (1): least squares of dV over dI, or None from fewer than 3 edges."""
    mine = [e for e in edges if np.sign(e.current_A) == direction]
    if len(mine) < _FEWEST_EDGES:
        return None
    step_A = np.array([e.step_A for e in mine])
    ohm = np.array([e.resistance_ohm for e in mine])
    weight = step_A**2 / np.sum(step_A**2)
    mean = float(weight @ ohm)
    variance = np.sum(weight**2 * (ohm - mean) ** 2)
    return EdgeResistance(mean, float(np.sqrt(variance)), len(mine))


def edge_notes(edges: Sequence[Edge]) -> tuple[Note, ...]:
    """Notes on R_0 of each direction from its edges, to compare with the fit."""
    found = {word: edge_resistance(edges, sign) for word, sign in (("discharge", -1), ("charge", 1))}
    return tuple(
        Note(f"{r.edges} edges show R_0 = {1e3 * r.ohm:.3g} ± {1e3 * BAND_95 * r.std_ohm:.2g} mohm in {word}")
        for word, r in found.items()
        if r
    )


#: Shortest rest [s] and fewest samples in which two time constants may show.
_SHORTEST_RELAXATION_S = 120.0
_FEWEST_OF_A_REST = 8
#: Samples of a longer rest that are used, denser at its start.
_MOST_OF_A_REST = 200
#: Points of the grid of time constants, and the smallest ratio of two.
_TAUS = 24
_SMALLEST_RATIO = 2.0
#: Refinements of the grid, and power to which each raises the ratio of neighbouring points.
_REFINEMENTS = 2
_REFINEMENT = 0.4
#: Keeps similar exponentials from making the normal equations singular.
_EXPONENTIALS_RIDGE = 1e-12


class ExponentialFit(NamedTuple):
    """Sum of exponentials through one rest."""

    v_inf_V: float  #: voltage [V] that it tends to
    #: (n,) of each exponential
    amplitude_V: tuple[float, ...]
    tau_s: tuple[float, ...]
    rms_V: float  #: of the residual
    aic: float  #: Akaike's criterion, smaller is better
    voltage_V: np.ndarray  #: (N,) along the rest


class Relaxation(NamedTuple):
    """A rest after a current, and its fits."""

    soc: float
    before_A: float  #: the current before
    time_s: np.ndarray  #: (N,) since the start of the rest
    voltage_V: np.ndarray  #: (N,) measured
    #: fits with one and with two time constants
    single: ExponentialFit
    double: ExponentialFit

    @property
    def pairs(self) -> int:
        """Number of time constants by Akaike's criterion, 1 or 2."""
        return 2 if self.double.aic < self.single.aic else 1


def find_relaxations(record: Record, soc: np.ndarray) -> tuple[Relaxation, ...]:
    """Fits of every rest of at least 2 minutes and 8 samples; soc: (T,) along the record."""
    rests = [p for p in find_rests(record.phases, _SHORTEST_RELAXATION_S) if p.last - p.first >= _FEWEST_OF_A_REST]
    found = (_relaxation(record, soc, rest) for rest in rests)
    return tuple(r for r in found if r is not None)


def fit_exponentials(time_s: np.ndarray, voltage_V: np.ndarray, pairs: int) -> ExponentialFit:
    """Best sum of `pairs` exponentials, by linear least squares for each set of time constants on a grid.

    time_s: (N,) from 0; voltage_V: (N,). The grid is refined around its best point.
    """
    fastest_s = max(np.median(np.diff(time_s)), time_s[-1] / 2000)
    grid = np.geomspace(fastest_s, 2 * time_s[-1], _TAUS)
    best = _best_of(time_s, voltage_V, [c for c in combinations(grid, pairs) if _apart(c)])
    step = grid[1] / grid[0]
    for _ in range(_REFINEMENTS):
        step = step**_REFINEMENT
        around = [tau * step ** np.arange(-2.0, 3.0) for tau in best.tau_s]
        candidates = np.stack(np.meshgrid(*around, indexing="ij"), axis=-1).reshape(-1, pairs)
        best = _best_of(time_s, voltage_V, [tuple(c) for c in candidates.tolist() if _apart(c)])
    return best


def _relaxation(record: Record, soc: np.ndarray, rest: Phase) -> Relaxation | None:
    rows = np.arange(rest.first, rest.last + 1)
    rows = rows[np.isfinite(record.log.voltage_V[rows])]
    if rows.size < _FEWEST_OF_A_REST:
        return None
    time_s = record.log.time_s[rows] - record.log.time_s[rest.first]
    denser_at_start = np.linspace(0.0, np.sqrt(time_s[-1]), _MOST_OF_A_REST) ** 2
    used = np.unique(np.searchsorted(time_s, denser_at_start).clip(0, rows.size - 1))
    time_s, voltage_V = time_s[used], record.log.voltage_V[rows[used]]
    before = next(p for p in reversed(record.phases) if p.last < rest.first)
    single, double = (fit_exponentials(time_s, voltage_V, pairs) for pairs in (1, 2))
    return Relaxation(float(soc[rest.first]), before.current_A, time_s, voltage_V, single, double)


def _apart(taus: Sequence[float]) -> bool:
    return all(b >= _SMALLEST_RATIO * a for a, b in pairwise(taus))


def _best_of(time_s: np.ndarray, voltage_V: np.ndarray, candidates: list[tuple[float, ...]]) -> ExponentialFit:
    """The best of several sets of time constants (C, n): all their linear problems at once."""
    taus = np.array(candidates)
    constant = np.ones((len(taus), time_s.size, 1))
    decays = np.exp(-time_s[:, None] / taus[:, None, :])
    A = np.concatenate([constant, decays], axis=2)
    transposed = A.transpose(0, 2, 1)
    H = transposed @ A + _EXPONENTIALS_RIDGE * np.eye(A.shape[2])
    x = np.linalg.solve(H, transposed @ voltage_V[:, None])
    fitted = (A @ x)[..., 0]
    rss = np.sum((voltage_V - fitted) ** 2, axis=1)
    k = int(np.argmin(rss))
    N, unknowns = time_s.size, 1 + 2 * taus.shape[1]
    mean_square = max(float(rss[k]) / N, 1e-18)
    return ExponentialFit(
        v_inf_V=float(x[k, 0, 0]),
        amplitude_V=tuple(x[k, 1:, 0].tolist()),
        tau_s=tuple(taus[k].tolist()),
        rms_V=float(np.sqrt(mean_square)),
        aic=float(N * np.log(mean_square) + 2 * unknowns),
        voltage_V=fitted[k],
    )


@dataclass(frozen=True, eq=False)
class LogDetails:
    """Stages of the identification on one log that the circuit was fitted to."""

    record: Record
    axis: SocAxis  #: its state of charge and the anchors of that
    parts: tuple[FitSamples, ...]  #: samples used by the fit, divided at gaps
    simulated_V: tuple[np.ndarray, ...]  #: voltage of the circuit along each part, (N,) each
    model: Thevenin  #: the circuit

    @property
    def is_whole(self) -> bool:
        """True where the log goes from full to empty by its charge, and its voltage falls to that of empty.

        In the cold a load takes the voltage there early.
        """
        soc, degC = self.axis.soc, self.record.typical_degC()
        warm = degC is None or degC >= COLDEST_EMPTY_DEGC
        ends = soc.max() >= 1.0 - _WHOLE_WITHIN and abs(soc.min()) <= _WHOLE_WITHIN
        empty_V = float(self.model.ocv.mean_V(_EMPTIED_SOC, ROOM_DEGC))
        return bool(warm and ends and np.nanmin(self.record.log.voltage_V) <= empty_V)

    @property
    def pulses(self) -> tuple[Phase, ...]:
        """Pulses of the current."""
        return find_pulses(self.record.phases, self.model.capacity_Ah)

    @cached_property
    def edges(self) -> tuple[Edge, ...]:
        """Jumps of the current."""
        return find_edges(self.record, self.axis.soc, self.model.capacity_Ah)

    @cached_property
    def relaxations(self) -> tuple[Relaxation, ...]:
        """Rests with the exponentials fitted to them."""
        return find_relaxations(self.record, self.axis.soc)

    @property
    def rests(self) -> tuple[RestPoint, ...]:
        """Ends of long rests."""
        return rest_points(self.record, self.axis.soc)

    @property
    def residual_V(self) -> tuple[np.ndarray, ...]:
        """Measured minus simulated voltage of each part, (N,) each."""
        return tuple(s.voltage_V - v for s, v in zip(self.parts, self.simulated_V, strict=True))

    @property
    def quality(self) -> LogFit:
        """Range of SoC and residual of the fit below gassing; samples are weighted by the time they stand for."""
        residual_V, modelled = np.concatenate(self.residual_V), self._modelled
        weight = np.minimum(np.concatenate([s.dt_s for s in self.parts])[modelled], COARSEST_S)
        mean_square = weight @ residual_V[modelled] ** 2 / max(weight.sum(), 1e-9)
        largest_V = float(np.abs(residual_V[modelled]).max(initial=0.0))
        return log_fit(self.record.log.name, self.record.test, self.axis.soc, float(np.sqrt(mean_square)), largest_V)

    @property
    def gassing_share(self) -> float:
        """Share of the measured samples at which the battery gases."""
        return 1.0 - int(np.count_nonzero(self._modelled)) / max(int(np.count_nonzero(self._measured)), 1)

    @property
    def _measured(self) -> np.ndarray:
        return np.isfinite(np.concatenate(self.residual_V))

    @property
    def _modelled(self) -> np.ndarray:
        voltage_V = np.concatenate([s.voltage_V for s in self.parts])
        return self._measured & (voltage_V < (self.model.gassing_V or np.inf))


def log_fit(name: str, test: str, soc: np.ndarray, rms_V: float = 0.0, largest_V: float = 0.0) -> LogFit:
    """Entry of a log in the provenance of a battery; soc: (T,) along it."""
    return LogFit(name, test, float(soc.min()), float(soc.max()), rms_V, largest_V)


def branch_fits(branches: Sequence[OcvBranch]) -> tuple[LogFit, ...]:
    """Entries of the low-rate tests that gave the OCV curve."""
    return tuple(log_fit(b.log_name, f"low-rate {b.direction}", b.soc) for b in branches)


#: Share by which usual voltages may lie beyond the curve: cells of one chemistry differ, and a log may be a charge. By
#: this much they are of another number of cells.
_BEYOND_CURVE, OTHER_CELLS = 0.08, 0.5

#: Largest RMS error of the voltage over the range of the open-circuit voltage from empty to full. Files that estimate
#: well reproduce tests of twenty cells, measured and of porous electrodes, to within 0.041.
MOST_OF_RANGE = 0.1


def is_reproduced(fit: LogFit, ocv: OcvCurve) -> bool:
    """True where the voltage of a circuit with this curve is close enough to that of the log."""
    return fit.residual_rms_V <= MOST_OF_RANGE * _range_V(ocv)


def _range_V(ocv: OcvCurve) -> float:
    return ocv.voltage_V[-1] - ocv.voltage_V[0]


def fit_notes(logs: Sequence[LogDetails], fits: Sequence[LogFit], ocv: OcvCurve) -> tuple[Note, ...]:
    """A warning for each log that the circuit does not reproduce, and where gassing was left out."""
    gassing = [
        f"{log.gassing_share:.0%} of {log.record.log.name!r} lie above {log.model.gassing_V:.4g} V, where the battery "
        "gases: no circuit models that, the voltage error leaves it out, and the filters do not use it"
        for log in logs
        if log.gassing_share > 0.0
    ]
    misfits = [
        f"the model does not fit {fit.log!r}: its voltage is off by {fit.residual_rms_V:.3g} V RMS "
        f"where empty and full are {_range_V(ocv):.3g} V apart; {OTHER_FILE}"
        for fit in fits
        if not is_reproduced(fit, ocv)
    ]
    return (*map(Note, gassing), *(Note(text, "warning") for text in misfits))


def label_notes(voltage_V: np.ndarray, ocv: OcvCurve, chemistry: str, n_series: int) -> tuple[Note, ...]:
    """A warning where the usual voltage of the logs, or their curve, is not that of this many cells of this chemistry.

    voltage_V: (T,) of all logs.  ocv: identified from them.  chemistry: "" if unknown.
    """
    contradiction = unlikely_cells(voltage_V, chemistry, n_series)
    if not contradiction and (differs := chemistry_contradiction(chemistry, [V / n_series for V in ocv.voltage_V])):
        contradiction = f"the identified open-circuit voltage {differs}"
    return (Note(contradiction, "warning"),) if contradiction else ()


def unlikely_cells(voltage_V: np.ndarray, chemistry: str, n_series: int, beyond: float = _BEYOND_CURVE) -> str:
    """Contradiction of the usual voltage of the logs with this many cells of this chemistry; "" for none.

    voltage_V, chemistry: as in `label_notes`.  beyond: share by which it may lie outside the curve.
    """
    if not chemistry:
        return ""
    empty_V, *_, full_V = CHEMISTRIES[chemistry].ocv_V
    usual_V = float(np.nanmedian(voltage_V))
    if empty_V / (1 + beyond) <= usual_V / n_series <= (1 + beyond) * full_V:
        return ""
    low_V, high_V = empty_V / (1 + _BEYOND_CURVE), (1 + _BEYOND_CURVE) * full_V
    fitting = [n for n in range(1, int(usual_V / low_V) + 1) if low_V <= usual_V / n <= high_V]
    advice = f"; {' or '.join(map(str, fitting))} would fit" if fitting else "; is the chemistry another one?"
    return (
        f"the usual voltage of the logs, {usual_V:.4g} V, is {usual_V / n_series:.3g} V a cell with n_series = "
        f"{n_series}, but cells of {chemistry} have {empty_V:g} to {full_V:g} V{advice}"
    )
