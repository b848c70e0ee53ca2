"""Another battery put in, live or along a log, found by a step of the voltage over a silence of the sensors.

The innovation before and after has the same errors of the curve, so they cancel in its change. What is left is

    s^2 = v (1/n + 1/m) / 2 + (e i)^2 + (g R i_most)^2 + f^2

v the mean square change from sample to sample and e the error of the resistance, both as this record shows them, i the
change of the current, n and m the samples before and after, g a share of the largest resistance R for the slow part of
the overpotential, f a floor. The step also has to be in the voltage itself, since the voltage that a filter expects
jumps where it changes its mind about the state of charge; and it has to stay, which the fall towards empty and the
relaxation after a load do not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.filters.estimator import row_of
from ohmward.logs.log import Note
from ohmward.quantities import SECONDS_PER_HOUR

#: What such a step says, after its time.
ANOTHER_IS_IN = (
    "the voltage stepped over a silence, which no load explains: another battery was put in, or a cell or a wire has "
    "failed; its charge starts from that voltage, all else from the file"
)

#: Silence of the sensors in which somebody may put in another battery, in usual intervals, shortest one [s], and most
#: that a usual interval can be [s]. A step without a silence is no exchange: near empty, and in the cold, the end of a
#: load lets the voltage rise as far.
EXCHANGE_INTERVALS, EXCHANGE_S, LONGEST_USUAL_S = 3.0, 2.0, 60.0

#: Step that shows another battery, in its standard deviations.
EXCHANGE_SIGMAS = 4.5

#: Fewest and most samples after a step that are compared with those before it; weight of the newest of these.
FEWEST_AFTER, MOST_AFTER, NEWEST_SAMPLE = 3, 10, 0.2

#: Samples before which the record does not know its own noise, and after which it has forgotten what was before them.
LEARNS, FORGETS = 20, 500

#: Error of the resistance before the record shows it, least error, and that of its slow part, over the largest one.
UNKNOWN_OHM_SHARE, LEAST_OHM_SHARE, SLOW_OHM_SHARE = 0.3, 0.03, 0.05

#: Parts of a step by which the innovation may move after its first sample, and may have moved before it.
STAYS_AFTER, STEADY_BEFORE = 0.5, 0.33

#: Change of the voltage that says nothing, and its usual one before the record shows it, over that of a full battery.
FLOOR_SHARE, USUAL_CHANGE = 3e-4, 1.5e-3

#: Estimates after which what was expected before no longer counts.
_AFRESH = SocFlag.GAP | SocFlag.DIVERGED | SocFlag.RESTARTED | SocFlag.ANCHORED | SocFlag.EXCHANGED


class TerminalMean(NamedTuple):
    """A sample of the terminals, or the mean of several."""

    innovation_V: float = math.nan
    voltage_V: float = 0.0
    current_A: float = 0.0

    def moved_to(self, other: TerminalMean, weight: float) -> TerminalMean:
        """The mean after another sample of this weight."""
        return TerminalMean(*(a + weight * (b - a) for a, b in zip(self, other, strict=True)))

    def step_V(self, other: TerminalMean, away_A: float, ohm: float) -> float:
        """Size of the step to another level: of the innovation, as far as voltage or load moved too."""
        seen_V = abs(other.voltage_V - self.voltage_V) + ohm * away_A
        return min(abs(other.innovation_V - self.innovation_V), seen_V)


class VoltageStep(NamedTuple):
    """The samples after a silence."""

    level: TerminalMean  #: their mean
    n: int  #: their number
    first_V: float  #: innovation at the first of them
    before_V: float  #: distance of the last innovation before them from those before it
    most_A: float  #: largest current, or change of it


class ExchangeWatch(NamedTuple):
    """Memory of the voltage, and of how well the filter foresees it."""

    before: TerminalMean = TerminalMean()  #: mean of the last samples
    last: TerminalMean = TerminalMean()  #: the last one
    earlier_A: float = 0.0  #: current of the one before it, since a voltage may lag behind its current
    interval_s: float = 0.0  #: usual time between two samples
    variance_V2: float = 0.0  #: mean square change at a steady current
    ohm2: float = 0.0  #: mean square error of the resistance [ohm^2]
    samples: int = 0
    waited_s: float = 0.0  #: of a silence, or since its start where the filter has used no voltage after it
    step: VoltageStep | None = None

    def after(
        self,
        dt_s: float,
        current_A: float,
        temperature_degC: float,
        voltage_V: float,
        estimate: SocEstimate,
        m: Thevenin,
    ) -> tuple[ExchangeWatch, bool]:
        """The watch after a sample, and whether another battery is in; it then begins afresh.

        estimate: after the sample.  m: model of the battery.
        """
        if int(estimate.flags) & _AFRESH:
            return ExchangeWatch(), False
        now = TerminalMean(float(estimate.innovation_V), voltage_V, current_A)
        dt_s += self.waited_s
        is_silent = dt_s > max(EXCHANGE_INTERVALS * self.interval_s, EXCHANGE_S)
        if not all(map(math.isfinite, now)):
            is_measured = math.isfinite(voltage_V) and math.isfinite(current_A)  # and not used by the filter
            return self._replace(waited_s=dt_s if is_silent or not is_measured else 0.0), False
        full_V = m.ocv.voltage_V[-1]
        known = math.isfinite(temperature_degC)
        ohm = m.largest_ohm * (m.arrhenius_factor(temperature_degC) if known else 1.0)
        if not self.samples:
            begun = ExchangeWatch(
                now, now, current_A, math.inf, (USUAL_CHANGE * full_V) ** 2, (UNKNOWN_OHM_SHARE * ohm) ** 2, 1
            )
            return begun, False
        away_A = max(abs(current_A - self.last.current_A), abs(current_A - self.earlier_A))
        change_V = self.last.step_V(now, away_A, ohm)
        error2 = self.ohm2 + (LEAST_OHM_SHARE * ohm) ** 2
        noise2 = self.variance_V2 + (FLOOR_SHARE * full_V) ** 2
        step = self.step
        if step is None and self.samples > LEARNS and is_silent:
            before_V = abs(self.last.innovation_V - self.before.innovation_V)
            step = VoltageStep(now, 0, now.innovation_V, before_V, abs(self.last.current_A))
        interval_s = dt_s if self.samples == 1 else _moved(self.interval_s, dt_s, 0.05, LONGEST_USUAL_S)
        latest = self._replace(last=now, earlier_A=self.last.current_A, interval_s=interval_s, waited_s=0.0)
        if step is not None:
            return latest.after_step(step, now, ohm, error2, full_V)
        latest = latest._replace(before=self.before.moved_to(now, NEWEST_SAMPLE), samples=self.samples + 1)
        if UNKNOWN_OHM_SHARE * ohm * away_A < 2.0 * math.sqrt(noise2):
            newest = max(0.01, 1.0 / (self.samples + 3))
            return latest._replace(variance_V2=_moved(self.variance_V2, change_V**2, newest, 9.0 * noise2)), False
        excess2 = max(change_V**2 - self.variance_V2, 0.0) / away_A**2
        return latest._replace(ohm2=_moved(self.ohm2, excess2, 0.05, 9.0 * error2)), False

    def after_step(
        self, step: VoltageStep, now: TerminalMean, ohm: float, error2: float, full_V: float
    ) -> tuple[ExchangeWatch, bool]:
        """The watch after a sample that follows a silence, and whether the step over it is one of another battery."""
        n = step.n + 1
        level = step.level.moved_to(now, 1.0 / n)
        most_A = max(step.most_A, abs(now.current_A), abs(now.current_A - self.before.current_A))
        away_A = abs(level.current_A - self.before.current_A)
        variance_V2 = 0.5 * self.variance_V2 * (NEWEST_SAMPLE / (2.0 - NEWEST_SAMPLE) + 1.0 / n)
        variance_V2 += error2 * away_A**2 + (SLOW_OHM_SHARE * ohm * most_A) ** 2 + (FLOOR_SHARE * full_V) ** 2
        step_V = self.before.step_V(level, away_A, ohm)
        stays = abs(now.innovation_V - step.first_V) < STAYS_AFTER * step_V and step.before_V < STEADY_BEFORE * step_V
        if n >= FEWEST_AFTER and stays and step_V > EXCHANGE_SIGMAS * math.sqrt(variance_V2):
            return ExchangeWatch(), True
        if n < MOST_AFTER:
            return self._replace(step=step._replace(level=level, n=n, most_A=most_A)), False
        return self._replace(before=level, step=None), False


def _moved(mean: float, value: float, weight: float, most: float) -> float:
    """Exponentially weighted mean after another value, which counts as `most` at most."""
    return mean + weight * (min(value, most) - mean)


def exchanged_at(samples: SocSample, innovation_V: np.ndarray, flags: np.ndarray, m: Thevenin) -> int | None:
    """First row of samples (T,), and of their estimates, that shows another battery; None without any.

    Only the samples around steps over silences are watched: the others change nothing in the end.
    """
    watch, seen = ExchangeWatch(), 0
    for begin, stop in _steps_over_silences(samples, innovation_V, m):
        if begin > seen:
            watch, seen = ExchangeWatch(), begin
        for row in range(seen, stop):
            s = row_of(samples, row)
            estimate = SocEstimate(0.0, 0.0, innovation_V=innovation_V[row], flags=flags[row])
            watch, exchanged = watch.after(s.dt_s, s.current_A, s.temperature_degC, s.voltage_V, estimate, m)
            if exchanged:
                return row
        seen = max(seen, stop)
    return None


def exchange_notes(time_s: np.ndarray, flags: np.ndarray) -> tuple[Note, ...]:
    """A warning for each battery that was put in along a log; flags: (T,) of the estimates."""
    return tuple(
        Note(f"{(time_s[row] - time_s[0]) / SECONDS_PER_HOUR:.3g} h after the start {ANOTHER_IS_IN}", "warning")
        for row in np.flatnonzero(np.asarray(flags).astype(int) & SocFlag.EXCHANGED).tolist()
    )


def _steps_over_silences(samples: SocSample, innovation_V: np.ndarray, m: Thevenin) -> list[tuple[int, int]]:
    """First and end row of the samples to watch: those about each silence over which the innovation may have stepped.

    The least step that `ExchangeWatch` finds is `EXCHANGE_SIGMAS` of the floor; from the last sample, which may have
    moved before, it is less by `STEADY_BEFORE`.
    """
    rows = np.flatnonzero(np.isfinite(innovation_V) & np.isfinite(samples.current_A))
    apart_s = np.diff(np.cumsum(samples.dt_s)[rows]) if rows.size < len(innovation_V) else samples.dt_s[1:]
    least_s = min(float(apart_s.min(initial=math.inf)), LONGEST_USUAL_S)  # the usual interval is no shorter
    silent = np.flatnonzero(apart_s > max(EXCHANGE_INTERVALS * least_s, EXCHANGE_S)) + 1
    least_V = (1.0 - STEADY_BEFORE) * EXCHANGE_SIGMAS * FLOOR_SHARE * m.ocv.voltage_V[-1]
    after = np.minimum(silent[:, None] + np.arange(MOST_AFTER), rows.size - 1)
    means_V = np.cumsum(innovation_V[rows[after]], axis=1) / np.arange(1, MOST_AFTER + 1)
    away_V = np.abs(means_V - innovation_V[rows[silent - 1]][:, None])[:, FEWEST_AFTER - 1 :]
    stepped = silent[(away_V > least_V).any(axis=1)]
    begins = np.maximum(rows[stepped] - FORGETS, 0)
    stops = rows[np.minimum(stepped + MOST_AFTER, rows.size) - 1] + 1
    return list(zip(begins.tolist(), stops.tolist(), strict=True))
