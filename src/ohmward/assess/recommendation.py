"""The method for a chemistry, a sensor and a processor, chosen from the figures by rules that are stated here.

Of the methods whose step the processor can hold, the one with the smallest RMSE in the worst condition of the
situation, among those whose band covers the truth there; where none covers, the smallest RMSE, and it is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.assess.cell import CellFigures
from ohmward.assess.lives import CHEMISTRIES

#: A 95 % band that covers at least this share in every condition of the situation can be trusted.
COVERS = 0.85


class Situation(NamedTuple):
    """Conditions that a designer meets together, by their factors."""

    name: str
    factors: tuple[str, ...]


class Processor(NamedTuple):
    """A class of processors, by the operations of a step that it holds."""

    name: str
    operations: float


_SENSOR = ("base", "current noise", "voltage noise", "voltage converter", "lost samples")
SITUATIONS = (
    Situation("laboratory", ("laboratory",)),
    Situation("everyday sensors, noisy or coarse", _SENSOR),
    Situation("the start is wrong or not known", ("start",)),
    Situation("current sensor with offset and gain", ("current offset", "current gain")),
    Situation("samples seldom or out of step", ("interval", "voltage late")),
    Situation("cold or hot", ("temperature",)),
    Situation("less capacity than told, aged", ("capacity less", "age")),
)
#: 2 KB of code hold about 350 operations in single precision, 16 KB about 2,500; see docs/export.md.
PROCESSORS = (
    Processor("2 KB of flash", 350.0),
    Processor("16 KB of flash", 2500.0),
    Processor("computer", np.inf),
)


class Recommendation(NamedTuple):
    """A row of the table: the method, its RMSE in the worst condition, and the least that its band covers."""

    chemistry: str
    situation: str
    processor: str
    method: str
    worst_rmse: float
    least_covered: float

    @property
    def trusted(self) -> bool:
        """True where the band can be trusted."""
        return self.least_covered >= COVERS


def recommend(found: Sequence[CellFigures]) -> list[Recommendation]:
    """A row for each chemistry, situation and processor of which there are figures."""
    rows = []
    for chemistry in CHEMISTRIES:
        for situation in SITUATIONS:
            here = [f for f in found if f.chemistry == chemistry and f.condition.split(": ")[0] in situation.factors]
            for processor in PROCESSORS:
                fitting = [f for f in here if f.operations <= processor.operations]
                judged = [
                    _judged(chemistry, situation, processor, [f for f in fitting if f.method == method])
                    for method in dict.fromkeys(f.method for f in fitting)
                ]
                if judged:
                    rows.append(min(judged, key=lambda row: (not row.trusted, row.worst_rmse)))
    return rows


def _judged(chemistry: str, situation: Situation, processor: Processor, of: Sequence[CellFigures]) -> Recommendation:
    """A method over the conditions of a situation; without a number or a band it is the worst there can be."""
    rmse = np.nan_to_num([f.rmse for f in of], nan=np.inf)
    covered = np.nan_to_num([f.covered for f in of], nan=0.0)
    return Recommendation(
        chemistry, situation.name, processor.name, of[0].method, float(rmse.max()), float(covered.min())
    )
