"""Confidence intervals of the parameters, and the chemistry's prior for those that the logs do not show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import ConfidenceInterval
from ohmward.battery.identification.circuit_design import RESISTANCE_GRID, pair_names
from ohmward.battery.identification.circuit_fit import CircuitFit
from ohmward.battery.identification.circuit_prior import entropy_std
from ohmward.battery.identification.circuit_solve import CircuitProblem, CircuitSolution
from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.filters.consistency import BAND_95
from ohmward.runs import runs

_REPORTED_SOC = (0.1, 0.3, 0.5, 0.7, 0.9)
#: Smaller currents, as a share of 1 C, show no resistance.
_COVERED_RATE = 0.02
#: Time for which a current must have flowed near a state of charge [s].
_COVERED_S = 10.0
#: Standard deviation of a logarithm beyond which a parameter is not identified: a factor of 2.
_VAGUE_LOG = 0.7


def confidence_intervals(fit: CircuitFit) -> tuple[ConfidenceInterval, ...]:
    """95 % intervals of the resistances at five states of charge, of the time constants and of the rates."""
    s = fit.solution
    names = pair_names(s.layout.pairs)
    resistances = [_resistance(s, j, names[j], soc) for j in range(s.layout.blocks) for soc in _REPORTED_SOC]
    return (*resistances, *_search_intervals(fit))


def not_identified(
    fit: CircuitFit, samples: Sequence[FitSamples], capacity_Ah: float, hysteresis: bool
) -> tuple[str, ...]:
    """Sentences on the parameters that the data do not show, and on what was put in their place.

    hysteresis: True where the OCV curve has two branches, whose distance gives the slow resistance its shape.
    """
    sentences = [*_uncovered(fit.solution, samples, capacity_Ah, hysteresis), *_directions(samples, capacity_Ah)]
    tau = fit.solution.rates.tau_s
    for rate in fit.sought:
        value = getattr(fit.solution.rates, rate.name)
        at_bound = rate.as_log and any(abs(np.log(value / bound)) < 0.05 for bound in (rate.low, rate.high))
        if rate.name == "hysteresis_rate" and (at_bound or fit.search_std(rate.name) > _VAGUE_LOG):
            sentences.append(
                f"{rate.name}: the data hardly depend on it; {value:.3g} was taken within {rate.low:g} to {rate.high:g}"
            )
    longest_s = max(s.time_s[-1] - s.time_s[0] for s in samples)
    sentences += [
        f"tau_{j}: {t:.3g} s is not short against the logs ({longest_s:.3g} s) or hardly shows in them"
        for j, t in enumerate(tau, start=1)
        if t > 0.5 * longest_s or _tau_std(fit, j) > _VAGUE_LOG
    ]
    return tuple(sentences)


def covered(samples: Sequence[FitSamples], capacity_Ah: float) -> np.ndarray:
    """(21,) bool: True where a current flowed within 2.5 % of that SoC for at least 10 s in all."""
    half = 0.5 * (RESISTANCE_GRID[1] - RESISTANCE_GRID[0])
    time_s = np.zeros(RESISTANCE_GRID.size)
    for s in samples:
        flows = np.abs(s.mean_current_A) > _COVERED_RATE * capacity_Ah
        time_s += (np.abs(s.soc - RESISTANCE_GRID[:, None]) <= half) @ np.where(flows, s.dt_s, 0.0)
    return time_s >= _COVERED_S


def _resistance(s: CircuitSolution, j: int, name: str, soc: float) -> ConfidenceInterval:
    k = int(np.argmin(np.abs(RESISTANCE_GRID - soc)))
    at = s.layout.block(j).start + k
    value, std = float(s.x[at]), float(np.sqrt(s.cov[at, at]))
    return ConfidenceInterval(f"{name} at soc {soc:g}", value, max(value - BAND_95 * std, 0.0), value + BAND_95 * std)


def _search_intervals(fit: CircuitFit) -> list[ConfidenceInterval]:
    rates = fit.solution.rates
    found = [_log_interval(f"tau{j}_s", t, _tau_std(fit, j)) for j, t in enumerate(rates.tau_s, start=1)]
    for rate in fit.sought:
        value, std = getattr(rates, rate.name), fit.search_std(rate.name)
        half = BAND_95 * std
        interval = ConfidenceInterval(rate.name, value, value - half, value + half)
        found.append(_log_interval(rate.name, value, std) if rate.as_log else interval)
    return found


def _tau_std(fit: CircuitFit, j: int) -> float:
    """Standard deviation of log tau_j, the sum of the first j search parameters."""
    return float(np.sqrt(max(fit.search_cov[:j, :j].sum(), 0.0)))


def _log_interval(name: str, value: float, std: float) -> ConfidenceInterval:
    spread = float(np.exp(min(BAND_95 * std, 50.0)))
    return ConfidenceInterval(name, value, value / spread, value * spread)


def _uncovered(s: CircuitSolution, samples: Sequence[FitSamples], capacity_Ah: float, shaped: bool) -> list[str]:
    missing = ~covered(samples, capacity_Ah)
    if not missing.any():
        return []
    source = "the shape of the low-rate branches" if shaped else "the nearest data, held"
    ranges = ", ".join(_range(a, b) for a, b in runs(missing))
    return [f"resistances at SoC {ranges}: no current flowed there; taken from {source}, ± {_share(s, missing):.0%}"]


def _range(first: int, stop: int) -> str:
    low, high = RESISTANCE_GRID[first], RESISTANCE_GRID[stop - 1]
    return f"{low:.2g}" if stop - first == 1 else f"{low:.2g} to {high:.2g}"


def _share(s: CircuitSolution, where: np.ndarray) -> float:
    """Two standard deviations of the total resistance over itself, the largest where (21,) is true."""
    rows = np.zeros((int(where.sum()), s.layout.size))
    for j in range(s.layout.blocks):
        if j != 1:
            rows[:, s.layout.block(j)] = np.eye(RESISTANCE_GRID.size)[where]
    std = np.sqrt(np.einsum("ij,jk,ik->i", rows, s.cov, rows))
    return float(np.max(2 * std / np.maximum(rows @ s.x, 1e-9)))


def _directions(samples: Sequence[FitSamples], capacity_Ah: float) -> list[str]:
    current_A = np.concatenate([s.current_A for s in samples])
    words = {
        "charge": current_A > _COVERED_RATE * capacity_Ah,
        "discharge": current_A < -_COVERED_RATE * capacity_Ah,
    }
    return [
        f"r0_{word}_ohm: the logs hold no {word}; taken from the other direction"
        for word, there in words.items()
        if np.count_nonzero(there) < 3
    ]


#: Resistances at temperatures that differ by more show an activation [K]: 10 K change them by a fifth. Days that warm
#: by 6 K change them by less than SoC and current do: they told -2900 to 5700 K of the RC pairs of simulated cells.
_SPREAD_K = 10.0
#: Share of the charge that may have flowed below the low and above the high temperature.
_OUTSIDE_SHARE = 0.02


#: No test knows the activation of a battery better [K]: that of measured cells differs by 1000 and more between warm
#: and cold, and a fit at two temperatures is used beyond them.
_ACTIVATION_FLOOR_K = 700.0
#: Relative error of a hysteresis that low-rate branches show: 0.35 to 0.7 of their gap on measured LFP cells.
_HYSTERESIS_STD = 0.5
#: The same where the circuit was fitted to the branches as well: the share of their gap that is no overpotential was
#: 0.71 to 0.87 of a cell at -15 to 45 degC.
_MEASURED_HYSTERESIS_STD = 0.15
#: No hysteresis is a smaller share of the gap, where a relative error needs one.
_SMALLEST_SCALE = 0.1
#: Least error of the curve's temperature slope over that of the chemistry: rests at two temperatures are not equally
#: complete, and low-rate branches hold overpotential, which changes with temperature as well.
_LEAST_SLOPE = 0.5


def activation_std_K(fit: CircuitFit, problem: CircuitProblem) -> float:
    """Standard deviation of all activations together [K]: of the fit, or the chemistry's at one temperature."""
    usual_K = problem.prior.activation_std_K
    if not problem.fit_activation:
        return usual_K
    found_K = float(np.hypot(fit.search_std("activation_K"), fit.search_std("pair_activation_K")) / np.sqrt(2.0))
    return min(max(found_K, _ACTIVATION_FLOOR_K), usual_K)


def ocv_std_V_per_K(fit: CircuitFit, problem: CircuitProblem) -> float:
    """Standard deviation of the change of the open-circuit voltage with temperature [V/K]; of a fit, rms along SoC."""
    usual = problem.volts * problem.prior.ocv_std_V_per_K
    if not problem.fit_activation:
        return entropy_std(problem.prior, problem.ocv, problem.volts)
    found = float(np.sqrt(np.diag(fit.solution.cov)[fit.solution.layout.entropic].mean()))
    return min(max(found, _LEAST_SLOPE * usual), usual)


def hysteresis_std(fit: CircuitFit, problem: CircuitProblem) -> float:
    """Relative standard deviation of the hysteresis: that of the fit where it has low-rate branches."""
    if not any(problem.ocv.hysteresis_V):
        return 0.0
    if not problem.branches:
        return _HYSTERESIS_STD
    scale, solution = fit.solution.layout.scale, fit.solution
    found = float(np.sqrt(solution.cov[scale, scale][0, 0]) / max(solution.x[scale][0], _SMALLEST_SCALE))
    return min(max(found, _MEASURED_HYSTERESIS_STD), _HYSTERESIS_STD)


def unknown_hysteresis_V(problem: CircuitProblem) -> float:
    """Error of the voltage [V] where no low-rate branches show a hysteresis: half their usual distance."""
    return 0.0 if any(problem.ocv.hysteresis_V) else problem.volts * problem.prior.hysteresis_V


def untested_sentences(fit: CircuitFit, problem: CircuitProblem, chemistry: str) -> tuple[str, ...]:
    """Sentences on what was taken from the chemistry `chemistry`, "" for an unknown one."""
    kind = f"{chemistry} cells" if chemistry else "batteries (name the chemistry for narrower values)"
    return (*_hysteresis(problem, kind), *_activation(problem, kind), *_ocv_temperature(fit, problem, kind))


def _hysteresis(problem: CircuitProblem, kind: str) -> list[str]:
    if any(problem.ocv.hysteresis_V):
        return []
    error_mV = 1e3 * unknown_hysteresis_V(problem)
    return [
        "hysteresis: needs a low-rate discharge and a low-rate charge; taken as none, with an error of the voltage of "
        f"{error_mV:.2g} mV, as usual for {kind}"
    ]


def _activation(problem: CircuitProblem, kind: str) -> list[str]:
    if problem.fit_activation:
        return []
    prior = problem.prior
    ohmic, pairs, tau = (f"{A.mean:.0f} K" for A in prior.activations_K)
    empty_K, empty_half_K = prior.empty_activation_K.mean, BAND_95 * prior.empty_activation_K.std
    more = f"{empty_K:.0f} ± {empty_half_K:.0f} K more" if empty_K else f"a further ± {empty_half_K:.0f} K"
    return [
        f"activation: currents flowed at {load_temperature(problem.samples)} only, so how the resistances change with "
        f"temperature was assumed as usual for {kind}: {ohmic} (R0), {pairs} (RC pairs) and {tau} (time constants), "
        f"each ± {BAND_95 * prior.activation_std_K:.0f} K; the RC pairs of an empty battery have {more} (95 %)"
    ]


def _ocv_temperature(fit: CircuitFit, problem: CircuitProblem, kind: str) -> list[str]:
    if problem.fit_activation or any(problem.ocv.temperature_V_per_K):
        return []
    half_mV = 1e3 * BAND_95 * ocv_std_V_per_K(fit, problem)
    return [
        f"open-circuit voltage against temperature: needs tests at two temperatures; 0 ± {half_mV:.2g} mV/K (95 %) was "
        f"assumed, as usual for {kind}"
    ]


class LoadTemperature(NamedTuple):
    """Temperatures [degC] between which nearly all charge flowed."""

    low_degC: float
    high_degC: float

    @property
    def shows_activation(self) -> bool:
        """True where they differ by more than 10 K."""
        return self.high_degC - self.low_degC > _SPREAD_K

    def __str__(self) -> str:
        low, high = f"{self.low_degC:.0f}", f"{self.high_degC:.0f}"
        return f"{low} degC" if low == high else f"{low} to {high} degC"


def load_temperature(samples: Sequence[FitSamples]) -> LoadTemperature:
    """Temperatures at which current flowed, of every sample and not only of every log; by the charge that flowed."""
    degC = np.concatenate([s.temperature_degC for s in samples])
    moved = np.concatenate([np.abs(s.mean_current_A) * s.dt_s for s in samples])
    order = np.argsort(degC)
    share = np.cumsum(moved[order]) / max(float(moved.sum()), 1e-12)
    low, high = np.searchsorted(share, [_OUTSIDE_SHARE, 1.0 - _OUTSIDE_SHARE]).clip(0, degC.size - 1)
    return LoadTemperature(float(degC[order[low]]), float(degC[order[high]]))
