"""Stage 7: the noise that a filter should assume, from what the fit leaves and from where it had no data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.battery.identification.circuit_design import OCV_KNOTS, RESISTANCE_GRID, hat
from ohmward.battery.identification.circuit_solve import Solution
from ohmward.battery.identification.circuit_prior import CELL_V
from ohmward.battery.identification.samples import Samples
from ohmward.battery.noise import Noise
from ohmward.battery.thevenin import Thevenin

OFFSET_SHARE = 0.025
_SMALLEST_STD_V = 0.002
_SMALLEST_MODEL_STD_V = 0.003
_WINDOW = 0.05
_MAD = 1.4826
_CORRELATION_S = (20.0, 1000.0)
_GAIN_STD = 0.01
_HYSTERESIS_STD = 0.3


def noise_from_fit(solution: Solution, samples: Sequence[Samples], p: Thevenin, current_noise_A: float) -> Noise:
    """The noise to assume with the identified circuit.

    The model's error along SoC is what the fit left there, and what its posterior does not know: little where there
    were data, growing where there were none.
    current_noise_A: white noise of the current sensor, as seen at rest.
    """
    volts = _volts(samples)
    data_V = residual_std_V(solution, samples)
    known_V = posterior_std_V(solution, samples, p)
    model_V = np.maximum(np.hypot(np.where(np.isnan(data_V), 0.0, data_V), known_V), _SMALLEST_MODEL_STD_V * volts)
    return Noise(
        voltage_std_V=max(white_std_V(solution), _SMALLEST_STD_V * volts),
        model_std_V=tuple(model_V.tolist()),
        correlation_s=correlation_s(solution, samples),
        current_std_A=max(current_noise_A, 0.002 * p.capacity_Ah),
        current_offset_std_A=OFFSET_SHARE * p.capacity_Ah,
        current_offset_walk_A=0.001 * p.capacity_Ah,
        capacity_std=_GAIN_STD,
    )


def residual_std_V(solution: Solution, samples: Sequence[Samples]) -> np.ndarray:
    """(21,) rms of what the fit left within 5 % of each SoC [V], nan where there are no data."""
    soc = np.concatenate([s.soc for s in samples])
    weight = np.concatenate([np.minimum(s.dt_s, 60.0) for s in samples])
    residual_V = np.concatenate(solution.residual_V)
    near = (np.abs(soc - RESISTANCE_GRID[:, None]) <= _WINDOW) & np.isfinite(residual_V)
    total = near @ weight
    mean_square = near @ (weight * np.nan_to_num(residual_V) ** 2) / np.where(total > 0, total, np.nan)
    return np.sqrt(mean_square)


def posterior_std_V(solution: Solution, samples: Sequence[Samples], p: Thevenin) -> np.ndarray:
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
    hysteresis_V = _HYSTERESIS_STD * np.asarray(p.ocv.half_gap_V(RESISTANCE_GRID)) * np.ones(RESISTANCE_GRID.size)
    return np.sqrt(np.maximum(variance, 0.0) + hysteresis_V**2)


def typical_current_A(samples: Sequence[Samples]) -> float:
    """Mean magnitude of the current over time [A], as a slow RC pair sees it."""
    moved = sum(float(np.abs(s.mean_current_A * s.dt_s).sum()) for s in samples)
    return moved / max(sum(float(s.dt_s.sum()) for s in samples), 1e-9)


def white_std_V(solution: Solution) -> float:
    """Standard deviation of the residual from one sample to the next [V], robust: it is the part that is white."""
    steps = np.concatenate([np.diff(r) for r in solution.residual_V])
    steps = np.abs(steps[np.isfinite(steps)])
    return float(_MAD * np.median(steps) / np.sqrt(2)) if steps.size else 0.0


def correlation_s(solution: Solution, samples: Sequence[Samples]) -> float:
    """Time after which the residual has lost its memory [s]: 1/e of its autocorrelation, on a grid of 10 s."""
    times = [_decay_s(s, r) for s, r in zip(samples, solution.residual_V, strict=True)]
    low, high = _CORRELATION_S
    return float(min(max(np.median(times), low), high))


def current_noise_A(current_A: np.ndarray) -> float:
    """White noise of a current sensor [A]: the robust spread of the steps where the current is steady."""
    steps = np.abs(np.diff(current_A))
    steady = steps[steps <= np.quantile(steps, 0.3)]
    return float(_MAD * np.median(steady)) if steady.size else 0.0


def _decay_s(samples: Samples, residual_V: np.ndarray) -> float:
    grid_s = np.arange(samples.time_s[0], samples.time_s[-1], 10.0)
    known = np.isfinite(residual_V)
    r = np.interp(grid_s, samples.time_s[known], residual_V[known])
    r = r - r.mean()
    spectrum = np.fft.rfft(r, 2 * r.size)
    autocorrelation = np.fft.irfft(np.abs(spectrum) ** 2)[: r.size]
    below = np.flatnonzero(autocorrelation < autocorrelation[0] / np.e)
    return 10.0 * float(below[0]) if below.size else _CORRELATION_S[1]


def _volts(samples: Sequence[Samples]) -> float:
    return float(np.nanmean(np.concatenate([s.voltage_V for s in samples]))) / CELL_V
