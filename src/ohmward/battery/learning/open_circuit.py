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
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.identification.circuit_design import hat
from ohmward.battery.learning.parameters import ENTROPY_KNOTS, OCV_KNOTS, Parameters, parameters_of
from ohmward.battery.models.slip import slip_shape
from ohmward.battery.models.thevenin import Thevenin

#: A shorter stretch than this above empty is not stretched: it is as good as seen.
_SHORTEST = 0.02


class CurvePlace(NamedTuple):
    """Places z on the curve of the file."""

    seen_from_soc: float  #: l
    log_ratio: float  #: of the capacity over the file's

    @property
    def empty(self) -> float:
        """Charge e at empty."""
        return 1.0 - float(np.exp(self.log_ratio))

    @property
    def stretches(self) -> bool:
        """True where a stretch of the curve has not been seen."""
        return self.seen_from_soc > _SHORTEST and self.seen_from_soc - self.empty > _SHORTEST

    def at(self, charge: np.ndarray) -> np.ndarray:
        """Places (N,) of these charges c."""
        if not self.stretches:
            return charge
        low, empty = self.seen_from_soc, self.empty
        return np.where(charge < low, low * (charge - empty) / (low - empty), charge)

    def by_log_ratio(self, charge: np.ndarray) -> np.ndarray:
        """(N,) derivative of the places by the logarithm of the capacity."""
        if not self.stretches:
            return np.zeros_like(charge)
        low, empty = self.seen_from_soc, self.empty
        return np.where(charge < low, low * (low - charge) * (1.0 - empty) / (low - empty) ** 2, 0.0)


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
        """Places on the curve without slip."""
        knowledge = self.battery.knowledge
        seen_from_soc = 1.0 if knowledge is None else knowledge.seen_from_soc
        return CurvePlace(seen_from_soc, float(self.theta[self.parameters.group("capacity")].sum()))

    @cached_property
    def slip(self) -> float:
        """Share of a loss of capacity by which the electrodes slip; 0 for a battery whose curve was learnt."""
        if self.battery.knowledge is not None:
            return 0.0
        return self.model.ocv_slip + float(self.theta[self.parameters.group("slip")].sum())

    @cached_property
    def loss(self) -> float:
        """Loss of capacity over the capacity that is left."""
        return float(np.expm1(-self.place.log_ratio))

    def at(self, charge: np.ndarray, temperature_degC: np.ndarray | float) -> np.ndarray:
        """Voltage [V] without hysteresis at these charges (N,)."""
        group, curve = self.parameters.group, self.model.ocv
        voltage_V = np.asarray(curve.mean_V(self._place(charge), temperature_degC))
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
        z, degC = self._place(charge), temperature_degC
        steep_V = (curve.mean_V(z + _HALF_STEP, degC) - curve.mean_V(z - _HALF_STEP, degC)) / (2 * _HALF_STEP)
        shape = slip_shape(self.place.at(charge), self.model.ocv_slip)
        moved = self.place.by_log_ratio(charge) - self.slip * shape * np.exp(-self.place.log_ratio)
        columns[:, group("capacity")] = (steep_V * moved)[:, None]
        if self.battery.knowledge is None:
            columns[:, group("slip")] = (steep_V * shape * self.loss)[:, None]
        columns[:, group("ocv")] = hat(charge, OCV_KNOTS)
        if self.theta[group("entropy")].size:
            warmer_K = np.broadcast_to(degC - curve.reference_degC, charge.shape)
            columns[:, group("entropy")] = warmer_K[:, None] * hat(charge, ENTROPY_KNOTS)
        return columns

    def _place(self, charge: np.ndarray) -> np.ndarray:
        """Places z (N,) on the curve of the file."""
        z = self.place.at(charge)
        return z + self.slip * slip_shape(z, self.model.ocv_slip) * self.loss if self.slip else z
