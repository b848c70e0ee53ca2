"""Rule for the events that anchor the state of charge: a full charge, a cut-off under load, a long rest.

    full    the voltage has stood still at that of a full battery while the charging current fell to a small share;
            at a lower voltage as well, where the full end of the curve is not known
    top     the charging voltage has left the flat part of the curve, whether a charger holds it there or not
    empty   a load ended at a voltage that, without its overpotential, is that of an empty battery
    rest    no current for so long that the RC pairs have relaxed

    soc_full  = 1 - d/2 +- hypot(width, d/2)     d = 1 - OCV^-1(V - R i): full by the charger, or by the curve
    soc_top   = 0.985 - u +- hypot(width, 0.015, std of u)
    soc_empty = OCV^-1(V + R |i|) + u +- hypot(width, std of u, effect of the errors of R and of the curve)
                u = |i| tau / Q, the charge that diffusion withholds from a strong load
    soc_rest  = OCV^-1(V) +- half of OCV^-1 between V + std and V - std

R is the resistance to a steady current at this temperature, so that a cold battery, which a charger leaves further from
full, has the wider anchor. Full and empty say more than the voltage: charger and protection define them. A rest only
repeats its voltage. Each event is reported once; traceable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import HYSTERESIS_UNKNOWN_STD, BatteryNoise, CurrentSensor
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, ohmic_resistance, pair_resistances
from ohmward.battery.soc.clean_sample import CleanSocSample, Rest, continue_rest
from ohmward.filters.gate import choose
from ohmward.trace import Scalar, clip, exp, logical_not, maximum, minimum, sqrt, table, where

#: At the limit of a charger the voltage stays within this share of itself; a sensor errs by as much.
_FLAT_SHARE = 0.004
#: A charger has reached its limit where the voltage is at least that of this state of charge at rest, and at most this
#: share below that of a full battery: on a flat curve the charge branch alone reaches the former.
_FULL_SOC, _BELOW_FULL = 0.985, 0.015
#: At the end of a flat curve the charging voltage rises, over this share of the capacity, by more than the curve does
#: between these states of charge.
_RISE_SOC, _BETWEEN_ENDS = 0.03, (0.1, 0.9)
#: An end is steep where the curve rises by more than this many times as much.
_STEEP = 2.0
#: A spike, or a missing voltage, is a single sample, and shorter than this [s].
_SAMPLE_AWAY_S = 30.0
#: A charger may have a lower limit of its own. It holds the voltage where the fall of its current would have moved it
#: by this many times the width in which it stands still: resistances on a label are known to within a factor of two.
_HELD_DROPS = 2.0
#: That limit is below full where the curve says so by this many of its standard deviations. It is above this share of
#: the voltage of a full battery, 3.98 V for 4.19 V: less would not last for a day.
BEYOND_SIGMAS, _LOWEST_LIMIT = 2.0, 0.95
#: By the end of a charge the current has fallen to this share of its largest: a charge at a small constant current has
#: no such end.
_TAPERED = 0.5
#: Rate over the capacity [1/h] above which a current is a load or ends a charge, and that below which it is a rest.
_LOAD_C, REST_C = 0.02, 0.01
#: A cut-off is below this state of charge by the curve, and stays there for this time [s]; the end of a flat curve is
#: passed for as long. Peaks of a load or a charge are shorter.
_EMPTY_SOC, _LOW_S = 0.03, 30.0
#: Lead-acid runs out of acid, and its voltage falls far below the line of the curve: 1.80 V a cell, 1.88 V at rest.
_DEPLETED_SHARE = 0.96
#: A load has ended where less than this share of it is left.
_LOAD_ENDED = 0.2
#: A full charge is reported again after this share of the capacity has been taken out, a cut-off after it was put in.
AGAIN = 0.05
#: A rest is long after this many of the largest time constant at its temperature, and at least after this time [s].
_RELAXED, _LONG_REST_S = 4.0, 3600.0
#: Time constant of a circuit without RC pairs [s].
_WITHOUT_PAIRS_S = 1.0
#: A longer step [s] says nothing about the voltage between its ends.
_LONGEST_ANCHOR_STEP_S = 3600.0
#: A charging current that falls by this share of its largest in a shorter step [s] was switched off.
_SUDDEN_S, _SUDDEN_SHARE = 60.0, 0.5
#: Events with a larger standard deviation of the state of charge are ignored.
_MOST_STD = 0.1
#: Points of the inverse of the curve.
_INVERSE_POINTS = 257


class AnchorLimits(NamedTuple):
    """Limits of the chargers and protections of one kind of battery."""

    taper_C: float  #: last current of a full charge, in multiples of the capacity per hour
    held_s: float  #: shortest time at the voltage limit before that [s]
    #: standard deviations of the state of charge where a charger or a protection stops
    full_std: float
    empty_std: float
    #: charge that a load leaves behind at its cut-off, over its current [s], and its standard deviation
    left_s: float
    left_std_s: float


#: Lithium chargers stop at C/10 to C/30; a load of 2 C leaves 3 to 8 % in fresh cells, 10 to 20 % in worn ones.
LITHIUM_LIMITS = AnchorLimits(0.05, 120.0, 0.01, 0.02, 100.0, 250.0)
#: Lead-acid monitors report full at 2 to 4 % of C. The last few percent take a day, the depth depends on the current.
GASSING_LIMITS = AnchorLimits(0.03, 1800.0, 0.03, 0.05, 600.0, 600.0)


class TopMemory(NamedTuple):
    """Memory of a charge that reaches the steep end of a flat curve, plain numbers."""

    #: mean of the voltage without its ohmic drop over the last few per cent of charge, 0 at the start
    usual_V: Any = 0.0
    usual_A: Any = 0.0  #: mean of the current over the same charge, 0 at the start
    #: time for which the voltage has been above its mean, samples without a voltage left out
    high_s: Any = 0.0
    charged: Any = 0.0  #: charge put in on balance since that was 0, over the capacity
    #: charge taken out since this event last occurred, over the capacity, at most 1
    discharged: Any = 1.0


class AnchorMemory(NamedTuple):
    """Memory between two samples, plain numbers."""

    limit_V: Any = 0.0  #: voltage at which the voltage of a charge began to stand still
    held_s: Any = 0.0  #: time for which the voltage has stood still
    away: Any = 1.0  #: 1 where the last sample was not there
    peak_A: Any = 0.0  #: largest charging current while the voltage stood still
    #: charge taken out since the last full charge, over the capacity, at most 1
    discharged: Any = 1.0
    #: charge put in since the last cut-off, over the capacity, at most 1
    charged: Any = 1.0
    load_A: Any = 0.0  #: current of the sample before where it was a load, else 0
    #: strongest load, fading with the slowest RC pair: what it left in the pairs must not pass for an empty battery
    peak_load_A: Any = 0.0
    #: time for which the voltage of a load has been that of a cut-off, less the time for which it has not
    low_s: Any = 0.0
    low_soc: Any = 0.0  #: state of charge of that cut-off
    low_std: Any = 1.0  #: standard deviation of that state of charge
    #: memory of a charge on a flat curve
    top: TopMemory = TopMemory()


class AnchorEvent(NamedTuple):
    """Conditions that a sample completes a full charge or a cut-off, and the state of charge that this implies."""

    full: Any
    empty: Any
    soc: Any
    std: Any
    top: Any = False  #: the condition that a charge has reached the end of the curve

    @property
    def gives_soc(self) -> Any:
        """The condition that there is an event."""
        return self.full | self.empty | self.top


#: Nothing has happened.
NO_EVENT = AnchorEvent(False, False, 0.0, 1.0)


class SocNormal(NamedTuple):
    """State of charge with its standard deviation."""

    soc: Any
    std: Any


class SocAnchor(NamedTuple):
    """Sample of a log at which the state of charge is known from another source than a model of the voltage."""

    sample: int
    soc: float
    std: float
    reason: str = ""  #: in words


@dataclass(frozen=True)
class AnchorRule:
    """Settings; `step` is a pure function of them."""

    #: battery model, its noise, and the current sensor
    model: Thevenin
    noise: BatteryNoise
    sensor: CurrentSensor

    def step(self, before: AnchorMemory, clean: CleanSocSample) -> tuple[AnchorMemory, AnchorEvent]:
        """The memory after a sample, and the event that the sample completes."""
        usable = clean.voltage_measured & clean.current_measured
        held = self.hold_limit(before, clean, usable)
        full = self.is_full(held, clean)
        ended = usable & (clean.now.current_A > _LOAD_ENDED * before.load_A) & clean.current_known
        empty = ended & self.was_low(before) & (before.charged > AGAIN)
        after = self.hold_low(held, clean, usable)
        at_full = self.full(clean.voltage_V, clean.now)
        event = AnchorEvent(
            full, empty, where(full, at_full.soc, before.low_soc), where(full, at_full.std, before.low_std)
        )
        after = after._replace(discharged=where(full, 0.0, after.discharged), charged=where(empty, 0.0, after.charged))
        after, top = self.reach_top(after, clean)
        return after, choose(event.gives_soc, event, top)

    def reach_end(self, memory: AnchorMemory, clean: CleanSocSample) -> tuple[AnchorMemory, AnchorEvent]:
        """The same with only the ends of charges that the curve does not show, as it is flat or its end unknown."""
        if not self.noise.full_soc_std:
            return self.reach_top(memory, clean)
        after, event = self.step(memory, clean)
        return after, choose(event.top | (event.full & (clean.voltage_V < self.full_V)), event, NO_EVENT)

    def reach_top(self, memory: AnchorMemory, clean: CleanSocSample) -> tuple[AnchorMemory, AnchorEvent]:
        """The memory after a sample, and the event that a charge has reached the steep end of a flat curve.

        It has where the voltage rises by more than the curve does elsewhere. The level of the curve is not used for
        that: the plateaus of cells differ by more than they rise.
        """
        if not self.has_steep_end:
            return memory, NO_EVENT
        before, u = memory.top, clean.now
        usable = clean.voltage_measured & clean.current_measured
        begun, ohm = before.usual_V > 0.0, self.steady_ohm(1.0, u)
        still_V = clean.voltage_V - ohm * u.current_A
        rise_V = where(begun, still_V - before.usual_V, 0.0)
        drop_V = ohm * where(begun, u.current_A - before.usual_A, 0.0)
        high = usable & (u.current_A > self.load_A) & (still_V > self.nearly_full_V)
        high = high & (rise_V > self.usual_rise_V + self.spurious_rise_V(drop_V, before.charged, u))
        high_s = where(high, before.high_s + clean.dt_s, where(usable, 0.0, before.high_s))
        end = self.nearly_full(u)
        top = high & (high_s > _LOW_S) & (before.discharged > AGAIN) & (end.std < _MOST_STD)

        share = clean.mean.current_A * clean.dt_s / self.model.capacity_As
        decay = where(begun, exp(abs(share) * (-1.0 / _RISE_SOC)), 0.0)
        after = TopMemory(
            usual_V=where(usable, still_V + decay * (before.usual_V - still_V), before.usual_V),
            usual_A=where(usable, u.current_A + decay * (before.usual_A - u.current_A), before.usual_A),
            high_s=high_s,
            charged=maximum(before.charged + share, 0.0),
            discharged=where(top, 0.0, minimum(before.discharged + maximum(-share, 0.0), 1.0)),
        )
        return memory._replace(top=after), AnchorEvent(False, False, *end, top)

    def spurious_rise_V(self, drop_V: Scalar, charged: Scalar, u: CircuitInput) -> Scalar:
        """Rise [V] that noise, hysteresis and a change of the drop, at the largest likely resistances, can imitate.

        charged: charge put in before, over the capacity: a battery on its charge branch rises by hysteresis no more.
        """
        left_V = self.model.hysteresis_V_at(1.0, u.temperature_degC) * exp(-self.model.hysteresis_rate * charged)
        still_V = _hypot(self.noise.voltage_std_V, left_V)
        most = exp(BEYOND_SIGMAS * sqrt(self.noise.resistance_variance_at(u, self.model)))
        return BEYOND_SIGMAS * still_V + (most - 1.0) * abs(drop_V)

    def nearly_full(self, u: CircuitInput) -> SocNormal:
        """State of charge at which the voltage of this charge leaves the flat part of the curve."""
        left = self.left_by_diffusion(u.current_A, u.temperature_degC)
        width = math.hypot(self.limits.full_std, 1.0 - _FULL_SOC)
        return SocNormal(_FULL_SOC - left.soc, _hypot(width, left.std))

    def left_by_diffusion(self, current_A: Scalar, temperature_degC: Scalar) -> SocNormal:
        """Share of the capacity that diffusion withholds from a load or a charge of this size."""
        rate_per_s = current_A / self.model.capacity_As
        slower = maximum(1.0 / self.model.rate_arrhenius_factor(temperature_degC), 1.0)
        return SocNormal(rate_per_s * self.limits.left_s * slower, rate_per_s * self.limits.left_std_s * slower)

    def hold_limit(self, memory: AnchorMemory, clean: CleanSocSample, usable: Any) -> AnchorMemory:
        """The memory with the voltage that stands still, its largest current, and the charge that flowed.

        A current that stops abruptly is not a taper: until the RC pairs relax, the voltage hardly falls. A spike or a
        missing voltage does not end it, two in a row do: the pulses of a drive come back to a flat curve too.
        """
        current_A, share = clean.now.current_A, clean.mean.current_A * clean.dt_s / self.model.capacity_As
        there = usable & (abs(clean.voltage_V - memory.limit_V) < _FLAT_SHARE * memory.limit_V)
        same = clean.current_measured & (there | (memory.away < 0.5) & (clean.dt_s < _SAMPLE_AWAY_S))
        same = same & (clean.dt_s < _LONGEST_ANCHOR_STEP_S) & (current_A > -self.load_A)
        fell_A = 2.0 * (clean.mean.current_A - current_A)
        same = same & logical_not((clean.dt_s < _SUDDEN_S) & (fell_A > _SUDDEN_SHARE * memory.peak_A))
        return memory._replace(
            limit_V=where(same, memory.limit_V, clean.voltage_V),
            held_s=where(same, memory.held_s + clean.dt_s, 0.0),
            away=where(there, 0.0, 1.0),
            peak_A=where(same, maximum(memory.peak_A, current_A), current_A),
            discharged=minimum(memory.discharged + maximum(-share, 0.0), 1.0),
            charged=minimum(memory.charged + maximum(share, 0.0), 1.0),
        )

    def is_full(self, memory: AnchorMemory, clean: CleanSocSample) -> Any:
        """True where the charge is complete: at the limit for long enough, and tapered there."""
        at_limit = clean.voltage_V > self.full_V
        if not self.gases:
            relaxed_V = self.relaxed_V(clean.voltage_V, clean.now)
            still = self.at_rest(relaxed_V, clean.now)
            may_be = (1.0 - still.soc < BEYOND_SIGMAS * still.std) & (still.std < _MOST_STD)
            may_be = may_be | (relaxed_V > self.lowest_limit_V) if self.noise.full_soc_std else may_be
            at_limit = at_limit | (self.is_held(memory, clean) & may_be)
        return at_limit & self.has_tapered(memory, clean) & (memory.discharged > AGAIN)

    def stops_below_full(self, memory: AnchorMemory, clean: CleanSocSample) -> Any:
        """True where a charger has tapered at a limit of its own that is clearly below that of a full battery."""
        if self.gases:
            return False
        relaxed_V = self.relaxed_V(clean.voltage_V, clean.now)
        still = self.at_rest(relaxed_V, clean.now)
        below = (1.0 - still.soc > BEYOND_SIGMAS * still.std) & (relaxed_V > self.lowest_limit_V)
        return below & self.is_held(memory, clean) & self.has_tapered(memory, clean)

    def has_tapered(self, memory: AnchorMemory, clean: CleanSocSample) -> Any:
        """True where the voltage has stood still for long enough while the charging current fell."""
        current_A = clean.now.current_A
        tapered = (memory.peak_A > self.taper_A) & (current_A < minimum(self.taper_A, _TAPERED * memory.peak_A))
        return tapered & (memory.held_s > self.limits.held_s) & (memory.away < 0.5)

    def is_held(self, memory: AnchorMemory, clean: CleanSocSample) -> Any:
        """True where a charger holds the voltage: otherwise the fall of the current would have moved it further."""
        drop_V = self.steady_ohm(1.0, clean.now) * (memory.peak_A - clean.now.current_A)
        return drop_V > _HELD_DROPS * _FLAT_SHARE * memory.limit_V

    def full(self, voltage_V: Scalar, u: CircuitInput) -> SocNormal:
        """State of charge at the end of a complete charge."""
        missing = 1.0 - self.soc_at(self.relaxed_V(voltage_V, u))
        return SocNormal(1.0 - 0.5 * missing, _hypot(self.limits.full_std, 0.5 * missing))

    def relaxed_V(self, voltage_V: Scalar, u: CircuitInput) -> Scalar:
        """Voltage [V] of a nearly full battery without the overpotential of its charge."""
        return voltage_V - self.steady_ohm(1.0, u) * maximum(u.current_A, 0.0)

    def hold_low(self, memory: AnchorMemory, clean: CleanSocSample, usable: Any) -> AnchorMemory:
        """The memory with the load, and the time for which its end would be a cut-off."""
        loaded = usable & (clean.now.current_A < -self.load_A)
        slowest_decay = exp(
            clean.dt_s * self.model.rate_arrhenius_factor(clean.now.temperature_degC) * (-1 / self.slowest_s)
        )
        strongest_A = minimum(clean.now.current_A, slowest_decay * memory.peak_load_A)
        peak = CircuitInput(strongest_A, clean.now.temperature_degC)
        at_cut_off = self.cut_off(clean.voltage_V, peak)
        low = loaded & (self.but_for_drop_V(clean.voltage_V, peak) < self.empty_V)
        return memory._replace(
            load_A=where(loaded, clean.now.current_A, where(usable, 0.0, memory.load_A)),
            peak_load_A=peak.current_A,
            low_s=where(low, memory.low_s + clean.dt_s, maximum(memory.low_s - clean.dt_s, 0.0)),
            low_soc=where(low, at_cut_off.soc, memory.low_soc),
            low_std=where(low, at_cut_off.std, memory.low_std),
        )

    def was_low(self, memory: AnchorMemory) -> Any:
        """True where a load that ends now is cut off: low for long enough, at a sufficiently known state of charge."""
        return (memory.low_s > _LOW_S) & (memory.low_std < _MOST_STD)

    def cut_off(self, voltage_V: Scalar, u: CircuitInput) -> SocNormal:
        """State of charge at which a load is cut off at this voltage."""
        still_V = self.but_for_drop_V(voltage_V, u)
        of_drop = sqrt(self.noise.resistance_variance_at(u, self.model))
        of_curve_V = _hypot(self.noise.model_std_V[0], self.noise.gain_error_V(0.0, u, self.model))
        uncertain_V = of_drop * (still_V - voltage_V) + of_curve_V
        soc = self.soc_at(still_V)
        left = self.left_by_diffusion(maximum(-u.current_A, 0.0), u.temperature_degC)
        of_load = _hypot(self.limits.empty_std, left.std)
        std = _hypot(of_load, self.soc_at(still_V + uncertain_V) - soc)
        return SocNormal(soc + left.soc, std)

    def but_for_drop_V(self, voltage_V: Scalar, u: CircuitInput) -> Scalar:
        """The voltage of an empty battery without the overpotential of its load."""
        return voltage_V - self.steady_ohm(0.0, u) * u.current_A

    def continue_rest(self, before: Rest, clean: CleanSocSample) -> tuple[Rest, Any]:
        """The rest after a sample, and the condition that it has become a long one, once."""
        usable = clean.voltage_measured & clean.current_measured
        resting = usable & (abs(clean.now.current_A) < self.rest_A) & (clean.dt_s < _LONGEST_ANCHOR_STEP_S)
        needed_s = _RELAXED * self.slowest_s / self.model.rate_arrhenius_factor(clean.now.temperature_degC)
        certain = self.at_rest(clean.voltage_V, clean.now).std < _MOST_STD
        return continue_rest(before, resting, clean.dt_s, maximum(needed_s, _LONG_REST_S), certain)

    def at_rest(self, voltage_V: Scalar, u: CircuitInput) -> SocNormal:
        """State of charge of a battery at rest at this voltage, from the curve of the file and its errors."""
        soc, noise = self.soc_at(voltage_V), self.noise
        hysteresis_V = HYSTERESIS_UNKNOWN_STD * self.model.hysteresis_V_at(soc, u.temperature_degC)
        gain_V = noise.gain_error_V(soc, u, self.model)
        errors_V = (noise.voltage_std_V, noise.model_std_at(soc), hysteresis_V, gain_V)
        uncertain_V = sqrt(sum(error_V * error_V for error_V in errors_V))
        half = 0.5 * (self.soc_at(voltage_V + uncertain_V) - self.soc_at(voltage_V - uncertain_V))
        return SocNormal(soc, _hypot(noise.axis_std_at(soc), half))

    def steady_ohm(self, soc: float, u: CircuitInput) -> Scalar:
        """Resistance to a steady current [ohm] at this temperature."""
        return ohmic_resistance(soc, u, self.model) + sum(pair_resistances(soc, u, self.model))

    def soc_at(self, voltage_V: Scalar) -> Scalar:
        """State of charge at which the curve has this voltage, in [0, 1]."""
        empty_V, full_V = self.model.ocv.voltage_V[0], self.model.ocv.voltage_V[-1]
        return clip(table(self._inverse, empty_V, (full_V - empty_V) / (_INVERSE_POINTS - 1), voltage_V), 0.0, 1.0)

    @cached_property
    def _inverse(self) -> tuple[float, ...]:
        """(M,) state of charge on a uniform grid of the voltage."""
        ocv = self.model.ocv
        soc = np.linspace(0.0, 1.0, 4 * _INVERSE_POINTS)
        rising_V = np.maximum.accumulate(ocv.mean_V(soc, ocv.reference_degC)) + 1e-12 * np.arange(soc.size)
        grid_V = np.linspace(ocv.voltage_V[0], ocv.voltage_V[-1], _INVERSE_POINTS)
        return tuple(np.interp(grid_V, rising_V, soc).tolist())

    @property
    def slowest_s(self) -> float:
        """Largest time constant [s]; a short one for a circuit without RC pairs, in which a load leaves nothing."""
        return self.model.tau_s[-1] if self.model.tau_s else _WITHOUT_PAIRS_S

    @property
    def gases(self) -> bool:
        """True for a battery that makes gas when it is nearly full."""
        return self.model.gassing_V is not None

    @property
    def limits(self) -> AnchorLimits:
        """Limits of its chargers and protections."""
        return GASSING_LIMITS if self.gases else LITHIUM_LIMITS

    @cached_property
    def has_steep_end(self) -> bool:
        """True where the curve is flat and rises steeply at its end."""
        if self.gases:
            return False
        before_V, end_V = self.model.ocv.mean_V(np.array([1.0 - _RISE_SOC, 1.0]), self.model.ocv.reference_degC)
        return bool(end_V - before_V > _STEEP * self.usual_rise_V)

    @cached_property
    def usual_rise_V(self) -> float:
        """Largest rise of the curve [V] between its ends, over `_RISE_SOC` of charge."""
        soc, step = np.linspace(*_BETWEEN_ENDS, 81, retstep=True)
        rises_V = np.diff(self.model.ocv.mean_V(soc, self.model.ocv.reference_degC))
        return float(rises_V.max()) * _RISE_SOC / float(step)

    @property
    def full_V(self) -> float:
        """Lowest voltage of a charger that has reached its limit [V]."""
        return self.model.gassing_V or max(self.nearly_full_V, (1.0 - _BELOW_FULL) * self.model.ocv.voltage_V[-1])

    @property
    def lowest_limit_V(self) -> float:
        """Lowest voltage [V] that a charger may have as a limit of its own."""
        return _LOWEST_LIMIT * self.model.ocv.voltage_V[-1]

    @cached_property
    def nearly_full_V(self) -> float:
        """Voltage [V] at rest of a battery that is nearly full."""
        return float(self.model.ocv.mean_V(_FULL_SOC, self.model.ocv.reference_degC))

    @property
    def empty_V(self) -> float:
        """Voltage [V], without the overpotential, below which a load is cut off."""
        ocv = self.model.ocv
        return _DEPLETED_SHARE * ocv.voltage_V[0] if self.gases else float(ocv.mean_V(_EMPTY_SOC, ocv.reference_degC))

    @property
    def taper_A(self) -> float:
        """Largest current at the end of a full charge."""
        return self.limits.taper_C * self.model.capacity_Ah

    @property
    def load_A(self) -> float:
        """Smallest current that is a load."""
        return _LOAD_C * self.model.capacity_Ah + 3.0 * self.sensor.noise_std_A

    @property
    def rest_A(self) -> float:
        """Largest current of a rest."""
        return self.sensor.rest_threshold_A(self.model.capacity_Ah, REST_C)


def _hypot(a: Scalar, b: Scalar) -> Scalar:
    return sqrt(a * a + b * b)
