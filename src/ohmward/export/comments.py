"""Comments of the C: the meanings of fields and flags, taken from the docstrings of the Python."""

from __future__ import annotations

import inspect
import re
from enum import IntFlag

from ohmward.trace.structure import Branch, Leaf, Structure

_LINE = re.compile(r"^((?:\w+)(?:, \w+)*): +(.*)$")

_FLAG = re.compile(r"^ +([A-Z_]+) = \d+ +#:? +(.*)$", re.MULTILINE)


def member_comments(structure: Structure) -> dict[str, str]:
    """Member of the C struct -> text, of all NamedTuples in a tree."""
    found: dict[str, str] = {}
    if isinstance(structure, Branch):
        own = field_comments(structure.type)
        for field, child in zip(structure.fields, structure.children, strict=True):
            found |= {field: own[field]} if field in own and isinstance(child, Leaf) else {}
            found |= {f"{field}_{member}": text for member, text in member_comments(child).items()}
    return found


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
    return {name: _safe(text) for name, text in found.items()}


def flag_comments(flags: type[IntFlag]) -> dict[str, str]:
    """Flag -> text, of the comments behind their values."""
    return {name: _safe(text) for name, text in _FLAG.findall(inspect.getsource(flags))}


def _safe(text: str) -> str:
    """Text that cannot end a comment of C."""
    return text.strip().rstrip(".").replace("*/", "* /")
