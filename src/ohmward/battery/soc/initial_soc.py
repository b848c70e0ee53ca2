"""State of charge before the first step: from a value, from the first voltage, or from both.

On a grid of SoC the likelihood of the first voltage accounts for all of its errors; mean and standard deviation of the
posterior start the filter. A value that the voltage contradicts is overruled: the prior keeps a small share for "the
value is wrong". Without a value the prior is flat. This is a Bayesian update without linearisation, where it matters
most: an OCV curve is flat in some places and steep in others.

The expected voltage of one SoC can be traced; the density on the grid (`start_density`) is plain NumPy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmward.battery.models.noise import HYSTERESIS_UNKNOWN_STD, BatteryNoise, CurrentSensor
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, ohmic_drop, pair_resistances
from ohmward.battery.soc.clean_sample import first_input
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.start_density import (
    GRID_STEP,
    WRONG_SHARE,
    ExpectedVoltage,
    Hypothesis,
    soc_grid,
    start_hypotheses,
)
from ohmward.checks import require_between, require_positive
from ohmward.trace import exp, sqrt

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
        self, first: SocSample, soc: float | None = None, soc_std: float = 0.03, wrong_share: float = WRONG_SHARE
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

    def expected_voltage(self, soc: Any, first: SocSample) -> ExpectedVoltage:
        """First voltage OCV + R_0 i expected at `soc`, and its errors; float, array or traced."""
        u, p = first_input(first, self.current_limit_A), self.model
        mean_V = p.ocv.mean_V(soc, u.temperature_degC) + ohmic_drop(soc, u, p)
        std_V = first_voltage_std(soc, u, p, self.noise, self.sensor)
        return ExpectedVoltage(mean_V, std_V, lasting_std_V(soc, u, p, self.noise))


def lasting_std_V(soc: Any, u: CircuitInput, p: Thevenin, noise: BatteryNoise) -> Any:
    """Standard deviation [V] of the voltage error at rest that stays: curve, level, axis, temperature, gain."""
    above_V = p.ocv.mean_V(soc + GRID_STEP, u.temperature_degC)
    slope = (above_V - p.ocv.mean_V(soc - GRID_STEP, u.temperature_degC)) * (0.5 / GRID_STEP)
    curve_V, level_V = noise.curve_stds(soc, u.error_degC - p.ocv.reference_degC)
    gain_V = noise.gain_error_V(soc, u, p)
    return sqrt(curve_V**2 + (noise.soc_axis_std * slope) ** 2 + level_V**2 + gain_V**2)


def first_voltage_std(soc: Any, u: CircuitInput, p: Thevenin, noise: BatteryNoise, sensor: CurrentSensor) -> Any:
    """Standard deviation [V] of the first voltage about OCV + R_0 i: sensor, model, OCV, drop, hysteresis, past."""
    past = sum(pair_resistances(soc, u, p)) * (abs(u.current_A) + sensor.offset_std_A)
    resistance_std = sqrt(noise.resistance_variance_at(u, p))
    drop = resistance_std * abs(ohmic_drop(soc, u, p))
    hysteresis = HYSTERESIS_UNKNOWN_STD * np.exp(noise.hysteresis_std**2) * p.hysteresis_V_at(soc, u.temperature_degC)
    terms = (
        noise.voltage_std_V,
        lasting_std_V(soc, u, p, noise),
        hysteresis,
        drop,
        PAST_SHARE * exp(resistance_std**2) * past,
    )
    return sqrt(sum(term * term for term in terms))
