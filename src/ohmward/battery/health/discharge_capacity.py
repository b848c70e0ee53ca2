"""Capacity of a discharge: what the battery gives from full down to where its discharges have lately ended.

    D = Q (1 - s_low)

Q is the charge down to the empty end of the open-circuit curve; a high current, or a resistance that has grown, ends a
discharge earlier, at s_low. Q and s_low are found together from the same charge, and their errors cancel in D: it is
known as well as that charge was counted and as the battery was full before or after it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from ohmward.battery.chemistries import Normal
from ohmward.battery.health.ageing_fit import REVERSIBLE_STD
from ohmward.battery.learning.learn import Lesson

#: A battery that has been below this is one that is emptied in use.
_EMPTIED_BELOW = 0.25
#: Its discharges still end alike where they end at most so much higher than the one before; others were broken off.
_ALIKE = 0.05


class Low(NamedTuple):
    """The end of the latest discharge that was not broken off.

    soc: lowest SoC of its log.
    log: name of that log.
    given_std: relative error of the charge from full down to it.
    """

    soc: float
    log: str
    given_std: float


def next_low(low: Low | None, lesson: Lesson) -> Low | None:
    """The end of discharges after one more lesson; None where the battery was not emptied yet."""
    highest = _EMPTIED_BELOW if low is None else low.soc + _ALIKE
    if not lesson.soc_min < highest:
        return low
    return Low(max(lesson.soc_min, 0.0), lesson.log, lesson.given_Ah.std / lesson.given_Ah.mean)


class UsedCapacity(NamedTuple):
    """Capacity of a battery as it is used, after a lesson.

    low: the end of its latest discharge that was not broken off; None where it was not emptied yet.
    capacity_Ah: of a discharge from full to there, as the battery's own sensor counts it; the whole capacity where
        nobody has seen where its discharges would end.
    """

    low: Low | None
    capacity_Ah: Normal


def used_capacities(lessons: Sequence[Lesson]) -> list[UsedCapacity]:
    """Capacity of a discharge after each lesson."""
    found = []
    low = None
    for lesson in lessons:
        low = next_low(low, lesson)
        found.append(UsedCapacity(low, lesson.capacity_Ah if low is None else _given(lesson, low)))
    return found


def _given(lesson: Lesson, low: Low) -> Normal:
    """D after one lesson, given where discharges end."""
    given_Ah = lesson.capacity_Ah.mean * (1.0 - low.soc)
    return Normal(given_Ah, given_Ah * math.hypot(REVERSIBLE_STD, low.given_std))
