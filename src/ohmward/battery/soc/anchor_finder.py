"""Step along a log that finds the events which anchor the state of charge; traceable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.anchor_rule import AnchorMemory, AnchorRule, SocNormal
from ohmward.battery.soc.clean_sample import CURRENT_GAP_S, Rest, first_input, sample_limits, sanitize
from ohmward.battery.soc.sample import SocSample
from ohmward.trace import where


class FinderState(NamedTuple):
    """Last credible current and temperature, the memory of the rule, and the present rest, if any."""

    current_A: Any
    temperature_degC: Any
    memory: AnchorMemory
    rest: Rest
    #: 1 from a full charge, or from one that tapers below full, on, for as long as the voltage stands still
    full: Any = 0.0
    below_full: Any = 0.0


class FinderOutput(NamedTuple):
    """Output at a sample; conditions are 1 and 0."""

    current_A: Any  #: last credible current
    #: conditions that the sample completes a cut-off, or reaches the end of a flat curve, and the SoC of either
    empty: Any
    top: Any
    event: SocNormal
    #: condition that a charge tapers below the voltage of a full battery from here on
    tapers: Any
    #: conditions that such a charge, a full charge, a long rest, or a load that is cut off here ended with the sample
    #: before
    below_full: Any
    full: Any
    rest: Any
    cut_off: Any
    #: of the sample before: last credible current and temperature, and state of charge of a cut-off
    before: CircuitInput
    low: SocNormal


@dataclass(frozen=True)
class AnchorFinder:
    """Settings; `init` and `step` are pure functions of them. It reaches no code that reads logs or estimates."""

    rule: AnchorRule

    def init(self, first: SocSample) -> FinderState:
        """State before the first sample."""
        u = first_input(first, sample_limits(self.rule.model).current_A)
        return FinderState(u.current_A, u.temperature_degC, AnchorMemory(), Rest())

    def step(self, state: FinderState, sample: SocSample) -> tuple[FinderState, FinderOutput]:
        """State and output after a sample."""
        rule = self.rule
        before = CircuitInput(state.current_A, state.temperature_degC)
        clean = sanitize(sample, before, sample_limits(rule.model))
        memory, event = rule.step(state.memory, clean)
        rest, _ = rule.continue_rest(state.rest, clean)
        moved = memory.held_s < state.memory.held_s
        full = where(event.full, 1.0, where(moved, 0.0, state.full))
        below_full = where(rule.stops_below_full(memory, clean), 1.0, where(moved, 0.0, state.below_full))
        after = FinderState(clean.now.current_A, clean.now.temperature_degC, memory, rest, full, below_full)
        output = FinderOutput(
            current_A=after.current_A,
            empty=where(event.empty, 1.0, 0.0),
            top=where(event.top, 1.0, 0.0),
            event=SocNormal(event.soc, event.std),
            tapers=where((state.below_full < 0.5) & (below_full > 0.5), 1.0, 0.0),
            below_full=where((state.below_full > 0.5) & moved, 1.0, 0.0),
            full=where((state.full > 0.5) & moved, 1.0, 0.0),
            rest=where((state.rest.used > 0.5) & (rest.used < 0.5), 1.0, 0.0),
            cut_off=where(rule.was_low(state.memory) & (sample.dt_s > CURRENT_GAP_S), 1.0, 0.0),
            before=before,
            low=SocNormal(state.memory.low_soc, state.memory.low_std),
        )
        return after, output
