"""State of charge before the first step: from a value, from the first voltage, or from both.

On a grid of SoC the likelihood of the first voltage accounts for all of its errors; mean and standard deviation of the
posterior start the filter. A value that the voltage contradicts is overruled: the prior keeps a small share for "the
value is wrong". Without a value the prior is flat. This is a Bayesian update without linearisation, where it matters
most: an OCV curve is flat in some places and steep in others.

The expected voltage of one SoC can be traced; the density on the grid (`start_density`) is plain NumPy. A coarse one
for an unknown start can be traced too, for microcontrollers (`VoltageStart.on_coarse_grid`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from itertools import accumulate
from typing import Any

import numpy as np

from ohmward.battery.models.noise import HYSTERESIS_UNKNOWN_STD, BatteryNoise, CurrentSensor
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, ohmic_drop, pair_resistances
from ohmward.battery.soc.clean_sample import first_input
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocSample
from ohmward.battery.soc.start_density import (
    BEYOND,
    GRID_STEP,
    WRONG_SHARE,
    ExpectedVoltage,
    Hypothesis,
    InitialSoc,
    soc_grid,
    start_hypotheses,
)
from ohmward.checks import require_between, require_positive
from ohmward.trace import clip, exp, maximum, minimum, sqrt, where

#: Cells of SoC of the start that can be traced; their number is divisible by that of the hypotheses of a sum.
COARSE_CELLS = 15
#: Density that is left to each of them, over the largest of a voltage with an error of 1 V.
LEAST_DENSITY = 1e-6

#: Standard deviation of the RC voltages before the first sample, as a share of those of a steady current of its size:
#: the true share may be anything from 0 to 1.
PAST_SHARE = 0.5


@dataclass(frozen=True)
class VoltageStart:
    """Start of an estimator from the first voltage."""

    #: battery model, its noise, and the current sensor
    model: Thevenin
    noise: BatteryNoise
    sensor: CurrentSensor
    current_limit_A: float = math.inf  #: a larger first current is a fault of its sensor
    count: int = 1  #: number of hypotheses

    def hypotheses(
        self,
        first: SocSample,
        soc: float | None = None,
        soc_std: float = INITIAL_SOC_STD,
        wrong_share: float = WRONG_SHARE,
    ) -> tuple[Hypothesis, ...]:
        """The density of SoC given the first sample and, where there is one, a value, in `count` parts.

        first: its voltage may be nan.  soc: value in [0, 1] from the user, from a full charge, from storage; None when
        unknown.  soc_std: standard deviation of that value.  wrong_share: prior probability that it is wrong.
        """
        if soc is not None:
            require_between("initial_soc", soc, 0.0, 1.0)
            require_positive("initial_soc_std", soc_std)
        grid = soc_grid(soc)
        expected = self.expected_voltage(grid, first)
        return start_hypotheses(grid, first.voltage_V, expected, soc, soc_std, self.count, wrong_share)

    def on_coarse_grid(self, first: SocSample) -> tuple[Hypothesis, ...]:
        """The density given the first voltage alone, in `count` parts of equal width; traceable.

        As `hypotheses` without a value, with the centres of `COARSE_CELLS` cells in place of the grid; the voltages of
        the outermost ones are those of empty and full, where curves are steep.
        """
        grid = (np.arange(COARSE_CELLS) + 0.5) / COARSE_CELLS
        expected = [self.expected_voltage(soc, first) for soc in (0.0, *grid[1:-1].tolist(), 1.0)]
        lowest_V, highest_V = expected[0].mean_V, expected[-1].mean_V
        above_empty = first.voltage_V > (1 - BEYOND) * lowest_V
        credible = above_empty & (first.voltage_V < (1 + BEYOND) * highest_V)
        nearest_V = clip(first.voltage_V, lowest_V, highest_V)
        excess_V = [where(credible, nearest_V - at.mean_V, 0.0) for at in expected]
        errors = [over / at.std_V for over, at in zip(excess_V, expected, strict=True)]
        too_low = list(accumulate(errors[::-1], maximum, initial=0.0))[:0:-1]
        too_high = list(accumulate((-error for error in errors), maximum, initial=0.0))[1:]
        scaled = [0.5 * (low * low + high * high) for low, high in zip(too_low, too_high, strict=True)]
        least = reduce(minimum, scaled)
        likely = [
            where(credible, exp(least - square) / at.std_V, 1.0) + LEAST_DENSITY
            for square, at in zip(scaled, expected, strict=True)
        ]
        share = [where(credible, (at.model_error_std_V / at.std_V) ** 2, 0.0) for at in expected]
        error_V = [part * over for part, over in zip(share, excess_V, strict=True)]
        left_V = [at.model_error_std_V * sqrt(1.0 - part) for part, at in zip(share, expected, strict=True)]
        columns = [np.split(np.array(column), self.count) for column in (grid, likely, error_V, left_V)]
        return tuple(self._coarse_part(first, *cells) for cells in zip(*columns, strict=True))

    def _coarse_part(
        self, first: SocSample, grid: np.ndarray, likely: np.ndarray, error_V: np.ndarray, left_V: np.ndarray
    ) -> Hypothesis:
        """Mass and moments of neighbouring cells, joint with the error of the model."""
        mass = likely.sum()
        density = likely / mass
        mean = density @ grid
        apart = grid - mean
        variance = density @ (apart * apart) + 1.0 / (12.0 * COARSE_CELLS**2)
        unit_V = lasting_std_V(mean, first_input(first, self.current_limit_A), self.model, self.noise)
        error = density @ error_V / unit_V
        off = error_V / unit_V - error
        error_variance = density @ ((left_V / unit_V) ** 2 + off * off)
        start = InitialSoc(mean, sqrt(variance), error, sqrt(error_variance), density @ (apart * off))
        return Hypothesis(mass, start)

    def expected_voltage(self, soc: Any, first: SocSample) -> ExpectedVoltage:
        """First voltage OCV + R_0 i expected at `soc`, and its errors; float, array or traced."""
        u, p = first_input(first, self.current_limit_A), self.model
        mean_V, full_V = (p.ocv.mean_V(at, u.temperature_degC) + ohmic_drop(at, u, p) for at in (soc, 1.0))
        below_full_V = where(first.voltage_V > 0.0, maximum(full_V - first.voltage_V, 0.0), full_V)
        std_V = first_voltage_std(soc, u, p, self.noise, self.sensor, below_full_V)
        return ExpectedVoltage(
            mean_V,
            std_V,
            lasting_std_V(soc, u, p, self.noise, below_full_V),
            lasting_std_V(soc, u, p, self.noise),
        )


def lasting_std_V(soc: Any, u: CircuitInput, p: Thevenin, noise: BatteryNoise, below_full_V: Any = math.inf) -> Any:
    """Standard deviation [V] of the voltage error at rest that stays: curve, level, axis, temperature, gain.

    below_full_V: as for `axis_error_V`.
    """
    axis_V = axis_error_V(soc, u, p, noise, below_full_V)
    curve_V, level_V = noise.curve_stds(soc, u.error_degC - p.ocv.reference_degC)
    gain_V = noise.gain_error_V(soc, u, p)
    return sqrt(curve_V**2 + axis_V**2 + level_V**2 + gain_V**2)


def axis_error_V(soc: Any, u: CircuitInput, p: Thevenin, noise: BatteryNoise, below_full_V: Any = math.inf) -> Any:
    """Standard deviation [V] of the open-circuit voltage by the error of the curve's SoC axis.

    below_full_V: voltage [V] of the battery below that of the full end of the curve. Its charger stops above the one,
    and such cells are not charged beyond the other, so that the axis errs by no more.
    """
    above_V = p.ocv.mean_V(soc + GRID_STEP, u.temperature_degC)
    slope_V = (above_V - p.ocv.mean_V(soc - GRID_STEP, u.temperature_degC)) * (0.5 / GRID_STEP)
    return minimum(noise.axis_std_at(soc) * slope_V, below_full_V)


def first_voltage_std(
    soc: Any, u: CircuitInput, p: Thevenin, noise: BatteryNoise, sensor: CurrentSensor, below_full_V: Any = math.inf
) -> Any:
    """Standard deviation [V] of the first voltage about OCV + R_0 i: sensor, model, OCV, drop, hysteresis, past.

    below_full_V: as for `axis_error_V`.
    """
    past = sum(pair_resistances(soc, u, p)) * (abs(u.current_A) + sensor.offset_std_A)
    resistance_std = sqrt(noise.resistance_variance_at(u, p))
    drop = resistance_std * abs(ohmic_drop(soc, u, p))
    hysteresis_state_std = np.hypot(
        HYSTERESIS_UNKNOWN_STD * np.exp(noise.hysteresis_std**2), p.tested_branch * noise.hysteresis_std
    )
    hysteresis = hysteresis_state_std * p.hysteresis_V_at(soc, u.temperature_degC)
    terms = (
        noise.voltage_std_V,
        lasting_std_V(soc, u, p, noise, below_full_V),
        hysteresis,
        drop,
        PAST_SHARE * exp(resistance_std**2) * past,
    )
    return sqrt(sum(term * term for term in terms))
