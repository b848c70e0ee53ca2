"""Parameters that the logs do not show: the chemistry's prior in their place, its width, and a sentence on each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.circuit_fit import CircuitFit
from ohmward.battery.identification.circuit_prior import entropy_std
from ohmward.battery.identification.circuit_solve import CircuitProblem
from ohmward.battery.identification.fit_samples import FitSamples

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
    usual_K = problem.prior.untested.activation_std_K
    if not problem.fit_activation:
        return usual_K
    found_K = float(np.hypot(fit.search_std("activation_K"), fit.search_std("pair_activation_K")) / np.sqrt(2.0))
    return min(max(found_K, _ACTIVATION_FLOOR_K), usual_K)


def ocv_std_V_per_K(fit: CircuitFit, problem: CircuitProblem) -> float:
    """Standard deviation of the change of the open-circuit voltage with temperature [V/K]; of a fit, rms along SoC."""
    usual = problem.volts * problem.prior.untested.ocv_std_V_per_K
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
    return 0.0 if any(problem.ocv.hysteresis_V) else problem.volts * problem.prior.untested.hysteresis_V


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
    prior = problem.prior.untested
    ohmic, pairs, tau = (f"{A.mean:.0f} K" for A in prior.activations_K)
    empty_K, empty_std_K = prior.empty_activation_K
    more = f"{empty_K:.0f} ± {empty_std_K:.0f} K more" if empty_K else f"a further ± {empty_std_K:.0f} K"
    return [
        f"activation: currents flowed at {load_temperature(problem.samples)} only, so how the resistances change with "
        f"temperature was assumed as usual for {kind}: {ohmic} (R0), {pairs} (RC pairs) and {tau} (time constants), "
        f"each ± {prior.activation_std_K:.0f} K; the RC pairs of an empty battery have {more} (all 1 sigma)"
    ]


def _ocv_temperature(fit: CircuitFit, problem: CircuitProblem, kind: str) -> list[str]:
    if problem.fit_activation or any(problem.ocv.temperature_V_per_K):
        return []
    std_mV = 1e3 * ocv_std_V_per_K(fit, problem)
    return [
        f"open-circuit voltage against temperature: needs tests at two temperatures; 0 ± {std_mV:.2g} mV/K was "
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
