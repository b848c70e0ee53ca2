"""The Thevenin circuit with one RC pair, the same at every SoC, as in the RC model of [P], and the noise to assume."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.thevenin import RESISTANCE_GRID, CircuitInput, Thevenin, ohmic_resistance, pair_resistances

#: Number of times after a step at which a circuit is compared with its equivalent of one pair.
_STEP_TIMES = 60
#: Keeps a relative difference of two circuits without resistances at 0.
_NO_OHM = 1e-12


def one_pair(model: Thevenin) -> Thevenin:
    """The circuit with one RC pair, the same at every SoC, as in the RC model; all else is unchanged.

    R_0 and the sum of the pairs are their means along SoC; the time constant is the geometric mean of all, weighted by
    their resistances.
    """
    r0, pairs = float(np.mean(model.r0_discharge_ohm)), np.array([np.mean(row) for row in model.r_ohm])
    r1 = float(pairs.sum())
    tau_s = math.exp(float(pairs @ np.log(model.tau_s)) / r1) if r1 > 0.0 else 1.0
    activation_K = mean_activation_K(model)
    return replace(
        model,
        r0_discharge_ohm=(r0, r0),
        r0_charge_ohm=(r0, r0),
        r_ohm=((r1, r1),),
        tau_s=(tau_s,),
        activation_K=activation_K,
        pair_activation_K=None,
        tau_activation_K=activation_K,
    )


def one_pair_noise(model: Thevenin, noise: BatteryNoise) -> BatteryNoise:
    """Noise to assume with `one_pair`, given that of the model: their difference is an error of the overpotential.

    Its share is the largest relative difference of their responses to a step of current, along SoC; it persists for the
    time constant.
    """
    alone, soc = one_pair(model), RESISTANCE_GRID
    time_s = np.geomspace(0.1 * min(model.tau_s, default=1.0), 5.0 * max(model.tau_s, default=1.0), _STEP_TIMES)
    response, expected = (step_response_ohm(p, soc, time_s) for p in (alone, model))
    differs = (np.abs(response - expected) / np.maximum(response, _NO_OHM)).max(axis=0)
    own = np.array([noise.overpotential_share_at(z) for z in soc.tolist()])
    return replace(
        noise,
        overpotential_share=tuple(np.hypot(own, differs).tolist()),
        correlation_s=max(noise.correlation_s, *alone.tau_s),
    )


def step_response_ohm(model: Thevenin, soc: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """(T, N) overpotential these times after a discharging current of 1 A began, at the reference temperature."""
    u = CircuitInput(-1.0, model.reference_degC)
    relaxed = [1.0 - np.exp(-time_s / tau)[:, None] for tau in model.tau_s]
    pairs = sum(share * r for share, r in zip(relaxed, pair_resistances(soc, u, model), strict=True))
    return ohmic_resistance(soc, u, model) + pairs + np.zeros((time_s.size, soc.size))


def mean_activation_K(model: Thevenin) -> float:
    """Activation of all resistances together: the mean of R_0's and the pairs', weighted by their resistances."""
    r0, r1 = float(np.mean(model.r0_discharge_ohm)), float(sum(map(np.mean, model.r_ohm)))
    return (r0 * model.activation_K + r1 * model.activation_of_pairs_K) / max(r0 + r1, 1e-12)
