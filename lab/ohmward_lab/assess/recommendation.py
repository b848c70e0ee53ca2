"""Recommended method for a subject, its conditions and a processor, by rules; and where a filter does harm.

Candidates are the methods whose step fits the processor, whose band covers the truth, whose RMSE is within a limit, and
that are no worse than the plain method, where a study has one. The candidate with the smallest RMSE in the worst
condition of the situation is recommended. Without a candidate it is the plain method, without a band, if it is within
the limit; else none, and the other rows show what helps: a larger processor, or what the situation lacks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward_lab.assess import LARGEST_RMSE

#: A 95 % band that covers at least this share in every condition of the situation can be trusted.
COVERS = 0.85
#: An RMSE that exceeds another by more than this factor is worse; smaller differences are due to chance.
WORSE = 1.05


#: Record of a method's figures under a condition. The rules need its fields subject, condition, method, rmse (of the
#: charge, or of the speed [m/s]), covered (share of the samples with the truth in the 95 % band) and operations.
MethodFigures = Any


class Improvement(NamedTuple):
    """Name of what a situation lacks, and the conditions that have it: factors, or names of single conditions."""

    name: str
    conditions: tuple[str, ...]


def as_in_the_base_case(name: str) -> tuple[Improvement, ...]:
    """Improvement of this name that the base case of a study has."""
    return (Improvement(name, ("base",)),)


class Situation(NamedTuple):
    """Factors of the conditions that a designer faces together, and improvements that would avoid them."""

    name: str
    factors: tuple[str, ...]
    improvements: tuple[Improvement, ...] = ()


class Processor(NamedTuple):
    """Class of processors, and the most operations of a step that fit into it."""

    name: str
    operations: float


_ANY = Processor("any", math.inf)


class Recommendation(NamedTuple):
    """Row of the table of recommendations."""

    subject: str
    situation: str
    processor: str
    method: str | None  #: None where there is none to recommend
    closest: str  #: the method, or if there is none the one with the smallest RMSE, which the next two figures describe
    worst_rmse: float  #: in the worst condition
    least_covered: float  #: smallest coverage of its band; nan without a band
    helps: tuple[str, ...] = ()  #: changes that would allow a recommendation where there is none, each by itself


class Worse(NamedTuple):
    """Methods that are worse than something simpler."""

    subject: str
    where: str  #: situation or condition
    #: their names and errors
    methods: tuple[str, ...]
    rmse: tuple[float, ...]
    #: what they are compared with, and the error of that for each method
    than: str
    than_rmse: tuple[float, ...]
    every: bool  #: True where all compared methods are worse


class _Judged(NamedTuple):
    """Method over the conditions of a situation: its largest RMSE, and the smallest coverage of its band, or nan."""

    method: str
    worst_rmse: float
    least_covered: float


class Rules(NamedTuple):
    """The rules of a study: the largest RMSE that is recommended, and the name of its plain method, if it has one."""

    largest_rmse: float = LARGEST_RMSE
    plain: str | None = None

    def best(self, judged: Sequence[_Judged]) -> _Judged | None:
        """The method to recommend, if any."""
        plain = next((each for each in judged if each.method == self.plain), None)
        bar = self.largest_rmse if plain is None else min(self.largest_rmse, WORSE * plain.worst_rmse)
        holding = [each for each in judged if each.least_covered >= COVERS and each.worst_rmse <= bar]
        if holding:
            return min(holding, key=lambda each: each.worst_rmse)
        return plain if plain is not None and plain.worst_rmse <= self.largest_rmse else None


def recommend(
    found: Sequence[MethodFigures], situations: Sequence[Situation], processors: Sequence[Processor], rules: Rules
) -> list[Recommendation]:
    """A row for each subject, situation and processor for which there are figures."""
    rows = []
    for subject, of in _by_subject(found):
        for situation in situations:
            for processor in processors:
                judged = _judged(of, situation.factors, processor)
                if not judged:
                    continue
                best = rules.best(judged)
                closest = best or min(judged, key=lambda each: each.worst_rmse)
                helps = () if best else _helps(of, situation, processor, processors, rules)
                names = subject, situation.name, processor.name, best and best.method
                rows.append(Recommendation(*names, *closest, helps))
    return rows


def worse_than_plain(found: Sequence[MethodFigures], situations: Sequence[Situation], plain: str) -> list[Worse]:
    """Methods that are worse than the plain one, by subject and situation."""
    rows = []
    for subject, of in _by_subject(found):
        for situation in situations:
            rmse = {each.method: each.worst_rmse for each in _judged(of, situation.factors)}
            plain_rmse = rmse.pop(plain, math.inf)
            than = dict.fromkeys(rmse, plain_rmse)
            rows += _worse(subject, situation.name, rmse, plain, than)
    return rows


def worse_when_given(found: Sequence[MethodFigures], pairs: Sequence[tuple[str, str]]) -> list[Worse]:
    """Methods that are worse under the first condition of a pair, which gives them the truth, than under the second."""
    rows = []
    for subject, of in _by_subject(found):
        for right, wrong in pairs:
            rmse, than = ({each.method: each.worst_rmse for each in _judged(of, (name,))} for name in (right, wrong))
            rows += _worse(subject, right, rmse, wrong, than)
    return rows


def _worse(
    subject: str, where: str, rmse: Mapping[str, float], than: str, than_rmse: Mapping[str, float]
) -> list[Worse]:
    methods = tuple(name for name in rmse if rmse[name] > WORSE * than_rmse.get(name, math.inf))
    if not methods:
        return []
    errors, than_errors = (tuple(each[name] for name in methods) for each in (rmse, than_rmse))
    return [Worse(subject, where, methods, errors, than, than_errors, len(methods) == len(rmse))]


def _helps(
    of: Sequence[MethodFigures],
    situation: Situation,
    processor: Processor,
    processors: Sequence[Processor],
    rules: Rules,
) -> tuple[str, ...]:
    """Improvements, a larger processor or, where neither helps by itself, both, that allow a recommendation."""
    larger = [each for each in processors if each.operations > processor.operations]

    def possible(conditions: Sequence[str], on: Sequence[Processor]) -> bool:
        return any(rules.best(_judged(of, conditions, each)) for each in on)

    helps = [
        improvement.name for improvement in situation.improvements if possible(improvement.conditions, [processor])
    ]
    if possible(situation.factors, larger):
        helps.append("a larger processor")
    both = [each.name for each in situation.improvements if possible(each.conditions, larger)]
    return tuple(helps or [f"{name} and a larger processor" for name in both])


def _by_subject(found: Sequence[MethodFigures]) -> Iterator[tuple[str, list[MethodFigures]]]:
    for subject in dict.fromkeys(f.subject for f in found):
        yield subject, [f for f in found if f.subject == subject]


def _judged(of: Sequence[MethodFigures], conditions: Sequence[str], processor: Processor = _ANY) -> list[_Judged]:
    """Methods that fit the processor; a missing RMSE counts as inf, a band missing in some conditions as coverage 0."""
    here = [f for f in of if f.operations <= processor.operations]
    here = [f for f in here if f.condition in conditions or f.condition.split(": ")[0] in conditions]
    rows = []
    for method in dict.fromkeys(f.method for f in here):
        rmse = np.nan_to_num([f.rmse for f in here if f.method == method], nan=math.inf)
        covered = np.array([f.covered for f in here if f.method == method])
        least = float(np.nan_to_num(covered).min()) if np.isfinite(covered).any() else math.nan
        rows.append(_Judged(method, float(rmse.max()), least))
    return rows
