"""The Thevenin model along a whole record at once, at a known state of charge: a voltage without a filter."""

from __future__ import annotations

import numpy as np

from ohmward.battery.identification.samples import Samples
from ohmward.battery.thevenin import Input, Thevenin, ohmic_resistance, pair_resistances


def scan(decay: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """v_k = decay_k v_(k-1) + drive_k with v_0 = drive_0, for each column of drive (N,) or (N, K)."""
    from scipy.linalg import solve_banded

    band = np.ones((2, decay.size))
    band[1, :-1] = -decay[1:]
    band[1, -1] = 0.0
    return solve_banded((1, 0), band, drive, check_finite=False)


def hysteresis_decay(samples: Samples, capacity_Ah: float, rate: float) -> np.ndarray:
    """(N,) share of the hysteresis state that an interval leaves: e^(-|gamma i dt / Q|)."""
    moved_Ah = np.abs(samples.mean_current_A * samples.dt_s) / 3600.0
    return np.exp(-rate * moved_Ah / capacity_Ah)


def simulate(samples: Samples, p: Thevenin, hysteresis: float = 0.0) -> np.ndarray:
    """(N,) terminal voltage [V] along the samples, from rest; the SoC is that of the samples, not counted again.

    hysteresis: state h at the first sample.
    """
    at = Input(samples.current_A, samples.temperature_degC)
    before = Input(samples.mean_current_A, samples.temperature_degC)
    decay_h = hysteresis_decay(samples, p.capacity_Ah, p.hysteresis_rate)
    drive_h = (1 - decay_h) * np.sign(samples.mean_current_A)
    h = scan(decay_h, np.concatenate([[hysteresis], drive_h[1:]]))
    voltage = p.ocv.mean_V(samples.soc, samples.temperature_degC) + p.ocv.half_gap_V(samples.soc) * h
    for tau, resistance in zip(p.tau_s, pair_resistances(samples.soc_before, before, p), strict=True):
        decay = np.exp(-samples.dt_s / tau)
        voltage = voltage + scan(decay, (1 - decay) * resistance * samples.mean_current_A)
    return voltage + ohmic_resistance(samples.soc, at, p) * samples.current_A
