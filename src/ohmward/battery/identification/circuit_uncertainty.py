"""Uncertainty of a fitted circuit: confidence intervals, what the logs do not show, and the noise to assume with it.

The noise is the residual of the fit and, where there were no data, its posterior or the chemistry's prior.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import ConfidenceInterval
from ohmward.battery.identification.circuit_fit import CircuitFit, levelled_V
from ohmward.battery.identification.circuit_solve import (
    COVERED_RATE,
    CircuitProblem,
    CircuitSolution,
    block,
    covered,
    entropy_std,
    error_factor,
    pair_names,
)
from ohmward.battery.identification.fit_samples import FitSamples, hysteresis_along
from ohmward.battery.identification.record import SETTLED_REST_S, Record
from ohmward.battery.models.noise import AGED_CAPACITY_STD, AGED_RESISTANCE_STD, BatteryNoise
from ohmward.battery.models.ocv import hat
from ohmward.battery.models.thevenin import RESISTANCE_GRID, Thevenin
from ohmward.battery.posterior import (
    ACTIVATION_STD_K,
    ENTROPY_SHARE,
    HYSTERESIS_STD,
    OCV_KNOTS,
    OVERPOTENTIAL_STD,
    SOC_AXIS_STD,
    USUAL_HYSTERESIS_STD,
    beyond_axis_V,
    remaining_std,
    variances,
)
from ohmward.filters.consistency import BAND_95
from ohmward.runs import runs

_REPORTED_SOC = (0.1, 0.3, 0.5, 0.7, 0.9)
#: Standard deviation of a logarithm beyond which a parameter is not identified: a factor of 2.
_VAGUE_LOG = 0.7


def confidence_intervals(fit: CircuitFit) -> tuple[ConfidenceInterval, ...]:
    """95 % intervals of the resistances at five states of charge, of the time constants and of the rates."""
    s, rates = fit.solution, fit.solution.rates
    found = []
    for j, name in enumerate(pair_names(len(rates.tau_s))):
        for soc in _REPORTED_SOC:
            at = block(j).start + int(np.argmin(np.abs(RESISTANCE_GRID - soc)))
            value, half = float(s.x[at]), BAND_95 * float(np.sqrt(s.cov[at, at]))
            found.append(ConfidenceInterval(f"{name} at soc {soc:g}", value, max(value - half, 0.0), value + half))
    found += [_log_interval(f"tau{j}_s", t, _tau_std(fit, j)) for j, t in enumerate(rates.tau_s, start=1)]
    for rate in fit.solution.problem.sought:
        value, std = getattr(rates, rate.name), fit.search_std(rate.name)
        half = BAND_95 * std
        interval = ConfidenceInterval(rate.name, value, value - half, value + half)
        found.append(_log_interval(rate.name, value, std) if rate.as_log else interval)
    return tuple(found)


def not_identified(fit: CircuitFit) -> tuple[str, ...]:
    """Sentences on the parameters that the data do not show, and on the values used instead."""
    sentences = [*_uncovered(fit.solution), *_directions(fit.solution.problem)]
    for rate in fit.solution.problem.sought:
        value = getattr(fit.solution.rates, rate.name)
        if rate.name == "hysteresis_rate" and (
            any(abs(np.log(value / bound)) < 0.05 for bound in (rate.low, rate.high))
            or fit.search_std(rate.name) > _VAGUE_LOG
        ):
            sentences.append(
                f"{rate.name}: the data hardly depend on it; {value:.3g} was taken within {rate.low:g} to {rate.high:g}"
            )
    longest_s = max(s.time_s[-1] - s.time_s[0] for s in fit.solution.problem.samples)
    sentences += [
        f"tau_{j}: {tau_s:.3g} s is not short against the logs ({longest_s:.3g} s) or hardly shows in them"
        for j, tau_s in enumerate(fit.solution.rates.tau_s, start=1)
        if tau_s > 0.5 * longest_s or _tau_std(fit, j) > _VAGUE_LOG
    ]
    return tuple(sentences)


def _tau_std(fit: CircuitFit, j: int) -> float:
    """Standard deviation of log tau_j, the sum of the first j search parameters."""
    return float(np.sqrt(max(fit.search_cov[:j, :j].sum(), 0.0)))


def _log_interval(name: str, value: float, std: float) -> ConfidenceInterval:
    spread = float(np.exp(min(BAND_95 * std, 50.0)))
    return ConfidenceInterval(name, value, value / spread, value * spread)


def _uncovered(s: CircuitSolution) -> list[str]:
    problem = s.problem
    missing = ~covered(problem.samples, problem.capacity_Ah)
    if not missing.any():
        return []
    # the distance of two branches gives the slow resistance its shape
    source = "the shape of the low-rate branches" if any(problem.ocv.hysteresis_V) else "the nearest data, held"
    ranges = ", ".join(_range(a, b) for a, b in runs(missing))
    return [f"resistances at SoC {ranges}: no current flowed there; taken from {source}, ± {_share(s, missing):.0%}"]


def _range(first: int, stop: int) -> str:
    low, high = RESISTANCE_GRID[first], RESISTANCE_GRID[stop - 1]
    return f"{low:.2g}" if stop - first == 1 else f"{low:.2g} to {high:.2g}"


def _share(s: CircuitSolution, where: np.ndarray) -> float:
    """Two relative standard deviations of the total resistance, the largest where `where` (21,) is true."""
    rows = _steady_resistance(s)[where]
    std = np.sqrt(variances(rows, s.cov))
    return float(np.max(2 * std / np.maximum(rows @ s.x, 1e-9)))


def _steady_resistance(s: CircuitSolution) -> np.ndarray:
    """(21, K) weights of the unknowns in the resistance to a lasting discharge, on RESISTANCE_GRID."""
    rows = np.zeros((RESISTANCE_GRID.size, s.unknowns.size))
    for j in (0, *range(2, 2 + len(s.rates.tau_s))):
        rows[:, block(j)] = np.eye(RESISTANCE_GRID.size)
    return rows


def _directions(problem: CircuitProblem) -> list[str]:
    current_A = np.concatenate([s.current_A for s in problem.samples])
    least_A = COVERED_RATE * problem.capacity_Ah
    words = {"charge": current_A > least_A, "discharge": current_A < -least_A}
    return [
        f"r0_{word}_ohm: the logs hold no {word}; taken from the other direction"
        for word, there in words.items()
        if np.count_nonzero(there) < 3
    ]


#: Resistances at temperatures that differ by more show an activation [K]: 10 K change them by a fifth. Days that warm
#: by 6 K change them by less than SoC and current do: they gave -2900 to 5700 K for the RC pairs of simulated cells.
_SPREAD_K = 10.0
#: Share of the charge that may have flowed below the low and above the high temperature.
_OUTSIDE_SHARE = 0.02

#: Smallest hysteresis, as a share of the gap, by which its error is divided.
_SMALLEST_SCALE = 0.1


def activation_std_K(fit: CircuitFit) -> float:
    """Standard deviation common to all activations [K]: of the fit, or the chemistry's for tests at one temperature."""
    problem = fit.solution.problem
    usual_K = problem.prior.activation_std_K
    if not problem.fit_activation:
        return usual_K
    found_K = float(np.hypot(fit.search_std("activation_K"), fit.search_std("pair_activation_K")) / np.sqrt(2.0))
    return remaining_std(found_K, ACTIVATION_STD_K, usual_K)


def ocv_std_V_per_K(fit: CircuitFit) -> float:
    """Standard deviation of the change of the open-circuit voltage with temperature [V/K]; of a fit, rms along SoC."""
    problem = fit.solution.problem
    usual = problem.volts * problem.prior.ocv_std_V_per_K
    if not problem.fit_activation:
        return entropy_std(problem.prior, problem.ocv, problem.volts)
    variance = np.diag(fit.solution.cov)[fit.solution.unknowns.group("entropy")]
    found = float(np.sqrt(variance.mean()))
    return remaining_std(found, ENTROPY_SHARE * usual, usual)


def hysteresis_std(fit: CircuitFit) -> float:
    """Relative standard deviation of the hysteresis: that of the fit where it has low-rate branches."""
    solution = fit.solution
    problem = solution.problem
    if not any(problem.ocv.hysteresis_V):
        return USUAL_HYSTERESIS_STD if usual_hysteresis_V(problem) else 0.0
    if not problem.branches:
        return USUAL_HYSTERESIS_STD
    at = solution.unknowns.group("hysteresis").start
    found = float(np.sqrt(solution.cov[at, at]) / max(solution.x[at], _SMALLEST_SCALE))
    return remaining_std(found, HYSTERESIS_STD, USUAL_HYSTERESIS_STD)


def usual_hysteresis_V(problem: CircuitProblem) -> float:
    """Half the usual distance of the branches [V] where no low-rate branches show it, else 0."""
    return 0.0 if any(problem.ocv.hysteresis_V) else problem.volts * problem.prior.hysteresis_V


def with_usual_hysteresis(p: Thevenin, problem: CircuitProblem) -> Thevenin:
    """The circuit with the usual hysteresis where no low-rate branches show it; with them, as it is.

    Its curve was fitted without one, so it is that of the branch on which the records were, of a pulse test the
    discharge branch; the mean of both branches is beside it.
    """
    half_V = usual_hysteresis_V(problem)
    if not half_V:
        return p
    soc = np.linspace(0.0, 1.0, len(p.ocv.voltage_V))
    branch = _branch(problem, p)
    middle_V = np.asarray(p.ocv.voltage_V) - half_V * np.interp(soc, RESISTANCE_GRID, branch)
    curve = replace(p.ocv, hysteresis_V=(half_V,) * soc.size).corrected(middle_V)
    return replace(p, ocv=curve, tested_branch=float(branch.mean()))


def _branch(problem: CircuitProblem, p: Thevenin) -> np.ndarray:
    """(21,) mean hysteresis state of the records near each SoC, of the nearest data where there are none."""
    h = np.concatenate([hysteresis_along(s, p, (0.0,))[:, 0] for s in problem.samples])
    near, weight = _near(problem)
    total = near @ weight
    seen = total > 0
    return np.interp(RESISTANCE_GRID, RESISTANCE_GRID[seen], (near @ (weight * h))[seen] / total[seen])


def untested_sentences(fit: CircuitFit, chemistry: str) -> tuple[str, ...]:
    """Sentences on the values taken from the chemistry `chemistry`, "" for an unknown one."""
    problem = fit.solution.problem
    kind = f"{chemistry} cells" if chemistry else "batteries (name the chemistry for narrower values)"
    sentences = []
    if not any(problem.ocv.hysteresis_V):
        half_mV, factor = 1e3 * usual_hysteresis_V(problem), np.exp(BAND_95 * USUAL_HYSTERESIS_STD)
        sentences.append(
            f"hysteresis: needs a low-rate discharge and a low-rate charge; {half_mV:.2g} mV was assumed beside the "
            f"tested branch, right within a factor of {factor:.1f} (95 %), as usual for {kind}"
        )
    if problem.fit_activation:
        return tuple(sentences)
    prior = problem.prior
    ohmic, pairs, tau = (f"{A.mean:.0f} K" for A in prior.activations_K)
    empty_K, empty_half_K = prior.empty_activation_K.mean, BAND_95 * prior.empty_activation_K.std
    more = f"{empty_K:.0f} ± {empty_half_K:.0f} K more" if empty_K else f"a further ± {empty_half_K:.0f} K"
    sentences.append(
        f"activation: currents flowed at {load_temperature(problem.samples)} only, so how the resistances change with "
        f"temperature was assumed as usual for {kind}: {ohmic} (R0), {pairs} (RC pairs) and {tau} (time constants), "
        f"each ± {BAND_95 * prior.activation_std_K:.0f} K; the RC pairs of an empty battery have {more} (95 %)"
    )
    if not any(problem.ocv.temperature_V_per_K):
        half_mV = 1e3 * BAND_95 * ocv_std_V_per_K(fit)
        sentences.append(
            f"open-circuit voltage against temperature: needs tests at two temperatures; 0 ± {half_mV:.2g} mV/K (95 %) "
            f"was assumed, as usual for {kind}"
        )
    return tuple(sentences)


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
    """Range of temperatures at which current flowed, by sample rather than by log, weighted by the charge moved."""
    degC = np.concatenate([s.temperature_degC for s in samples])
    moved = np.concatenate([np.abs(s.mean_current_A) * s.dt_s for s in samples])
    order = np.argsort(degC)
    share = np.cumsum(moved[order]) / max(float(moved.sum()), 1e-12)
    low, high = np.searchsorted(share, [_OUTSIDE_SHARE, 1.0 - _OUTSIDE_SHARE]).clip(0, degC.size - 1)
    return LoadTemperature(float(degC[order[low]]), float(degC[order[high]]))


#: Relative error of the overpotential of a lasting load where no settled rest shows it, or short pulses only the start
#: of a slow process: from one drive of an NMC cell to another of the same cell it was 18 %, with the open-circuit
#: voltage known.
_LASTING_LOAD_ERROR = 0.15

#: Smallest white noise of a voltage sensor, for a lithium-ion cell [V].
_SMALLEST_STD_V = 0.002
#: Blocks of SoC that are left out of the fit and predicted, between the steep ends; and number of blocks that the error
#: of the chemistry counts as. Of 29 tests of ten cells, the error at small currents on another day at 15 to 40 degC was
#: 0.7 to 9.6 mV. Its rank correlation was 0.7 with the median over the blocks, -0.3 with the error of the chemistry.
_BLOCK_SOC = 0.1
_BLOCKS_SOC = np.linspace(0.1, 0.8, 8)
_CHEMISTRY_BLOCKS = 2.0
#: Residuals count within this distance of a state of charge.
_SOC_WINDOW = 0.05
#: Error of a cell's model 0.1 of SoC away from any data [V], and the largest where low-rate branches of both directions
#: have shown the curve there: 3 to 9 mV for measured cells at the temperature of the test, 12 mV in the cold.
_UNVISITED_STD_V = 0.03
_UNVISITED_ON_BRANCHES_STD_V = 0.012
#: Largest relative error of the overpotential.
_LARGEST_ERROR = 0.5
#: Charges count for it within this distance of a state of charge.
_SHARE_WINDOW = 0.1
#: Standard deviation over median absolute value of normal numbers.
_MAD = 1.4826
#: Bounds of the correlation time of the residual [s], and the grid on which it is sought.
_CORRELATION_S = (60.0, 1000.0)
#: A fit leaves a residual that is whiter than the errors of another drive: those of the relaxation last about as long
#: as the slowest pair, of which short pulses show only the start, but not much longer than the loads of a drive [s].
_RELAXATION_S = 300.0
_RESAMPLED_S = 10.0


def noise_from_fit(
    fit: CircuitFit,
    p: Thevenin,
    pulses_only: bool,
    anchors_std: float,
    longest_rest_s: float,
    measured: Collection[str],
) -> BatteryNoise:
    """The noise to assume with the identified circuit.

    The model's error along SoC is the residual of the fit there and the standard deviation of its posterior, which is
    small where there were data and grows where there were none.
    pulses_only: no log has a lasting load; anchors_std: error of the SoC to which the logs are tied.
    longest_rest_s: of all logs.
    measured: directions in which a low-rate test has shown the open-circuit voltage from full to empty.
    """
    solution = fit.solution
    problem = solution.problem
    samples, volts = problem.samples, problem.volts
    residual_V = residual_std_V(solution)
    axis_std = float(np.hypot(SOC_AXIS_STD, anchors_std))
    # as a slow RC pair sees the current
    moved_As = sum(float(np.abs(s.mean_current_A * s.dt_s).sum()) for s in samples)
    typical_A = moved_As / max(sum(float(s.dt_s.sum()) for s in samples), 1e-9)
    loaded_V, rested_V = posterior_std_V(solution, typical_A), posterior_std_V(solution, 0.0)
    posterior_V = beyond_axis_V(np.maximum(loaded_V, rested_V), p.ocv, axis_std)
    unvisited_V = volts * unvisited_std_V(problem)
    if len(measured) == 2:
        unvisited_V = np.minimum(unvisited_V, volts * _UNVISITED_ON_BRANCHES_STD_V)
    posterior_V = np.maximum(posterior_V, unvisited_V)
    if longest_rest_s < SETTLED_REST_S:
        steady_ohm = np.sum([p.r0_discharge_ohm, *p.r_ohm], axis=0)
        posterior_V = np.hypot(posterior_V, _LASTING_LOAD_ERROR * typical_A * steady_ohm)
    posterior_V = np.hypot(posterior_V, levelled_V(solution, RESISTANCE_GRID))
    floor_V = pulses_floor_V(solution) if pulses_only else volts * problem.prior.model_V
    model_V = np.maximum(np.hypot(np.nan_to_num(residual_V), posterior_V), floor_V)
    least_share = _LASTING_LOAD_ERROR if pulses_only else OVERPOTENTIAL_STD
    relaxation_s = _RELAXATION_S if pulses_only else min(max(p.tau_s, default=0.0), _RELAXATION_S)
    steps_V = np.concatenate([np.diff(r) for r in solution.residual_V])
    return BatteryNoise(
        soc_axis_std=axis_std,
        voltage_std_V=max(_white_std(steps_V[np.isfinite(steps_V)]), _SMALLEST_STD_V * volts),
        model_std_V=tuple(model_V.tolist()),
        model_soc_length=problem.prior.model_soc_length,
        level_std_V=float(model_V.min()),
        overpotential_share=overpotential_share(solution, p, np.nan_to_num(residual_V), least_share),
        correlation_s=max(correlation_s(solution), relaxation_s),
        capacity_std=AGED_CAPACITY_STD,
        resistance_std=AGED_RESISTANCE_STD,
        ageing_correlation=problem.prior.ageing_correlation[bool(measured)],
        activation_std_K=activation_std_K(fit),
        empty_activation_std_K=problem.prior.empty_activation_K.std,
        ocv_std_V_per_K=ocv_std_V_per_K(fit),
        hysteresis_std=hysteresis_std(fit),
        ocv_slip_std=problem.prior.ocv_slip.std,
    )


def pulses_floor_V(solution: CircuitSolution) -> float:
    """Smallest model error at any SoC [V] after short pulses: the chemistry's, narrowed by what the test itself shows.

    sigma^2 = (n_0 sigma_0^2 + n e^2) / (n_0 + n) with the chemistry's sigma_0 and the median e of n `held_out_V`: the
    posterior of a variance [Gelman et al., Bayesian Data Analysis, 2013, 2.6]. Never larger than sigma_0, because the
    file has data where those blocks were predicted without.
    """
    prior = solution.problem.prior
    usual_V = solution.problem.volts * max(prior.model_V, prior.pulses_V)
    errors_V = held_out_V(solution)
    n, error_V = errors_V.size, float(np.median(errors_V)) if errors_V.size else usual_V
    variance = (_CHEMISTRY_BLOCKS * usual_V**2 + n * error_V**2) / (_CHEMISTRY_BLOCKS + n)
    return min(float(np.sqrt(variance)), usual_V)


def held_out_V(solution: CircuitSolution) -> np.ndarray:
    """(n,) rms error [V] of each block of SoC with data over half of it, predicted by a fit to all other samples.

    e = (I + A (H - A'A)^-1 A') r, with residuals r and columns A of the block and the posterior precision H of all.
    """
    rows, soc = solution.rows, solution.problem.joined("soc")
    columns, errors_V = rows.columns, []
    for low in _BLOCKS_SOC:
        inside = (soc >= low) & (soc < low + _BLOCK_SOC) & (rows.scale > 0)
        if inside.any() and np.ptp(soc[inside]) > 0.5 * _BLOCK_SOC:
            A, r = columns[inside], rows.residual[inside]
            error = r + A @ np.linalg.solve(solution.precision - A.T @ A, A.T @ r)
            errors_V.append(np.linalg.norm(error) / np.linalg.norm(rows.scale[inside]))
    return np.array(errors_V)


def residual_std_V(solution: CircuitSolution) -> np.ndarray:
    """(21,) rms of the residual within 5 % of each SoC [V], nan where there are no data.

    Samples that count little in the fit, such as the charge of a lead-acid battery, count little here.
    """
    residual_V = np.concatenate(solution.residual_V)
    near, weight = _near(solution.problem)
    total = near @ weight
    sum_V2 = near @ (weight * np.nan_to_num(residual_V) ** 2)
    return np.sqrt(sum_V2 / np.where(total > 0, total, np.nan))


def _near(problem: CircuitProblem) -> tuple[np.ndarray, np.ndarray]:
    """(21, N) bool: the samples with a voltage within 5 % of each SoC; and the weight of each in the fit (N,)."""
    soc = np.concatenate([s.soc for s in problem.samples])
    measured = np.concatenate([np.isfinite(s.voltage_V) for s in problem.samples])
    factor = np.concatenate([error_factor(problem.prior, s) for s in problem.samples])
    weight = np.concatenate([s.weight_s for s in problem.samples]) / factor**2
    return (np.abs(soc - RESISTANCE_GRID[:, None]) <= _SOC_WINDOW) & measured, weight


def overpotential_share(solution: CircuitSolution, p: Thevenin, curve_V: np.ndarray, least: float) -> tuple[float, ...]:
    """(21,) relative error of the overpotential: residual over overpotential, in rms over the currents near each SoC.

    curve_V: (21,) part of the residual that rests have as well; least: smallest error.
    """
    over_V2, residual_V2 = np.zeros((2, RESISTANCE_GRID.size))
    for s, residual_V in zip(solution.problem.samples, solution.residual_V, strict=True):
        flows = (np.abs(s.mean_current_A) > COVERED_RATE * p.capacity_Ah) & np.isfinite(residual_V)
        near = np.abs(s.soc - RESISTANCE_GRID[:, None]) <= _SHARE_WINDOW
        time_s = near * np.where(flows, s.weight_s, 0.0)
        over_V2 += time_s @ np.nan_to_num(s.voltage_V - p.ocv.mean_V(s.soc, s.temperature_degC)) ** 2
        residual_V2 += time_s @ np.nan_to_num(residual_V) ** 2 - time_s.sum(axis=1) * curve_V**2
    seen = over_V2 > 0
    if not seen.any():
        return (least,) * RESISTANCE_GRID.size
    share = np.sqrt(np.maximum(residual_V2[seen], 0.0) / over_V2[seen])
    share = np.interp(RESISTANCE_GRID, RESISTANCE_GRID[seen], share)
    return tuple(np.clip(share, least, _LARGEST_ERROR).tolist())


def posterior_std_V(solution: CircuitSolution, current_A: float) -> np.ndarray:
    """(21,) standard deviation of the predicted voltage at each SoC under a lasting load of this current [V].

    That of the OCV correction and of all resistances together, after the relaxation of all RC pairs.
    """
    rows = -current_A * _steady_resistance(solution)
    rows[:, solution.unknowns.group("ocv")] = hat(RESISTANCE_GRID, OCV_KNOTS)
    return np.sqrt(np.maximum(variances(rows, solution.cov), 0.0))


def unvisited_std_V(problem: CircuitProblem) -> np.ndarray:
    """(21,) standard deviation of a lithium-ion cell's model away from the SoC at which a current flowed [V].

    Measured on cells identified from one half of their range: it grows with the root of the distance.
    """
    seen = RESISTANCE_GRID[covered(problem.samples, problem.capacity_Ah)]
    distance = np.abs(RESISTANCE_GRID[:, None] - seen).min(axis=1, initial=1.0)
    return _UNVISITED_STD_V * np.sqrt(np.maximum(distance - _SOC_WINDOW, 0.0) / 0.1)


def _white_std(steps: np.ndarray) -> float:
    """Standard deviation of white noise by its steps (N,) from sample to sample; robust."""
    return float(_MAD * np.median(np.abs(steps)) / np.sqrt(2)) if steps.size else 0.0


def correlation_s(solution: CircuitSolution) -> float:
    """Correlation time of the residual [s], after which its autocorrelation has fallen to 1/e, on a grid of 10 s."""
    times = [_decay_s(s, r) for s, r in zip(solution.problem.samples, solution.residual_V, strict=True)]
    low, high = _CORRELATION_S
    return float(min(max(np.median(times), low), high))


def current_noise_A(record: Record) -> float:
    """White noise of a current sensor [A]: the robust spread of the steps within rests and steady currents.

    0 for a record of varying currents alone, whose steps are those of the load.
    """
    current_A = record.current_A
    steps = [np.diff(current_A[p.first : p.last + 1]) for p in record.phases if p.kind != "varying"]
    return _white_std(np.concatenate([np.zeros(0), *steps]))


def _decay_s(samples: FitSamples, residual_V: np.ndarray) -> float:
    grid_s = np.arange(samples.time_s[0], samples.time_s[-1], _RESAMPLED_S)
    known = np.isfinite(residual_V)
    r = np.interp(grid_s, samples.time_s[known], residual_V[known])
    r = r - r.mean()
    spectrum = np.fft.rfft(r, 2 * r.size)
    autocorrelation = np.fft.irfft(np.abs(spectrum) ** 2)[: r.size]
    below = np.flatnonzero(autocorrelation < autocorrelation[0] / np.e)
    return _RESAMPLED_S * float(below[0]) if below.size else _CORRELATION_S[1]
