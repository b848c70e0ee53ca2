"""A whole study: every subject under every condition with every method, in parallel and resumable."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.errors import InputError, OhmwardError
from ohmward.fleet.run import in_processes, run_fleet
from ohmward_lab.assess import LARGEST_RMSE, battery, traction
from ohmward_lab.assess.recommendation import (
    Processor,
    Recommendation,
    Rules,
    Situation,
    Worse,
    recommend,
    worse_than_plain,
    worse_when_given,
)

_BETWEEN = " | "


class Study(NamedTuple):
    """A study."""

    #: in words: what is estimated, what a subject is, and what one run is
    name: str
    subject: str
    run: str
    #: run in all combinations; each condition and method has a `name`
    subjects: tuple[str, ...]
    conditions: Sequence[Any]
    methods: Sequence[Any]
    #: record of a row; `cell(subject, condition, method, runs, seed)` computes it
    figures: type[battery.SocFigures] | type[traction.SlipFigures]

    cell: Callable[[str, Any, Any, int, int], Any]
    #: for which a method is recommended
    situations: tuple[Situation, ...]
    processors: tuple[Processor, ...]
    plain: str | None = None  #: method that every other one is compared with, if there is one
    #: conditions that differ only in what the method is given: the truth, and something else
    pairs: tuple[tuple[str, str], ...] = ()

    def items(self, only: Sequence[str] = ()) -> list[str]:
        """Names of the items: all, or those that match these words; words of the same kind are alternatives.

        only: names of subjects, factors of conditions, methods.

        Raises:
            InputError: a word names nothing.
        """
        kinds = (self.subjects, [c.factor for c in self.conditions], [m.name for m in self.methods])
        for word in only:
            if not any(word in kind for kind in kinds):
                known = ", ".join(dict.fromkeys(name for kind in kinds for name in kind))
                raise InputError(f"there is no {word!r} to assess; there are {known}")
        subjects, factors, methods = ([name for name in kind if name in only] or kind for kind in kinds)
        return [
            _BETWEEN.join((subject, condition.name, method.name))
            for subject in subjects
            for condition in self.conditions
            if condition.factor in factors
            for method in self.methods
            if method.name in methods
        ]

    def recommended(self, found: Sequence[Any], largest_rmse: float = LARGEST_RMSE) -> list[Recommendation]:
        """The method for each subject, situation and processor, or none."""
        return recommend(found, self.situations, self.processors, Rules(largest_rmse, self.plain))

    def worse(self, found: Sequence[Any]) -> list[Worse]:
        """Methods that are worse than the plain one, or worse when given the truth than without it."""
        plainly = [] if self.plain is None else worse_than_plain(found, self.situations, self.plain)
        return plainly + worse_when_given(found, self.pairs)


STUDIES: Mapping[str, Study] = {
    "battery": Study(
        "battery",
        "chemistry",
        "shifts of eight hours",
        battery.CHEMISTRIES,
        battery.CONDITIONS,
        battery.METHODS,
        battery.SocFigures,
        battery.soc_cell,
        battery.SITUATIONS,
        battery.PROCESSORS,
    ),
    "traction": Study(
        "traction",
        "robot",
        "drives of two minutes",
        tuple(traction.ROBOTS),
        traction.DRIVE_CONDITIONS,
        traction.SLIP_METHODS,
        traction.SlipFigures,
        traction.slip_cell,
        traction.DRIVE_SITUATIONS,
        traction.OBSERVER_PROCESSORS,
        traction.PLAIN,
        traction.GROUND_PAIRS,
    ),
}


@dataclass(frozen=True)
class Assessment:
    """The job of a study: its items are named by subject, condition and method."""

    study: str  #: its name
    runs: int  #: of each subject under each condition
    seed: int  #: of all random numbers
    estimates: None = None  #: none are kept

    @property
    def digest(self) -> str:
        """Digest that differs between studies with different results."""
        return f"assess {self.study}, {self.runs} runs, seed {self.seed}"

    def run(self, items: Sequence[str]) -> list[dict[str, Any]]:
        """A row for each item."""
        study, rows = STUDIES[self.study], []
        conditions, methods = ({each.name: each for each in kind} for kind in (study.conditions, study.methods))
        for item in items:
            subject, condition, method = item.split(_BETWEEN)
            found = study.cell(subject, conditions[condition], methods[method], self.runs, self.seed)
            rows.append({"path": item, "error": None, **found._asdict()})
        return rows


def assess(
    study: Study,
    folder: Path,
    runs: int,
    seed: int,
    only: Sequence[str] = (),
    processes: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[Any]:
    """Figures of all items, in their order; an earlier, interrupted study in this folder is continued.

    progress: called with (items done, all).

    Raises:
        InputError: a word of `only` names nothing, or the folder holds another study.
        OhmwardError: the folder cannot be written, or an item failed.
    """
    wanted = study.items(only)
    work = partial(in_processes, processes=processes)
    finished = run_fleet(wanted, Assessment(study.name, runs, seed), folder, work, progress, batch=len(study.methods))
    if finished.failed:
        raise OhmwardError(finished.failed[0]["error"])
    rows = {row["path"]: row for row in finished.rows}
    return [study.figures(**{name: rows[item][name] for name in study.figures._fields}) for item in wanted]
