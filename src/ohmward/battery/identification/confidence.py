"""Confidence intervals of the parameters, and sentences on those that the data do not show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.battery.battery import ConfidenceInterval
from ohmward.battery.identification.circuit_design import RESISTANCE_GRID, pair_names
from ohmward.battery.identification.circuit_fit import CircuitFit
from ohmward.battery.identification.circuit_solve import CircuitSolution
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
