"""Open-circuit voltage along the charge c, SoC by the capacity of the file, with the corrections of its curve.

    V(c) = OCV(z, T) + c_ocv(c) + (T - T_0) e(c)

The place z on the curve of the file is that of `curve_place`, and for a battery that has not learnt and may have aged
since its test, the slip of its electrodes.

Place on the open-circuit curve of the file that belongs to a charge, if the capacity is another one.

A log shows the voltage over the charge below full, whatever the capacity is. Where logs have shown the curve, down to
the SoC l, it is pinned to that charge. Below, it is known along SoC, so that it stretches to where empty is: at the
charge e = 1 - Q / Q_file, with the capacity Q_file taken for 1,

    z(c) = c                            c >= l
    z(c) = l (c - e) / (l - e)          c <  l

No log has been seen with l = 1: then z is the state of charge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.learning.parameters import ENTROPY_KNOTS, OCV_KNOTS, Parameters, parameters_of
from ohmward.battery.models.knots import hat
from ohmward.battery.models.slip import slip_shape
from ohmward.battery.models.thevenin import Thevenin
from ohmward.trace import Kernel, exp, linearize, where

#: A shorter stretch than this above empty is not stretched: it is as good as seen.
_SHORTEST = 0.02


class CurvePlace(NamedTuple):
    """Places z on the curve of the file."""

    seen_from_soc: Any  #: l
    log_ratio: Any  #: of the capacity over the file's
    slip: Any = 0.0  #: share of a loss of capacity by which the electrodes slip
    full_stays: bool = True  #: False where slip leaves empty where it is, see `slip`

    @property
    def empty(self) -> Any:
        """Charge e at empty."""
        return 1.0 - exp(self.log_ratio)

    def at(self, charge: Any) -> Any:
        """Places (N,) of these charges c; traced as well."""
        low, empty = self.seen_from_soc, self.empty
        stretches = (low > _SHORTEST) & (low - empty > _SHORTEST) & (charge < low)
        z = where(stretches, low * (charge - empty) / where(stretches, low - empty, 1.0), charge)
        loss = exp(-self.log_ratio) - 1.0  # over the capacity that is left
        return z + self.slip * loss * slip_shape(z, 1.0 if self.full_stays else -1.0)

    def columns(self, charge: np.ndarray) -> np.ndarray:
        """(N, 2) derivatives of the places by the logarithm of the capacity and by the slip."""
        place = np.array(self[:3], dtype=float)
        return np.asarray(_columns(self.full_stays).scan(place, np.asarray(charge, dtype=float))[1])


@cache
def _columns(full_stays: bool) -> Kernel:
    """The derivatives of a place, compiled once for all batteries."""

    def step(place: np.ndarray, charge: Any) -> tuple[np.ndarray, np.ndarray]:
        def at(z: np.ndarray) -> np.ndarray:
            return np.array([CurvePlace(place[0], z[0], z[1], full_stays).at(charge)])

        return place, linearize(at, place[1:])[1][0]

    return Kernel(step, np.zeros(3), 0.0)


def true_soc(charge: np.ndarray, log_ratio: float) -> np.ndarray:
    """State of charge at the charges c by the capacity of the file."""
    return 1.0 - (1.0 - charge) * np.exp(-log_ratio)


def file_charge(soc: np.ndarray, log_ratio: float) -> np.ndarray:
    """Charges c by the capacity of the file at these states of charge."""
    return 1.0 - (1.0 - soc) * np.exp(log_ratio)


#: Half step of SoC for the slope of the curve: nearly a distance of its knots, so that the slope has no steps there.
#: They would tell the capacity from where the knots lie.
_HALF_STEP = 0.02


@dataclass(frozen=True, eq=False)
class OpenCircuit:
    """The curve of a battery with the corrections theta (K,)."""

    battery: Battery
    theta: np.ndarray

    @cached_property
    def parameters(self) -> Parameters:
        """Unknowns of the battery."""
        return parameters_of(self.battery)

    @cached_property
    def model(self) -> Thevenin:
        """The circuit of the file."""
        return require_thevenin(self.battery)

    @cached_property
    def place(self) -> CurvePlace:
        """Places on the curve; the electrodes of a battery whose curve was learnt do not slip."""
        knowledge, share = self.battery.knowledge, self.model.ocv_slip
        log_ratio = float(self.theta[self.parameters.group("capacity")].sum())
        if knowledge is not None:
            return CurvePlace(knowledge.seen_from_soc, log_ratio)
        return CurvePlace(1.0, log_ratio, share + float(self.theta[self.parameters.group("slip")].sum()), share >= 0.0)

    def at(self, charge: np.ndarray, temperature_degC: np.ndarray | float) -> np.ndarray:
        """Voltage [V] without hysteresis at these charges (N,)."""
        group, curve = self.parameters.group, self.model.ocv
        voltage_V = np.asarray(curve.mean_V(self.place.at(charge), temperature_degC))
        voltage_V = voltage_V + hat(charge, OCV_KNOTS) @ self.theta[group("ocv")]
        entropy = self.theta[group("entropy")]
        if not entropy.size:
            return voltage_V
        return voltage_V + (temperature_degC - curve.reference_degC) * (hat(charge, ENTROPY_KNOTS) @ entropy)

    def slope_V(self, charge: np.ndarray, temperature_degC: np.ndarray | float) -> np.ndarray:
        """Slope of the voltage along the charge [V] (N,)."""
        above_V, below_V = (self.at(charge + step, temperature_degC) for step in (_HALF_STEP, -_HALF_STEP))
        return (above_V - below_V) / (2 * _HALF_STEP)

    def columns(self, charge: np.ndarray, temperature_degC: np.ndarray | float) -> np.ndarray:
        """(N, K) derivatives of the voltage by the corrections."""
        group, curve = self.parameters.group, self.model.ocv
        columns = np.zeros((charge.size, self.parameters.size))
        z, degC = self.place.at(charge), temperature_degC
        steep_V = (curve.mean_V(z + _HALF_STEP, degC) - curve.mean_V(z - _HALF_STEP, degC)) / (2 * _HALF_STEP)
        by_capacity, by_slip = self.place.columns(charge).T
        columns[:, group("capacity")] = (steep_V * by_capacity)[:, None]
        if self.battery.knowledge is None:
            columns[:, group("slip")] = (steep_V * by_slip)[:, None]
        columns[:, group("ocv")] = hat(charge, OCV_KNOTS)
        if self.theta[group("entropy")].size:
            warmer_K = np.broadcast_to(degC - curve.reference_degC, charge.shape)
            columns[:, group("entropy")] = warmer_K[:, None] * hat(charge, ENTROPY_KNOTS)
        return columns
