"""Continuation of the estimators after a restart or a loss of power.

In a short absence only time has passed. In a long one the RC voltages decay and the charge becomes less certain,

std^2 = std_before^2 + (I t / Q)^2 + (c t)^2

where the robot may have gone on for a while with its last current I, and electronics that are off draw a share c of the
capacity. The filter keeps its estimate of the curve errors and their correlation with the charge: the first voltage
after the absence has the same error as the last one before it, so that restarts add no information. A filter of
another battery file or version starts afresh, no more certain than the better of that charge and that voltage. If the
voltage contradicts the charge, somebody has charged or used the battery, and the voltage alone counts. After hours that
is as likely as not: the estimator then restarts by itself, as after any gap in which the current is unknown.
Speed and pose restart: the robot may have been moved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypedDict

from ohmward.battery.cells.pack_estimator import PackEstimator
from ohmward.battery.soc.anchor_rule import SocNormal
from ohmward.battery.soc.clean_sample import CURRENT_GAP_S
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.gaussian_sum import carries_errors
from ohmward.battery.soc.given_soc import STANDBY_PER_HOUR, after_absence
from ohmward.checks import require_between, require_positive
from ohmward.energy.range_estimator import RangeEstimator
from ohmward.errors import InputError
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.robot_state import totals_from
from ohmward.quantities import DAY_S, QUANTITIES, SECONDS_PER_HOUR
from ohmward.trace.snapshot import to_json, typed

#: Longest absence in which the current is assumed to have stayed the same: a crashed process, a rebooting computer.
SHORT_ABSENCE_S = 60.0

#: Absence assumed if no clock measured it: a day.
UNKNOWN_S = DAY_S

#: Step that the filter treats as a gap, after which it forgets the charge, as anything may have happened in it.
_GAP_S = CURRENT_GAP_S + 1.0

#: Longest time that a robot goes on with its last current before it is switched off.
_STILL_ON_S = 600.0

#: Longest interruption of a drive; after a longer one a new drive begins with the consumption learnt so far.
DRIVE_S = 3600.0

#: Largest factor between labelled and learnt capacity: a battery that has lost more was worn out long before.
_MOST_LEARNT = 2.0

#: Largest time that any clock counts: some 300 years [s].
_MOST_S = 1e10


def remember(estimation: Estimation, time_s: float) -> dict[str, Any]:
    """State of the estimators for a snapshot; empty before the first sample.

    time_s: now, on the clock of the messages.
    """
    content: dict[str, Any] = {}
    soc, charge = estimation.soc, estimation.state.battery
    if estimation.battery and soc and charge and soc.state is not None:
        current_A = to_json(estimation.last_current_A)
        content["charge"] = {"soc": charge.soc, "std": charge.soc_std, "current_A": current_A}
        content["battery"] = {name: getattr(estimation.battery, name) for name in _Label.__annotations__}
        content |= {"soc": soc.snapshot(), "time_s": time_s + estimation.shift_s}
        content["cells_lost"] = estimation.cell_loss.lost if estimation.cell_loss else 0
    if estimation.cells and estimation.cells.last:
        content["cells"] = estimation.cells.snapshot()
    if estimation.range and math.isfinite(estimation.range.time_s):
        content["range"] = estimation.range.snapshot()
    if any(estimation.totals) and (content or estimation.battery is None):  # keep an earlier charge
        content["totals"] = estimation.totals._asdict()
    return content


def resume(estimation: Estimation, content: Mapping[str, Any], away_s: float, now_s: float) -> list[str]:
    """Continue the estimators from a snapshot; returns sentences about what could not be continued.

    away_s: time since it was taken, nan if unknown.  now_s: now, on the clock of the messages.
    """
    if isinstance(totals := content.get("totals"), Mapping):
        estimation.totals = totals_from(totals)
    if "soc" not in content or estimation.battery is None:
        return []
    away_s = UNKNOWN_S if math.isnan(away_s) else away_s
    try:
        charge, label, lost = _charge_of(content)
    except InputError as error:
        return [f"the snapshot cannot be used: {error}"]
    growth = label["capacity_Ah"] / estimation.battery.capacity_Ah
    if not 1.0 / _MOST_LEARNT <= growth <= _MOST_LEARNT or label["n_series"] != estimation.battery.n_series:
        return ["the battery file is of another battery than before: its charge starts afresh"]
    moved_std = _moved_std(charge, estimation.battery.capacity_Ah, away_s)
    known = SocNormal(charge["soc"], math.hypot(charge["std"], moved_std))
    try:
        estimation.soc = SocEstimator.restore(estimation.battery, content["soc"], lowering=estimation.lowering)
    except InputError:
        estimation.absence = away_s, known
        return ["another battery file or version of ohmward: the charge goes on, the rest of the filter starts afresh"]
    if estimation.cell_loss and away_s <= SHORT_ABSENCE_S:  # in a longer one the pack may have been repaired
        estimation.cell_loss.lost = lost
    passed_s = away_s if away_s <= SHORT_ABSENCE_S else max(away_s, _GAP_S)
    soc = estimation.soc
    if SHORT_ABSENCE_S < away_s <= soc.known_gap_s and carries_errors(soc.settings):
        soc.state = after_absence(soc.settings, soc.state, away_s, moved_std)
        soc.time_s += passed_s
        estimation.absence = away_s, known
    estimation.shift_s = content["time_s"] + passed_s - now_s
    return [*_resume_cells(estimation, content), *_resume_range(estimation, content, away_s)]


class _Charge(TypedDict):
    """Charge in a snapshot, its standard deviation, and the last current, None before the first."""

    soc: float
    std: float
    current_A: float | None


class _Label(TypedDict):
    """Label of the battery in a snapshot: what nobody corrects later, unlike the chemistry."""

    capacity_Ah: float
    n_series: float


def _charge_of(content: Mapping[str, Any]) -> tuple[_Charge, _Label, int]:
    """Charge, label and number of lost cells of a snapshot; raise InputError for another type or one out of range."""
    charge: _Charge = typed(_Charge, "charge", content.get("charge"))
    label: _Label = typed(_Label, "battery", content.get("battery"))
    current = QUANTITIES["battery_current_A"]
    require_between("charge.soc", charge["soc"], -0.5, 1.5)
    require_between("charge.std", charge["std"], 0.0, 10.0)
    require_between("charge.current_A", charge["current_A"] or 0.0, *current.limits)
    require_positive("battery.capacity_Ah", label["capacity_Ah"])
    require_between("time_s", typed(float, "time_s", content.get("time_s")), -_MOST_S, _MOST_S)
    lost: int = typed(int, "cells_lost", content.get("cells_lost", 0))
    require_between("cells_lost", lost, 0, label["n_series"] - 1)
    return charge, label, lost


def _moved_std(charge: _Charge, capacity_Ah: float, away_s: float) -> float:
    """Standard deviation of the change of the charge in the absence; see the equation at the head."""
    drawn = abs(charge["current_A"] or 0.0) * min(away_s, _STILL_ON_S) / SECONDS_PER_HOUR / capacity_Ah
    standby = STANDBY_PER_HOUR * away_s / SECONDS_PER_HOUR
    return math.hypot(drawn, standby)


def _resume_cells(estimation: Estimation, content: Mapping[str, Any]) -> list[str]:
    if "cells" not in content or estimation.battery is None:
        return []
    try:
        estimation.cells = PackEstimator.restore(estimation.battery, content["cells"], lowering=estimation.lowering)
    except InputError as error:
        return [f"the estimate of the cells starts afresh: {error}"]
    return []


def _resume_range(estimation: Estimation, content: Mapping[str, Any], away_s: float) -> list[str]:
    """Continue the drive after a short interruption; otherwise begin a new one with the learnt consumption."""
    if "range" not in content or estimation.range is None or estimation.battery is None:
        return []
    cutoff_V = estimation.range.settings.cutoff_V
    try:
        before = RangeEstimator.restore(estimation.battery, content["range"], cutoff_V=cutoff_V)
    except InputError:
        return ["the previous drive cannot be continued: battery or settings have changed; a new one starts"]
    if away_s <= DRIVE_S:
        estimation.range = before
    else:
        estimation.range = RangeEstimator(estimation.battery, before.consumption, away_s / DAY_S, cutoff_V=cutoff_V)
    return []
