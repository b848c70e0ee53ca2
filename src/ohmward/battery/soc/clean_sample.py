"""A sample made safe for a filter: bad numbers replaced by the last good ones, and said so. Never stops or raises."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.trace import exp, maximum, where

#: No battery is used beyond these; sensors say -127 or -273 when their wire is off.
COLDEST_DEGC, HOTTEST_DEGC = -60.0, 120.0

#: Without a sensor the last current is believed for so long, then less and less.
HOLD_S = 30.0

#: A longer step is a clock that was set, not a battery that waited.
LONGEST_STEP_S = 365 * 86400.0

#: No cell shows more than so many times its highest open-circuit voltage; a sensor without its wire shows 0.
HIGHEST_VOLTAGE_SHARE = 2.0


class CleanSocSample(NamedTuple):
    """A sample made safe: every number finite, and what was wrong with it.

    dt_s: step [s], >= 0.
    mean: mean current over the step and temperature.
    now: current of this instant and temperature.
    change_A: current now minus current before.
    known: 1 where the current is measured and close enough in time to the one before, else 0.
    flags: sum of `SocFlag`.
    unknown_s: how long the current has not been known, this step included; 0 where it is.
    measured: 1 where the current of this instant is measured, else 0.
    """

    dt_s: Any
    mean: CircuitInput
    now: CircuitInput
    change_A: Any
    known: Any
    flags: Any
    unknown_s: Any
    measured: Any


class Rest(NamedTuple):
    """A rest of the battery.

    quiet_s: how long the current has been quiet.
    used: 1 once the voltage of this rest has been used: it would say the same again and again.
    """

    quiet_s: Any = 0.0
    used: Any = 0.0


def sanitize(
    sample: SocSample,
    current_before_A: Any,
    temperature_before_degC: Any,
    gap_s: float,
    current_limit_A: float = math.inf,
    unknown_before_s: Any = 0.0,
) -> CleanSocSample:
    """The sample with everything that cannot be true replaced by what was last known, and said so.

    gap_s: a longer step says nothing about the current between its two samples. Then the line between them is taken
        for `gap_s` of the step and no current for the rest of it: a robot that was switched off did not go on driving.
    current_limit_A: a larger current is a fault of the sensor; one sample of it would move SoC for good.
    unknown_before_s: how long the current had not been known before this step.
    """
    time_good = (sample.dt_s >= 0) & (sample.dt_s <= LONGEST_STEP_S)
    dt_s = where(time_good, sample.dt_s, 0.0)
    current_good = is_current(sample.current_A, current_limit_A)
    current = where(current_good, sample.current_A, current_before_A * exp(-dt_s / HOLD_S))
    temperature = where(is_temperature(sample.temperature_degC), sample.temperature_degC, temperature_before_degC)
    gap = dt_s > gap_s
    flags = (
        where(current_good, 0.0, float(SocFlag.NO_CURRENT))
        + where(time_good, 0.0, float(SocFlag.BAD_TIME))
        + where(gap, float(SocFlag.GAP), 0.0)
    )
    trusted_share = gap_s / maximum(dt_s, gap_s)
    mean = CircuitInput(0.5 * (current + current_before_A) * trusted_share, temperature)
    measured, known = where(current_good, 1.0, 0.0), where(current_good & ~gap, 1.0, 0.0)
    unknown_s = where(known > 0.5, 0.0, unknown_before_s + dt_s)
    return CleanSocSample(
        dt_s, mean, CircuitInput(current, temperature), current - current_before_A, known, flags, unknown_s, measured
    )


def rested(before: Rest, quiet: Any, dt_s: Any, settle_s: float, usable: Any = True) -> tuple[Rest, Any]:
    """The rest after a step, and whether its voltage is to be used now: once, when it is usable and has settled.

    quiet: whether the current is one of rest.  usable: whether there is a voltage.
    """
    quiet_s = where(quiet, before.quiet_s + dt_s, 0.0)
    due = (quiet_s > settle_s) & (before.used < 0.5) & usable
    return Rest(quiet_s, where(quiet, where(due, 1.0, before.used), 0.0)), due


def first_input(first: SocSample, current_limit_A: float = math.inf) -> CircuitInput:
    """Current and temperature of the first sample: no current and room temperature where it says nothing credible."""
    current = where(is_current(first.current_A, current_limit_A), first.current_A, 0.0)
    temperature = where(is_temperature(first.temperature_degC), first.temperature_degC, ROOM_DEGC)
    return CircuitInput(current, temperature)


def is_current(current_A: Any, limit_A: float) -> Any:
    """Whether it is a finite number within the limit."""
    return abs(current_A) <= min(limit_A, 1e9)


def is_temperature(temperature_degC: Any) -> Any:
    """Whether it is a number and a battery can have that temperature."""
    return (temperature_degC >= COLDEST_DEGC) & (temperature_degC <= HOTTEST_DEGC)


def is_voltage(voltage_V: Any, highest_ocv_V: float) -> Any:
    """Whether it is a number and a battery with this open-circuit voltage when full can show it."""
    return (voltage_V > 0.0) & (voltage_V < HIGHEST_VOLTAGE_SHARE * highest_ocv_V)


def finite_or(value: float, otherwise: float) -> float:
    """The value, or something else where it is no number."""
    return float(value) if math.isfinite(value) else otherwise
