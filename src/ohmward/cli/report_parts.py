"""Footer and assumptions that the reports of several commands share."""

from __future__ import annotations

from collections.abc import Sequence

from ohmward import __version__
from ohmward.report import Page

FOOTER = f"ohmward {__version__}"


def with_assumptions(page: Page, notes: Sequence[str]) -> Page:
    """The page with everything that was assumed: warnings stand out, the rest is a list."""
    page = page.heading("What was assumed")
    for note in notes:
        if note.startswith("warning: "):
            page = page.callout("warning", note.removeprefix("warning: "))
    plain = [note.removeprefix("info: ") for note in notes if not note.startswith("warning: ")]
    return page.table(["Assumption"], [[note] for note in plain]) if plain else page
