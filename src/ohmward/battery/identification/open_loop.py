"""Open-loop simulation of the Thevenin model along a whole record, at a known state of charge."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, ohmic_drop, pair_decays, pair_resistances
from ohmward.logs.log import SECONDS_PER_HOUR
from ohmward.optional import require


def scan(decay: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """Recursion v_k = decay_k v_(k-1) + drive_k with v_0 = drive_0, for each column of drive (N,) or (N, K)."""
    solve_banded = require("scipy.linalg", "identification").solve_banded

    band = np.ones((2, decay.size))
    band[1, :-1] = -decay[1:]
    band[1, -1] = 0.0
    return solve_banded((1, 0), band, drive, check_finite=False)


def hysteresis_decay(samples: FitSamples, capacity_Ah: float, rate: float) -> np.ndarray:
    """(N,) decay factor of the hysteresis state over each interval, e^(-|gamma i dt / Q|)."""
    moved_Ah = np.abs(samples.mean_current_A * samples.dt_s) / SECONDS_PER_HOUR
    return np.exp(-rate * moved_Ah / capacity_Ah)


def net_charge_hysteresis(samples: FitSamples, capacity_Ah: float, rate: float, start: float) -> np.ndarray:
    """(N,) hysteresis state where it follows the net charge, `start` at the first sample."""
    steps = (rate * samples.mean_current_A * samples.dt_s / (SECONDS_PER_HOUR * capacity_Ah))[1:]
    return np.array(list(accumulate(steps.tolist(), lambda h, step: min(max(h + step, -1.0), 1.0), initial=start)))


def simulate(samples: FitSamples, p: Thevenin, start_V: Sequence[float] = (), hysteresis: float = 0.0) -> np.ndarray:
    """(N,) terminal voltage [V] along the samples; the SoC is that of the samples, not counted again.

    start_V: (n,) RC voltages at the first sample, () for rest; hysteresis: state h there.
    """
    at = CircuitInput(samples.current_A, samples.temperature_degC)
    before = CircuitInput(samples.mean_current_A, samples.temperature_degC)
    if p.net_charge_hysteresis:
        h = net_charge_hysteresis(samples, p.capacity_Ah, p.hysteresis_rate, hysteresis)
    else:
        decay_h = hysteresis_decay(samples, p.capacity_Ah, p.hysteresis_rate)
        h = scan(decay_h, np.append(hysteresis, ((1 - decay_h) * np.sign(samples.mean_current_A))[1:]))
    voltage = (
        p.ocv.mean_V(samples.soc, samples.temperature_degC)
        + p.hysteresis_V_at(samples.soc, samples.temperature_degC) * h
    )
    resistances = pair_resistances(samples.soc_before, before, p)
    decays = pair_decays(before, p, samples.dt_s)
    for decay, resistance, v0 in zip(decays, resistances, start_V or (0.0,) * p.pairs, strict=True):
        voltage = voltage + scan(decay, np.append(v0, ((1 - decay) * resistance * samples.mean_current_A)[1:]))
    return voltage + ohmic_drop(samples.soc, at, p)
