"""Relaxation of the voltage in each rest, V = V_inf + a_1 e^(-t/tau_1) + a_2 e^(-t/tau_2) ([P] 2.3)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.record import Record
from ohmward.battery.identification.segments import Phase, find_rests

#: Shortest rest [s] and fewest samples in which two time constants may show.
SHORTEST_S = 120.0
_FEWEST_OF_A_REST = 8
#: Samples of a longer rest that are used, denser at its start.
_MOST_OF_A_REST = 200
#: Points of the grid of time constants, and the smallest ratio of two.
_TAUS = 24
_SMALLEST_RATIO = 2.0
#: Refinements of the grid, each with a ratio of its points of the one before to this power.
_REFINEMENTS = 2
_REFINEMENT = 0.4
#: Keeps exponentials that are alike from making the normal equations singular.
_EXPONENTIALS_RIDGE = 1e-12


class ExponentialFit(NamedTuple):
    """Sum of exponentials through one rest."""

    v_inf_V: float  #: voltage [V] that it tends to
    #: (n,) of each
    amplitude_V: tuple[float, ...]
    tau_s: tuple[float, ...]
    rms_V: float  #: of the residual
    aic: float  #: Akaike's criterion, smaller is better
    voltage_V: np.ndarray  #: (N,) along the rest


class Relaxation(NamedTuple):
    """A rest after a current, and its fits."""

    log_name: str
    first: int
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
    rests = [p for p in find_rests(record.phases, SHORTEST_S) if p.last - p.first >= _FEWEST_OF_A_REST]
    found = (_relaxation(record, soc, rest) for rest in rests)
    return tuple(r for r in found if r is not None)


def fit_exponentials(time_s: np.ndarray, voltage_V: np.ndarray, pairs: int) -> ExponentialFit:
    """Best sum of `pairs` exponentials, by linear least squares for each set of time constants on a grid.

    time_s: (N,) from 0; voltage_V: (N,). The grid is refined around its best point.
    """
    grid = np.geomspace(max(np.median(np.diff(time_s)), time_s[-1] / 2000), 2 * time_s[-1], _TAUS)
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
    name = record.log.name
    return Relaxation(name, rest.first, float(soc[rest.first]), before.current_A, time_s, voltage_V, single, double)


def _apart(taus: Sequence[float]) -> bool:
    return all(b >= _SMALLEST_RATIO * a for a, b in pairwise(taus))


def _best_of(time_s: np.ndarray, voltage_V: np.ndarray, candidates: list[tuple[float, ...]]) -> ExponentialFit:
    """The best of several sets of time constants (C, n): all their linear problems at once."""
    taus = np.array(candidates)
    constant = np.ones((len(taus), time_s.size, 1))
    A = np.concatenate([constant, np.exp(-time_s[:, None] / taus[:, None, :])], axis=2)
    H = A.transpose(0, 2, 1) @ A + _EXPONENTIALS_RIDGE * np.eye(A.shape[2])
    x = np.linalg.solve(H, A.transpose(0, 2, 1) @ voltage_V[:, None])
    fitted = (A @ x)[..., 0]
    rss = np.sum((voltage_V - fitted) ** 2, axis=1)
    k = int(np.argmin(rss))
    N, unknowns = time_s.size, 1 + 2 * taus.shape[1]
    mean_square = max(float(rss[k]) / N, 1e-18)
    return ExponentialFit(
        float(x[k, 0, 0]),
        tuple(x[k, 1:, 0].tolist()),
        tuple(taus[k].tolist()),
        float(np.sqrt(mean_square)),
        float(N * np.log(mean_square) + 2 * unknowns),
        fitted[k],
    )
