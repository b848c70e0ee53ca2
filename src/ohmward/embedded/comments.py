"""Meanings of fields and flags, taken from the Python that defines them: for comments of C, and for the documentation.

The meaning of a field stands behind it, or above it and the fields that follow it without one:

    speed_m_s: Scalar  #: forward
    #: of the body
    motion: np.ndarray
    motion_std: np.ndarray

Records that users read most list them in the docstring instead, as `name: text` or `name, name: text`.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from enum import IntFlag
from textwrap import dedent

from ohmward.trace.lower.c_operations import comment_text
from ohmward.trace.structure import Branch, Leaf, Structure

_ITEM = re.compile(r"^( *)((?:\w+)(?:, \w+)*): +(.*)$")
_FIELD = re.compile(r"^    (\w+): (?:[^#]*[^#\s])?(?: +#: +(.*))?$")
_ABOVE = "    #: "

#: Shape of an array at the beginning of a text, which C shows by itself: `(driven,)`, `(n (n + 1) / 2,)`.
_SHAPE = re.compile(r"^\((?:[^()]|\([^()]*\))*,(?:[^()]|\([^()]*\))*\)(?:, *| +|$)")

_FLAG = re.compile(r"^ +([A-Z_]+) = \d+ +#:? +(.*)$", re.MULTILINE)


def member_comments(structure: Structure) -> dict[str, str]:
    """Member of the C struct -> text without its shape, of all NamedTuples in a tree."""
    found: dict[str, str] = {}
    if isinstance(structure, Branch):
        own = field_comments(structure.type) if hasattr(structure.type, "_fields") else {}
        for field, child in zip(structure.fields, structure.children, strict=True):
            found |= {field: _SHAPE.sub("", own[field])} if field in own and isinstance(child, Leaf) else {}
            found |= {f"{field}_{member}": text for member, text in member_comments(child).items()}
    return found


def field_comments(cls: type) -> dict[str, str]:
    """Field -> text, for the fields of a record, and of those that it is made from, that have one."""
    found: dict[str, str] = {}
    for part in reversed(cls.__mro__):
        if inspect.get_annotations(part):
            found |= _listed(part) | dict(_beside_fields(part))
    return {name: _safe(text) for name, text in found.items()}


def flag_comments(flags: type[IntFlag]) -> dict[str, str]:
    """Flag -> text, of the comments behind their values."""
    return {name: _safe(text) for name, text in _FLAG.findall(inspect.getsource(flags))}


def _beside_fields(cls: type) -> Iterator[tuple[str, str]]:
    above: list[str] = []
    last_was_comment = False
    for line in dedent(inspect.getsource(cls)).splitlines():
        if line.startswith(_ABOVE):
            above = [*above, line[len(_ABOVE) :]] if last_was_comment else [line[len(_ABOVE) :]]
        elif (field := _FIELD.match(line)) is not None:
            above = [] if field[2] else above
            if text := field[2] or " ".join(above):
                yield field[1], text
        elif not line.startswith("     "):
            above = []
        last_was_comment = line.startswith(_ABOVE)


def _listed(cls: type) -> dict[str, str]:
    """Meanings listed in the docstring, each with its indented continuation lines."""
    fields = set(inspect.get_annotations(cls))
    found: dict[str, str] = {}
    names: list[str] = []
    indent = 0
    for line in inspect.cleandoc(cls.__doc__ or "").splitlines():
        item = _ITEM.match(line)
        if item and set(item[2].split(", ")) <= fields:
            names, indent = item[2].split(", "), len(item[1])
            found |= dict.fromkeys(names, item[3].strip())
        elif line.startswith(" " * (indent + 4)):
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
        else:
            names = []
    return found


def _safe(text: str) -> str:
    """Text that cannot end a C comment."""
    return comment_text(text.strip().rstrip("."))
