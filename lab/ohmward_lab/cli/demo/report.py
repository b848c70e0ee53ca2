"""Report of `ohmward demo`: what every command shows first, on one page."""

from __future__ import annotations

from collections.abc import Mapping

from ohmward.cli.outcome import Outcome
from ohmward.cli.report_parts import FOOTER
from ohmward.report import Page

_SUBTITLE = "Everything here is simulated: a robot with a 12 V battery, its day, and its drive home"

#: Steps of the demo in the order of the story: the title of each, and how many sections of its own report are shown.
CHAPTERS = {
    "identify": ("The battery, from its pulse test", 0),
    "soc": ("Charge over the day", 0),
    "simulate": ("The drive home as it was", 0),
    "slip": ("Speed and slip as the robot knows them", 0),
    "mission": ("Where the energy went, and whether it gets home", 3),
}


def make_page(outcomes: Mapping[str, Outcome], figures: Mapping[str, str]) -> Page:
    """A chapter for every step; outcomes: by the name of the step.  figures: what is to be seen first."""
    page = Page("A robot, from its battery test to the way home", _SUBTITLE, FOOTER)
    page = page.numbers({label.capitalize(): value for label, value in figures.items()})
    for name, (title, sections) in CHAPTERS.items():
        if make := outcomes[name].page:
            page = page.chapter(title, make(), sections)
    return page
