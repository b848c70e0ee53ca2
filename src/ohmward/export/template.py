"""Files that come with the package, with words to fill in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import resources
from importlib.resources.abc import Traversable


def templates() -> list[str]:
    """Names of the files that every library has."""
    return sorted(t.name for t in _folder().iterdir() if t.name.endswith(".in"))


def template(name: str) -> str:
    """Text of a template."""
    return _folder().joinpath(*name.split("/")).read_text(encoding="utf-8")


def filled(text: str, words: Mapping[str, str]) -> str:
    """The text with @WORD@ replaced."""
    return re.sub(r"@(\w+)@", lambda match: words[match[1]], text)


def _folder() -> Traversable:
    return resources.files("ohmward.export") / "templates"
