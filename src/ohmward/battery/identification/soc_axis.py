"""State of charge along a record: counted charge, tied to samples of known state of charge.

Two rules find a full charge, as they know different things. Here the curve is what is sought: the highest voltage of
the test is the limit of its charger, which defines full. `soc.anchor_rule` knows a curve, sees one sample after the
other, and judges whether a charger, which may stop lower, came to the full end of that curve.
"""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.chemistries import HysteresisPrior, Normal
from ohmward.battery.identification.fit_samples import hysteresis_by_charge
from ohmward.battery.identification.ocv_from_logs import CAPACITY_WARNING
from ohmward.battery.identification.record import (
    LONGEST_PULSE_S,
    SETTLED_REST_S,
    Record,
    find_rests,
    is_rest,
    settled_ends,
)
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.soc.anchor_rule import LITHIUM_LIMITS, REST_C, SocAnchor
from ohmward.errors import InputError
from ohmward.logs.log import Note

#: Standard deviation of SoC where a constant-voltage charge has tapered, for the charger of this log and no other.
FULL_STD = 0.005
#: Standard deviation of a state of charge given by the tester, in whole per cent.
TEST_START_STD = 0.01
#: A log that moves this share of the capacity was full at its highest charge; bounds of the standard deviation there.
_SWEEP_SHARE = 0.85
_SWEEP_STD = (0.01, 0.03)
#: A log ends empty where its charge at the lowest voltage is within this share of the capacity of its lowest charge.
_AT_THE_END = 0.03
#: A constant voltage: largest relative distance from the log's highest, longest break bridged and shortest length [s].
_TOP_SHARE = 0.02
_TOP_BREAK_S = 600.0
_SHORTEST_TOP_S = 60.0
#: Samples at the end of a taper whose mean current counts, and smallest charge of a taper as a share of the capacity.
_TAPER_SAMPLES = 3
_TAPER_CHARGE = 0.003
#: A rest that follows a full charge within an hour is that of a full battery [s].
_SOON_S = 3600.0
#: Smallest standard deviation of SoC from a rest.
_SMALLEST_REST_STD = 0.005
#: Relative error of an open-circuit voltage at the end of a rest.
_VOLTAGE_STD_SHARE = 0.0015
#: A low-rate gap includes slow overpotential: share of its half that is hysteresis at a rest, and its error. On A123
#: LFP cells it is 0.7 to 0.9; after an hour of rest a Panasonic NCA cell lies on the low-rate discharge itself.
_HYSTERESIS_SHARE, _HYSTERESIS_SHARE_STD = 0.9, 0.25
#: Cut-offs lie within this share of the capacity of the lowest charge: after an earlier one, the battery gave more.
_SAME_CHARGE = 0.01
#: Lowest temperature at which a load that reaches the voltage of empty has emptied the battery [degC].
COLDEST_EMPTY_DEGC = 15.0
#: Losses below this are errors of the current sensor.
_SMALLEST_LOSS = 0.01
#: SoC beyond [0, 1] by more means a wrong capacity.
_MOST_OUTSIDE = 0.1
#: Smallest span of SoC and largest standard deviation of rests that show a capacity.
_CAPACITY_SPAN = 0.5
_CAPACITY_REST_STD = 0.02

#: Reasons of anchors.
_GIVEN, _FULL = "given", "full charge"


class SocAxis(NamedTuple):
    """State of charge along a record."""

    soc: np.ndarray  #: (T,)
    anchors: tuple[SocAnchor, ...]  #: those it is tied to
    efficiency: float  #: share of the charging current that is stored
    notes: tuple[Note, ...]  #: for the user
    left: float = 0.0  #: SoC by the count, beyond the usual, where a load has emptied the battery
    capacity_ratio: float = 1.0  #: charge from full to empty in the log over the given capacity, where they disagree

    @property
    def std(self) -> float:
        """Standard deviation of the axis: that of its anchors, and of a count that leaves [0, 1] or ends before empty.

        A count that is off by x at its end has drifted by x since its anchor, x / sqrt(3) rms along the way.
        """
        off = max(-self.soc.min(), self.soc.max() - 1.0, self.left)
        return float(np.sqrt(np.mean([a.std**2 for a in self.anchors]) + off**2 / 3.0))


def anchor_soc(
    record: Record,
    capacity_Ah: float,
    ocv: OcvCurve | None = None,
    initial_soc: float | None = None,
    efficiency: float = 1.0,
    ocv_axis_std: float = 0.0,
    empty_V: float = 0.0,
    left_per_C: Normal | None = None,
) -> SocAxis:
    """The state of charge along a record, tied to its best anchors.

    In order: the ends of full charges and, before the first of them, `initial_soc` of the user, known to within
    `TEST_START_STD`; the rest at which `ocv` gives the SoC best; a sweep of at least 85 % of the capacity, whose top is
    assumed full.
    The loss between two full charges gives the coulombic efficiency, and any difference left is spread over the charge
    that flowed; without them `efficiency` holds. A count that contradicts the ends of discharges at empty
    (`cut_offs`), or is of more than the capacity, in the cold as well, is tied to empty too: the capacity is wrong, or
    the current, or that changed between samples.
    ocv_axis_std: standard deviation of the SoC axis of `ocv` in the middle.
    empty_V: usual open-circuit voltage of an empty battery of this chemistry; 0 where that is unknown.
    left_per_C: SoC that a load leaves there, for each C of its rate; None where that is unknown.

    Raises:
        InputError: nothing shows the SoC; the SoC leaves [0, 1] by more than 0.1 because the capacity is wrong.
    """
    anchors = axis_anchors(record, capacity_Ah, ocv, initial_soc, ocv_axis_std, empty_V)
    efficiency = _efficiency(record, anchors, efficiency)
    axis = SocAxis(_tied(record, capacity_Ah, anchors, efficiency), anchors, efficiency, ())
    _require_inside(record, axis, capacity_Ah)
    empties = cut_offs(record, capacity_Ah, empty_V, left_per_C) if left_per_C else ()
    if not empties and np.ptp(axis.soc) > 1.0 + CAPACITY_WARNING:
        empties = (SocAnchor(int(np.argmin(axis.soc)), 0.0, _SWEEP_STD[0], "by more than the capacity given"),)
    axis = _ending_empty(record, axis, capacity_Ah, empties)
    notes = axis.notes + _notes(record, axis, capacity_Ah, ocv)
    if initial_soc is not None and abs(initial_soc - axis.soc[0]) > 3.0 * math.hypot(TEST_START_STD, anchors[0].std):
        set_aside = f"starts at {initial_soc:g} as given, but its full charges say {axis.soc[0]:.3f}, which is taken"
        notes += (Note(f"{record.log.name!r}: {set_aside}", "warning"),)
    return axis._replace(notes=notes)


def axis_anchors(
    record: Record,
    capacity_Ah: float,
    ocv: OcvCurve | None,
    initial_soc: float | None,
    ocv_axis_std: float = 0.0,
    empty_V: float = 0.0,
) -> tuple[SocAnchor, ...]:
    """The anchors that the axis is tied to: one, or all ends of full charges and a given start before them."""
    full = full_charges(record, capacity_Ah)
    if initial_soc is not None and not (full and full[0].sample == 0):
        return (SocAnchor(0, initial_soc, TEST_START_STD, _GIVEN), *full)
    if full:
        return full
    known = []
    for rest in rest_anchors(record, ocv, capacity_Ah) if ocv else ():
        known.append(rest._replace(std=float(np.hypot(rest.std, ocv_axis_std * axis_bridge(rest.soc)))))
    known += sweep_anchor(record, capacity_Ah, empty_V)
    if not known:
        divided = "".join(f"{note.text}; " for note in record.charge.notes if note.level == "warning")
        if not divided:
            _require_likely_capacity(record, capacity_Ah)
        moved = float(np.ptp(record.charge.total_Ah)) / capacity_Ah
        raise InputError(
            f"log {record.log.name!r}: its state of charge is unknown (no full charge, no rest at a known "
            f"open-circuit voltage, {moved:.0%} of the capacity moved, less than {_SWEEP_SHARE:.0%}); {divided}"
            f"give it (--initial-soc {shlex.quote(record.log.name + '=0.8')}, initial_soc={{{record.log.name!r}: "
            "0.8}), add a low-rate test of the same battery, or give its open-circuit voltage (--ocv, ocv=)"
        )
    return (min(known, key=lambda a: a.std),)


def axis_bridge(soc: Any) -> Any:
    """Shape along SoC of an error of the axis that is 0 where the battery is full or empty, and 1 in the middle."""
    inside = np.clip(soc, 0.0, 1.0)
    return 2 * np.sqrt(inside * (1 - inside))


def _require_likely_capacity(record: Record, capacity_Ah: float) -> None:
    """Refuse a capacity in mAh: a log that moves a few thousandths of it, but a likely share of a thousandth.

    Raises:
        InputError: the capacity seems to be in mAh.
    """
    moved_Ah = float(np.ptp(record.charge.total_Ah))
    if 1000.0 * moved_Ah > 0.5 * capacity_Ah > 10.0 * moved_Ah:
        raise InputError(
            f"log {record.log.name!r} moves {moved_Ah:.3g} Ah, {moved_Ah / capacity_Ah:.1%} of the capacity given, "
            f"{capacity_Ah:g} Ah; is that in mAh? Then write {capacity_Ah / 1000:g}"
        )


def full_charges(record: Record, capacity_Ah: float) -> tuple[SocAnchor, ...]:
    """Ends of charges with constant voltage: at the highest voltage of the log the current fell below C/20.

    A log that starts at rest at the voltage of the rest after such a charge started full as well.
    """
    tapers = [_end_of_taper(record, first, last, capacity_Ah) for first, last in _tops(record, capacity_Ah)]
    ends = [end for end in tapers if end]
    if ends and _starts_like(record, ends):
        ends = [0, *ends]
    return tuple(SocAnchor(int(end), 1.0, FULL_STD, _FULL) for end in ends)


def rest_anchors(record: Record, ocv: OcvCurve, capacity_Ah: float) -> tuple[SocAnchor, ...]:
    """SoC at the ends of long rests, and of a rest at the start, by the inverse of the open-circuit voltage.

    After a discharge the voltage rests below the mean of both branches, after a charge above it. It errs by 1.5 mV per
    volt and by the error of the hysteresis, which is all of it where its state is unknown.
    """
    degC = record.log.temperature_along(ocv.reference_degC)
    h, known = _hysteresis(record, capacity_Ah)
    found = []
    for _, at in settled_ends(record):
        voltage_V, T, branch = float(record.log.voltage_V[at]), float(degC[at]), _HYSTERESIS_SHARE * float(h[at])
        soc = ocv.soc_at(voltage_V, T, branch)
        hysteresis_std = float(known[at]) * _HYSTERESIS_SHARE_STD + (1 - float(known[at]))
        error_V = hysteresis_std * float(ocv.hysteresis_at(soc)) + _VOLTAGE_STD_SHARE * voltage_V
        low, high = (ocv.soc_at(voltage_V + s * error_V, T, branch) for s in (-1, 1))
        std = max(_SMALLEST_REST_STD, 0.5 * (high - low))
        found.append(SocAnchor(at, soc, std, f"rest at {voltage_V:.4g} V"))
    return tuple(found)


def sweep_anchor(record: Record, capacity_Ah: float, empty_V: float = 0.0) -> tuple[SocAnchor, ...]:
    """Full at the highest charge of a log that moves at least 85 % of the capacity, else nothing.

    The charge that it does not move may be missing at the top or at the bottom: half of it is the standard deviation.
    If a load has drawn the battery below `empty_V` at the end, that rate left no more: it is missing at the bottom.
    """
    total_Ah, voltage_V = record.charge.total_Ah, record.log.voltage_V
    if np.ptp(total_Ah) < _SWEEP_SHARE * capacity_Ah:
        return ()
    lowest = int(np.nanargmin(voltage_V))
    emptied = voltage_V[lowest] < empty_V and total_Ah[lowest] - total_Ah.min() < _AT_THE_END * capacity_Ah
    at_top = 0.0 if emptied else 0.5 * (1 - np.ptp(total_Ah) / capacity_Ah)
    std = float(np.clip(at_top, *_SWEEP_STD))
    return (SocAnchor(int(np.argmax(total_Ah)), 1.0, std, "highest charge of a full sweep"),)


def cut_offs(record: Record, capacity_Ah: float, empty_V: float, left_per_C: Normal) -> tuple[SocAnchor, ...]:
    """SoC at the lowest charge, where a load has drawn a warm battery below `empty_V`: what its rate usually leaves.

    The load is constant, and lasts or ends in a rest: a drive dips below that voltage long before the battery is empty.
    """
    current_A, voltage_V, total_Ah = record.current_A, record.log.voltage_V, record.charge.total_Ah
    warm = record.log.temperature_along(ROOM_DEGC) >= COLDEST_EMPTY_DEGC
    low = warm & (voltage_V < empty_V) & (current_A < 0.0)
    low &= total_Ah - total_Ah.min() < _SAME_CHARGE * capacity_Ah
    before_rests = {rest.first - 1 for rest in find_rests(record.phases, SETTLED_REST_S)}
    constant = [p for p in record.phases if p.kind == "constant" and not voltage_V[max(p.first - 1, 0)] < empty_V]
    ended = [p for p in constant if p.duration_s > LONGEST_PULSE_S or p.last in before_rests]
    loads = [np.arange(p.first, p.last + 1) for p in ended]
    ends = [int(load[low[load]][-1]) for load in loads if low[load].any()]
    found = ((at, -float(current_A[at]) / capacity_Ah, f"cut-off at {voltage_V[at]:.4g} V") for at in ends)
    return tuple(SocAnchor(at, rate * left_per_C.mean, rate * left_per_C.std, text) for at, rate, text in found)


def axis_std(records: Sequence[Record], axes: Sequence[SocAxis]) -> float:
    """Standard deviation of the axes of several records, weighted by the charge that each moves."""
    moved_Ah = [float(np.abs(r.charge.moved_Ah).sum()) for r in records]
    return float(np.sqrt(np.average([a.std**2 for a in axes], weights=moved_Ah)))


def capacity_from_rests(record: Record, axis: SocAxis, ocv: OcvCurve, capacity_Ah: float) -> float | None:
    """Capacity [Ah] for which the counted charge agrees with the open-circuit voltage at the rests.

    None where the rests span less than half of the SoC range, or their voltages give SoC no better than to 2 %.
    """
    rests = [a for a in rest_anchors(record, ocv, capacity_Ah) if a.std < _CAPACITY_REST_STD and 0.0 < a.soc < 1.0]
    by_charge = np.array([axis.soc[a.sample] for a in rests])
    by_voltage = np.array([a.soc for a in rests])
    if len(rests) < 2 or np.ptp(by_voltage) < _CAPACITY_SPAN:
        return None
    return float(capacity_Ah * np.polyfit(by_voltage, by_charge, 1)[0])


def _tops(record: Record, capacity_Ah: float) -> list[tuple[int, int]]:
    """First and last sample of each stay within 2 % of the highest voltage.

    Breaks of up to 10 minutes are bridged, unless the battery was discharged.
    """
    voltage_V, time_s = np.nan_to_num(record.log.voltage_V), record.log.time_s
    at = np.flatnonzero(voltage_V >= (1 - _TOP_SHARE) * voltage_V.max())
    discharged = np.diff(np.cumsum(record.current_A < -REST_C * capacity_Ah)[at]) > 0
    breaks = np.flatnonzero(discharged | (np.diff(time_s[at]) > _TOP_BREAK_S))
    return [(stay[0], stay[-1]) for stay in np.split(at, breaks + 1)]


def _end_of_taper(record: Record, first: int, last: int, capacity_Ah: float) -> int | None:
    """End of a constant-voltage charge whose current has tapered, among the samples first ... last, or None."""
    current_A = record.current_A[first : last + 1]
    charging = np.flatnonzero(current_A > REST_C * capacity_Ah)
    if charging.size < _TAPER_SAMPLES or record.log.time_s[last] - record.log.time_s[first] < _SHORTEST_TOP_S:
        return None
    end_A = float(current_A[charging[-_TAPER_SAMPLES:]].mean())
    charged_Ah = record.charge.moved_Ah[first : last + 1].sum()
    tapered = end_A <= LITHIUM_LIMITS.taper_C * capacity_Ah and current_A.max() >= 2 * end_A
    return int(first + charging[-1]) if tapered and charged_Ah >= _TAPER_CHARGE * capacity_Ah else None


def _starts_like(record: Record, full: Sequence[int]) -> bool:
    """True where the log starts at rest at (or above) the lowest voltage of a rest after a full charge, within 1 %."""
    if not is_rest(record.phases[0]):
        return False
    time_s = record.log.time_s
    full_s = time_s[list(full)]
    voltage_V = record.log.voltage_V
    for rest in find_rests(record.phases, SETTLED_REST_S):
        since_s = time_s[rest.first] - full_s
        soon = np.any((since_s > 0) & (since_s < _SOON_S))
        if soon and voltage_V[0] >= (1 - 0.5 * _TOP_SHARE) * voltage_V[rest.last]:
            return True
    return False


def _hysteresis(record: Record, capacity_Ah: float) -> tuple[np.ndarray, np.ndarray]:
    """Hysteresis state (T,) in [-1, 1] by the charge that flowed, and the share of it that is known."""
    moved_Ah = record.charge.moved_Ah
    per_Ah = np.full(moved_Ah.size, HysteresisPrior().rate / capacity_Ah)
    states = hysteresis_by_charge(moved_Ah, per_Ah, (-1.0, 0.0, 1.0))
    unknown = 0.0 if record.came_from else 0.5 * (states[:, 2] - states[:, 0])
    return states[:, 1 + record.came_from], 1.0 - unknown * np.ones(moved_Ah.size)


def _efficiency(record: Record, anchors: Sequence[SocAnchor], otherwise: float) -> float:
    """Charge that came out over charge that went in between the first and the last full charge; 1 above 0.99."""
    full = [a.sample for a in anchors if a.reason == _FULL]
    if len(full) < 2:
        return otherwise
    moved_Ah = record.charge.moved_Ah[full[0] + 1 : full[-1] + 1]
    into_Ah = moved_Ah[moved_Ah > 0].sum()
    out_of_Ah = -moved_Ah[moved_Ah < 0].sum()
    efficiency = out_of_Ah / into_Ah if into_Ah > 0 else 1.0
    return float(efficiency) if 0.5 <= efficiency < 1 - _SMALLEST_LOSS else 1.0


def _tied(record: Record, capacity_Ah: float, anchors: Sequence[SocAnchor], efficiency: float) -> np.ndarray:
    """Counted SoC, corrected so that it passes the anchors; between them in proportion to the charge that flowed."""
    moved_Ah = record.charge.moved_Ah
    counted = np.cumsum(np.where(moved_Ah > 0, efficiency * moved_Ah, moved_Ah)) / capacity_Ah
    at = [a.sample for a in anchors]
    flowed = np.cumsum(np.abs(moved_Ah))
    return counted + np.interp(flowed, flowed[at], [a.soc - counted[a.sample] for a in anchors])


def _ending_empty(record: Record, axis: SocAxis, capacity_Ah: float, empties: Sequence[SocAnchor]) -> SocAxis:
    """The axis, tied to the cut-offs that its count clearly contradicts as well."""
    first = axis.anchors[0]
    off = {a: float(axis.soc[a.sample]) - a.soc for a in empties}
    # from full the count ends no higher where full was not reached
    start_std = {a: 0.0 if off[a] < 0.0 and first.soc == 1.0 else first.std for a in empties}
    wrong = [a for a in empties if abs(off[a]) > max(CAPACITY_WARNING, 2.0 * math.hypot(a.std, start_std[a]))]
    left = max([0.0, *off.values()])
    if not wrong and left <= CAPACITY_WARNING:
        return axis._replace(left=left)
    last = wrong[-1] if wrong else max(empties, key=lambda a: off[a])
    ratio = (first.soc - axis.soc[last.sample]) / (first.soc - last.soc) if first.soc > _CAPACITY_SPAN else 1.0
    usual = f"{last.soc:.3f} ± {2 * last.std:.3f} is usual at that rate, and nothing is wrong if it leaves as much"
    done = f"it was tied to {last.soc:.3f} there" if wrong else usual
    text = (
        f"{record.log.name!r}: the count is at SoC {axis.soc[last.sample]:.3f} where a load has emptied the battery "
        f"({last.reason}); {done}. Is {ratio * capacity_Ah:.4g} Ah the capacity that estimators should use, not "
        f"{capacity_Ah:g} Ah? Or does the current err, or change between its samples?"
    )
    note = Note(text, "warning")
    if not wrong:
        return axis._replace(left=left, notes=(note,))
    anchors = tuple(sorted({a.sample: a for a in (*wrong, *axis.anchors)}.values()))
    soc = _tied(record, capacity_Ah, anchors, axis.efficiency)
    return axis._replace(soc=soc, anchors=anchors, notes=(note,), capacity_ratio=float(ratio))


def _require_inside(record: Record, axis: SocAxis, capacity_Ah: float) -> None:
    soc, first = axis.soc, axis.anchors[0]
    if max(-soc.min(), soc.max() - 1.0) > _MOST_OUTSIDE:
        start = f"{first.soc:.2f} at t = {record.log.time_s[first.sample]:g} s ({first.reason})"
        raise InputError(
            f"log {record.log.name!r}: with a capacity of {capacity_Ah:g} Ah its state of charge would run from "
            f"{soc.min():.2f} to {soc.max():.2f}; it moves {np.ptp(record.charge.total_Ah):.4g} Ah and is tied to "
            f"{start}; correct what is wrong: capacity_Ah, initial_soc or ocv"
        )


def _notes(record: Record, axis: SocAxis, capacity_Ah: float, ocv: OcvCurve | None) -> tuple[Note, ...]:
    name, first = record.log.name, axis.anchors[0]
    reasons = Counter(a.reason for a in axis.anchors)
    tied = ", ".join(reason if n == 1 else f"{n} {reason}s" for reason, n in reasons.items())
    tied += f", ± {2 * first.std:.1%}" if len(axis.anchors) == 1 else ""
    notes = [
        Note(
            f"{name!r}: SoC starts at {axis.soc[0]:.3f} and runs from {axis.soc.min():.3f} to "
            f"{axis.soc.max():.3f} ({tied})"
        )
    ]
    if axis.efficiency < 1:
        notes.append(Note(f"{name!r}: {axis.efficiency:.1%} of the charging current is stored"))
    seen_Ah = capacity_from_rests(record, axis, ocv, capacity_Ah) if ocv else None
    if seen_Ah and abs(seen_Ah / capacity_Ah - 1) > CAPACITY_WARNING:
        notes.append(
            Note(
                f"{name!r}: its rest voltages and its charge agree for a capacity of {seen_Ah:.4g} Ah, "
                f"not for the given {capacity_Ah:g} Ah",
                "warning",
            )
        )
    return tuple(notes)
