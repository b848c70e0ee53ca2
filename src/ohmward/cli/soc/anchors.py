"""Anchors of a log in `ohmward soc`, for programs and for people: what each tells, and what was estimated there."""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.battery.soc.anchors import find_anchors
from ohmward.battery.soc.estimator import SocRun
from ohmward.cli import wording
from ohmward.cli.battery_inputs import SocTask
from ohmward.filters.consistency import BAND_95

TITLE = "Events that tell the state of charge"
HEADER = ("Event", "After", "Told by", "It tells", "Estimate before it")
#: Kinds that a filter may use.
_USABLE = ("full charge", "empty")


def anchor_list(task: SocTask, answer: SocRun) -> list[dict[str, Any]]:
    """The list `anchors` of --json; nothing for a battery file without a Thevenin model.

    The estimate is that before the event, or before the filter used it: it sees a full charge while it tapers.
    """
    if task.battery.thevenin is None:
        return []
    used = np.flatnonzero(answer.flags.astype(np.int32) & np.int32(answer.flag_type["ANCHORED"]))
    before = -1
    found = []
    for anchor in find_anchors(task.log, task.battery):
        seen = used[(used > before) & (used <= anchor.sample)] if anchor.kind in _USABLE else used[:0]
        k = max(int(seen[-1] if seen.size else anchor.sample) - 1, 0)
        found.append(
            anchor._asdict()
            | {"soc": float(anchor.soc), "soc_std": float(anchor.soc_std), "used": bool(seen.size)}
            | {"soc_estimated": float(answer.soc[k]), "soc_std_estimated": float(answer.soc_std[k])}
        )
        before = anchor.sample
    return found


def anchor_rows(figures: dict[str, Any]) -> list[list[str]]:
    """Event, its time, what tells it, its state of charge and the one that was estimated."""
    return [
        [
            anchor["kind"],
            wording.duration(anchor["time_s"]),
            anchor["told_by"] + (", used" if anchor["used"] else ""),
            _band(anchor["soc"], anchor["soc_std"]),
            _band(anchor["soc_estimated"], anchor["soc_std_estimated"]),
        ]
        for anchor in figures["anchors"]
    ]


def anchor_text(figures: dict[str, Any]) -> str:
    """The same as lines of text; nothing without an anchor."""
    lines = [
        f"{kind} after {after} ({by}): {tells}, estimated {estimated}"
        for kind, after, by, tells, estimated in anchor_rows(figures)
    ]
    return wording.bullets(TITLE, lines)


def _band(soc: float, std: float) -> str:
    return f"{wording.percent(soc, 1)} ± {wording.percent(BAND_95 * std, 1)}"
