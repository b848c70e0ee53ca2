"""Noise that a filter should assume with the identified circuit: residual of the fit, and posterior without data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.battery.identification.circuit_design import RESISTANCE_GRID
from ohmward.battery.identification.circuit_fit import CircuitFit
from ohmward.battery.identification.circuit_solve import (
    CircuitProblem,
    CircuitSolution,
    error_factor,
    last_direction,
)
from ohmward.battery.identification.confidence import (
    activation_std_K,
    covered,
    hysteresis_std,
    ocv_std_V_per_K,
    unknown_hysteresis_V,
)
from ohmward.battery.identification.fit_samples import COARSEST_S, FitSamples
from ohmward.battery.identification.record import SETTLED_REST_S
from ohmward.battery.models.noise import AGED_RESISTANCE_STD, BatteryNoise
from ohmward.battery.models.ocv import OcvCurve, hat
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.posterior import OCV_KNOTS

#: Relative error of the overpotential of a lasting load where no settled rest shows it: from one drive of an NMC cell
#: to another of the same cell it was 18 %, with the open-circuit voltage known.
_LASTING_LOAD_ERROR = 0.15


#: Error of the SoC axis of the OCV curve where its anchors are sure: branches of measured cells agree so.
SOC_AXIS_STD = 0.005
#: White noise of a voltage sensor is no smaller, of a lithium-ion cell [V].
_SMALLEST_STD_V = 0.002
#: Short pulses show only the start of a slow process: least error of the overpotential after them.
_PULSES_SHARE = 0.15
_PULSES_CORRELATION_S = 300.0
#: Residuals count within this distance of a state of charge.
_SOC_WINDOW = 0.05
#: Error of a cell's model 0.1 of SoC away from any data [V], and the largest where low-rate branches of both directions
#: have shown the curve there: 3 to 9 mV of measured cells at the temperature of the test, 12 mV in the cold.
_UNVISITED_STD_V = 0.03
_UNVISITED_ON_BRANCHES_STD_V = 0.012
#: Relative error of the overpotential: usual, and largest.
_USUAL_ERROR = 0.1
_LARGEST_ERROR = 0.5
#: Charges count for it within this distance of a state of charge.
_SHARE_WINDOW = 0.1
#: Standard deviation over median absolute value of normal numbers.
_MAD = 1.4826
#: Bounds of the correlation time of the residual [s], and the grid on which it is sought.
_CORRELATION_S = (60.0, 1000.0)
#: A fit leaves a residual that is whiter than the errors of another drive: those of the relaxation last about as long
#: as the slowest pair, but not much longer than the loads of a drive [s].
_RELAXATION_S = 300.0
_RESAMPLED_S = 10.0


def noise_from_fit(
    fit: CircuitFit,
    problem: CircuitProblem,
    p: Thevenin,
    pulses_only: bool,
    anchors_std: float,
    longest_rest_s: float,
    whole_curve: bool = False,
) -> BatteryNoise:
    """The noise to assume with the identified circuit.

    The model's error along SoC is the residual of the fit there and the standard deviation of its posterior, which is
    small where there were data and grows where there were none.
    pulses_only: no log has a lasting load; anchors_std: error of the SoC to which the logs are tied.
    longest_rest_s: of all logs.
    whole_curve: low-rate tests of both directions have shown the open-circuit voltage from full to empty.
    """
    solution, samples, volts = fit.solution, problem.samples, problem.volts
    residual_V = residual_std_V(solution, problem)
    axis_std = float(np.hypot(SOC_AXIS_STD, anchors_std))
    posterior_V = beyond_axis_V(posterior_std_V(solution, samples, p), p.ocv, axis_std)
    unvisited_V = volts * unvisited_std_V(samples, p.capacity_Ah)
    if whole_curve:
        unvisited_V = np.minimum(unvisited_V, volts * _UNVISITED_ON_BRANCHES_STD_V)
    posterior_V = np.maximum(posterior_V, unvisited_V)
    posterior_V = np.hypot(posterior_V, lasting_error_V(p, typical_current_A(samples), longest_rest_s))
    posterior_V = np.hypot(posterior_V, unknown_hysteresis_V(problem))
    floor_V = volts * max(problem.prior.model_V, problem.prior.pulses_V if pulses_only else 0.0)
    model_V = np.maximum(np.hypot(np.where(np.isnan(residual_V), 0.0, residual_V), posterior_V), floor_V)
    return BatteryNoise(
        soc_axis_std=axis_std,
        voltage_std_V=max(white_std_V(solution), _SMALLEST_STD_V * volts),
        model_std_V=tuple(model_V.tolist()),
        model_soc_length=problem.prior.model_soc_length,
        level_std_V=float(model_V.min()),
        overpotential_share=overpotential_share(solution, problem, p, _PULSES_SHARE if pulses_only else _USUAL_ERROR),
        correlation_s=max(
            correlation_s(solution, samples),
            _PULSES_CORRELATION_S if pulses_only else min(max(p.tau_s, default=0.0), _RELAXATION_S),
        ),
        resistance_std=AGED_RESISTANCE_STD,
        activation_std_K=activation_std_K(fit, problem),
        empty_activation_std_K=problem.prior.empty_activation_K.std,
        ocv_std_V_per_K=ocv_std_V_per_K(fit, problem),
        hysteresis_std=hysteresis_std(fit, problem),
        ocv_slip_std=problem.prior.ocv_slip.std,
    )


def beyond_axis_V(std_V: np.ndarray, ocv: OcvCurve, axis_std: float = SOC_AXIS_STD) -> np.ndarray:
    """(21,) error of the model [V] without that of the SoC axis, which the filter adds itself.

    Otherwise a steep end of the curve would count twice, and any voltage would be possible there.
    """
    fine = np.linspace(0.0, 1.0, len(ocv.voltage_V))
    slope_V = np.interp(RESISTANCE_GRID, fine, np.gradient(np.asarray(ocv.voltage_V), fine))
    return np.sqrt(np.maximum(std_V**2 - (axis_std * slope_V) ** 2, 0.0))


def residual_std_V(solution: CircuitSolution, problem: CircuitProblem) -> np.ndarray:
    """(21,) rms of the residual within 5 % of each SoC [V], nan where there are no data.

    Samples that count little in the fit, as the charge of a lead-acid battery, count little here.
    """
    soc = np.concatenate([s.soc for s in problem.samples])
    factor = np.concatenate([error_factor(problem.prior, s) for s in problem.samples])
    weight = np.concatenate([np.minimum(s.dt_s, COARSEST_S) for s in problem.samples]) / factor**2
    residual_V = np.concatenate(solution.residual_V)
    near = (np.abs(soc - RESISTANCE_GRID[:, None]) <= _SOC_WINDOW) & np.isfinite(residual_V)
    total = near @ weight
    return np.sqrt(near @ (weight * np.nan_to_num(residual_V) ** 2) / np.where(total > 0, total, np.nan))


def overpotential_share(
    solution: CircuitSolution, problem: CircuitProblem, p: Thevenin, least: float
) -> float | tuple[float, ...]:
    """Relative error of the overpotential: `least`, or (21,) by the residuals about each SoC of charges in the fit."""
    if problem.prior.charging_factor == 1.0:
        return least
    soc = np.concatenate([s.soc for s in problem.samples])
    over_V = np.concatenate([s.voltage_V - p.ocv.mean_V(s.soc, s.temperature_degC) for s in problem.samples])
    residual_V = np.concatenate(solution.residual_V)
    charging = np.concatenate([last_direction(s.mean_current_A) > 0 for s in problem.samples])  # or at rest after it
    near = (np.abs(soc - RESISTANCE_GRID[:, None]) <= _SHARE_WINDOW) & np.isfinite(residual_V) & charging
    over_V2, residual_V2 = near @ np.nan_to_num(over_V) ** 2, near @ np.nan_to_num(residual_V) ** 2
    seen = over_V2 > 0
    if not seen.any():
        return least
    share = np.sqrt(residual_V2[seen] / over_V2[seen])
    share = np.interp(RESISTANCE_GRID, RESISTANCE_GRID[seen], share)
    return tuple(np.clip(share, least, _LARGEST_ERROR).tolist())


def posterior_std_V(solution: CircuitSolution, samples: Sequence[FitSamples], p: Thevenin) -> np.ndarray:
    """(21,) standard deviation of the predicted voltage at each SoC under the typical current of the logs [V].

    That of the OCV correction and of all resistances together, after the relaxation of all RC pairs.
    """
    layout, rows = solution.layout, np.zeros((RESISTANCE_GRID.size, solution.layout.size))
    typical_A = typical_current_A(samples)
    at_grid = hat(RESISTANCE_GRID, RESISTANCE_GRID)
    for j in range(layout.blocks):
        if j != 1:
            rows[:, layout.block(j)] = -typical_A * at_grid
    rows[:, layout.correction] = hat(RESISTANCE_GRID, OCV_KNOTS)
    variance = np.einsum("ij,jk,ik->i", rows, solution.cov, rows)
    return np.sqrt(np.maximum(variance, 0.0))


def unvisited_std_V(samples: Sequence[FitSamples], capacity_Ah: float) -> np.ndarray:
    """(21,) standard deviation of a lithium-ion cell's model away from the SoC at which a current flowed [V].

    Measured on cells identified from one half of their range: it grows with the root of the distance.
    """
    seen = RESISTANCE_GRID[covered(samples, capacity_Ah)]
    distance = np.abs(RESISTANCE_GRID[:, None] - seen).min(axis=1) if seen.size else np.ones(RESISTANCE_GRID.size)
    return _UNVISITED_STD_V * np.sqrt(np.maximum(distance - _SOC_WINDOW, 0.0) / 0.1)


def typical_current_A(samples: Sequence[FitSamples]) -> float:
    """Mean magnitude of the current over time [A], as a slow RC pair sees it."""
    moved = sum(float(np.abs(s.mean_current_A * s.dt_s).sum()) for s in samples)
    return moved / max(sum(float(s.dt_s.sum()) for s in samples), 1e-9)


def white_std_V(solution: CircuitSolution) -> float:
    """Standard deviation of the residual from one sample to the next [V], robust: it is the part that is white."""
    steps = np.concatenate([np.diff(r) for r in solution.residual_V])
    steps = np.abs(steps[np.isfinite(steps)])
    return float(_MAD * np.median(steps) / np.sqrt(2)) if steps.size else 0.0


def correlation_s(solution: CircuitSolution, samples: Sequence[FitSamples]) -> float:
    """Correlation time of the residual [s]: its autocorrelation falls to 1/e, on a grid of 10 s."""
    times = [_decay_s(s, r) for s, r in zip(samples, solution.residual_V, strict=True)]
    low, high = _CORRELATION_S
    return float(min(max(np.median(times), low), high))


def current_noise_A(current_A: np.ndarray) -> float:
    """White noise of a current sensor [A]: the robust spread of the steps where the current is steady."""
    steps = np.abs(np.diff(current_A))
    steady = steps[steps <= np.quantile(steps, 0.3)]
    return float(_MAD * np.median(steady)) if steady.size else 0.0


def _decay_s(samples: FitSamples, residual_V: np.ndarray) -> float:
    grid_s = np.arange(samples.time_s[0], samples.time_s[-1], _RESAMPLED_S)
    known = np.isfinite(residual_V)
    r = np.interp(grid_s, samples.time_s[known], residual_V[known])
    r = r - r.mean()
    spectrum = np.fft.rfft(r, 2 * r.size)
    autocorrelation = np.fft.irfft(np.abs(spectrum) ** 2)[: r.size]
    below = np.flatnonzero(autocorrelation < autocorrelation[0] / np.e)
    return _RESAMPLED_S * float(below[0]) if below.size else _CORRELATION_S[1]


def lasting_error_V(p: Thevenin, typical_A: float, longest_rest_s: float) -> np.ndarray:
    """(21,) error of the voltage [V] under a lasting load of typical_A; 0 where a rest of 10 min shows what it does."""
    if longest_rest_s >= SETTLED_REST_S:
        return np.zeros(RESISTANCE_GRID.size)
    ohm = np.sum([p.r0_discharge_ohm, *p.r_ohm], axis=0)
    return _LASTING_LOAD_ERROR * typical_A * np.interp(RESISTANCE_GRID, np.linspace(0, 1, ohm.size), ohm)
