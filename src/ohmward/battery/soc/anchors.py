"""Anchors in a log: full charges, cut-offs under load and long rests, each with the state of charge that it implies."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.anchor_finder import AnchorFinder, FinderOutput
from ohmward.battery.soc.anchor_rule import AGAIN, AnchorRule, SocNormal
from ohmward.battery.soc.estimator import SocRun, samples_of
from ohmward.battery.soc.sample import NO_SAMPLE, SocFlag, SocSample
from ohmward.filters.estimator import row_of
from ohmward.logs.log import Log
from ohmward.trace import Kernel

AnchorKind = Literal["full charge", "nearly full", "empty", "rest"]

#: Source of an anchor that no column reports.
VOLTAGE = "voltage"

#: Samples of a log whose output is in memory at the same time.
_STRETCH = 1 << 15


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


def find_anchors(log: Log, battery: Battery) -> tuple[Anchor, ...]:
    """The anchors in a log, in order, each event once."""
    return anchors_and_limit(log, battery)[0]


def anchors_and_limit(log: Log, battery: Battery) -> tuple[tuple[Anchor, ...], float | None]:
    """The anchors in a log, and the highest voltage [V], without overpotential, at which a charger stops below full.

    The rule is that of the live estimator (`AnchorRule`), but a log shows what follows: a full charge and a rest are
    placed at their end, where they say most, and a load that is low at the end of the log or before a gap was cut off.
    None for a log in which no charger stops below full, or one comes to full.
    """
    rule = rule_of(battery)
    found: list[Anchor] = []
    tapers: list[int] = []
    limits_V: list[float] = []
    current_A = np.empty(len(log))
    for first, output in _outputs(log, rule):
        current_A[first : first + _STRETCH] = output.current_A[: len(log) - first]
        found += _anchors_inside(log, first, rule, output)
        tapers += (first + np.flatnonzero(output.tapers)).tolist()
        for k in np.flatnonzero(output.below_full).tolist():
            middle_V = float(np.nanmedian(log.voltage_V[tapers.pop(0) : first + k]))
            limits_V.append(float(rule.relaxed_V(middle_V, row_of(output.before, k))))
    is_full = any(anchor.kind == "full charge" for anchor in found)
    declared = SocNormal(1.0, rule.limits.full_std)
    found += [_anchor("full charge", k, declared, log, name) for name, k in log.full_charges()]
    found.sort(key=lambda anchor: anchor.sample)
    anchors = tuple(_without_repeats(found, log.time_s, current_A, AGAIN * rule.model.capacity_As))
    return anchors, None if is_full else max(limits_V, default=None)


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


def with_known_full(battery: Battery) -> Battery:
    """The battery that is full at the full end of its curve."""
    known = replace(battery, noise=replace(battery.noise, full_soc_std=0.0))
    return known if battery.noise.full_soc_std else battery


def rule_of(battery: Battery) -> AnchorRule:
    """Rule for the events of a battery."""
    return AnchorRule(battery.thevenin, battery.noise, battery.sensor)


def _outputs(log: Log, rule: AnchorRule) -> Iterator[tuple[int, FinderOutput]]:
    """First sample and output of each stretch of a log; the last one is of a sample after its end, without a value."""
    finder = AnchorFinder(rule)
    kernel = Kernel(finder.step, finder.init(NO_SAMPLE), NO_SAMPLE)
    columns = samples_of(log)
    state = finder.init(row_of(columns, 0))
    for first in range(0, len(log), _STRETCH):
        state, output = kernel.scan(state, SocSample(*(column[first : first + _STRETCH] for column in columns)))
        yield first, output
    _, output = kernel.scan(state, NO_SAMPLE._replace(dt_s=np.array([math.inf])))
    yield len(log), output


def _anchors_inside(log: Log, first: int, rule: AnchorRule, output: FinderOutput) -> Iterator[Anchor]:
    """The anchors that current and voltage show in a stretch of a log from a sample on."""

    def before(k: int) -> tuple[int, float, CircuitInput]:
        last = first + k - 1
        return last, float(log.voltage_V[last]), row_of(output.before, k)

    for k in np.flatnonzero(output.full).tolist():
        last, voltage_V, u = before(k)
        yield _anchor("full charge", last, rule.full(voltage_V, u), log)
    for k in np.flatnonzero(output.top).tolist():
        yield _anchor("nearly full", first + k, row_of(output.event, k), log)
    for k in np.flatnonzero(output.empty).tolist():
        yield _anchor("empty", first + k, row_of(output.event, k), log)
    for k in np.flatnonzero(output.cut_off).tolist():
        yield _anchor("empty", first + k - 1, row_of(output.low, k), log)
    for k in np.flatnonzero(output.rest).tolist():
        last, voltage_V, u = before(k)
        yield _anchor("rest", last, rule.at_rest(voltage_V, u), log)


def _without_repeats(
    anchors: Sequence[Anchor], time_s: np.ndarray, current_A: np.ndarray, apart_As: float
) -> Iterator[Anchor]:
    """The anchors, only one for each charge or cut-off: between two of a kind, charge flows the other way.

    time_s, current_A: (T,); apart_As: least charge that has to flow the other way.
    """
    ways = {"full charge": -1.0, "nearly full": -1.0, "empty": 1.0}
    last: dict[str, int] = {}
    for anchor in anchors:
        kind, k = anchor.kind, anchor.sample
        if kind in ways and kind in last:
            between = slice(last[kind], k + 1)
            moved_As = ways[kind] * current_A[between][1:] * np.diff(time_s[between])
            if np.maximum(moved_As, 0.0).sum() < apart_As:
                continue
        last[kind] = k
        yield anchor


def _anchor(kind: AnchorKind, k: int, soc: SocNormal, log: Log, source: str = VOLTAGE) -> Anchor:
    degC = math.nan if log.temperature_degC is None else float(log.temperature_degC[k])
    measured = float(log.voltage_V[k]), float(log.current_A[k]), degC
    return Anchor(kind, float(log.time_s[k]), k, *soc, *measured, source)
