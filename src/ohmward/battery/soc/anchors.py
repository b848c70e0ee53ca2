"""Anchors in a log: full charges, cut-offs under load and long rests, each with the state of charge that it implies."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.anchor_rule import AGAIN, AnchorEvent, AnchorMemory, AnchorRule, SocNormal
from ohmward.battery.soc.clean_sample import CURRENT_GAP_S, Rest, SampleLimits, first_input, sample_limits, sanitize
from ohmward.battery.soc.estimator import SocRun, samples_of
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.logs.log import Log
from ohmward.trace import Kernel, where

AnchorKind = Literal["full charge", "nearly full", "empty", "rest"]

#: Source of an anchor that no column reports.
VOLTAGE = "voltage"

#: A long log is searched in stretches of this many samples, so that the memory for each stays small; each is extended
#: by this many samples at both ends, for events that began before it or end after it.
_STRETCH, _LEAD = 240_000, 20_000


class Anchor(NamedTuple):
    """Event that anchors the state of charge."""

    #: a full charge, the cut-off of a load at empty, or a long rest. Charger and protection define the first two, which
    #: say more than the voltage; a rest says no more than its voltage does through the curve.
    kind: AnchorKind
    time_s: float  #: in the log [s]
    sample: int  #: its index in the log
    soc: float  #: state of charge
    soc_std: float  #: its standard deviation
    #: measured at that sample; nan where there is none
    voltage_V: float
    current_A: float
    temperature_degC: float
    source: str = VOLTAGE  #: `VOLTAGE`, or the name of the column that reports it


class FinderState(NamedTuple):
    """Last credible current and temperature, the memory of the rule, and the present rest, if any."""

    current_A: Any
    temperature_degC: Any
    memory: AnchorMemory
    rest: Rest


class FinderOutput(NamedTuple):
    """Output at a sample; conditions are 1 and 0."""

    current_A: Any  #: last credible current
    temperature_degC: Any  #: last credible temperature
    event: AnchorEvent
    long_rest: Any  #: its rest has become a long one
    below_full: Any  #: a charger has tapered below the voltage of a full battery
    held_s: Any  #: time for which the voltage has stood still
    rest_s: Any  #: time for which the battery has rested
    low: Any  #: a load that ends here is cut off
    low_soc: Any  #: state of charge of that cut-off
    low_std: Any  #: its standard deviation


@dataclass(frozen=True)
class AnchorFinder:
    """Settings; `init` and `step` are pure functions of them."""

    rule: AnchorRule  #: of the battery
    gap_s: float = CURRENT_GAP_S  #: a longer step between two samples says nothing about the current in between

    @property
    def limits(self) -> SampleLimits:
        """Plausibility limits of a sample."""
        model = self.rule.model
        return sample_limits(model, self.gap_s)

    def no_sample(self) -> SocSample:
        """A sample in which nothing was measured."""
        return SocSample(0.0, math.nan, math.nan, math.nan)

    def init(self, first: SocSample) -> FinderState:
        """State before the first sample."""
        u = first_input(first, self.limits.current_A)
        return FinderState(u.current_A, u.temperature_degC, AnchorMemory(), Rest())

    def step(self, state: FinderState, sample: SocSample) -> tuple[FinderState, FinderOutput]:
        """State and output after a sample."""
        clean = sanitize(sample, CircuitInput(state.current_A, state.temperature_degC), self.limits)
        memory, event = self.rule.step(state.memory, clean)
        rest, long_rest = self.rule.continue_rest(state.rest, clean)
        after = FinderState(clean.now.current_A, clean.now.temperature_degC, memory, rest)
        below_full = self.rule.stops_below_full(memory, clean)
        conditions = (event.full, event.empty, event.top, long_rest, below_full, self.rule.was_low(memory))
        full, empty, top, long_rest, below_full, low = (where(condition, 1.0, 0.0) for condition in conditions)
        seen = FinderOutput(
            current_A=after.current_A,
            temperature_degC=after.temperature_degC,
            event=event._replace(full=full, empty=empty, top=top),
            long_rest=long_rest,
            below_full=below_full,
            held_s=memory.held_s,
            rest_s=rest.rest_s,
            low=low,
            low_soc=memory.low_soc,
            low_std=memory.low_std,
        )
        return after, seen


def find_anchors(log: Log, battery: Battery) -> tuple[Anchor, ...]:
    """The anchors in a log, in order, each event once.

    The rule is that of the live estimator (`AnchorRule`), but a log shows what follows: a full charge and a rest are
    placed at their end, where they say most, and a load that is low at the end of the log or before a gap was cut off.
    """
    finder = _finder(battery)
    found: list[Anchor] = []
    current_A = np.zeros(len(log))
    for stretch in _stretches(log, finder):
        current_A[stretch.inside] = stretch.output.current_A
        inside = _anchors_inside(log, stretch.inside, finder, stretch.output)
        found += [anchor for anchor in inside if stretch.first <= anchor.sample < stretch.first + _STRETCH]
    said = SocNormal(1.0, finder.rule.limits.full_std)
    found += [_anchor("full charge", k, said, log, name) for name, k in log.full_charges()]
    found.sort(key=lambda anchor: anchor.sample)
    moved_As = current_A * np.diff(log.time_s, prepend=log.time_s[0])
    return tuple(_without_repeats(found, moved_As, AGAIN * finder.rule.model.capacity_As))


class JudgedAnchor(NamedTuple):
    """An anchor, and the estimate before it or before the filter used it, which sees a full charge while it tapers."""

    anchor: Anchor
    used: bool  #: the filter has been corrected by it
    soc_estimated: float
    soc_std_estimated: float

    def as_dict(self) -> dict[str, Any]:
        """The anchor and the estimate for JSON, in one object."""
        fields = self._asdict()
        return fields.pop("anchor")._asdict() | fields


def judged_anchors(log: Log, battery: Battery, run: SocRun) -> list[JudgedAnchor]:
    """The anchors in a log, each with the estimate before it."""
    used = np.flatnonzero(run.flags & SocFlag.ANCHORED)
    before, found = -1, []
    for anchor in find_anchors(log, battery):
        usable = anchor.kind != "rest"  # filters use the voltage of a rest anyway
        seen = used[(used > before) & (used <= anchor.sample)] if usable else used[:0]
        k = max(int(seen[-1] if seen.size else anchor.sample) - 1, 0)
        found.append(JudgedAnchor(anchor, bool(seen.size), float(run.soc[k]), float(run.soc_std[k])))
        before = anchor.sample
    return found


def charger_limit_V(log: Log, battery: Battery) -> float | None:
    """Highest voltage [V], without overpotential, at which a charger stops below full; None if it never does."""
    finder, limits_V = _finder(battery), []
    for stretch in _stretches(log, finder):
        seen, voltage_V = stretch.output, log.voltage_V[stretch.inside]
        if np.any(seen.event.full):
            return None
        for k in np.flatnonzero(np.diff(seen.below_full, prepend=0.0) > 0.0):
            last = _end_of_run(seen.held_s, int(k))
            u = CircuitInput(float(seen.current_A[last]), float(seen.temperature_degC[last]))
            limits_V.append(float(finder.rule.relaxed_V(float(np.median(voltage_V[k : last + 1])), u)))
    return max(limits_V, default=None)


class _Stretch(NamedTuple):
    """Stretch of a log: its first sample, the samples that were searched, and what was found in them."""

    first: int
    inside: slice
    output: FinderOutput


def _finder(battery: Battery) -> AnchorFinder:
    return AnchorFinder(AnchorRule(battery.thevenin, battery.noise, battery.sensor))


def _stretches(log: Log, finder: AnchorFinder) -> Iterator[_Stretch]:
    """The stretches of a log, one after the other."""
    nothing = finder.no_sample()
    kernel = Kernel(finder.step, finder.init(nothing), nothing)
    samples_of_log = samples_of(log)
    for first in range(0, len(log), _STRETCH):
        inside = slice(max(first - _LEAD, 0), min(first + _STRETCH + _LEAD, len(log)))
        samples = SocSample(*(column[inside] for column in samples_of_log))
        start = finder.init(SocSample(*(float(column[0]) for column in samples)))
        _, output = kernel.scan(start, samples)
        yield _Stretch(first, inside, output)


def _anchors_inside(log: Log, inside: slice, finder: AnchorFinder, output: FinderOutput) -> Iterator[Anchor]:
    """The anchors that current and voltage show in a part of a log."""
    rule, event = finder.rule, output.event

    def at(k: int) -> tuple[float, CircuitInput]:
        voltage_V = float(log.voltage_V[inside.start + k])
        return voltage_V, CircuitInput(float(output.current_A[k]), float(output.temperature_degC[k]))

    def anchor(kind: AnchorKind, k: int, soc: Any, std: Any) -> Anchor:
        return _anchor(kind, inside.start + k, SocNormal(float(soc), float(std)), log)

    for k in np.flatnonzero(event.full).tolist():
        last = _end_of_run(output.held_s, k)
        yield anchor("full charge", last, *rule.full(*at(last)))
    for k in np.flatnonzero(event.top).tolist():
        yield anchor("nearly full", k, event.soc[k], event.std[k])
    for k in np.flatnonzero(event.empty).tolist():
        yield anchor("empty", k, event.soc[k], event.std[k])
    ends = np.append(np.diff(log.time_s[inside]) > finder.gap_s, True)
    for k in np.flatnonzero((output.low > 0.0) & ends).tolist():
        yield anchor("empty", k, output.low_soc[k], output.low_std[k])
    for k in np.flatnonzero(output.long_rest).tolist():
        last = _end_of_run(output.rest_s, k)
        yield anchor("rest", last, *rule.at_rest(*at(last)))


def _end_of_run(held_s: np.ndarray, k: int) -> int:
    """Last sample of the run of rising times that sample k belongs to."""
    falls = np.flatnonzero(np.diff(held_s[k:]) < 0.0)
    return k + int(falls[0]) if falls.size else len(held_s) - 1


def _without_repeats(anchors: Sequence[Anchor], moved_As: np.ndarray, apart_As: float) -> Iterator[Anchor]:
    """The anchors, only one for each charge or cut-off: between two of a kind, charge flows the other way.

    moved_As: (T,) charge of each interval, > 0 charges; apart_As: least charge that has to flow the other way.
    """
    out_As, in_As = np.cumsum(np.maximum(-moved_As, 0.0)), np.cumsum(np.maximum(moved_As, 0.0))
    flowed = {"full charge": out_As, "nearly full": out_As, "empty": in_As}
    last: dict[str, int] = {}
    for anchor in anchors:
        kind, k = anchor.kind, anchor.sample
        if kind in flowed and kind in last and flowed[kind][k] - flowed[kind][last[kind]] < apart_As:
            continue
        last[kind] = k
        yield anchor


def _anchor(kind: AnchorKind, k: int, soc: SocNormal, log: Log, source: str = VOLTAGE) -> Anchor:
    degC = math.nan if log.temperature_degC is None else float(log.temperature_degC[k])
    measured = float(log.voltage_V[k]), float(log.current_A[k]), degC
    return Anchor(kind, float(log.time_s[k]), k, *soc, *measured, source)
