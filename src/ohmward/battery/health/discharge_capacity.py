"""Capacity of a discharge: what the battery gives from full down to where its discharges have lately ended.

    D = Q (1 - s_low)

Q is the charge down to the empty end of the open-circuit curve; a high current, or a resistance that has grown, ends a
discharge earlier, at s_low. Q and s_low are found together from the same log, and their errors cancel in D: it is known
as well as that charge was counted and as the battery was full before or after it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from ohmward.battery.chemistries import Normal
from ohmward.battery.health.ageing_fit import REVERSIBLE_STD
from ohmward.battery.learning.lesson import Lesson

#: A battery that has been below this SoC is one that is emptied in use.
_EMPTIED_BELOW = 0.25
#: A discharge that gave this share of the one before was not broken off: from one to the next a battery loses less.
_WHOLE = 0.95


class FullDischarge(NamedTuple):
    """The latest discharge that was not broken off, or the charge after it."""

    log: str  #: its name
    soc: float  #: at its end
    given_Ah: Normal  #: charge from full down to there, as the battery's own sensor counts it


class UsedCapacity(NamedTuple):
    """Capacity of a battery as it is used, after a lesson."""

    latest: FullDischarge | None  #: the discharge that shows it; None where the battery was not emptied yet
    capacity_Ah: Normal  #: of a discharge; the whole capacity where nobody has seen where discharges would end


def used_capacities(lessons: Sequence[Lesson]) -> list[UsedCapacity]:
    """Capacity of a discharge after each lesson."""
    found = []
    latest = None
    for lesson in lessons:
        latest = _next(latest, lesson)
        found.append(UsedCapacity(latest, lesson.capacity_Ah if latest is None else _of_next(latest)))
    return found


def _next(latest: FullDischarge | None, lesson: Lesson) -> FullDischarge | None:
    """The latest full discharge after one more lesson."""
    if latest is None:
        whole = lesson.soc_min < _EMPTIED_BELOW
    else:
        whole = lesson.given_Ah.mean >= _WHOLE * latest.given_Ah.mean
    return FullDischarge(lesson.log, max(lesson.soc_min, 0.0), _as_counted(lesson)) if whole else latest


def _as_counted(lesson: Lesson) -> Normal:
    """Charge from full down to the lowest SoC as the sensor counts it, its offset over the log left in.

    A charge and the discharge before it count the offset the other way; what a log turns around cancels.
    """
    turned = (lesson.soc_end.mean - lesson.soc_start.mean) / max(lesson.soc_max - lesson.soc_min, 1e-3)
    return lesson.given_Ah._replace(mean=lesson.given_Ah.mean + turned * lesson.offset_A.mean * lesson.hours)


def _of_next(latest: FullDischarge) -> Normal:
    """Capacity of the discharge that follows: as the latest, but for what comes and goes."""
    given_Ah = latest.given_Ah.mean
    return Normal(given_Ah, math.hypot(latest.given_Ah.std, REVERSIBLE_STD * given_Ah))
