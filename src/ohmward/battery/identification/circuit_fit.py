"""Circuit whose voltage fits whole records best, by separable least squares (variable projection).

For given time constants the rest is linear and is solved at once (`circuit_solve`); the outer search runs over the
logarithms of time constants and rates only. The number of RC pairs is chosen by evidence. The solution then gives the
Thevenin model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.identification.circuit_solve import (
    CircuitProblem,
    CircuitSolution,
    Rates,
    block,
    covered,
    solve,
)
from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.battery.identification.ocv_from_logs import smooth
from ohmward.battery.identification.record import Record, find_rests
from ohmward.battery.models.ocv import OCV_GRID, OcvCurve
from ohmward.battery.models.thevenin import RESISTANCE_GRID, Thevenin
from ohmward.battery.posterior import ENTROPY_KNOTS, OCV_KNOTS
from ohmward.logs.log import Note
from ohmward.optional import require

#: Rates of the hysteresis to start from.
_GAMMAS = (10.0, 40.0)
#: Steps of each search; each takes a further evaluation for every parameter.
_EVALUATIONS = 6
#: Step of the numerical derivative in the logarithms.
_STEP = 0.02
#: Each time constant is at least twice the one before.
_APART = np.log(2.0)
#: Time constants to start from [s], by the number of pairs.
_STARTS: dict[int, tuple[tuple[float, ...], ...]] = {
    0: ((),),
    1: ((15.0,), (60.0,), (300.0,), (1500.0,)),
    2: ((15.0, 300.0), (20.0, 1500.0), (40.0, 2500.0)),
    3: ((5.0, 60.0, 1500.0), (10.0, 200.0, 2500.0), (60.0, 900.0, 7200.0)),
}


class CircuitFit(NamedTuple):
    """The best solution of a search over the parameters theta."""

    solution: CircuitSolution
    theta: np.ndarray  #: (n,) see `_to_search`
    search_cov: np.ndarray  #: (n, n) their covariance

    def search_std(self, name: str) -> float:
        """Standard deviation of a rate that was sought: of its logarithm, or in its unit."""
        sought = self.solution.problem.sought
        k = [rate.name for rate in sought].index(name)
        rate, place = sought[k], len(self.solution.rates.tau_s) + k
        return float(np.sqrt(self.search_cov[place, place])) * (1.0 if rate.as_log else rate.unit)

    def ocv_std_V(self, soc: np.ndarray) -> np.ndarray:
        """Standard deviation [V] of the correction of the open-circuit voltage at soc."""
        return np.interp(soc, OCV_KNOTS, self._std(self.solution.unknowns.group("ocv")))

    def resistance_std_ohm(self, j: int) -> np.ndarray:
        """Standard deviation [ohm] of the j-th resistance on its grid of soc: R0 discharge, R0 charge, R1, ..."""
        return self._std(block(j))

    def _std(self, rows: slice) -> np.ndarray:
        return np.sqrt(np.diag(self.solution.cov)[rows])


def fit_circuit(
    problem: CircuitProblem,
    pairs: int,
    progress: Callable[[float], None] | None = None,
    near: Sequence[Rates] = (),
) -> CircuitFit:
    """The circuit with `pairs` RC pairs that fits the records best.

    Several starts are compared, a search runs from two of them, and the better search is continued.
    progress: called with the share done, from 0 to 1.
    near: rates to start from, known from another fit; a single search then runs from the best of them.
    """
    report = progress or (lambda share: None)
    low, high = _bounds(problem, pairs)
    first_rates = near or [problem.usual_rates(tau_s) for tau_s in _STARTS[pairs]]
    if not near and any(problem.ocv.hysteresis_V):
        first_rates = [rates._replace(hysteresis_rate=gamma) for rates in first_rates for gamma in _GAMMAS]
    starts = [np.clip(_to_search(rates, problem), low + _STEP, high - _STEP) for rates in first_rates]
    tried: list[CircuitSolution] = []
    for k, start in enumerate(starts):
        tried.append(solve(problem, _to_rates(start, problem, pairs), most_steps=1))
        report(0.3 * (k + 1) / len(starts))
    searches = []
    for k, start in enumerate(_best_apart(starts, tried)[: 1 if near else 2]):
        searches.append(_search(problem, pairs, start, (low, high)))
        report(0.3 + 0.25 * (k + 1))
    best = min(searches, key=lambda s: s.solution.score)
    found = best if near else _search(problem, pairs, best.theta, (low, high))
    report(1.0)
    return found


def _search(
    problem: CircuitProblem, pairs: int, start: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]
) -> CircuitFit:
    """Least squares over the search parameters, with the weights that outlying samples have at the start."""
    least_squares = require("scipy.optimize", "identification").least_squares

    first = solve(problem, _to_rates(start, problem, pairs))
    if not start.size:
        return CircuitFit(first, start, np.zeros((0, 0)))

    def residuals(theta: np.ndarray) -> np.ndarray:
        return solve(problem, _to_rates(theta, problem, pairs), first).weighted

    found = least_squares(residuals, start, bounds=bounds, diff_step=_STEP, x_scale=0.3, max_nfev=_EVALUATIONS)
    search_cov = np.linalg.pinv(found.jac.T @ found.jac)  # a parameter without an effect has no inverse
    return CircuitFit(solve(problem, _to_rates(found.x, problem, pairs)), found.x, search_cov)


def _best_apart(starts: list[np.ndarray], tried: list[CircuitSolution]) -> list[np.ndarray]:
    """The best start, and the best of those whose slowest time constant differs by more than a factor of 2."""
    order = sorted(range(len(starts)), key=lambda k: tried[k].score)
    slowest = [(s.rates.tau_s or (1.0,))[-1] for s in tried]
    apart = [k for k in order if abs(np.log(slowest[k] / slowest[order[0]])) > _APART]
    return [starts[k] for k in (order[0], *apart[:1])]


def _to_search(rates: Rates, problem: CircuitProblem) -> np.ndarray:
    """Search parameters: log tau_1, log of the ratios of further ones, then those of the sought rates."""
    tau = np.log(np.array(rates.tau_s))
    tail = [rate.parameter(getattr(rates, rate.name)) for rate in problem.sought]
    return np.array([*tau[:1], *np.diff(tau), *tail])


def _to_rates(theta: np.ndarray, problem: CircuitProblem, pairs: int) -> Rates:
    tau = tuple(float(t) for t in np.exp(np.cumsum(theta[:pairs])))
    rest = zip(problem.sought, theta[pairs:].tolist(), strict=True)
    found: dict[str, Any] = {rate.name: rate.value(parameter) for rate, parameter in rest}
    return problem.usual_rates(tau)._replace(**found)


def _bounds(problem: CircuitProblem, pairs: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the search: tau_1 not below half a sampling interval, each further one at least twice the last."""
    interval_s = min(float(np.quantile(s.dt_s[1:], 0.05)) for s in problem.samples)
    longest_s = max(s.time_s[-1] - s.time_s[0] for s in problem.samples)
    low, high = [], []
    if pairs:
        fastest_s, slowest_s = max(0.5 * interval_s, 0.05), min(20000.0, max(longest_s, 4 * interval_s))
        low = [np.log(fastest_s)] + [_APART] * (pairs - 1)
        high = [np.log(slowest_s)] + [np.log(1000.0)] * (pairs - 1)
    low += [rate.parameter(rate.low) for rate in problem.sought]
    high += [rate.parameter(rate.high) for rate in problem.sought]
    return np.array(low), np.array(high)


#: Slowest time constant over the longest rest: in two time constants a process reaches 1 - e^-2 = 86 % of its end.
_REST_SHARE = 0.5
#: Under a load the open-circuit voltage moves as well; a process that takes longer than a tenth of the record cannot be
#: separated from an error of the OCV curve.
_RECORD_SHARE = 0.1
#: One pair more needs strong evidence: 2 ln(Bayes factor) > 6 (Kass and Raftery, J. Am. Stat. Assoc. 1995).
_STRONG_EVIDENCE = 6.0
#: The fit with two pairs comes first, at this share of the time; the others start from its time constants.
_FIRST, _SECOND = 0.6, 0.9
#: Time constant of a third pair to start from, over the faster of two; its inverse, over the slower.
_FASTER = 0.25


def longest_rest_s(records: Sequence[Record]) -> float:
    """Duration [s] of the longest rest after a current, 0 without any."""
    longest_s = [max((rest.duration_s for rest in find_rests(r.phases, 0.0)), default=0.0) for r in records]
    return max(longest_s, default=0.0)


def longest_tau_s(records: Sequence[Record]) -> float:
    """Slowest time constant [s] that the records can show: half the longest rest, or a tenth of the longest record."""
    return max(_REST_SHARE * longest_rest_s(records), _RECORD_SHARE * max(r.log.duration_s for r in records))


def choose_pairs(problem: CircuitProblem, progress: Callable[[float], None]) -> tuple[CircuitFit, Note]:
    """The circuit with one, two or three RC pairs, the fewest without strong evidence for more, and a note on it.

    The evidence of a fit is its score, minus twice the log of the marginal likelihood.
    """
    two = fit_circuit(problem, 2, lambda s: progress(_FIRST * s))
    rates = two.solution.rates
    fast_s, slow_s = rates.tau_s
    between_s = float(np.sqrt(fast_s * slow_s))
    of_three = [(fast_s, between_s, slow_s), (_FASTER * fast_s, fast_s, slow_s), (fast_s, slow_s, slow_s / _FASTER)]
    near = [rates._replace(tau_s=tau_s) for tau_s in of_three]
    three = fit_circuit(problem, 3, lambda s: progress(_FIRST + (_SECOND - _FIRST) * s), near)
    fits, chosen = {2: two, 3: three}, 3
    if not _speaks_for(three, two):
        near = [rates._replace(tau_s=(tau_s,)) for tau_s in (fast_s, between_s, slow_s)]
        fits[1] = fit_circuit(problem, 1, lambda s: progress(_SECOND + (1 - _SECOND) * s), near)
        chosen = 2 if _speaks_for(two, fits[1]) else 1
    progress(1.0)
    others = ", ".join(
        f"{fit.solution.score - fits[chosen].solution.score:+.0f} with {pairs}"
        for pairs, fit in sorted(fits.items())
        if pairs != chosen
    )
    text = f"RC pairs: {chosen} chosen by evidence (-2 ln of it: {others}; a pair more must lower it by"
    return fits[chosen], Note(f"{text} {_STRONG_EVIDENCE:g})")


def _speaks_for(more: CircuitFit, fewer: CircuitFit) -> bool:
    """True where the evidence for the circuit with more pairs is strong."""
    return fewer.solution.score - more.solution.score > _STRONG_EVIDENCE


#: Points of the OCV grid over which the gap is averaged: 5 % of SoC.
_SHAPE_SMOOTHING = 11
#: Largest share of a curve that may fall with SoC by more than noise, and that noise over the voltage at full.
_MOST_BACKWARDS, _SMALL_FALL = 0.03, 3e-4
#: Smallest resistance over its mean along SoC, however narrow the gap.
_SMALLEST_SHAPE = 0.3


def circuit_of(solution: CircuitSolution, efficiency: float) -> Thevenin:
    """The Thevenin model of a solution: its OCV curve corrected, its hysteresis scaled."""
    problem = solution.problem
    resistances = 2 + len(solution.rates.tau_s)
    discharge, charge, *pairs = (tuple(solution.x[block(j)].tolist()) for j in range(resistances))
    return Thevenin(
        capacity_Ah=problem.capacity_Ah,
        ocv=corrected_ocv(solution),
        r0_discharge_ohm=discharge,
        r0_charge_ohm=charge,
        r_ohm=tuple(pairs),
        coulombic_efficiency=efficiency,
        reference_degC=problem.reference_degC,
        **solution.rates._asdict(),
        ocv_slip=problem.prior.ocv_slip.mean,
    )


def corrected_ocv(solution: CircuitSolution) -> OcvCurve:
    """The first OCV curve as the fit corrected it, non-decreasing, and its hysteresis at the scale of the fit."""
    entropy = solution.x[solution.unknowns.group("entropy")]
    more_V_per_K = np.interp(OCV_GRID, ENTROPY_KNOTS, entropy) if entropy.size else 0.0
    return solution.problem.ocv.corrected(_fitted_curve_V(solution), _hysteresis_scale(solution), more_V_per_K)


def curve_notes(solution: CircuitSolution) -> tuple[Note, ...]:
    """A warning where much of the fitted OCV curve falls with SoC, so that `corrected_ocv` levels it."""
    fitted_V = _fitted_curve_V(solution)
    falls_V = np.maximum.accumulate(fitted_V) - np.minimum.accumulate(fitted_V[::-1])[::-1]
    share = float(np.mean(falls_V > _SMALL_FALL * fitted_V[-1]))
    if share <= _MOST_BACKWARDS:
        return ()
    text = (
        f"{share:.0%} of the open-circuit voltage curve that fits the logs falls with SoC and was levelled; the "
        "file counts that as its error. A flat curve (lfp) often does; else the logs contradict the capacity or each "
        f"other. Is {solution.problem.capacity_Ah:g} Ah what the tests at low rate move, and are all logs of the same "
        "battery?"
    )
    return (Note(text, "warning"),)


def levelled_V(solution: CircuitSolution, soc: np.ndarray) -> np.ndarray:
    """RMS of what was levelled of the fitted OCV curve [V], about each point of a uniform grid of SoC (N,)."""
    corrected_V = np.asarray(corrected_ocv(solution).voltage_V)
    near = np.abs(OCV_GRID - soc[:, None]) <= 0.5 * (soc[1] - soc[0])
    return np.sqrt(near @ (corrected_V - _fitted_curve_V(solution)) ** 2 / near.sum(axis=1))


def _fitted_curve_V(solution: CircuitSolution) -> np.ndarray:
    """The first OCV curve with the correction of the fit [V], on OCV_GRID."""
    first = solution.problem.ocv
    correction_V = np.interp(OCV_GRID, OCV_KNOTS, solution.x[solution.unknowns.group("ocv")])
    return np.asarray(first.mean_V(OCV_GRID, first.reference_degC)) + correction_V


def start_of(solution: CircuitSolution, part: int) -> tuple[tuple[float, ...], float]:
    """RC voltages (n,) [V] and hysteresis state at the start of one part of the records."""
    start = solution.x[solution.unknowns.group(f"start {part}")].tolist()
    scale = _hysteresis_scale(solution)
    return tuple(start[: len(solution.rates.tau_s)]), start[-1] / scale if scale > 0 else 0.0


def _hysteresis_scale(solution: CircuitSolution) -> float:
    return float(solution.x[solution.unknowns.group("hysteresis")].sum())


def slow_shape(ocv: OcvCurve, samples: Sequence[FitSamples], capacity_Ah: float) -> np.ndarray:
    """(21,) expected shape of the slowest resistance along SoC, about 1 where there are data: that of the low-rate gap.

    The gap of the low-rate branches is slow overpotential as well as hysteresis, so it shows where the battery is slow.
    Its ends include more than that and are replaced. Flat without a gap.
    """
    gap_V = smooth(np.asarray(ocv.hysteresis_at(OCV_GRID)) * np.ones(OCV_GRID.size), _SHAPE_SMOOTHING)
    shape = np.interp(RESISTANCE_GRID, OCV_GRID, gap_V)
    shape[0], shape[-1] = shape[1], shape[-2]
    there = covered(samples, capacity_Ah)
    level = float(shape[there].mean()) if there.any() else float(shape.mean())
    return np.maximum(shape / level, _SMALLEST_SHAPE) if level > 0 else np.ones(RESISTANCE_GRID.size)
