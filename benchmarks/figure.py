"""One measured figure with its bar, and where the measured data are. `accuracy.py` and `lives.py` collect them."""

from __future__ import annotations

import os
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


def rms(errors: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(errors**2)))


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


def _judged(sign: str, bar: float | None, met: bool | None) -> tuple[str, bool | None]:
    return (f"{sign} {bar:g}", met) if bar is not None else ("", None)
