"""What the linear Kalman filters on the RC model share: the circuit with what is wrong with sensor and model as states.

    x = [V_cb, V_cs, model_error, offset, resistance]

`offset` [A] is what the current sensor shows at zero current, `resistance` the error of all resistances together as a
share; both are random walks, and the voltage is linear in both as long as the current is measured. `model_error` is the
voltage error of the model in its own standard deviations: a function of SoC, it stays while SoC stays and is new after
`model_soc_length`. Errors of a battery model are not white; as white noise they would average out, and the filter would
be sure and wrong.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models import rc
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc import coulomb
from ohmward.battery.soc.clean_sample import CleanSocSample, is_voltage
from ohmward.battery.soc.sample import SocFlag
from ohmward.checks import require_between, require_positive
from ohmward.filters import kalman
from ohmward.filters.belief import Belief, PackedBelief
from ohmward.filters.gate import choose
from ohmward.trace import clip, logical_not, maximum, table, where

BULK, SURFACE, MODEL_ERROR, OFFSET, RESISTANCE = range(5)

STATE_NAMES = (*rc.STATE_NAMES, "model_error", "offset_A", "resistance")


class LinearState(NamedTuple):
    """All that a linear filter on the RC model carries from sample to sample: plain numbers.

    belief: mean (n,) and lower triangle of the covariance.
    current_A: of the sample before.
    rejected_s: how long the voltage has been outside its gate [s].
    unknown_s: how long the current has not been known [s].
    """

    belief: PackedBelief
    current_A: float
    rejected_s: float
    unknown_s: float


class Gate(NamedTuple):
    """Which voltages are used.

    largest: NIS of a voltage that is used.
    reset_after_s: after so much time outside it is the filter that is wrong; see `correct`.
    highest_ocv_V: of the battery [V]; voltages that no such battery can show are none.
    rejected_s: how long the voltage has been outside so far [s].
    """

    largest: float
    reset_after_s: float
    highest_ocv_V: float
    rejected_s: Any


class VoltageUpdate(NamedTuple):
    """What became of a voltage.

    belief: after it, or the prior where it was not used.
    voltage_V, voltage_std_V: expected, and how far off the measurement may be.
    innovation_V: measured minus expected; nan where there is none.
    flags: sum of `SocFlag`.
    rejected_s: how long the voltage has been outside its gate.
    """

    belief: Belief
    voltage_V: Any
    voltage_std_V: Any
    innovation_V: Any
    flags: Any
    rejected_s: Any


def start(bulk_V: float, bulk_variance: float, past_V: float, noise: BatteryNoise) -> Belief:
    """Belief before the first sample.

    bulk_V, bulk_variance: open-circuit voltage [V] and its variance.  past_V: how far V_cs may be from it.
    """
    voltages = np.full((2, 2), bulk_variance) + np.diag([0.0, past_V**2])
    errors = np.diag(np.square([1.0, noise.current_offset_std_A, noise.resistance_std]))
    return Belief(np.array([bulk_V, bulk_V, 0.0, 0.0, 0.0]), block_diagonal(voltages, errors))


def transition(p: rc.Circuit | rc.RcModel, kept: Any, dt_s: Any) -> tuple[np.ndarray, np.ndarray]:
    """F (5, 5) and B (5,) of the step x+ = F x + B i_measured.

    kept: share of the model error that is still there after the step.
    """
    A, b = rc.transition(p, dt_s)
    F = block_diagonal(A, np.diag(np.array([kept, 1.0, 1.0])))
    F[:2, OFFSET] = -b
    return F, np.array([*b, 0.0, 0.0, 0.0])


def process_noise(voltages: np.ndarray, kept: Any, dt_s: Any, noise: BatteryNoise) -> np.ndarray:
    """Q (5, 5) of a step.

    voltages: (2, 2), of V_cb and V_cs.  kept: as for `transition`.
    """
    offset = noise.current_offset_walk_A**2 * dt_s / 3600.0
    resistance = noise.resistance_walk**2 * dt_s / 3.6e5
    return block_diagonal(voltages, np.diag(np.array([1 - kept**2, offset, resistance])))


def overpotential(x: np.ndarray, current_A: Any, p: rc.Circuit | rc.RcModel) -> Any:
    """Voltage beyond V_cb [V] in state x at the measured current, with the resistances of p."""
    return rc.voltage(x[:2], current_A - x[OFFSET], p)[0] - x[BULK]


def output(p: rc.Circuit | rc.RcModel, model_std_V: Any, overpotential_V: Any) -> np.ndarray:
    """H (1, 5): the voltage is H x + `rc.instant_resistance` * measured current."""
    bulk_share, surface_share = rc.divider(p)
    return np.array([[surface_share, bulk_share, model_std_V, -rc.instant_resistance(p), overpotential_V]])


def require_settings(gap_s: float, gate: float, reset_after_s: float, current_limit_C: float) -> None:
    """The settings that every linear filter on the RC model has are what they can be."""
    require_positive("gap_s", gap_s)
    require_positive("gate", gate)
    require_between("reset_after_s", reset_after_s, 0.0, math.inf)
    require_positive("current_limit_C", current_limit_C)


def error_decay(moved: Any, noise: BatteryNoise) -> Any:
    """Share of the model error that is left after SoC has moved by so much."""
    return np.exp(-moved / noise.model_soc_length)


def charge_variance(reading: CleanSocSample, moved: Any, noise: BatteryNoise, model: Thevenin) -> Any:
    """Variance of the change of SoC in a step, a gain error included, which adds up over a full charge.

    moved: SoC that flows in the step, without sign.  model: gives the capacity.
    """
    return coulomb.charge_variance(reading, noise, model) + noise.capacity_std**2 * moved


def voltage_variance(
    reading: CleanSocSample, overpotential_V: Any, slope_V: Any, noise: BatteryNoise, share: Any = 0.0
) -> Any:
    """R [V^2] of a step: white noise, and errors that hold on for `correlation_s` and count once in that time.

    overpotential_V: voltage beyond the open circuit's.  slope_V: rise of the open-circuit voltage per unit of SoC.
    share: further error of the overpotential, as a share.
    """
    over = (noise.overpotential_share**2 + share**2) * overpotential_V**2
    axis = (noise.soc_axis_std * slope_V) ** 2
    lasting = maximum(1.0, 2 * noise.correlation_s / maximum(reading.dt_s, 1e-3))
    return (noise.voltage_std_V**2 + over + axis) * lasting


def correct(
    prior: Belief, H: np.ndarray, R: Any, y_hat: Any, voltage_V: Any, gate: Gate, reading: CleanSocSample
) -> VoltageUpdate:
    """The belief after a voltage, or the prior where there is none or it is outside its gate.

    Once patience is at its end, every voltage is used until one fits, and the prior's covariance is widened until the
    voltage stands at the edge of its gate: who was sure and wrong must doubt all that he was sure of.

    H: (1, n).  R: [V^2].  y_hat: voltage expected [V].
    """
    measured = is_voltage(voltage_V, gate.highest_ocv_V)
    y = where(measured, voltage_V, y_hat)
    spread = (H @ prior.cov @ H.T)[0, 0]
    distance = (y - y_hat) ** 2 / gate.largest
    outside = measured & (distance > spread + R)
    lost = outside & (gate.rejected_s > gate.reset_after_s)
    wider = where(lost, maximum((distance - R) / maximum(spread, 1e-30), 1.0), 1.0)
    posterior, innovation = kalman.update(
        prior._replace(cov=wider * prior.cov), np.array([y]), H, np.array([[R]]), np.array([y_hat])
    )
    return VoltageUpdate(
        choose(measured & (logical_not(outside) | lost), posterior, prior),
        y_hat,
        np.sqrt(innovation.cov[0, 0]),
        where(measured, innovation.value[0], math.nan),
        where(measured, 0.0, float(SocFlag.NO_VOLTAGE))
        + where(outside & logical_not(lost), float(SocFlag.VOLTAGE_REJECTED), 0.0)
        + where(lost, float(SocFlag.DIVERGED), 0.0),
        where(outside, gate.rejected_s + reading.dt_s, 0.0),
    )


def limited(belief: Belief, direction: np.ndarray, low: Any, high: Any) -> tuple[Belief, Any]:
    """The belief with direction' x projected into [low, high] along its covariance, and 1.0 where it had to be."""
    mean, P = belief
    value, common = direction @ mean, P @ direction
    excess = value - clip(value, low, high)
    projected = mean - common * (excess / maximum(direction @ common, 1e-30))
    return Belief(projected, P), where(abs(excess) > 0.0, 1.0, 0.0)


def on_soc_grid(values: tuple[float, ...], soc: Any) -> Any:
    """Linear between points on a uniform grid of SoC from 0 to 1, constant beyond."""
    return table(values, 0.0, 1.0 / (len(values) - 1), clip(soc, 0.0, 1.0))


def block_diagonal(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The square matrices a (n, n) and b (m, m) as blocks of one of (n + m, n + m)."""
    n, m = len(a), len(b)
    return np.block([[a, np.zeros((n, m))], [np.zeros((m, n)), b]])
