"""Sanitise a sample of the battery: replace and flag values that its sensors and its clock cannot have shown."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import CircuitInput, Thevenin
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.filters.flags import flags_of
from ohmward.filters.sanitize import between, hold, is_step, sanitize_step, within
from ohmward.quantities import COLDEST_DEGC, DAY_S, HOTTEST_DEGC, MOST_C
from ohmward.trace import Scalar, logical_not, maximum, where

#: Time constant with which the last current fades while none is measured [s].
HOLD_S = 30.0

#: Time [s] for which a current that is not measured stays the last one, and a voltage waits for the next one, as where
#: the two come one after the other.
WAITS_S = 10.0

#: A longer step says nothing about the current between its two samples [s].
CURRENT_GAP_S = 600.0

#: A longer step means that the clock was set, not that the battery was idle [s].
LONGEST_PAUSE_S = 365 * DAY_S

#: Lowest voltage of a battery over its open-circuit voltage when empty, and highest over that when full. At half the
#: open-circuit voltage a battery gives its greatest power, and a load that draws more gets less. Charging lifts nickel
#: and lead cells most, by 30 % in the cold.
LOWEST_VOLTAGE_RATIO, HIGHEST_VOLTAGE_RATIO = 0.5, 1.4

#: Standard deviation of a temperature that has not been measured yet [K]: a robot works indoors and outdoors.
WEATHER_STD_K = 15.0

#: Without a limit of the current, anything from here on counts as missing [A]: its squares and sums overflow.
_NO_NUMBER_A = 1e9


class SampleLimits(NamedTuple):
    """Plausibility limits of a sample."""

    gap_s: float  #: a longer step says nothing about the current between its two samples
    #: largest current; more is a fault of the sensor: one sample of it would move SoC for good
    current_A: float = math.inf
    #: of the battery, empty and full: what `is_voltage` rejects is a fault of the sensor
    lowest_ocv_V: float = 0.0
    highest_ocv_V: float = math.inf

    def is_current(self, current_A: Any) -> Any:
        """True where a battery can have this current; float, array or traced."""
        return is_current(current_A, self.current_A)

    def is_voltage(self, voltage_V: Any) -> Any:
        """True where a battery can show this voltage; float, array or traced."""
        return is_voltage(voltage_V, self.lowest_ocv_V, self.highest_ocv_V)


def sample_limits(model: Thevenin, gap_s: float = CURRENT_GAP_S) -> SampleLimits:
    """Plausibility limits of a sample of a battery."""
    return SampleLimits(gap_s, MOST_C * model.capacity_Ah, model.ocv.voltage_V[0], model.ocv.voltage_V[-1])


class CleanSocSample(NamedTuple):
    """Sample with finite numbers only, and flags for those that were replaced."""

    dt_s: Scalar  #: step [s], >= 0
    mean: CircuitInput  #: mean current over the step and temperature
    now: CircuitInput  #: current at the instant of the voltage, usually this one, and temperature
    latest_A: Scalar  #: current of this instant
    change_A: Scalar  #: current now minus current before
    current_measured: Any  #: the condition that the current of this instant is measured
    current_known: Any  #: the condition that it is measured, and close enough in time to the previous one
    unknown_s: Scalar  #: time for which the current has not been known, this step included; 0 where it is known
    voltage_V: Scalar  #: measured terminal voltage; 0 where it is missing
    voltage_measured: Any  #: the condition that it is measured
    voltage_step_s: Scalar  #: time since the voltage before [s], this step included
    flags: Scalar  #: sum of `SocFlag`


class CleanBareSample(NamedTuple):
    """A sample sanitised for filters that must fit into a small microcontroller: no flags, no fading, no gaps."""

    dt_s: Scalar  #: step [s], >= 0
    current_A: Scalar  #: of this instant; the previous one where it is missing
    mean_A: Scalar  #: mean current over the step
    voltage_V: Scalar  #: measured terminal voltage; 0 where it is missing
    measured: Any  #: the condition that it is measured


class Rest(NamedTuple):
    """A rest of the battery."""

    rest_s: Any = 0.0  #: time for which the current has been below the rest threshold
    used: Any = 0.0  #: 1 once the voltage of this rest has been used: repeating it would add nothing


def sanitize(
    sample: SocSample,
    before: CircuitInput,
    limits: SampleLimits,
    unknown_before_s: Scalar = 0.0,
    voltage_age_s: Scalar = 0.0,
) -> CleanSocSample:
    """The sample with impossible values replaced by the last credible ones, and flagged.

    Over a gap, the straight line between its two currents is assumed for `limits.gap_s`, and no current for the
    remainder: a robot that was switched off did not go on driving.

    before: last current and temperature.
    unknown_before_s: time for which the current was unknown before this step.
    voltage_age_s: time since the last voltage before this step.
    """
    step = sanitize_step(sample.dt_s, LONGEST_PAUSE_S, limits.gap_s)
    current_measured = limits.is_current(sample.current_A)
    current_known = current_measured & logical_not(step.gap)
    voltage_measured = limits.is_voltage(sample.voltage_V)
    unknown_s = unknown_before_s + step.dt_s
    fades_s = where(unknown_s > WAITS_S, step.dt_s, 0.0)
    current_A = hold(sample.current_A, current_measured, before.current_A, fades_s, HOLD_S)
    temperature_measured = is_temperature(sample.temperature_degC)
    temperature_degC = hold(sample.temperature_degC, temperature_measured, before.temperature_degC)
    unknown_K = where(temperature_measured, 0.0, before.unknown_K)
    line_share = limits.gap_s / maximum(step.dt_s, limits.gap_s)
    return CleanSocSample(
        dt_s=step.dt_s,
        mean=CircuitInput(0.5 * (current_A + before.current_A) * line_share, temperature_degC, unknown_K),
        now=CircuitInput(current_A, temperature_degC, unknown_K),
        latest_A=current_A,
        change_A=current_A - before.current_A,
        current_measured=current_measured,
        current_known=current_known,
        unknown_s=where(current_known, 0.0, unknown_s),
        voltage_V=where(voltage_measured, sample.voltage_V, 0.0),
        voltage_measured=voltage_measured,
        voltage_step_s=voltage_age_s + step.dt_s,
        flags=flags_of(
            {
                SocFlag.NO_CURRENT: logical_not(current_measured),
                SocFlag.NO_VOLTAGE: logical_not(voltage_measured),
                SocFlag.BAD_TIME: logical_not(step.credible),
                SocFlag.GAP: step.gap,
            }
        ),
    )


def without_voltage(clean: CleanSocSample, faulty: Any, flag: SocFlag) -> CleanSocSample:
    """The sample without its voltage, and with the flag, where the condition `faulty` holds."""
    return clean._replace(
        voltage_V=where(faulty, 0.0, clean.voltage_V),
        voltage_measured=clean.voltage_measured & logical_not(faulty),
        flags=clean.flags + flags_of({flag: faulty}),
    )


def sanitize_bare(
    sample: SocSample, before_A: Scalar, highest_ocv_V: float, longest_step_s: float = LONGEST_PAUSE_S
) -> CleanBareSample:
    """The sample with an impossible current, step or voltage replaced; before_A: last current.

    Every positive voltage below the highest counts: the constant of another limit is flash of the microcontroller.
    """
    current_A = hold(sample.current_A, is_current(sample.current_A), before_A)
    measured = is_voltage(sample.voltage_V, 0.0, highest_ocv_V)
    return CleanBareSample(
        dt_s=where(is_step(sample.dt_s, longest_step_s), sample.dt_s, 0.0),
        current_A=current_A,
        mean_A=0.5 * (current_A + before_A),
        voltage_V=where(measured, sample.voltage_V, 0.0),
        measured=measured,
    )


def first_input(first: SocSample, current_limit_A: float = math.inf) -> CircuitInput:
    """Current and temperature of the first sample; zero and room temperature where they are not credible."""
    current_A = hold(first.current_A, is_current(first.current_A, current_limit_A), 0.0)
    measured = is_temperature(first.temperature_degC)
    temperature_degC = hold(first.temperature_degC, measured, ROOM_DEGC)
    return CircuitInput(current_A, temperature_degC, where(measured, 0.0, WEATHER_STD_K))


def continue_rest(before: Rest, resting: Any, dt_s: Scalar, settle_s: float, usable: Any = True) -> tuple[Rest, Any]:
    """The rest after a step, and the condition that its voltage is to be used now: once, when the rest has settled.

    resting: the condition that the current is below the rest threshold.
    settle_s: length of a rest after which its voltage is the open-circuit voltage.
    usable: the condition that there is a voltage.
    """
    rest_s = where(resting, before.rest_s + dt_s, 0.0)
    due = (rest_s > settle_s) & (before.used < 0.5) & usable
    used = where(resting, where(due, 1.0, before.used), 0.0)
    return Rest(rest_s, used), due


def is_current(current_A: Scalar, limit_A: float = math.inf) -> Any:
    """True where it is a finite number within the limit."""
    return within(current_A, min(limit_A, _NO_NUMBER_A))


def is_temperature(temperature_degC: Scalar) -> Any:
    """True where it is a number and a battery can have that temperature."""
    return between(temperature_degC, COLDEST_DEGC, HOTTEST_DEGC)


def is_voltage(voltage_V: Scalar, lowest_ocv_V: float, highest_ocv_V: float) -> Any:
    """True where it is a number and a battery with these open-circuit voltages, empty and full, can show it."""
    return (voltage_V > LOWEST_VOLTAGE_RATIO * lowest_ocv_V) & (voltage_V < HIGHEST_VOLTAGE_RATIO * highest_ocv_V)
