"""What a notebook shows of a log, a battery or a run; drawn by a room above, which a robot never loads."""

from __future__ import annotations

from importlib import import_module
from typing import Any

#: Modules that draw every kind of result. They stand above and are loaded by their names, as a command is.
CARDS, PLOTS = "ohmward.figures.card", "ohmward.figures.plot"


class RichDisplay:
    """Something that a notebook shows by a few lines and a small picture, and that can be drawn."""

    def plot(self, *others: Any, truth: Any = None) -> Any:
        """Figures with their 95 % bands: shown by a notebook, written by `plot().save("x.html")`, .svg, .pdf or .png.

        others: further runs over the same log, drawn beside this one; truth: (T,) what they estimate, in its unit.
        """
        return import_module(PLOTS).plot(self, *others, truth=truth)

    def _repr_html_(self) -> str:
        card: str = import_module(CARDS).card(self)
        return card
