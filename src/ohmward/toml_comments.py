"""Comments of a TOML file that people edit: taken from its text, and written into the text that replaces it.

A comment belongs to the key or table below it, or to the one before it on the same line; one inside a list moves above
its key. The comments of keys that are gone, and those after the last key, move to the end.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

_TABLE = re.compile(r"\[+\s*([^\[\]]+?)\s*\]+")
_KEY = re.compile(r"""([\w-]+|"[^"]*"|'[^']*')\s*=""")
#: Code in front of a comment; strings may have a `#` in them.
_CODE = re.compile(r"""(?:[^"'#]|"(?:[^"\\]|\\.)*"|'[^']*')*""")
_STRINGS = re.compile(r""""(?:[^"\\]|\\.)*"|'[^']*'""")
_END = ""


class _Comments(NamedTuple):
    """Comments of one key or table."""

    above: list[str]
    behind: str


def with_comments(text: str, old: str) -> str:
    """The text of a file with the comments that people have written into the old one; common ones appear once."""
    own = {line.strip() for line in text.splitlines() if line.startswith("#")}
    found = _comments(old, own)
    lines = []
    for name, line in _named_lines(text):
        comments = found.pop(name, _Comments([], "")) if name else _Comments([], "")
        lines += [*comments.above, f"{line}  {comments.behind}" if comments.behind else line]
    left = [each for comments in found.values() for each in (*comments.above, comments.behind) if each]
    return "\n".join([*lines, *([""] if left else []), *left]) + "\n"


def _comments(text: str, known: set[str]) -> dict[str, _Comments]:
    """Comments by the name of their key or table, without the known ones."""
    found: dict[str, _Comments] = {}
    above: list[str] = []
    last = _END
    for name, line in _named_lines(text):
        comment = line[_CODE.match(line).end() :].strip()  # type: ignore[union-attr]
        if name:
            found[name] = _Comments(above, comment)
            above, last = [], name
        elif comment and comment not in known:
            if line.lstrip().startswith("#") and not line.startswith(" "):
                above = [*above, comment]
            else:
                found.setdefault(last, _Comments([], "")).above.append(comment)
    found[_END] = _Comments(above, "")
    return {name: comments for name, comments in found.items() if comments.above or comments.behind}


def _named_lines(text: str) -> Iterator[tuple[str, str]]:
    """Each line with the name of the key or table that it begins, "" for all others."""
    table, depth = "", 0
    seen: dict[str, int] = {}
    for line in text.splitlines():
        code = _CODE.match(line)[0]  # type: ignore[index]
        name = ""
        if depth == 0 and (head := _TABLE.match(code)):
            table = head[1]
            if code.startswith("[["):
                seen[table] = seen.get(table, 0) + 1
                table = f"{table}#{seen[table]}"
            name = f"[{table}]"
        elif depth == 0 and (key := _KEY.match(code)):
            name = f"{table}.{key[1]}"
            depth = _opened(code[key.end() :])
        elif depth:
            depth += _opened(code)
        yield name, line


def _opened(code: str) -> int:
    """Brackets that a line opens and does not close."""
    bare = _STRINGS.sub("", code)
    return bare.count("[") + bare.count("{") - bare.count("]") - bare.count("}")
