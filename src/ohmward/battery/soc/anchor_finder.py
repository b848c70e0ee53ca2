"""Step along a log that finds the events which anchor the state of charge; traceable."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Any, NamedTuple

from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.anchor_rule import AnchorMemory, AnchorRule, SocNormal
from ohmward.battery.soc.clean_sample import CURRENT_GAP_S, CleanSocSample, Rest, first_input, sample_limits, sanitize
from ohmward.battery.soc.sample import SocSample
from ohmward.filters.flags import flags_of
from ohmward.trace import where


class AnchorFlag(IntFlag):
    """Events that a sample shows; several of them show that they were, when they end."""

    FULL = 1  #: a full charge ended with the sample before
    TOP = 2  #: the charging voltage leaves the flat part of the curve
    EMPTY = 4  #: a load that was low has ended: it was cut off
    CUT_OFF = 8  #: the same at the sample before, since no sample follows it for long
    REST = 16  #: a long rest ended with the sample before
    TAPERS = 32  #: a charge tapers below the voltage of a full battery from here on
    BELOW_FULL = 64  #: such a charge ended with the sample before


class OpenEvents(NamedTuple):
    """Events that have begun and not ended."""

    discharged: Any = 1.0  #: charge taken out since the last full charge, over the capacity, at most 1
    rest: Rest = Rest()
    #: 1 from a full charge, or from one that tapers below full, on, for as long as the voltage stands still
    full: Any = 0.0
    below_full: Any = 0.0


class SampleEvents(NamedTuple):
    """Events at a sample."""

    flags: Any  #: sum of `AnchorFlag`
    soc: SocNormal  #: at the end of a flat curve, or at a cut-off that the sample completes


class FinderState(NamedTuple):
    """Last credible current and temperature, the memory of the rule, and open events, see `FinderOutput`."""

    current_A: Any
    temperature_degC: Any
    memory: AnchorMemory
    own: OpenEvents
    known: OpenEvents


class FinderOutput(NamedTuple):
    """Output at a sample."""

    current_A: Any  #: last credible current
    #: of the sample before: last credible current and temperature, and state of charge of a cut-off
    before: CircuitInput
    low: SocNormal
    #: events by the rule, and by the one with a known full end
    own: SampleEvents
    known: SampleEvents


@dataclass(frozen=True)
class AnchorFinder:
    """Settings; `init` and `step` are pure functions of them. It reaches no code that reads logs or estimates."""

    rule: AnchorRule
    known_rule: AnchorRule  #: the same for a battery that is full at the full end of its curve

    def init(self, first: SocSample) -> FinderState:
        """State before the first sample."""
        u = first_input(first, sample_limits(self.rule.model).current_A)
        return FinderState(u.current_A, u.temperature_degC, AnchorMemory(), OpenEvents(), OpenEvents())

    def step(self, state: FinderState, sample: SocSample) -> tuple[FinderState, FinderOutput]:
        """State and output after a sample."""
        before = CircuitInput(state.current_A, state.temperature_degC)
        clean = sanitize(sample, before, sample_limits(self.rule.model))
        # but for `discharged`, the memory does not depend on how well the full end is known
        cut_off = self.rule.was_low(state.memory) & (sample.dt_s > CURRENT_GAP_S)
        memory, own, own_events = _events(self.rule, state.memory, state.own, clean, cut_off)
        _, known, known_events = _events(self.known_rule, state.memory, state.known, clean, cut_off)
        low = SocNormal(state.memory.low_soc, state.memory.low_std)
        after = FinderState(clean.now.current_A, clean.now.temperature_degC, memory, own, known)
        return after, FinderOutput(after.current_A, before, low, own_events, known_events)


def _events(
    rule: AnchorRule, before: AnchorMemory, open_events: OpenEvents, clean: CleanSocSample, cut_off: Any
) -> tuple[AnchorMemory, OpenEvents, SampleEvents]:
    """Memory and open events after a sample, and its events, to which the condition of a cut-off belongs."""
    memory, event = rule.step(before._replace(discharged=open_events.discharged), clean)
    rest, _ = rule.continue_rest(open_events.rest, clean)
    moved = memory.held_s < before.held_s
    full = where(event.full, 1.0, where(moved, 0.0, open_events.full))
    below_full = where(rule.stops_below_full(memory, clean), 1.0, where(moved, 0.0, open_events.below_full))
    flags = flags_of(
        {
            AnchorFlag.FULL: (open_events.full > 0.5) & moved,
            AnchorFlag.TOP: event.top,
            AnchorFlag.EMPTY: event.empty,
            AnchorFlag.CUT_OFF: cut_off,
            AnchorFlag.REST: (open_events.rest.used > 0.5) & (rest.used < 0.5),
            AnchorFlag.TAPERS: (open_events.below_full < 0.5) & (below_full > 0.5),
            AnchorFlag.BELOW_FULL: (open_events.below_full > 0.5) & moved,
        }
    )
    after = OpenEvents(memory.discharged, rest, full, below_full)
    return memory, after, SampleEvents(flags, SocNormal(event.soc, event.std))
