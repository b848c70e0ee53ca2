"""The whole study: every chemistry under every condition by every method, side by side, resumable."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ohmward.assess.cell import CellFigures, cell
from ohmward.assess.conditions import CONDITIONS
from ohmward.assess.lives import CHEMISTRIES
from ohmward.assess.methods import METHODS
from ohmward.errors import InputError
from ohmward.fleet.run import in_processes, run_fleet

_BETWEEN = " | "
_CONDITIONS = {condition.name: condition for condition in CONDITIONS}
_METHODS = {method.name: method for method in METHODS}


@dataclass(frozen=True)
class Assessment:
    """The job of a study: its items are named by chemistry, condition and method.

    Attributes:
        runs: shifts of each chemistry under each condition.
        seed: of all random numbers.
        estimates: none are kept.
    """

    runs: int
    seed: int
    estimates: None = None

    @property
    def digest(self) -> str:
        """Another one for every study with other results."""
        return f"assess, {self.runs} runs, seed {self.seed}"

    def run(self, items: Sequence[str]) -> list[dict[str, Any]]:
        """A row for each item."""
        rows = []
        for item in items:
            chemistry, condition, method = item.split(_BETWEEN)
            found = cell(chemistry, _CONDITIONS[condition], _METHODS[method], self.runs, self.seed)
            rows.append({"path": item, "error": None, **found._asdict()})
        return rows


def items(only: Sequence[str] = ()) -> list[str]:
    """Names of the items: all, or those in whose name each of these words stands; words of one kind are alternatives.

    only: chemistries, factors of conditions, methods.

    Raises:
        InputError: a word names nothing.
    """
    kinds = (CHEMISTRIES, [c.factor for c in CONDITIONS], [m.name for m in METHODS])
    for word in only:
        if not any(word in kind for kind in kinds):
            known = ", ".join(dict.fromkeys(name for kind in kinds for name in kind))
            raise InputError(f"there is no {word!r} to assess; there are {known}")
    chemistries, factors, methods = ([name for name in kind if name in only] or kind for kind in kinds)
    return [
        _BETWEEN.join((chemistry, condition.name, method.name))
        for chemistry in chemistries
        for condition in CONDITIONS
        if condition.factor in factors
        for method in METHODS
        if method.name in methods
    ]


def assess(
    folder: Path,
    runs: int,
    seed: int,
    only: Sequence[str] = (),
    processes: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[CellFigures]:
    """CellFigures of all items, or of those that an earlier, interrupted study in this folder has left; in their order.

    progress: called with (items done, all).

    Raises:
        InputError: a word of `only` names nothing, or the folder holds another study.
        OhmwardError: the folder cannot be written.
    """
    wanted = items(only)
    work = partial(in_processes, processes=processes)
    finished = run_fleet(wanted, Assessment(runs, seed), folder, work, progress, batch=len(METHODS))
    rows = {row["path"]: row for row in finished.rows}
    return [CellFigures(*(rows[item][name] for name in CellFigures._fields)) for item in wanted]
