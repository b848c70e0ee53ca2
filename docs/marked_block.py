"""Block of a page that a script writes, between the markers `<!-- name: written by ... -->` and `<!-- /name -->`."""

from __future__ import annotations

import re
from collections.abc import Iterable


def replaced(text: str, name: str, lines: Iterable[str]) -> str:
    """The text of a page with these lines between the markers of that name."""
    before, begin, _, end, after = re.split(rf"(<!-- {name}: [^>]*-->\n)(.*?)(<!-- /{name} -->)", text, flags=re.DOTALL)
    return before + begin + "".join(f"{line}\n" for line in lines) + end + after
