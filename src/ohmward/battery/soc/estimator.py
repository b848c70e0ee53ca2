"""Stateful estimator of the state of charge: `update` takes live samples, `run` takes a whole log."""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self, cast

import numpy as np

from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.log_check import require_log_of
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc.anchor_rule import SocNormal
from ohmward.battery.soc.charge_history import FULL_WITHIN, ChargeHistory, ChargeMemory
from ohmward.battery.soc.clean_sample import LONGEST_PAUSE_S
from ohmward.battery.soc.exchange_watch import FORGETS, exchange_notes, exchanged_at
from ohmward.battery.soc.explanation import Explanation, explain
from ohmward.battery.soc.fit_check import DO_NOT_TRUST, misfits
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter, carries_errors
from ohmward.battery.soc.given_soc import after_gap, correct_soc, full_charge, longest_known_gap_s
from ohmward.battery.soc.registry import DEFAULT, chosen_name, make_estimator
from ohmward.battery.soc.sample import (
    INITIAL_SOC_STD,
    LEARNT_FIELDS,
    NO_SAMPLE,
    Estimator,
    SocEstimate,
    SocFlag,
    SocSample,
    require_soc_std,
)
from ohmward.battery.soc.voltage_faults import START_SETTLED_S, StartWatch, watch_start, wrong_starts
from ohmward.checks import require_between
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.filters.estimator import LiveEstimator, Progress, number, row_of
from ohmward.filters.run import Run
from ohmward.logs.log import Log, LogSource, Note, as_log
from ohmward.trace import Kernel
from ohmward.trace.snapshot import take

#: Most samples of a log that are estimated before another battery is looked for in them.
_PIECE = 1 << 18
_NO_MEMORY = ChargeMemory()
_NO_WATCH = StartWatch()


class BeforeGap(NamedTuple):
    """State before a gap with unknown current, and the length of the gap [s]."""

    state: Any
    gap_s: float


@dataclass(frozen=True)
class LogEvents:
    """Rows of a log at which its estimate does more than follow the samples."""

    rows: int  #: of the log
    gaps: Mapping[int, float]  #: rows after a gap with unknown current, and the length of each gap [s]
    declared_full: Collection[int]  #: rows at which a column reports a full battery
    watch: StartWatch | None  #: of the start of the estimate, after the log
    #: rows from which the estimate starts again, each with the sample that it starts from
    wrong_starts: Mapping[int, SocSample] = field(default_factory=dict)
    exchanged: int = -1  #: row from which on another battery is in, the last one found

    @cached_property
    def stops(self) -> list[int]:
        """Rows at which a piece of the log ends, in order: no event lies inside a piece."""
        after_full = {k + 1 for k in self.declared_full}
        at_most = {*range(0, self.rows, _PIECE), self.rows}
        return sorted(after_full | self.gaps.keys() | {*self.wrong_starts} | at_most | {max(self.exchanged, 0)})

    def flags_at(self, row: int) -> int:
        """Flags of the events with which the piece from this row on begins."""
        events = {SocFlag.GAP: row in self.gaps, SocFlag.EXCHANGED: row == self.exchanged}
        events[SocFlag.RESTARTED] = row in self.wrong_starts
        return sum(flag for flag, happened in events.items() if happened)


@dataclass(frozen=True, eq=False, repr=False)
class SocRun(Run[SocEstimate]):
    """Estimates for a whole log, every field an array (T,)."""

    #: the estimator, its compiled step, and its state after the log
    settings: Any
    kernel: Kernel
    end: Any
    history: ChargeHistory  #: time since the events that anchor SoC, also those before this log
    label: str = "estimate"  #: estimator and battery, for a legend
    #: warnings that the battery does not fit the log, see `misfits`; () for an estimator made from settings
    notes: tuple[Note, ...] = ()

    flag_type = SocFlag

    @property
    def exchanges(self) -> tuple[Note, ...]:
        """A warning for each battery that was put in along the log."""
        return exchange_notes(self.time_s, self.flags)

    def explain(self) -> Explanation:
        """State of charge at the end of the log in one sentence, and the causes of its uncertainty."""
        last = row_of(self.estimates, -1)
        found = explain(self.settings, self.kernel, self.end, last, self.history)
        return found._replace(sentence=f"{DO_NOT_TRUST} {found.sentence}") if self.notes else found


class SocEstimator(LiveEstimator[SocSample, SocEstimate]):
    """State of charge, live or from logs.

    >>> estimator = ow.SocEstimator(ow.load_battery("battery.toml"), initial_soc=0.8)
    >>> now = estimator.update(time_s=0.0, current_A=-3.2, voltage_V=13.1, temperature_degC=21.0)
    >>> round(now.soc, 1), now.soc_std < 0.05
    (0.8, True)

    Args:
        battery: identified or generic; or settings of an estimator: a `TheveninFilter`, or those of `make_estimator`.
        initial_soc: in [0, 1]; None takes it from the first voltage.
        initial_soc_std: standard deviation of that value, at most 0.5. A value that the first voltage contradicts is
            overruled.
        lowering: "python", "machine" or None, see `ohmward.trace.Kernel`; results differ in their last digits.
        filter: name of the estimator, see `ohmward.available`; by default the Gaussian sum filter, "gsf".
        unix_s: Unix time of the first sample [s], since the capacity in the battery file becomes less certain with age;
            None if unknown. `run` takes it from the log.
    """

    flag_type = SocFlag
    known = SocEstimate._fields.index("soc"), SocEstimate._fields.index("soc_std")
    longest_step_s = LONGEST_PAUSE_S

    def __init__(
        self,
        battery: Battery | Estimator,
        initial_soc: float | None = None,
        initial_soc_std: float = INITIAL_SOC_STD,
        lowering: str | None = None,
        filter: str = DEFAULT,
        unix_s: float | None = None,
    ):
        if initial_soc is not None and not 0.0 <= number("initial_soc", initial_soc) <= 1.0:
            raise InputError(f"initial_soc must be between 0 and 1 (0.8 is 80 %), got {initial_soc:g}")
        require_soc_std("initial_soc_std", initial_soc_std)
        super().__init__(estimator_of(battery, filter), lowering)
        self.battery = battery if isinstance(battery, Battery) else None
        self.initial_soc = initial_soc
        self.initial_soc_std = initial_soc_std
        self.unix_s = unix_s
        self.title = _title(battery, filter)
        self.known_gap_s = longest_known_gap_s(self.settings)
        self.memory = _NO_MEMORY
        self._model = model_of(self.settings)
        self._watch: StartWatch | None = _NO_WATCH if self._model else None
        self._before_gap: BeforeGap | None = None

    def update(
        self,
        time_s: float,
        current_A: float | None,
        voltage_V: float | None,
        temperature_degC: float | None = math.nan,
    ) -> SocEstimate:
        """Estimate after one live sample; a bad one is tolerated and flagged, see `SocFlag`. None and nan are missing.

        time_s: time stamp. A late sample (its time stamp before the previous one) is used without a step in time; if
            it is earlier by more than a minute, or the fifth late one in a row, the clock is assumed to have been set,
            and time continues from there.
        current_A: > 0 charges. Current and voltage may come one after the other, each None where the other comes.

        Raises:
            InputError: something other than a number.
        """
        if not float is type(time_s) is type(current_A) is type(voltage_V) is type(temperature_degC):
            time_s = number("time_s", time_s)
            current_A = number("current_A", current_A)
            voltage_V = number("voltage_V", voltage_V)
            temperature_degC = number("temperature_degC", temperature_degC)
        before_s = self.time_s
        dt_s = 0.0 if self._state is None else time_s - before_s
        clock_s = time_s if before_s <= time_s < math.inf else self._clock(time_s)
        sample = (dt_s, current_A, voltage_V, temperature_degC)
        estimate = self._advance(sample, clock_s) if dt_s <= self.known_gap_s else self._after_gap(sample, clock_s)
        if estimate[0] >= 1.0 - FULL_WITHIN or estimate[-1] is not self._no_flags or self.memory is _NO_MEMORY:
            self.memory = self.memory.after(clock_s, estimate)
        return estimate

    def step(self, sample: SocSample) -> SocEstimate:
        """Estimate after one live sample, see `LiveEstimator.step`."""
        if self._state is not None and self.known_gap_s < sample.dt_s <= LONGEST_PAUSE_S:
            before_s = 0.0 if math.isnan(self.time_s) else self.time_s
            return self._after_gap(sample, before_s + sample.dt_s)
        return super().step(sample)

    def _advance(self, sample: Any, clock_s: float) -> SocEstimate:
        """Estimate after one live sample, from which it starts again if the start was wrong."""
        wrong = self._watch is not None and self._start_is_wrong(self._record(sample))
        estimate = super()._advance(sample, clock_s)
        if wrong:
            self.last = estimate = estimate._replace(flags=estimate.flags | SocFlag.RESTARTED)
        return estimate

    def _start_is_wrong(self, sample: SocSample) -> bool:
        """True where another voltage than that of the start has lasted for longer; then the estimate starts again."""
        if self._watch is None or self._model is None:
            return False
        if self._state is None:
            self._watch = watch_start(sample, self._model, self._waits_s)
            return False
        self._watch, start = self._watch.after(sample, self._model)
        if start is not None:
            self._start_again_from(start, self._model)
        return start is not None

    @property
    def _waits_s(self) -> float:
        """Longest time for which a new estimate waits for its first voltage [s]."""
        return math.inf if self.initial_soc is None else START_SETTLED_S

    def _start_again_from(self, sample: SocSample, model: Thevenin) -> None:
        """Start from this sample as from the first one, or as from the first one after a gap."""
        if self._before_gap is None:
            self.state, self.memory = self.init(sample), _NO_MEMORY
        else:
            self.state = self._before_gap.state
            self._begin_after_gap(sample, self._before_gap.gap_s)
        self._watch = watch_start(sample, model)

    def _after_gap(self, sample: Any, clock_s: float) -> SocEstimate:
        """Estimate after a sample that follows a gap with unknown current."""
        dt_s, *measured = sample
        if not dt_s <= LONGEST_PAUSE_S:
            return self._advance(sample, clock_s)
        first = SocSample(0.0, *measured)
        self._begin_after_gap(first, dt_s)
        estimate = self._advance(first, clock_s)
        self.last = estimate._replace(flags=estimate.flags | SocFlag.GAP)
        return self.last

    def _begin_after_gap(self, first: SocSample, gap_s: float) -> None:
        """Restart before the first sample that follows such a gap."""
        self._before_gap = BeforeGap(self.state, gap_s)
        self._watch = watch_start(first, self._model) if self._model else None
        self.state, self.memory = after_gap(self.settings, self.state, first, gap_s), _NO_MEMORY

    def run(self, log: LogSource, progress: Progress | None = None, learnt_along: bool = True) -> SocRun:
        """Estimates for every sample of a log, continuing from the present state; a new estimator starts with the log.

        Where a column of the log reports a full battery, as a charger does, the filters on the Thevenin model are
        corrected as by `correct_soc`.

        log: a Log, or a path or DataFrame of one.
        progress: called now and then with (steps done, T).
        learnt_along: False stores the sensor offset, the capacity, the resistance and their standard deviations at the
            end of the log only, (1,), which takes half of the memory.

        Raises:
            InputError: the log cannot be of this battery, its voltage or current is far outside.
        """
        log = as_log(log)
        if self.battery:
            require_log_of(log, self.battery)
        if self._state is None and log.begin_unix_s is not None:
            self.unix_s = log.begin_unix_s
        estimates, seconds = self._scan_log(log, progress, () if learnt_along else LEARNT_FIELDS)
        history = self.memory.history(self.time_s)
        settings = on_day(self.settings, self.unix_s)
        notes = misfits(self.battery, log, self.settings, estimates) if self.battery else ()
        return SocRun(log.time_s, estimates, seconds, settings, self.kernel, self.state, history, self.title, notes)

    def correct_soc(self, soc: float = 1.0, soc_std: float | None = None) -> SocEstimate:
        """Estimate after a state of charge from another source than the samples, such as the flag of a charger.

        Repeating it changes next to nothing, so it may be called for as long as the charger reports full.

        soc: given, in [0, 1]; soc_std: its standard deviation, None takes that of a full charge in this chemistry.

        Raises:
            InputError: values out of range, no sample yet, or an estimator that takes no state of charge from outside.
        """
        if self.last is None:
            raise InputError("correct_soc needs an estimate: give update() a sample first")
        require_between("soc", number("soc", soc), 0.0, 1.0)
        if soc_std is not None:
            require_soc_std("soc_std", number("soc_std", soc_std))
        estimate = self._with_given(soc, soc_std)
        self.last = SocEstimate._make([*map(float, estimate[:-1]), SocFlag(int(estimate.flags))])
        self.memory = self.memory.after(self.time_s, self.last)
        return self.last

    def _with_given(self, soc: float = 1.0, soc_std: float | None = None) -> SocEstimate:
        """Update the state with a given state of charge, and return the estimate."""
        std = full_charge(self.settings).std if soc_std is None and carries_errors(self.settings) else soc_std
        assert self.last is not None
        self.state, estimate = correct_soc(self.settings, self.state, self.last, SocNormal(soc, std))
        self._watch = None
        return estimate

    def _scan_log(self, log: Log, progress: Progress | None, at_end: Collection[str]) -> tuple[SocEstimate, float]:
        """Estimates along a log and the run time [s]; the log is taken piece by piece, from event to event."""
        samples = samples_of(log, self.time_s)
        events = self._events(samples, log)
        lengths = [1 if name in at_end else len(log) for name in SocEstimate._fields]
        whole = SocEstimate._make(map(np.empty, lengths))
        seconds, before, begin = 0.0, 0, 0
        while begin < len(log):
            end = events.stops[bisect(events.stops, begin)]
            rows = SocSample(*(column[begin:end] for column in samples))
            first, end_s = row_of(rows, 0), float(log.time_s[end - 1])
            piece = SocEstimate._make(column[begin:end] if len(column) > 1 else column for column in whole)
            self._begin_piece(begin, first, events)
            _, took_s = self._scan(rows, first, end_s, _from(begin, len(log), progress), at_end, piece)
            seconds += took_s
            piece.flags[0] = int(piece.flags[0]) | events.flags_at(begin)
            since = begin if begin == events.exchanged else max(begin - FORGETS, before)
            found = self._exchanged_at(samples, whole, slice(since, end))
            if found is not None:
                end = max(found, begin)  # what follows is estimated again, with the other battery
                samples.dt_s[end] = 0.0
                events = self._with_wrong_starts(replace(events, exchanged=end), samples, since=end, is_new=True)
                piece = SocEstimate._make(column[: end - begin] for column in piece)
            elif end - 1 in events.declared_full:
                self.last = self._with_given()
                for column, value in zip(piece, self.last, strict=True):
                    column[-1] = value
            self.memory = self.memory.after_log(log.time_s[begin:end], piece)
            before, begin = begin, end
        self._watch = events.watch
        return whole, seconds

    def _begin_piece(self, begin: int, first: SocSample, events: LogEvents) -> None:
        """Restart where the piece of a log from this row on, and its first sample, begins with an event."""
        if begin in events.gaps:
            self._begin_after_gap(first, events.gaps[begin])
        if begin == events.exchanged:
            self.state, self.memory, self._before_gap = self.init_again(first), _NO_MEMORY, None
        if begin in events.wrong_starts and self._model:
            self._start_again_from(events.wrong_starts[begin], self._model)

    def _exchanged_at(self, samples: SocSample, estimates: SocEstimate, part: slice) -> int | None:
        """First row in a part of the estimates along a log that shows another battery."""
        rows = SocSample(*(column[part] for column in samples))
        row = exchange_in(self.settings, rows, estimates.innovation_V[part], estimates.flags[part])
        return None if row is None else part.start + row

    def _events(self, samples: SocSample, log: Log) -> LogEvents:
        """Events along a log that show before its estimate; the length of its gaps leaves the samples."""
        gaps = {k: float(samples.dt_s[k]) for k in after_long_gaps(self.settings, samples.dt_s)}
        samples.dt_s[list(gaps)] = 0.0
        events = LogEvents(len(log), gaps, declared_full_at(self.settings, log), self._watch)
        return self._with_wrong_starts(events, samples, since=0, is_new=self._state is None)

    def _with_wrong_starts(self, events: LogEvents, samples: SocSample, since: int, is_new: bool) -> LogEvents:
        """The events with the rows, not before `since`, from which the estimate starts again.

        is_new: whether the estimate starts at `since`, and does not continue there.
        """
        if self._model is None:
            return events
        starts = sorted({since, *(k for k in events.gaps if k > since)})
        watch = events.watch
        wrong: dict[int, SocSample] = {}
        for start, end in zip(starts, [*starts[1:], events.rows], strict=True):
            begins = start == since and is_new
            if start in events.gaps or begins:
                watch = None
            elif watch is None:
                continue  # the start of this estimate was judged in an earlier log
            full = min((k + 1 for k in events.declared_full if start <= k < end), default=None)
            rows = SocSample(*(column[start : full or end] for column in samples))
            found, watch = wrong_starts(rows, self._model, watch, self._waits_s if begins else START_SETTLED_S)
            wrong |= {start + k: sample for k, sample in found.items()}
            watch = None if full else watch
        return replace(events, wrong_starts=wrong, watch=watch)

    def explain(self) -> Explanation:
        """State of charge in one sentence, the causes of its uncertainty, and what would settle it; takes about 50 ms.

        Raises:
            InputError: there is no estimate before the first sample.
        """
        if self.last is None:
            raise InputError("explain needs an estimate: give update() a sample first")
        settings = on_day(self.settings, self.unix_s)
        return explain(settings, self.kernel, self.state, self.last, self.memory.history(self.time_s))

    def snapshot(self) -> dict[str, Any]:
        """The state, the memory and the date of the start as a dict for JSON, see `LiveEstimator.snapshot`."""
        return take(self.settings, self.state, self.time_s, memory=self.memory.to_json(), unix_s=self.unix_s)

    @classmethod
    def restore(cls, settings: Any, snapshot: Mapping[str, Any], **options: Any) -> Self:
        """Estimator that continues from a snapshot, see `LiveEstimator.restore`.

        Memory and date may be missing from it.
        """
        estimator = super().restore(settings, snapshot, **options)
        if estimator.unix_s is None:
            estimator.unix_s = snapshot.get("unix_s")
        if "memory" in snapshot:
            estimator.memory = ChargeMemory.of_json(snapshot["memory"])
        return estimator

    def init(self, first: SocSample) -> Any:
        """State before the first sample."""
        return on_day(self.settings, self.unix_s).init(first, self.initial_soc, self.initial_soc_std)

    def init_again(self, sample: SocSample) -> Any:
        """State before a sample after the last state was lost: the initial SoC given by the user no longer holds."""
        return on_day(self.settings, self.unix_s).init(sample)

    def no_sample(self) -> SocSample:
        """A sample in which nothing was measured."""
        return NO_SAMPLE

    def __repr__(self) -> str:
        now = f", soc {self.last.soc:.3f} ± {BAND_95 * self.last.soc_std:.3f}" if self.last else ""
        return f"SocEstimator({self.title}{now})"


def estimator_of(battery: Battery | Estimator, filter: str) -> Estimator:
    """Estimator of that name for a battery; an estimator is returned as it is.

    Raises:
        InputError: neither a battery nor an estimator, or no estimator of that name.
    """
    if not isinstance(battery, Battery) and hasattr(battery, "step") and hasattr(battery, "init"):
        return battery
    return make_estimator(filter, require_battery(battery, " or an estimator"))


def model_of(settings: Estimator) -> Thevenin | None:
    """Model of an estimator that starts from the first voltage; None for another one."""
    return getattr(getattr(settings, "voltage_start", None), "model", None)


def exchange_in(settings: Estimator, samples: SocSample, innovation_V: np.ndarray, flags: np.ndarray) -> int | None:
    """First row of samples (T,), and of their estimates, that shows another battery; None without any.

    Only filters that carry the errors of sensor and model can show it.
    """
    model = model_of(settings) if carries_errors(settings) else None
    return None if model is None else exchanged_at(samples, innovation_V, flags, model)


def declared_full_at(settings: Estimator, log: Log) -> set[int]:
    """Rows at which a column of the log reports a full battery; none for an estimator that cannot use it."""
    return {k for _, k in log.full_charges()} if carries_errors(settings) else set()


def after_long_gaps(settings: Estimator, dt_s: np.ndarray) -> list[int]:
    """Rows that follow a gap with unknown current; dt_s: steps (T,)."""
    return np.flatnonzero((dt_s > longest_known_gap_s(settings)) & (dt_s <= LONGEST_PAUSE_S)).tolist()


def on_day(settings: Estimator, unix_s: float | None) -> Estimator:
    """Estimator for a start at a Unix time [s], with the uncertainty that capacity and resistances have by then.

    Its step is the same; only the initial state differs. None is an unknown day.
    """
    if unix_s is None:
        return settings
    if isinstance(settings, GaussianSumFilter):
        member: Any = on_day(settings.member, unix_s)
        return cast(Estimator, replace(settings, member=member))
    of_one: Any = settings
    noise = getattr(of_one, "noise", None)
    return cast(Estimator, replace(of_one, noise=noise.on(unix_s))) if isinstance(noise, BatteryNoise) else settings


def _from(begin: int, steps: int, progress: Progress | None) -> Progress | None:
    """Progress callback for a piece of a log that begins after `begin` steps."""
    return None if progress is None else lambda done, _: progress(begin + done, steps)


def _title(battery: Battery | Estimator, filter: str) -> str:
    if isinstance(battery, Battery):
        title = f"{chosen_name(filter.lower())}, {battery.chemistry or battery.name} {battery.capacity_Ah:.3g} Ah"
        return f"{title}, learnt" if battery.learnt_logs else title
    return type(battery).__name__


def samples_of(log: Log, before_s: float = math.nan) -> SocSample:
    """The log as samples (T,); its first step counts from `before_s` if that is before the log."""
    dt_s, temperature_degC = np.zeros(len(log)), log.temperature_degC
    if before_s < log.time_s[0]:
        dt_s[0] = log.time_s[0] - before_s
    np.subtract(log.time_s[1:], log.time_s[:-1], out=dt_s[1:])
    if temperature_degC is None:
        temperature_degC = np.full(len(log), math.nan)
    return SocSample(dt_s, log.current_A, log.voltage_V, temperature_degC)
