"""For people: an estimator that remembers its state. `update` takes live samples, `run` takes a whole log."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.errors import InputError
from ohmward.filters.flags import count_flags
from ohmward.logs.log import Log
from ohmward.trace import Kernel, snapshot
from ohmward.trace.live import Live

Progress = Callable[[int, int], None]

#: A sample that is late by more than this is not late: the clock was set.
CLOCK_SET_S = 60.0


class Estimator(Protocol):
    """What every estimator of the battery offers: pure functions of frozen settings."""

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> Any:
        """State before the first sample; `soc` None is unknown."""
        ...

    def step(self, state: Any, sample: SocSample) -> tuple[Any, SocEstimate]:
        """The state after a sample, and what is known then."""
        ...


class SocRun(NamedTuple):
    """An estimator's answer to a whole log.

    estimates: every field an array (T,), as the log's samples.
    seconds: what it took, compilation included.
    """

    estimates: SocEstimate
    seconds: float

    def counts(self) -> dict[str, int]:
        """How many samples carry each flag, by name; flags that never occur are left out."""
        return count_flags(self.estimates.flags, SocFlag)


class SocEstimator:
    """State of charge, live or from logs.

    >>> estimator = SocEstimator(TheveninFilter(model, noise), initial_soc=0.8)     # doctest: +SKIP
    >>> estimator.update(time_s=0.0, current_A=-3.2, voltage_V=12.9).soc            # doctest: +SKIP
    0.801

    Args:
        estimator: settings, as `TheveninFilter`; `ohmward.battery.make_estimator` finds one by name.
        initial_soc: in [0, 1]; None takes it from the first voltage.
        initial_soc_std: standard deviation of that value. A value that the first voltage contradicts is overruled.
        lowering: "python", "machine" or "auto", see `ohmward.trace.Kernel`; results differ in their last digits.
    """

    def __init__(
        self,
        estimator: Estimator,
        initial_soc: float | None = None,
        initial_soc_std: float = 0.03,
        lowering: str | None = None,
    ):
        if initial_soc is not None and not 0.0 <= initial_soc <= 1.0:
            raise InputError(f"initial_soc must be between 0 and 1 (0.8 is 80 %), got {initial_soc:g}")
        self.estimator = estimator
        self.initial_soc = initial_soc
        self.initial_soc_std = initial_soc_std
        self.lowering = lowering
        self.time_s = math.nan
        self._state: Any = None
        self._live: Live | None = None
        self._kernel: Kernel | None = None

    @property
    def state(self) -> Any:
        """The estimator's state after the last sample; None before the first."""
        return self._state if self._live is None else self._live.state

    def update(
        self, time_s: float, current_A: float, voltage_V: float, temperature_degC: float = math.nan
    ) -> SocEstimate:
        """What is known after one live sample. A bad sample is survived and flagged, see `SocFlag`.

        time_s: of the sample. A late one (its time before that of the sample before) is used without a step in time;
            where it is earlier by more than `CLOCK_SET_S`, the clock was set, and time goes on from there.
        current_A: > 0 charges.
        """
        started = self._state is not None
        dt_s = time_s - self.time_s if started else 0.0
        sample = SocSample(float(dt_s), float(current_A), float(voltage_V), float(temperature_degC))
        if not started:
            self._start(sample)
        if math.isfinite(time_s) and not self.time_s - CLOCK_SET_S <= time_s < self.time_s:
            self.time_s = time_s
        if self._live is None:
            self._live = self.kernel.live(self._state)
        return self._live.step(sample)

    def run(self, log: Log, progress: Progress | None = None) -> SocRun:
        """Estimates for every sample of a log, from this estimator's state on; a new one starts at the log's start."""
        began = time.perf_counter()
        samples = samples_of(log, self.time_s)
        if self.state is None:
            self._start(SocSample(*(float(column[0]) for column in samples)))
        after, estimates = self.kernel.scan(self.state, samples, progress)
        self._go_on_from(after)
        self.time_s = float(log.time_s[-1])
        return SocRun(estimates, time.perf_counter() - began)

    def snapshot(self) -> dict[str, Any]:
        """The state as a dict for JSON; an estimator with the same settings that restores it goes on to the bit.

        Raises:
            InputError: there is no state before the first sample.
        """
        return snapshot.take(self.estimator, self.state, self.time_s)

    def restore(self, taken: Mapping[str, Any]) -> None:
        """Go on from a snapshot.

        Raises:
            InputError: it is of another version, another estimator or other settings, or damaged.
        """
        example = self.estimator.init(SocSample(0.0, math.nan, math.nan, math.nan))
        state, self.time_s = snapshot.resume(self.estimator, example, taken)
        self._go_on_from(state)

    @property
    def kernel(self) -> Kernel:
        """The compiled step."""
        if self._kernel is None:
            example = SocSample(0.0, 0.0, 0.0, 0.0)
            self._kernel = Kernel(self.estimator.step, self._state, example, lowering=self.lowering)
        return self._kernel

    def _start(self, first: SocSample) -> None:
        self._go_on_from(self.estimator.init(first, self.initial_soc, self.initial_soc_std))

    def _go_on_from(self, state: Any) -> None:
        self._state, self._live = state, None


def samples_of(log: Log, before_s: float = math.nan) -> SocSample:
    """The log as samples (T,), its first step counted from `before_s` where that is a time before it."""
    first = log.time_s[0] if not before_s < log.time_s[0] else before_s
    temperature = log.temperature_degC
    if temperature is None:
        temperature = np.full(len(log.time_s), math.nan)
    return SocSample(np.diff(log.time_s, prepend=first), log.current_A, log.voltage_V, temperature)
