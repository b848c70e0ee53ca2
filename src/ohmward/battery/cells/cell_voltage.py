"""Voltage of one cell minus that of the typical cell of its pack, and the variance beyond what the states describe."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ohmward.battery.cells.cell_sample import COMMON, GAIN, SOC, CellSpread, Differences, TypicalCell
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.ocv import beyond_line
from ohmward.battery.models.slip import slip_shape
from ohmward.battery.models.thevenin import CircuitInput, StateOfHealth, Thevenin, overpotentials
from ohmward.filters.belief import Belief
from ohmward.trace import clip, exp, linearize, maximum
from ohmward.trace.expression import Scalar

#: Least variance of a state of charge: no voltage tells it better.
LEAST_VARIANCE = 1e-8
#: Share of the hysteresis by which two cells that carry the same current differ.
_HYSTERESIS_SHARE = 0.2


class LinearCurve(NamedTuple):
    """Open-circuit voltage over a belief of the state of charge."""

    voltage_V: Scalar  #: mean [V]
    slope: Scalar  #: [V] for each unit of SoC
    variance: Scalar  #: of what the straight line leaves [V^2]


class Expected(NamedTuple):
    """Expected voltage of a cell minus that of the typical one."""

    voltage_V: Scalar  #: mean [V]
    slopes: np.ndarray  #: (1, 6) its derivatives by the state, `Differences`
    variance: Scalar  #: of what the states do not describe [V^2]


@dataclass(frozen=True)
class CellVoltage:
    """Difference of the voltages of a cell and of the typical one, both as of a pack of such cells."""

    model: Thevenin  #: the circuit of the pack
    noise: BatteryNoise  #: of the model
    n_series: int  #: cells in series
    spread: CellSpread = field(default_factory=CellSpread)  #: differences to expect

    def expect(
        self, prior: Belief, typical: TypicalCell, charge_gain: Scalar, now: tuple[CircuitInput, np.ndarray]
    ) -> Expected:
        """The difference expected of a belief, linearised over it.

        charge_gain: of the typical cell.
        now: current and temperature, and the (n,) RC voltages of the typical cell with the resistances of the file.
        """
        u, pair_V = now
        x, P, slip = Differences(*prior.mean), prior.cov, self.model.ocv_slip
        soc = typical.soc + x.soc
        variance = P[COMMON, COMMON] + 2.0 * P[COMMON, SOC] + P[SOC, SOC]
        own = self.curve(soc, variance, slip * (charge_gain + x.charge_gain - 1.0), u)
        common = self.curve(typical.soc, P[COMMON, COMMON], slip * (charge_gain - 1.0), u)
        curve_std_V = self.curve_std_V(prior, typical, (own, common), u)
        ratio = typical.resistance_ratio

        def overpotentials_V(soc: Scalar, ohmic: Scalar, pair: Scalar) -> list[Scalar]:
            state = np.array([soc, *(pair * v for v in pair_V), 0.0])
            return overpotentials(state, u, self.model, StateOfHealth(resistance_ratio=ohmic))

        def own_overpotentials_V(d: Differences) -> list[Scalar]:
            return overpotentials_V(soc, ratio * exp(d.ohmic_log), ratio * exp(d.pair_log))

        def difference_V(z: np.ndarray) -> np.ndarray:
            d = Differences(*z)
            slipped = slip * slip_shape(soc, slip) * (d.charge_gain - x.charge_gain)
            own_V = (
                own.voltage_V + own.slope * (d.common_soc + (d.soc - x.soc) + slipped) + sum(own_overpotentials_V(d))
            )
            common_V = common.voltage_V + common.slope * d.common_soc + sum(overpotentials_V(typical.soc, ratio, ratio))
            return np.array([own_V - common_V + curve_std_V * d.curve])

        voltage_V, slopes = linearize(difference_V, np.array([0.0, *prior.mean[1:]]))
        *pairs_V, drop_V = own_overpotentials_V(x)
        variance = self.white_variance(x, typical, (drop_V, sum(pairs_V))) + own.variance + common.variance
        return Expected(voltage_V[0], slopes, variance)

    def white_variance(self, x: Differences, typical: TypicalCell, over_V: tuple[Scalar, Scalar]) -> Scalar:
        """Variance of the channel, and of the overpotentials (ohmic, RC) beyond a common factor of each [V^2]."""
        uneven = self.noise.overpotential_share_at(typical.soc) * (exp(x.pair_log) - 1.0)
        share2 = self.spread.overpotential_share**2 + uneven * uneven
        channel_V = self.n_series * self.spread.voltage_std_V
        return channel_V * channel_V + share2 * sum(v * v for v in over_V)

    def curve(self, soc: Scalar, variance: Scalar, slipped: Scalar, u: CircuitInput) -> LinearCurve:
        """Open-circuit voltage of a cell whose electrodes have slipped, linearised over its belief of SoC.

        Over three points of the belief, weights 1/6, 2/3, 1/6 (Gauss-Hermite), none beyond empty or full: statistical
        linearisation (Gelb 1974, 6.2), because a knee is narrower than the belief.
        """
        step = np.sqrt(3.0 * maximum(variance, LEAST_VARIANCE))

        def voltage(point: Scalar) -> Scalar:
            inside = clip(point, 0.0, 1.0)
            on_curve = inside + slipped * slip_shape(inside, self.model.ocv_slip)
            return self.model.ocv.mean_V(on_curve, u.temperature_degC)

        low, middle, high = voltage(soc - step), voltage(soc), voltage(soc + step)
        slope = (high - low) / (2.0 * step)
        mean, variance = beyond_line(high - middle - slope * step, low - middle + slope * step)
        return LinearCurve(middle + mean, slope, maximum(variance, 0.0))

    def curve_std_V(
        self, prior: Belief, typical: TypicalCell, curves: tuple[LinearCurve, LinearCurve], u: CircuitInput
    ) -> Scalar:
        """Standard deviation of the difference of the open-circuit voltages beyond that of the curve [V].

        Two cells at the same state of charge differ by their making. At two states of charge d apart the errors of the
        file's curve differ too: by its axis where the slope is another, and by 2 (1 - e^(-|d| / length)) of its
        variance.

        curves: of the cell and of the typical one.
        """
        x, spread, noise = Differences(*prior.mean), self.spread, self.noise
        soc, slope, slope_of_typical = typical.soc + x.soc, curves[0].slope, curves[1].slope
        gain2 = x.charge_gain * x.charge_gain + prior.cov[GAIN, GAIN]
        distance = np.sqrt(x.soc * x.soc + prior.cov[SOC, SOC])
        model_std_V = noise.model_std_at(soc)
        terms = (
            self.n_series * spread.curve_std_V,
            spread.soc_axis_std * slope,
            noise.ocv_slip_std * slip_shape(soc, self.model.ocv_slip) * np.sqrt(gain2) * slope,
            noise.soc_axis_std * (slope - slope_of_typical),
            _HYSTERESIS_SHARE * self.model.hysteresis_V_at(soc, u.temperature_degC),
        )
        of_curve_V2 = model_std_V * model_std_V * 2.0 * (1.0 - exp(-distance / noise.model_soc_length))
        return np.sqrt(sum(term * term for term in terms) + of_curve_V2)
