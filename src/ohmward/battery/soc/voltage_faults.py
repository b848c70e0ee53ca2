"""Voltages that are not the battery's although a battery could have them: those that jump, and those that stand still.

The voltage of a battery changes at once by the drop of its current alone; another value is a fault of a sensor, a
converter or a message. Used, it decides between hypotheses that are all far from it, and as the first voltage it starts
an estimate at the wrong state of charge.

Jumps are found in the innovation: a wire that comes loose moves it at once, an error of the state of charge or of the
curve never does. Neither side of a jump is known to be the true one: the one that has lasted longer counts. A voltage
that comes back from one that was used in the end shows that the charge was learnt from a false one.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import CircuitInput, Thevenin
from ohmward.battery.soc.clean_sample import (
    WAITS_S,
    CleanSocSample,
    first_input,
    sample_limits,
    sanitize,
    without_voltage,
)
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.filters.estimator import row_of
from ohmward.filters.sanitize import between
from ohmward.trace import Scalar, logical_not, maximum, minimum, where

#: A voltage that stays the same to the last digit comes from a dead sensor if the ohmic drop of a load must have moved
#: it by this many standard deviations of its noise: twice the step of a coarse converter.
FROZEN_STD = 10.0

#: A frozen voltage that was used for longer than this before it was found has corrupted SoC [s].
FROZEN_S = 60.0

#: A voltage jumps if it changes by more than this share of the full battery's beyond zero to this many times the drop
#: that the change of the current causes, within this time [s].
JUMP_SHARE, JUMP_DROPS, JUMP_S = 0.05, 3.0, 60.0
#: Smallest time [s] used as a divisor.
_LEAST_WAIT_S = 1e-6

#: A start is settled after this time [s], and this many samples: a few wrong ones at 0.1 Hz last as long.
START_SETTLED_S, START_SETTLED_AFTER = 30.0, 10
#: Samples in which that is sought before the whole log is looked at.
_FIRST_LOOKED_AT = 4096

#: An innovation jumps if it leaves its mean over `LEVEL_S` [s] by this many of its usual deviations, these over
#: `DEVIATION_S` [s] but not below the noise and this share of the voltage of the full battery, or by `JUMP_SHARE`.
#: Beyond that it may leave by the drop of the last changes of the current: the resistance may be wrong, and the voltage
#: may lag.
LEAVES_SIGMAS, LEVEL_S, DEVIATION_S, LEAST_DEVIATION_SHARE = 5.0, 5.0, 30.0, 0.002
#: One that jumped has come back where less than this share of the jump is left.
BACK_SHARE = 0.5
#: It is used all the same once it has been away for as long as it had kept its level before, but at most this [s]:
#: by then the charge counted meanwhile is no better.
MOST_TRUSTED_S = 1800.0


class LevelLimits(NamedTuple):
    """Limits of a battery for the steps of the innovation [V^2]."""

    least_V2: float  #: least mean square deviation from the level
    jump_V2: float  #: square of a step that is a jump, however uncertain the innovation is

    @classmethod
    def of(cls, model: Thevenin, noise: BatteryNoise) -> LevelLimits:
        """The limits for a battery."""
        full_V = model.ocv.voltage_V[-1]
        least_V2 = 2.0 * noise.voltage_std_V**2 + (LEAST_DEVIATION_SHARE * full_V) ** 2
        return cls(least_V2, (JUMP_SHARE * full_V) ** 2)


class LevelJudgement(NamedTuple):
    """Conditions of a voltage, from its innovation."""

    leaves: Any  #: it left its level, and is held to be none of the battery's
    returns: Any  #: it came back from a jump that lasted for so long that it was used


class VoltageLevel(NamedTuple):
    """The level that the innovation keeps, and a jump away from it."""

    mean_V: Scalar = 0.0  #: innovation that the last voltages at that level left
    away_V: Scalar = 0.0  #: jump away from it; 0 while there is none
    trusted_s: Scalar = 0.0  #: time for which the voltage has kept its level, less the time for which it has been away
    square_V2: Scalar = 0.0  #: mean square deviation from it
    used_V: Scalar = 0.0  #: jump that lasted for so long that it was used all the same; 0 without one
    away_s: Scalar = 0.0  #: time for which the voltage has been away

    @property
    def is_away(self) -> Any:
        """True while the voltage is away from its level."""
        return abs(self.away_V) > 0.0

    def judge(self, innovation_V: Scalar, uncertain_V2: Scalar, drop_V: Scalar, limits: LevelLimits) -> LevelJudgement:
        """Whether an innovation jumps, or has not come back: it has where the rest of the jump is small.

        uncertain_V2: variance of the innovation.  drop_V: by the last changes of the current.
        """
        off_V = innovation_V - self.mean_V
        usual_V2 = LEAVES_SIGMAS**2 * maximum(self.square_V2, limits.least_V2) + uncertain_V2
        jump_V2 = minimum(usual_V2, limits.jump_V2) + drop_V * drop_V
        jumps = where(self.is_away, logical_not(_is_back(off_V, self.away_V)), off_V * off_V > jump_V2)
        jumps = jumps & (self.trusted_s > 0.0)
        returns = jumps & logical_not(self.is_away) & _is_back(off_V + self.used_V, self.used_V)
        # a load that ends moves the voltage of a worn battery by more than the file's resistances do
        returns = returns & (abs(off_V) > JUMP_DROPS * abs(drop_V))
        return LevelJudgement(jumps & logical_not(returns), returns)

    def after(
        self,
        innovation_V: Scalar,
        residual_V: Scalar,
        dt_s: Scalar,
        measured: Any,
        now: LevelJudgement,
        limits: LevelLimits,
    ) -> VoltageLevel:
        """The level after a voltage.

        residual_V: what is left of the innovation once the voltage has been used.
        """
        off_V = innovation_V - self.mean_V
        used = measured & logical_not(now.leaves)
        newest = where(self.trusted_s > 0.0, dt_s / (dt_s + LEVEL_S), 1.0)
        usual = where(measured & logical_not(self.is_away), dt_s / (dt_s + DEVIATION_S), 0.0)
        most_V2 = 9.0 * maximum(self.square_V2, limits.least_V2)
        lasted = self.away_s > JUMP_S  # no spike, and no load that the file does not explain
        change_s = where(used, dt_s, where(now.leaves, -dt_s, 0.0))
        return VoltageLevel(
            self.mean_V + where(used, newest, 0.0) * (residual_V - self.mean_V),
            where(now.leaves, where(self.is_away, self.away_V, off_V), 0.0),
            minimum(self.trusted_s + change_s, MOST_TRUSTED_S),
            self.square_V2 + usual * (minimum(off_V * off_V, most_V2) - self.square_V2),
            where(used & lasted & (self.trusted_s <= 0.0), self.away_V, where(now.returns, 0.0, self.used_V)),
            where(now.leaves, self.away_s + dt_s, where(used, 0.0, self.away_s)),
        )


def _is_back(left_V: Scalar, jump_V: Scalar) -> Any:
    """True where what is left of a jump is small."""
    return left_V * left_V < BACK_SHARE * BACK_SHARE * jump_V * jump_V


class HeldVoltage(NamedTuple):
    """The last voltage, and for how long it has stood still to the last digit."""

    voltage_V: Scalar = -1.0  #: last voltage used; at the start one that no battery has
    load_A: Scalar = 0.0  #: current out of the battery, negative, when this voltage first came
    used_s: Scalar = 0.0  #: time for which that voltage has been used since it first came
    frozen: Scalar = 0.0  #: 1 where the load has changed too much meanwhile for the sensor to be alive
    current_A: Scalar = 0.0  #: current of the sample before the last
    age_s: Scalar = 0.0  #: time since a voltage was used
    waiting_V: Scalar = 0.0  #: voltage that waits for the next current; 0 for none
    waiting_s: Scalar = 0.0  #: time between the current before it and that voltage


def is_alike(clean: CleanSocSample, before_V: Scalar, earlier_A: Scalar, model: Thevenin) -> Any:
    """True where the current explains the change from a voltage before to that of the sample; else it jumps.

    earlier_A: current of the sample before the last, since a voltage may lag behind its current.
    """
    most_ohm = JUMP_DROPS * model.largest_ohm * model.arrhenius_factor(clean.now.temperature_degC)
    lagging_A = clean.now.current_A - earlier_A
    fall_V = most_ohm * minimum(minimum(clean.change_A, lagging_A), 0.0)
    rise_V = most_ohm * maximum(maximum(clean.change_A, lagging_A), 0.0)
    noise_V = JUMP_SHARE * model.ocv.voltage_V[-1]
    return between(clean.voltage_V - before_V, fall_V - noise_V, rise_V + noise_V)


class StartWatch(NamedTuple):
    """The voltage that an estimator started from, while it may still prove to be none of the battery's."""

    voltage_V: Scalar = math.nan  #: the last one like the first
    now: CircuitInput = CircuitInput(0.0, ROOM_DEGC)  #: current and temperature of the last sample
    current_A: Scalar = 0.0  #: of the sample before the last
    age_s: Scalar = 0.0  #: time since the start
    samples: int = 1  #: their number since the start
    lasts_s: Scalar = 0.0  #: time from the start to the last voltage like the first
    other_V: Scalar = math.nan  #: one that jumped away
    other_s: Scalar = 0.0  #: time for which it has lasted
    waits_s: float = 0.0  #: longest time to wait for a first voltage, where the first sample has none
    unknown_s: Scalar = 0.0  #: time since the last current; infinite before the first
    has_current: bool = True  #: whether the start had a current beside its voltage

    def after(self, sample: SocSample, model: Thevenin) -> tuple[StartWatch | None, SocSample | None]:
        """The watch after a sample, None once the start is settled, and a sample to start again from, if any.

        The start was wrong if a voltage that jumped away has lasted for longer than the first, or if it had none, or no
        current beside it: where the two come one after the other, that sample has the last of each.
        """
        clean = sanitize(sample, self.now, sample_limits(model), self.unknown_s)
        age_s, samples = self.age_s + clean.dt_s, self.samples + 1
        watch = self._replace(
            now=clean.now, current_A=self.now.current_A, age_s=age_s, samples=samples, unknown_s=clean.unknown_s
        )
        if math.isnan(self.voltage_V):
            if not clean.voltage_measured:
                return (watch if age_s < self.waits_s else None), None
            latest_A = clean.latest_A if clean.unknown_s < WAITS_S else sample.current_A
            return watch, sample._replace(current_A=latest_A) if age_s < self.waits_s else None
        if clean.dt_s > JUMP_S:
            return None, None
        if clean.current_measured and not self.has_current and age_s < WAITS_S:
            return watch, sample._replace(voltage_V=clean.voltage_V if clean.voltage_measured else self.voltage_V)
        if not clean.voltage_measured:
            return watch, None
        if is_alike(clean, self.voltage_V, self.current_A, model):
            alike = watch._replace(voltage_V=clean.voltage_V, lasts_s=watch.age_s, other_V=math.nan)
            return (alike if age_s < START_SETTLED_S or samples < START_SETTLED_AFTER else None), None
        again = is_alike(clean, self.other_V, self.current_A, model)
        watch = watch._replace(other_V=clean.voltage_V, other_s=self.other_s + clean.dt_s if again else 0.0)
        return watch, sample if watch.other_s > watch.lasts_s else None


def watch_start(first: SocSample, model: Thevenin, waits_s: float = START_SETTLED_S) -> StartWatch:
    """The watch of a start from the voltage of this sample.

    waits_s: for the first voltage, infinite where nothing else shows the charge.
    """
    limits = sample_limits(model)
    used, has_current = limits.is_voltage(first.voltage_V), bool(limits.is_current(first.current_A))
    u = first_input(first, limits.current_A)
    return StartWatch(
        first.voltage_V if used else math.nan,
        u,
        u.current_A,
        waits_s=waits_s,
        unknown_s=0.0 if has_current else math.inf,
        has_current=has_current,
    )


def wrong_starts(
    samples: SocSample, model: Thevenin, watch: StartWatch | None = None, waits_s: float = START_SETTLED_S
) -> tuple[dict[int, SocSample], StartWatch | None]:
    """Rows of samples (T,) from which to start again, each with its sample, and the watch after them.

    The watch is None where the start is settled.

    watch: before the samples; None where the estimator starts from the first of them.  waits_s: see `watch_start`.
    """
    if watch is None and _hardly_moves(samples, model):
        return {}, None
    begin = 0
    again: dict[int, SocSample] = {}
    if watch is None:
        watch = watch_start(row_of(samples, 0), model, waits_s)
        begin = 1
    for k in range(begin, len(samples.dt_s)):
        if watch is None:
            break
        watch, start = watch.after(row_of(samples, k), model)
        if start is not None:
            again[k] = start
            watch = watch_start(start, model)
    return again, watch


def _hardly_moves(samples: SocSample, model: Thevenin) -> bool:
    """True where no two voltages are far enough apart for a jump until a start from the first of samples is settled."""
    for count in (_FIRST_LOOKED_AT, len(samples.dt_s)):
        elapsed_s = np.cumsum(samples.dt_s[:count]) - samples.dt_s[0]
        settled = np.flatnonzero(elapsed_s >= START_SETTLED_S)
        if settled.size:
            break
    else:
        return False
    if not math.isfinite(samples.current_A[0]):
        return False
    until = slice(0, max(int(settled[0]) + 1, START_SETTLED_AFTER))
    steps_s = samples.dt_s[until][1:]
    regular = bool(np.all((steps_s >= 0.0) & (steps_s <= JUMP_S)))
    return regular and bool(np.ptp(samples.voltage_V[until]) <= JUMP_SHARE * model.ocv.voltage_V[-1])


def beside_current(
    before: HeldVoltage, clean: CleanSocSample, unknown_before_s: Scalar
) -> tuple[HeldVoltage, CleanSocSample]:
    """The memory after the sample, and the sample with its voltage where a current is known on both sides of it.

    A voltage without a current waits for the next one, and is used with the current between the two at its time: beside
    the last current alone, each change of the load would pass for an error of the voltage. Without a current for
    `WAITS_S` it is used as it is.
    """
    alone = clean.voltage_measured & logical_not(clean.current_measured) & (clean.unknown_s < WAITS_S)
    comes = clean.current_known & logical_not(clean.voltage_measured) & (before.waiting_V > 0.0)
    share = before.waiting_s / maximum(unknown_before_s + clean.dt_s, _LEAST_WAIT_S)
    at_voltage_A = clean.latest_A - where(comes, 1.0 - share, 0.0) * clean.change_A
    held = before._replace(
        waiting_V=where(alone, clean.voltage_V, where(clean.current_measured, 0.0, before.waiting_V)),
        waiting_s=where(alone, clean.unknown_s, before.waiting_s),
    )
    return held, clean._replace(
        now=clean.now._replace(current_A=at_voltage_A),
        voltage_V=where(comes, before.waiting_V, where(alone, 0.0, clean.voltage_V)),
        voltage_measured=comes | (clean.voltage_measured & logical_not(alone)),
    )


def stands_for(clean: CleanSocSample) -> Scalar:
    """Time [s] that a voltage stands for: since the one before, but after a long absence not more than `JUMP_S`."""
    return maximum(clean.dt_s, minimum(clean.voltage_step_s, JUMP_S))


def without_frozen(
    before: HeldVoltage, clean: CleanSocSample, model: Thevenin, noise: BatteryNoise
) -> tuple[HeldVoltage, Any, CleanSocSample]:
    """The memory after the sample, and the sample without a voltage that stands still while the load changes.

    A charger holds the voltage too, while its current falls, so only loads count. The condition returned between the
    two is that the next voltage shows the frozen one, used for `FROZEN_S`, not to have been the battery's: a voltage
    that only lags behind its current moves by the drop of the load.
    """
    load_A = minimum(clean.now.current_A, 0.0)
    same = clean.voltage_measured & (clean.voltage_V == before.voltage_V)
    other = clean.voltage_measured & logical_not(same)
    least_ohm = float(np.median(model.r0_discharge_ohm)) * math.exp(-noise.resistance_std)
    drop_V = least_ohm * abs(load_A - before.load_A)
    frozen = same & ((before.frozen > 0.0) | (drop_V > FROZEN_STD * noise.voltage_std_V))
    held = before._replace(
        voltage_V=where(clean.voltage_measured, clean.voltage_V, before.voltage_V),
        load_A=where(other, load_A, before.load_A),
        used_s=where(other, 0.0, before.used_s + where(same & logical_not(frozen), clean.voltage_step_s, 0.0)),
        frozen=where(clean.voltage_measured, where(frozen, 1.0, 0.0), before.frozen),
        current_A=clean.latest_A - clean.change_A,
        age_s=where(clean.voltage_measured & logical_not(frozen), 0.0, clean.voltage_step_s),
    )
    came_V = abs(clean.voltage_V - before.voltage_V)
    misled = other & (before.frozen > 0.0) & (before.used_s > FROZEN_S)
    return held, misled & (came_V < 0.5 * drop_V), without_voltage(clean, frozen, SocFlag.NO_VOLTAGE)
