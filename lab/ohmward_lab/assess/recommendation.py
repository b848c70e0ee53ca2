"""The method for a subject, its conditions and a processor, chosen from the figures by rules that are stated here.

Of the methods whose step the processor can hold, the one with the smallest RMSE in the worst condition of the
situation, among those whose band covers the truth there; where none covers, the smallest RMSE, and it is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

#: A 95 % band that covers at least this share in every condition of the situation can be trusted.
COVERS = 0.85


class MethodFigures(Protocol):
    """Figures of a method under a condition, as far as the rules need them."""

    @property
    def subject(self) -> str:
        """Chemistry, or robot."""
        ...

    @property
    def condition(self) -> str:
        """Its name."""
        ...

    @property
    def method(self) -> str:
        """Its name."""
        ...

    @property
    def rmse(self) -> float:
        """Of the charge, or of the speed [m/s]."""
        ...

    @property
    def covered(self) -> float:
        """Share of the samples with the truth in the 95 % band."""
        ...

    @property
    def operations(self) -> int:
        """In a step."""
        ...


class Situation(NamedTuple):
    """Conditions that a designer meets together, by their factors."""

    name: str
    factors: tuple[str, ...]


class Processor(NamedTuple):
    """A class of processors, by the operations of a step that it holds."""

    name: str
    operations: float


class Recommendation(NamedTuple):
    """A row of the table: the method, its RMSE in the worst condition, and the least that its band covers, or nan."""

    subject: str
    situation: str
    processor: str
    method: str
    worst_rmse: float
    least_covered: float

    @property
    def trusted(self) -> bool:
        """True where the band can be trusted."""
        return self.least_covered >= COVERS


def recommend(
    found: Sequence[MethodFigures], situations: Sequence[Situation], processors: Sequence[Processor]
) -> list[Recommendation]:
    """A row for each subject, situation and processor of which there are figures."""
    rows = []
    for subject in dict.fromkeys(f.subject for f in found):
        for situation in situations:
            here = [f for f in found if f.subject == subject and f.condition.split(": ")[0] in situation.factors]
            for processor in processors:
                fitting = [f for f in here if f.operations <= processor.operations]
                judged = [
                    _judged(situation, processor, [f for f in fitting if f.method == method])
                    for method in dict.fromkeys(f.method for f in fitting)
                ]
                if judged:
                    rows.append(min(judged, key=lambda row: (not row.trusted, row.worst_rmse)))
    return rows


def _judged(situation: Situation, processor: Processor, of: Sequence[MethodFigures]) -> Recommendation:
    """A method over the conditions of a situation; without a number or a band it is the worst there can be."""
    rmse = np.nan_to_num([f.rmse for f in of], nan=np.inf)
    covered = np.array([f.covered for f in of])
    least = float(np.nan_to_num(covered).min()) if np.isfinite(covered).any() else np.nan
    return Recommendation(of[0].subject, situation.name, processor.name, of[0].method, float(rmse.max()), least)
