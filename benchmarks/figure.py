"""One measured figure with its bar, tables of them, and where the measured data are."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).resolve().parent
DATA = Path(os.environ.get("OHMWARD_DATA", HERE.parents[1] / "shared" / "data"))


class Figure(NamedTuple):
    """One line of the table.

    data: the plant or recording, and the case.
    method: estimator or controller, with its sensors.
    quantity: what was measured, with its unit.
    value: the figure as it is shown.
    bar: what was to be reached, empty where nothing was.
    met: whether it was; None without a bar.
    """

    data: str
    method: str
    quantity: str
    value: str
    bar: str = ""
    met: bool | None = None

    @property
    def cells(self) -> tuple[str, ...]:
        """Cells of a row: the line with the verdict in words."""
        return (*self[:5], verdict(self.met))


def at_most(data: str, method: str, quantity: str, value: float, bar: float | None = None, form: str = ".3g") -> Figure:
    """A figure that should not exceed its bar."""
    return Figure(
        data, method, quantity, f"{value:{form}}", *_judged("<=", bar, value <= bar if bar is not None else None)
    )


def at_least(
    data: str, method: str, quantity: str, value: float, bar: float | None = None, form: str = ".3g"
) -> Figure:
    """A figure that should reach its bar."""
    return Figure(
        data, method, quantity, f"{value:{form}}", *_judged(">=", bar, value >= bar if bar is not None else None)
    )


def between(
    data: str, method: str, quantity: str, value: float, bars: tuple[float, float], form: str = ".0f"
) -> Figure:
    """A figure that should lie between its bars."""
    low, high = bars
    return Figure(data, method, quantity, f"{value:{form}}", f"{low:g} to {high:g}", low <= value <= high)


def rms(errors: Sequence[float] | np.ndarray) -> float:
    """Root mean square; nan of nothing."""
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else float("nan")


def data_file(path: str) -> Path:
    """A file of measured data.

    Raises:
        FileNotFoundError: it is not there; the caller skips its section and says so.
    """
    if not (DATA / path).exists():
        raise FileNotFoundError(DATA / path)
    return DATA / path


def verdict(met: bool | None) -> str:
    """Cell of the tables for a bar that was met or missed; empty without a bar."""
    return {True: "met", False: "**missed**", None: ""}[met]


def table(header: Sequence[str], rows: Iterable[Iterable[object]]) -> list[str]:
    """Lines of a table in Markdown."""
    head, *lines = [f"| {' | '.join(map(str, cells))} |" for cells in (header, *rows)]
    return [head, "|---" * len(header) + "|", *lines]


def _judged(sign: str, bar: float | None, met: bool | None) -> tuple[str, bool | None]:
    return (f"{sign} {bar:g}", met) if bar is not None else ("", None)
