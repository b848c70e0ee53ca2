"""Notebook display of a log, a battery or a run; drawn by a package above this one, which a robot never loads."""

from __future__ import annotations

from importlib import import_module
from typing import Any

#: Module that draws every kind of result. It is in a package above and is loaded by name, as a command is.
PLOTS = "ohmward.figures.plot"


class RichDisplay:
    """Base of results that a notebook shows as a few lines and a small picture, and that can be plotted."""

    def plot(self, *others: Any, truth: Any = None) -> Any:
        """Figures with their 95 % bands: shown by a notebook, written by `plot().save("x.html")`, .svg, .pdf or .png.

        others: further runs over the same log, drawn beside this one; truth: (T,) true values, in the estimate's unit.
        """
        return import_module(PLOTS).plot(self, *others, truth=truth)

    def _repr_html_(self) -> str:
        card: str = import_module(PLOTS).card(self)
        return card
