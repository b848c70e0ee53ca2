"""RC model from a whole log, by least squares that are linear but for one number.

With s = C_s / (C_b + C_s) and D = R_b + R_s the terminal voltage of the model is, exactly,

    V = V_start + q / C + R_1 F[i] + R_0 i

where q is the charge since the start, F a first-order filter of gain 1 and rate w, and

    C = C_b + C_s,   R_0 = R_t + R_b R_s / D,   R_1 = (R_b - s D)^2 / D,   w = 1 / (s (1 - s) C D) = 1 / tau.

Each part between two long charges has a V_start of its own. For a given w this is linear: one search in w finds the
best. Where an OCV curve is known, it stands in place of V_start + q / C, so that its bends are not taken for a slow
relaxation, and C is that of the straight line through the part of the curve that the log passes.

`models.rc_elements` makes a circuit of the four numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.open_loop import scan
from ohmward.battery.identification.rc_rule import RcSamples
from ohmward.optional import require

#: Samples further apart weigh no more: the model is wrong for as long as the current lasts.
_LONGEST_WEIGHT_S = 60.0
#: Slower processes belong to the open-circuit voltage of a model with one time constant.
LONGEST_TAU_S = 900.0
#: A relaxation that explains less of the square of the residual is none: slow samples do not tell it from R_0.
_LEAST_EXPLAINED = 0.05
#: Points of the grid of time constants before the search.
_RATES = 40


class VoltageFit(NamedTuple):
    """The four numbers that the voltage of an RC model depends on, see the top of the file."""

    start_V: np.ndarray  #: (parts,) open-circuit voltage at the first sample of each part of the log
    capacitance_F: float  #: C_b + C_s
    #: R_0, R_1
    r0_ohm: float
    r1_ohm: float
    tau_s: float  #: 1 / w
    residual_V: np.ndarray  #: (T,) measured minus fitted voltage; where a curve is known, the curve's is the fitted one

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """C, R_0, R_1 and tau, as `rc.four_numbers`."""
        return self.capacitance_F, self.r0_ohm, self.r1_ohm, self.tau_s

    @property
    def rms_V(self) -> float:
        """Root of the mean square of the residual."""
        return float(np.sqrt(np.mean(self.residual_V**2)))


def fit_voltage(
    samples: RcSamples, ocv_V: np.ndarray | None = None, longest_tau_s: float = LONGEST_TAU_S
) -> VoltageFit | None:
    """Best V_start, C, R_0, R_1 and tau for the whole log; None where the log shows no R_0 or no C.

    Samples weigh as the time they stand for, up to 60 s. No number may be negative.

    ocv_V: (T,) open-circuit voltage along the log where it is known [V].
    longest_tau_s: no slower relaxation is looked for.
    """
    minimize_scalar = require("scipy.optimize", "identification").minimize_scalar

    longest_s = min(0.5 * (samples.time_s[-1] - samples.time_s[0]), longest_tau_s)
    grid = np.geomspace(_shortest_s(samples), max(longest_s, 4 * _shortest_s(samples)), _RATES)
    best = int(np.argmin([_solve(samples, ocv_V, tau)[1] for tau in grid]))
    low, high = np.log(grid[max(best - 1, 0)]), np.log(grid[min(best + 1, _RATES - 1)])
    found = minimize_scalar(
        lambda log_tau: _solve(samples, ocv_V, math.exp(log_tau))[1], bounds=(low, high), method="bounded"
    )
    tau_s = math.exp(found.x)
    (r0, r1, per_C), cost = _solve(samples, ocv_V, tau_s)
    alone, cost_alone = _solve(samples, ocv_V, math.inf)
    if r0 == 0.0 or cost > (1 - _LEAST_EXPLAINED) * cost_alone:
        r0, r1, per_C = alone
    if not (per_C > 0 and r0 > 0):
        return None
    return voltage_fit(samples, ocv_V, (1 / per_C, r0, r1, tau_s if r1 > 0 else _shortest_s(samples)))


def voltage_fit(samples: RcSamples, ocv_V: np.ndarray | None, numbers: tuple[float, float, float, float]) -> VoltageFit:
    """The voltage with these four numbers C, R_0, R_1 and tau, and with the V_start that suits them best."""
    capacitance_F, r0, r1, tau_s = numbers
    over_V = r0 * samples.current_A + r1 * filtered(samples, tau_s)
    charge_V = charge_in_part(samples) / capacitance_F
    open_V = samples.voltage_V - over_V if ocv_V is None else ocv_V
    start_V = _means(samples, open_V - charge_V)
    if ocv_V is None:
        open_V = start_V[samples.part] + charge_V
    return VoltageFit(start_V, capacitance_F, r0, r1, tau_s, samples.voltage_V - (open_V + over_V))


def _solve(samples: RcSamples, ocv_V: np.ndarray | None, tau_s: float) -> tuple[tuple[float, float, float], float]:
    """Best R_0, R_1 and 1 / C >= 0 for a time constant, and the weighted sum of squares that they leave."""
    nnls = require("scipy.optimize", "identification").nnls

    currents = _centred(samples, np.column_stack([samples.current_A, filtered(samples, tau_s)]))
    charge = _centred(samples, charge_in_part(samples))
    if ocv_V is None:
        (r0, r1, per_C), norm = nnls(np.column_stack([currents, charge]), _centred(samples, samples.voltage_V))
    else:
        (r0, r1), norm = nnls(currents, _centred(samples, samples.voltage_V - ocv_V))
        per_C = charge @ _centred(samples, ocv_V) / max(charge @ charge, 1e-300)
    return (float(r0), float(r1), float(per_C)), float(norm) ** 2


def charge_in_part(samples: RcSamples) -> np.ndarray:
    """Charge since the first sample of each part [A s], (T,)."""
    _, first = np.unique(samples.part, return_index=True)
    return samples.charge_As - samples.charge_As[first][samples.part]


def filtered(samples: RcSamples, tau_s: float) -> np.ndarray:
    """The current through a first-order filter of gain 1, (T,); exact for the mean current of each step.

    Each part starts from rest.
    """
    first = np.diff(samples.part, prepend=-1) > 0
    decay = np.where(first, 0.0, np.exp(-samples.dt_s / tau_s))
    return scan(decay, np.where(first, 0.0, (1 - decay) * samples.mean_A))


def _weights(samples: RcSamples) -> np.ndarray:
    """Root of the time that each sample stands for, (T,)."""
    return np.sqrt(np.clip(samples.dt_s, 1e-3, _LONGEST_WEIGHT_S))


def _centred(samples: RcSamples, values: np.ndarray) -> np.ndarray:
    """Weighted values (T,) or (T, n) less the mean of their part, which the best V_start takes."""
    columns = values.reshape(len(values), -1)
    left = [_weights(samples) * (c - _means(samples, c)[samples.part]) for c in columns.T]
    return np.column_stack(left).reshape(values.shape)


def _means(samples: RcSamples, values: np.ndarray) -> np.ndarray:
    """Weighted mean (parts,) of values (T,) over each part."""
    weights = _weights(samples) ** 2
    return np.bincount(samples.part, weights * values) / np.bincount(samples.part, weights)


def _shortest_s(samples: RcSamples) -> float:
    """Half the typical step [s]: anything faster looks like R_0."""
    return 0.5 * float(np.median(samples.dt_s[1:]))
