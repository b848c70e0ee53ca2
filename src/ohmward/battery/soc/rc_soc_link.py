"""State of charge and voltage of the RC model: by the inverse OCV curve, or as a state beside a straight OCV line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ohmward.battery.models.noise import BatteryNoise, on_soc_grid
from ohmward.battery.models.rc import Circuit, RcModel
from ohmward.filters.belief import Belief
from ohmward.trace import clip, maximum, table
from ohmward.trace.expression import Scalar

BULK, SURFACE, MODEL_ERROR, OFFSET, RESISTANCE, SOC = range(6)

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
        soc, ocv_V = _curve(self.model)
        return tuple(np.gradient(ocv_V, soc).tolist())


@dataclass(frozen=True)
class SocAsState:
    """SoC is a state that counts charge, d soc/dt = i / Q, and V_cb lies on a straight OCV line ([T] 3.4.2).

    SoC does not change when the circuit's capacitances do, and the voltage corrects it by
    their common errors: a wrong start, a wrong current. The distance of the OCV curve from the line is model error.
    """

    model: RcModel
    noise: BatteryNoise
    soc_is_state = True

    def ocv_V(self, soc: Scalar) -> Scalar:
        """Open-circuit voltage [V] on the line, which passes through the middle of the curve."""
        return self._empty_V + self._slope_V * soc

    def slope_V(self, soc: Scalar) -> Scalar:
        """Slope of the line [V per unit of SoC]."""
        return self._slope_V

    def curvature_variance_V2(self, soc: Scalar) -> Scalar:
        """Process variance of the voltages for a bent curve [V^2 per unit of SoC moved]: none."""
        return 0.0

    def model_std_V(self, soc: Scalar) -> Scalar:
        """Standard deviation of the model's voltage error [V], that of the line included."""
        return on_soc_grid(self._model_std_V, soc)

    def soc(self, x: np.ndarray) -> Scalar:
        """State of charge in state x."""
        return x[SOC]

    def soc_variance(self, belief: Belief) -> Scalar:
        """Variance of SoC."""
        return maximum(belief.cov[SOC, SOC], 0.0)

    def project(self, belief: Belief) -> tuple[Belief, Scalar]:
        """The belief with its SoC in [0, 1], and the condition that it was not."""
        return project(belief, np.eye(SOC + 1)[SOC], 0.0, 1.0)

    @cached_property
    def _slope_V(self) -> float:
        return float(line_slope_V(self.model, self.model.capacity_As))

    @cached_property
    def _empty_V(self) -> float:
        """Voltage of the line [V] at SoC 0."""
        soc, ocv_V = _curve(self.model)
        return float(np.median(ocv_V - self._slope_V * soc))

    @cached_property
    def _model_std_V(self) -> tuple[float, ...]:
        """Model error [V] on a uniform grid of SoC.

        The distance of the curve has zeros, but at a SoC that is itself in doubt: it counts as at least its root mean
        square between 10 and 90 %.
        """
        soc, ocv_V = _curve(self.model)
        curvature_V = np.abs(ocv_V - self._empty_V - self._slope_V * soc)
        usual_V = np.sqrt(np.mean(curvature_V[(soc > 0.1) & (soc < 0.9)] ** 2))
        return tuple(np.hypot(np.maximum(curvature_V, usual_V), on_soc_grid(self.noise.model_std_V, soc)).tolist())


SocLink = SocByCurve | SocAsState


def line_slope_V(p: Circuit | RcModel, capacity_As: float) -> Scalar:
    """Slope Q / (C_b + C_s) [V per unit of SoC] of the straight OCV line for which the capacitances stand."""
    return capacity_As / (p.c_bulk_F + p.c_surface_F)


def project(belief: Belief, row: np.ndarray, low: float, high: float) -> tuple[Belief, Scalar]:
    """The belief with row @ x projected into [low, high] along its covariance, and the condition that it had to be."""
    mean, P = belief
    value = row @ mean
    excess = value - clip(value, low, high)
    common = P @ row
    projected = mean - common * (excess / maximum(row @ common, 1e-30))
    return Belief(projected, P), abs(excess) > 0.0


def _curve(model: RcModel) -> tuple[np.ndarray, np.ndarray]:
    """OCV curve at its reference temperature on a uniform grid of SoC."""
    soc = np.linspace(0.0, 1.0, 101)
    return soc, model.ocv.mean_V(soc, model.ocv.reference_degC)
