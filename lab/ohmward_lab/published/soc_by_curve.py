"""State of charge of the RC model by the inverse OCV curve at the mean voltage of its capacitors ([P] 3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ohmward.battery.models.noise import BatteryNoise, on_soc_grid
from ohmward.battery.models.rc import RcModel
from ohmward.filters.belief import Belief
from ohmward.trace import clip, maximum, table
from ohmward.trace.expression import Scalar
from ohmward_lab.published.rc_filter import curve_on_grid, line_slope_V, project

_CURVE_POINTS = 1001


@dataclass(frozen=True)
class SocByCurve:
    """SoC is where the OCV curve passes the mean voltage of both capacitors ([P] 3.1, which takes that of the bulk).

    The capacitance is one number, so charge moves the voltages along a straight line while the curve has bends. The
    difference of the slopes is process noise of both voltages, which then follow the measured voltage rather than the
    charge where the curve is not straight.
    """

    model: RcModel
    noise: BatteryNoise
    soc_is_state = False

    def ocv_V(self, soc: Scalar) -> Scalar:
        """Open-circuit voltage [V] at the curve's reference temperature."""
        return self.model.ocv.mean_V(soc, self.model.ocv.reference_degC)

    def slope_V(self, soc: Scalar) -> Scalar:
        """Slope of the open-circuit voltage [V per unit of SoC]."""
        return on_soc_grid(self._slopes_V, soc)

    def curvature_variance_V2(self, soc: Scalar) -> Scalar:
        """Process variance of both voltages [V^2 per unit of SoC moved] where the curve is not the straight line."""
        curvature_V = self.slope_V(soc) - line_slope_V(self.model, self.model.capacity_As)
        return curvature_V**2 * 2 * self.noise.model_soc_length

    def model_std_V(self, soc: Scalar) -> Scalar:
        """Standard deviation of the model's voltage error [V]."""
        return self.noise.model_std_at(soc)

    def soc(self, x: np.ndarray) -> Scalar:
        """State of charge in [0, 1] in state x."""
        return clip(self.soc_beyond(self.open_circuit @ x), 0.0, 1.0)

    def soc_variance(self, belief: Belief) -> Scalar:
        """Variance of SoC: half the width that one sigma of the open-circuit voltage has on the curve, squared."""
        ocv_V = self.open_circuit @ belief.mean
        std_V = np.sqrt(maximum(self.open_circuit @ belief.cov @ self.open_circuit, 0.0))
        half_width = 0.5 * (self.soc_beyond(ocv_V + std_V) - self.soc_beyond(ocv_V - std_V))
        return half_width**2

    def project(self, belief: Belief) -> tuple[Belief, Scalar]:
        """The belief with its open-circuit voltage on the curve, and the condition that it was not."""
        return project(belief, self.open_circuit, self.model.ocv.voltage_V[0], self.model.ocv.voltage_V[-1])

    def soc_beyond(self, ocv_V: Scalar) -> Scalar:
        """SoC at which the curve passes `ocv_V`, without limits: the inverse curve goes on as a straight line."""
        low, high = self.model.ocv.voltage_V[0], self.model.ocv.voltage_V[-1]
        return table(self._inverse_curve, low, (high - low) / (_CURVE_POINTS - 1), ocv_V)

    @cached_property
    def open_circuit(self) -> np.ndarray:
        """Row (5,) that gives the open-circuit voltage of a state: the mean of both capacitors by charge."""
        total_F = self.model.c_bulk_F + self.model.c_surface_F
        return np.array([self.model.c_bulk_F, self.model.c_surface_F, 0.0, 0.0, 0.0]) / total_F

    @cached_property
    def _inverse_curve(self) -> tuple[float, ...]:
        """SoC on a uniform grid of voltage between the ends of the OCV curve."""
        ocv = self.model.ocv
        grid_V = np.linspace(ocv.voltage_V[0], ocv.voltage_V[-1], _CURVE_POINTS)
        return tuple(ocv.soc_at(v, ocv.reference_degC) for v in grid_V)

    @cached_property
    def _slopes_V(self) -> tuple[float, ...]:
        """Slope of the OCV curve on a uniform grid of SoC."""
        soc, ocv_V = curve_on_grid(self.model)
        return tuple(np.gradient(ocv_V, soc).tolist())
