"""What the fields of a NamedTuple mean, from its own docstring: the C says it in the same words."""

from __future__ import annotations

import inspect
import re

_LINE = re.compile(r"^((?:\w+)(?:, \w+)*): +(.*)$")


def field_comments(cls: type) -> dict[str, str]:
    """Field -> text, for the fields that the docstring explains as `name: text` or `name, name: text`."""
    fields = set(getattr(cls, "_fields", ()))
    found: dict[str, str] = {}
    current: list[str] = []
    for line in inspect.cleandoc(cls.__doc__ or "").splitlines():
        match = _LINE.match(line)
        if match and set(names := match[1].split(", ")) <= fields:
            current = names
            found |= dict.fromkeys(names, match[2].strip())
        elif line.startswith("    ") and current:
            found |= {name: f"{found[name]} {line.strip()}" for name in current}
        else:
            current = []
    return {name: text.rstrip(".").replace("*/", "* /") for name, text in found.items()}
