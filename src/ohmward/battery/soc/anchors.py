"""Anchors in a log: full charges, cut-offs under load and long rests, each with the state of charge that it implies."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.soc.anchor_finder import AnchorFinder, AnchorFlag, FinderOutput, SampleEvents
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
_STRETCH = 1 << 16


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


class LogAnchors(NamedTuple):
    """Anchors in a log, in order, each event once, and where a charger in it stops."""

    anchors: tuple[Anchor, ...]
    #: highest voltage [V], without overpotential, at which a charger stops below full; None where none does, or one
    #: comes to full
    limit_V: float | None


def find_anchors(log: Log, battery: Battery) -> tuple[Anchor, ...]:
    """The anchors in a log, in order, each event once."""
    return scan_anchors(log, battery)[0].anchors


def scan_anchors(log: Log, battery: Battery) -> tuple[LogAnchors, LogAnchors]:
    """The anchors in a log by a battery, and by the same battery when it is full at the full end of its curve.

    The rule is that of the live estimator (`AnchorRule`), but a log shows what follows: a full charge and a rest are
    placed at their end, where they say most, and a load that is low at the end of the log or before a gap was cut off.
    """
    finder = AnchorFinder(rule_of(battery), rule_of(with_known_full(battery)))
    current_A = np.empty(len(log))
    events: list[tuple[int, FinderOutput]] = []
    for first, output in _outputs(log, finder):
        current_A[first : first + _STRETCH] = output.current_A[: len(log) - first]
        rows = np.flatnonzero((output.own.flags > 0.0) | (output.known.flags > 0.0))
        events += [(first + k, row_of(output, k)) for k in rows.tolist()]
    own = [(k, output, output.own) for k, output in events]
    known = [(k, output, output.known) for k, output in events]
    return _log_anchors(log, finder.rule, own, current_A), _log_anchors(log, finder.known_rule, known, current_A)


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


def judged_anchors(anchors: Sequence[Anchor], run: SocRun) -> list[JudgedAnchor]:
    """The anchors in a log, each with the estimate before it."""
    used = np.flatnonzero(run.flags & SocFlag.ANCHORED)
    before, found = -1, []
    for anchor in anchors:
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


def _outputs(log: Log, finder: AnchorFinder) -> Iterator[tuple[int, FinderOutput]]:
    """First sample and output of each stretch of a log; the last one is of a sample after its end, without a value."""
    kernel = Kernel(finder.step, finder.init(NO_SAMPLE), NO_SAMPLE)
    columns = samples_of(log)
    state = finder.init(row_of(columns, 0))
    for first in range(0, len(log), _STRETCH):
        state, output = kernel.scan(state, SocSample(*(column[first : first + _STRETCH] for column in columns)))
        yield first, output
    _, output = kernel.scan(state, NO_SAMPLE._replace(dt_s=np.array([math.inf])))
    yield len(log), output


def _log_anchors(
    log: Log, rule: AnchorRule, events: Sequence[tuple[int, FinderOutput, SampleEvents]], current_A: np.ndarray
) -> LogAnchors:
    """The anchors by a rule, from the rows of a log that show an event by it, and where its charger stops.

    current_A: (T,) last credible current.
    """
    found: list[Anchor] = []
    tapers: list[int] = []
    limits_V: list[float] = []
    for k, output, here in events:
        found += _anchors_at(k, output, here, rule, log)
        if int(here.flags) & AnchorFlag.TAPERS:
            tapers.append(k)
        if int(here.flags) & AnchorFlag.BELOW_FULL:
            middle_V = float(np.nanmedian(log.voltage_V[tapers.pop(0) : k]))
            limits_V.append(float(rule.relaxed_V(middle_V, output.before)))
    is_full = any(anchor.kind == "full charge" for anchor in found)
    declared = SocNormal(1.0, rule.limits.full_std)
    found += [_anchor("full charge", k, declared, log, name) for name, k in log.full_charges()]
    found.sort(key=lambda anchor: anchor.sample)
    anchors = tuple(_without_repeats(found, log.time_s, current_A, AGAIN * rule.model.capacity_As))
    return LogAnchors(anchors, None if is_full else max(limits_V, default=None))


def _anchors_at(k: int, output: FinderOutput, events: SampleEvents, rule: AnchorRule, log: Log) -> Iterator[Anchor]:
    """The anchors that current and voltage show at the sample k of a log, which may be the one after its end."""
    flags, last = int(events.flags), k - 1
    last_V = float(log.voltage_V[last])
    if flags & AnchorFlag.FULL:
        yield _anchor("full charge", last, rule.full(last_V, output.before), log)
    if flags & AnchorFlag.TOP:
        yield _anchor("nearly full", k, events.soc, log)
    if flags & AnchorFlag.EMPTY:
        yield _anchor("empty", k, events.soc, log)
    if flags & AnchorFlag.CUT_OFF:
        yield _anchor("empty", last, output.low, log)
    if flags & AnchorFlag.REST:
        yield _anchor("rest", last, rule.at_rest(last_V, output.before), log)


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
