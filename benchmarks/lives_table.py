"""Rows of the table of lives: their scores, their bars, and the Markdown. `lives.py` collects and writes them.

The simulated half is `lives.py`'s own, the measured half `measured_lives.py`'s; both yield `LifeRow`s.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from figure import table as markdown_table
from figure import verdict
from ohmward.battery.battery import Battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import DEFAULT, EstimatorSettings, available, chosen_name, make_estimator
from ohmward.battery.soc.score import Score, score
from ohmward.logs import Log

#: The default, the better of two plain filters that it must not be worse than, and coulomb counting beside them.
METHODS = (DEFAULT, "textbook-ukf", "rc", "coulomb")
PLAIN = ("textbook-ukf", "rc")
#: A band must hold after the first half hour; an unknown start must be found after the first hour.
SETTLED_S, FOUND_S = 1800.0, 3600.0
COVERAGE_BAR, PLAIN_BAR, WRONG_BAR = 0.90, 0.003, 0.001
POOLED_COVERAGE, POOLED_RATIO = (0.93, 0.98), (0.7, 1.2)


class LifeRow(NamedTuple):
    """One life of one battery.

    chemistry: the pooled row that it belongs to.
    cell, tested, life: in words: the cell, the tests that identified it, the life and its start.
    bands: by method, after SETTLED_S; None where the battery file has no model for the method.
    errors: the same, from the beginning, after FOUND_S where the start was not the right one; their RMSE is judged.
    rmse_bar: of the default, in SoC; None without one.
    kept_out: settings were never chosen on this cell.
    """

    chemistry: str
    cell: str
    tested: str
    life: str
    bands: dict[str, Score | None]
    errors: dict[str, Score | None]
    rmse_bar: float | None = None
    kept_out: bool = False


def life_row(
    chemistry: str,
    cell: str,
    tested: str,
    life: str,
    battery: Battery,
    log: Log,
    truth: np.ndarray,
    initial_soc: float | None,
    *,
    rmse_bar: float | None = None,
    kept_out: bool = False,
    methods: Sequence[str] = METHODS,
    settled_s: float = SETTLED_S,
) -> LifeRow:
    """The row of a life: every method on its log.

    initial_soc: given to the estimators; None for unknown. Judged after FOUND_S where it is not the truth.
    truth: (T,) of the state of charge, nan where it is not known.
    settled_s: the band is judged after this time, the RMSE of a start that was not right after twice the time at most.
    """
    right = initial_soc is not None and abs(initial_soc - truth[np.isfinite(truth)][0]) < 0.02
    since_s = log.time_s - log.time_s[0]
    late = since_s >= (0.0 if right else min(FOUND_S, 2 * settled_s))
    known = available(battery, with_published=True)
    settings = EstimatorSettings(battery.idle_current_A)
    bands: dict[str, Score | None] = dict.fromkeys(methods)
    errors: dict[str, Score | None] = dict.fromkeys(methods)
    for method in (method for method in methods if chosen_name(method) in known):
        run = SocEstimator(make_estimator(method, battery, settings), initial_soc).run(log).estimates
        for scores, part in ((bands, since_s >= settled_s), (errors, late)):
            scores[method] = score(run.soc[part], truth[part], run.soc_std[part])
    return LifeRow(chemistry, cell, tested, life, bands, errors, rmse_bar, kept_out)


def disturbed(log: Log, offset_A: float) -> Log:
    """The log as a current sensor with this offset would have recorded it."""
    return replace(log, current_A=log.current_A + offset_A)


def missed_bars(row: LifeRow) -> tuple[str, ...]:
    """Bars that the default of a row misses, in words."""
    band, error = row.bands[DEFAULT], row.errors[DEFAULT]
    if band is None or error is None:
        return ("no estimate",)
    plain = [s.rmse for s in (row.errors.get(name) for name in PLAIN) if s is not None]
    missed = {
        f"RMSE <= {100 * (row.rmse_bar or 0):.1f}": row.rmse_bar is not None and error.rmse > row.rmse_bar,
        f"covered >= {100 * COVERAGE_BAR:.0f} %": band.coverage_95 < COVERAGE_BAR,
        f"plain filter + {100 * PLAIN_BAR:.1f}": bool(plain) and error.rmse > min(plain) + PLAIN_BAR,
        "4 sigma": band.confidently_wrong >= WRONG_BAR,
    }
    return tuple(bar for bar, is_missed in missed.items() if is_missed)


def pooled(rows: Iterable[LifeRow], method: str = DEFAULT) -> Score | None:
    """Scores over all rows together, after SETTLED_S; the largest error of all. A row counts as one, at any rate."""
    found = [s for s in (row.bands.get(method) for row in rows) if s is not None and np.isfinite(s.error_over_std)]
    if not found:
        return None

    def mean(field: str) -> float:
        return float(np.mean([getattr(s, field) for s in found]))

    def rms(field: str) -> float:
        return float(np.sqrt(np.mean([getattr(s, field) ** 2 for s in found])))

    spread = np.sqrt(max(rms("rmse") ** 2 - mean("mean") ** 2, 0.0))
    return Score(
        rmse=rms("rmse"),
        mae=mean("mae"),
        mean=mean("mean"),
        std=float(spread),
        max_error=max(s.max_error for s in found),
        coverage_95=mean("coverage_95"),
        interval_95=mean("interval_95"),
        error_over_std=rms("error_over_std"),
        confidently_wrong=mean("confidently_wrong"),
        samples=sum(s.samples for s in found),
    )


def missed_pooled_bars(found: Score) -> tuple[str, ...]:
    """Bars of a chemistry that its pooled score misses, in words."""
    low, high = POOLED_COVERAGE
    least, most = POOLED_RATIO
    missed = {
        f"covered {100 * low:.0f} to {100 * high:.0f} %": not low <= found.coverage_95 <= high,
        f"error over sigma {least} to {most}": not least <= found.error_over_std <= most,
        "4 sigma": found.confidently_wrong >= WRONG_BAR,
    }
    return tuple(bar for bar, is_missed in missed.items() if is_missed)


HEAD = (
    "| tested | life | RMSE | covered | interval | error / sigma | > 4 sigma | textbook-ukf | rc | coulomb "
    "| RMSE to reach | |",
    "|---|---|---|---|---|---|---|---|---|---|---|---|",
)


def table(rows: Sequence[LifeRow]) -> list[str]:
    """Rows of one chemistry in Markdown, by cell, and the pooled row below them."""
    lines = []
    for cell in dict.fromkeys(row.cell for row in rows):
        of_cell = [row for row in rows if row.cell == cell]
        note = ", kept out of every choice of settings" if of_cell[0].kept_out else ""
        lines += ["", f"**{cell}**{note}", "", *HEAD, *map(markdown, of_cell)]
    return [*lines, "", *pooled_table(rows)]


def markdown(row: LifeRow) -> str:
    """One line of the table."""
    others = (percent_pair(row, method) for method in METHODS[1:])
    bar = "" if row.rmse_bar is None else f"{100 * row.rmse_bar:.1f}"
    return "| " + " | ".join([row.tested, row.life, *row_figures(row), *others, bar, judged(row)]) + " |"


def pooled_table(rows: Sequence[LifeRow]) -> list[str]:
    """All rows of a chemistry together, for every method."""
    rows_of_methods = []
    for method in METHODS:
        if (found := pooled(rows, method)) is not None:
            missed = missed_pooled_bars(found) if method == DEFAULT else None
            word = "" if missed is None else "met" if not missed else f"{verdict(False)}: {', '.join(missed)}"
            rows_of_methods.append((f"`{method}`", *figures(found), word))
    header = ("all of these", "RMSE", "covered", "interval", "error / sigma", "> 4 sigma", "")
    return markdown_table(header, rows_of_methods)


def figures(found: Score | None) -> list[str]:
    """Cells of a score."""
    if found is None:
        return 5 * [""]
    return [
        f"{100 * found.rmse:.2f}",
        f"{100 * found.coverage_95:.0f}",
        f"{100 * found.interval_95:.1f}",
        f"{found.error_over_std:.2f}",
        f"{100 * found.confidently_wrong:.2g}",
    ]


def row_figures(row: LifeRow) -> list[str]:
    """Cells of the default's scores in a row."""
    band, error = row.bands[DEFAULT], row.errors[DEFAULT]
    return figures(band and error and band._replace(rmse=error.rmse))


def percent_pair(row: LifeRow, method: str) -> str:
    """RMSE and, in brackets, coverage of a method."""
    band, error = row.bands.get(method), row.errors.get(method)
    return f"{100 * error.rmse:.2f} ({100 * band.coverage_95:.0f})" if band and error else ""


def judged(row: LifeRow) -> str:
    """The bars that a row misses, or that it meets them."""
    missed = missed_bars(row)
    return "met" if not missed else f"{verdict(False)}: {', '.join(missed)}"


def line(row: LifeRow) -> str:
    """A row for the terminal."""
    shown = " ".join(f"{cell:>6s}" for cell in row_figures(row))
    others = " ".join(f"{percent_pair(row, method):>12s}" for method in METHODS[1:])
    return f"{row.chemistry:9s} {row.cell:24s} {row.tested:24s} {row.life:44s} {shown} {others} {judged(row)}"
