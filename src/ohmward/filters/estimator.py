"""The live shell of an estimator: its state, clock and compiled step; the same for every estimator.

The estimator itself is a frozen dataclass with pure `init` and `step`. The shell keeps the state between samples.
"""

from __future__ import annotations

import math
import os
import struct
import time
from abc import ABC
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from threading import Lock
from typing import Any, ClassVar, Generic, NamedTuple, Self, TypeVar

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.flags import SampleFlag, flag_table
from ohmward.filters.sanitize import is_step
from ohmward.trace import Kernel
from ohmward.trace.live import Live
from ohmward.trace.snapshot import resume, take
from ohmward.trace.structure import check, is_finite, structure_of

Progress = Callable[[int, int], None]

#: Measured values of wheels or motors, in their order; None or nan where there is none.
PerWheel = Sequence[float | None] | np.ndarray

#: A sample earlier than the clock by more than this is not late: the clock was set. It was also set where this many
#: samples in a row are late, each later than the one before.
CLOCK_SET_S, CLOCK_SET_SAMPLES = 60.0, 5

#: Number of compiled steps kept for further estimators, those used last; each takes some megabytes.
MOST_KERNELS = 8
_KERNELS: dict[tuple[Any, ...], Kernel] = {}
_KERNELS_LOCK = Lock()

S = TypeVar("S", bound=tuple[Any, ...])
E = TypeVar("E", bound=tuple[Any, ...])


class LateSamples(NamedTuple):
    """Samples in a row that are earlier than the clock, each later than the one before."""

    clock_s: float = math.nan  #: the clock, which they leave unchanged
    time_s: float = math.nan  #: of the last one
    in_a_row: int = 0  #: their number


def clock_after(clock_s: float, time_s: float, late: LateSamples) -> tuple[float, LateSamples]:
    """The clock after a sample at `time_s`, and the samples in a row that have been late.

    A late sample leaves it unchanged; one that is earlier by more than `CLOCK_SET_S` sets it, as does the last of
    `CLOCK_SET_SAMPLES` late ones that follow each other in time, and time goes on from there.

    clock_s: before the sample; nan before the first.
    """
    if not math.isfinite(time_s):
        return clock_s, late
    if clock_s - CLOCK_SET_S <= time_s < clock_s:
        follows = late.clock_s == clock_s and late.time_s < time_s
        late = LateSamples(clock_s, time_s, late.in_a_row + 1 if follows else 1)
        if late.in_a_row < CLOCK_SET_SAMPLES:
            return clock_s, late
    return time_s, late


class LiveEstimator(ABC, Generic[S, E]):
    """Base of the stateful estimators; S is the record of a sample, E that of an estimate.

    A running estimator can be copied and pickled, and the copy continues bit for bit. The first samples run in Python
    while the step is compiled, where machine code is not at hand: their last digits may differ, not with a `lowering`.

    Attributes:
        settings: the estimator itself.
        lowering: "python", "machine" or None, see `ohmward.trace.Kernel`; results differ in their last digits.
        time_s: of the last sample; nan before the first.
        last: estimate after the last sample; None before the first.
    """

    #: Type of the flags of an estimate, which are its last field; one of them is RESTARTED.
    flag_type: ClassVar[type[SampleFlag]]
    #: Indices in an estimate of a quantity that is always known, and of its standard deviation.
    known: ClassVar[tuple[int, int]]
    #: Longest step between two samples [s]; a longer one means that the clock was set.
    longest_step_s: ClassVar[float]

    def __init__(self, settings: Any, lowering: str | None = None):
        self.settings = settings
        self.lowering = lowering
        self.time_s = math.nan
        self._late = LateSamples()
        self.last: E | None = None
        self._state: Any = None
        self._live: Live | None = None
        self._kernel: Kernel | None = None
        self._no_flags = flag_table(self.flag_type)[0.0]

    @classmethod
    def restore(cls, settings: Any, snapshot: Mapping[str, Any], **options: Any) -> Self:
        """The estimator that continues from a snapshot; settings, options: those of the estimator that took it.

        Raises:
            InputError: the snapshot is of another version, another estimator or other settings, or damaged.
        """
        estimator = cls(settings, **options)
        example = estimator.init(estimator.no_sample())
        estimator.state, estimator.time_s = resume(estimator.settings, example, snapshot)
        return estimator

    def compiled(self) -> Kernel:
        """The step, compiled."""
        nothing = self.no_sample()
        return Kernel(self.settings.step, self.settings.init(nothing), nothing, lowering=self.lowering)

    def init(self, first: S) -> Any:
        """State before the first sample, initialised from it."""
        return self.settings.init(first)

    def init_again(self, sample: S) -> Any:
        """State to restart from before a sample, after the last state was lost."""
        return self.init(sample)

    def no_sample(self) -> S:
        """A sample in which nothing was measured."""
        return self.settings.no_sample()

    @property
    def kernel(self) -> Kernel:
        """The step, compiled when it is first asked for; estimators of equal settings share it."""
        if self._kernel is not None:
            return self._kernel
        key = (type(self), self.settings, self.lowering, os.environ.get("OHMWARD_LOWERING"))
        try:
            hash(key)
        except TypeError:  # settings that hold a list or an array: equal ones cannot be found
            self._kernel = self.compiled()
            return self._kernel
        with _KERNELS_LOCK:
            found = _KERNELS.pop(key, None)
        self._kernel = found or self.compiled()
        with _KERNELS_LOCK:
            _KERNELS[key] = self._kernel
            if len(_KERNELS) > MOST_KERNELS:
                del _KERNELS[next(iter(_KERNELS))]
        return self._kernel

    @property
    def state(self) -> Any:
        """The state after the last sample; None before the first. The next step starts from an assigned one."""
        return self._state if self._live is None else self._live.state

    @state.setter
    def state(self, state: Any) -> None:
        self._state, self._live = state, None

    def step(self, sample: S) -> E:
        """Estimate after one live sample, for callers that have a record of it, with `dt_s` instead of a time.

        The clock begins at 0, and stops where `dt_s` is not a valid time step. A bad sample is flagged, not an error.

        Raises:
            InputError: anything but numbers, or a sample of another shape than this estimator was made for.
        """
        before_s = 0.0 if math.isnan(self.time_s) else self.time_s
        dt_s = sample.dt_s  # type: ignore[attr-defined]
        return self._advance(sample, before_s + dt_s if is_step(dt_s, self.longest_step_s) else before_s)

    def snapshot(self) -> dict[str, Any]:
        """The state as a dict for JSON; an estimator with the same settings continues from it bit for bit.

        Raises:
            InputError: there is no state before the first sample.
        """
        return take(self.settings, self.state, self.time_s)

    def _since_last(self, time_s: float) -> float:
        """Time since the sample before [s]; 0 for the first."""
        return 0.0 if self._state is None else time_s - self.time_s

    def _clock(self, time_s: float) -> float:
        """The clock after a sample at `time_s`."""
        clock_s, self._late = clock_after(self.time_s, time_s, self._late)
        return clock_s

    def _advance(self, sample: Any, clock_s: float) -> E:
        """Estimate after one live sample (dt_s, ...), and the clock then."""
        live = self._live
        first = live is None
        if live is None:
            live = self._wake(sample)
        try:
            estimate = live.step(sample)
        except (TypeError, ValueError, struct.error):
            check(self.kernel.program.argument_structure, (self.state, sample))
            raise
        value, std = self.known
        # Checking the state costs a tenth of a step. A filter whose belief is not finite has no measurement inside its
        # gate, and flags that; so it is enough to check where there is a flag.
        incident = first or estimate[-1] is not self._no_flags or not estimate[value] + estimate[std] < math.inf
        if incident and not live.is_finite():
            self.state = self.init_again(self._record(sample))
            estimate = self._wake(sample).step(sample)
            estimate = estimate._replace(flags=estimate[-1] | self.flag_type["RESTARTED"])
        self.last = estimate
        self.time_s = clock_s
        return estimate

    def _wake(self, sample: S) -> Live:
        """The live step, from the state or, where there is none, from this sample on."""
        if self._state is None:
            self._state = self.init(self._record(sample))
        self._live = self.kernel.live(self._state, flag_table(self.flag_type))
        return self._live

    def _record(self, sample: Any) -> S:
        """The sample by name; raises InputError where it is of another shape."""
        nothing = self.no_sample()
        check(structure_of(nothing, "sample"), sample, "sample")
        return type(nothing)(*sample)

    def _scan(
        self,
        samples: S,
        first: S,
        end_s: float,
        progress: Progress | None,
        at_end: Collection[str] = (),
        into: E | None = None,
    ) -> tuple[E, float]:
        """Estimates along samples (T, ...), and the seconds that they took; a new estimator starts from `first`.

        at_end: fields of the estimates of which only the last value is needed.  into: arrays for the estimates.
        A log in which the state is lost is run again sample by sample, so that the estimator restarts as it does live.
        """
        began = time.perf_counter()
        if self.state is None:
            self.state = self.init(first)
        after, estimates = self.kernel.scan(self.state, samples, progress, at_end, into)
        if is_finite(structure_of(after, "state"), after):
            self.state = after
        else:
            found = [self._advance(row, end_s) for row in rows_of(samples)]
            for column, values in zip(estimates, zip(*found, strict=True), strict=True):
                column[:] = values[-len(column) :]
        self.time_s = end_s
        self.last = self._last_of(estimates)
        return estimates, time.perf_counter() - began

    def _last_of(self, estimates: E) -> E:
        """The last of estimates (T, ...)."""
        *values, flags = (column[-1] for column in estimates)
        return type(estimates)._make([*values, flag_table(self.flag_type)[flags]])  # type: ignore[attr-defined]

    def __copy__(self) -> Self:
        """Another estimator in the same state; the settings and the compiled step never change and are shared."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__ | {"_state": self.state, "_live": None})
        return other

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self.__copy__()

    def __getstate__(self) -> dict[str, Any]:
        """State to pickle; the other process compiles the step again, or finds it in its cache."""
        return self.__dict__ | {"_state": self.state, "_live": None, "_kernel": None}


def rows_of(samples: Any) -> Iterator[Any]:
    """Each of the samples (T, ...), whose fields may be records themselves."""
    columns = (rows_of(values) if isinstance(values, tuple) else values for values in samples)
    return (type(samples)(*row) for row in zip(*columns, strict=True))


def row_of(samples: Any, k: int) -> Any:
    """Sample k of samples (T, ...), whose fields may be records themselves; plain numbers from fields (T,)."""

    def of_field(values: Any) -> Any:
        if isinstance(values, tuple):
            return row_of(values, k)
        return values[k].item() if values.ndim == 1 else values[k]

    return type(samples)(*map(of_field, samples))


def number(name: str, value: Any) -> float:
    """A measured value as a float; None, for a missing one, becomes nan.

    Raises:
        InputError: it is not a number.
    """
    if type(value) is float:
        return value
    if value is None:
        return math.nan
    if not isinstance(value, str | bytes) and np.ndim(value) == 0:
        try:
            return float(value)
        except (TypeError, ValueError):
            pass
    raise InputError(f"{name} must be a number, or None where it was not measured, got {value!r:.80}")


def numbers(name: str, values: Any, *counts: int) -> np.ndarray:
    """Measured values as an array of length `counts[0]`; None is missing, and so are all beyond the last one given.

    Raises:
        InputError: anything but numbers, or a length that is not one of `counts`.
    """
    given = np.full(counts[-1], math.nan) if values is None else np.asarray(values)
    if given.ndim != 1 or len(given) not in counts:
        raise InputError(
            f"{name} must have the shape {' or '.join(f'({n},)' for n in counts)}, one number for each wheel or motor "
            f"(nan where there is none), got {given.shape}"
        )
    if given.dtype.kind not in "fiu":
        given = np.array([number(f"{name}[{k}]", value) for k, value in enumerate(values)])
    if len(given) == counts[0]:
        return given
    return np.concatenate([given, np.full(counts[0] - len(given), math.nan)])
