"""Write `docs/keys.md`, the keys of the files that people edit, from their records: `python docs/fill_keys.py`."""

from __future__ import annotations

import dataclasses
import types
from collections import defaultdict
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from textwrap import fill
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from ohmward.battery.battery import Knowledge, Provenance
from ohmward.battery.file import BATTERY_FILE
from ohmward.embedded.comments import field_comments
from ohmward.energy.mission import PLAN_FILE
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.toml_file import TomlFile
from ohmward.traction.robot.robot import ROBOT_FILE

PAGE = Path(__file__).parent / "keys.md"
INTRODUCTION = """\
# Keys of the files

Written by `python docs/fill_keys.py` from the records that read the files. In parentheses is the default of a key or,
if it has none, its type: in **bold** if the key is required. Keys carry their unit; an unknown key is refused with the
nearest known one. `ohmward setup`, `robot`, `generic` and `identify` write these files.
"""
#: Tables that no one edits.
WRITTEN = (Provenance, Knowledge)
FILES: tuple[tuple[str, str, TomlFile[Any]], ...] = (
    (
        "battery.toml",
        "[How a battery file comes about](identification.md). `identify` and `learn` write `[identification]` and "
        "`[knowledge]`: `Provenance` and `Knowledge` in the [reference](reference/battery.md).",
        BATTERY_FILE,
    ),
    ("robot.toml", "[How a robot is described](slip.md).", ROBOT_FILE),
    (
        "setup.toml",
        "[The process on the robot](on-board.md). Every source and sink also has a `name` for diagnostics, its kind "
        'unless given. A secret is given as the name of an environment variable or as "file:PATH" (mode 600).',
        SETUP_FILE,
    ),
    ("plan.toml", "[The way ahead](energy.md).", PLAN_FILE),
)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """The text of the page."""
    blocks = [INTRODUCTION.rstrip()]
    for name, about, file in FILES:
        paragraph = fill(f'`format = "{file.format}"`. {about}', 120, break_long_words=False, break_on_hyphens=False)
        blocks.append("\n".join([f"## {name}", "", paragraph, *_tables(file, file.cls, "", {})]))
    return "\n\n".join(blocks) + "\n"


def _tables(
    file: TomlFile[Any], record: type, path: str, places: dict[tuple[str, str, str], str], kind: str | None = None
) -> Iterator[str]:
    """Lines on the table of a record, then on those in it; `places` has where each key of the file stands first."""
    hints, said = get_type_hints(record), field_comments(record)
    title = (path or "At the head") + (f", kind `{kind}`" if kind else "")
    rows, repeated, inner = [], defaultdict[str, list[str]](list), []
    for field in dataclasses.fields(record):
        records = [cls for cls in _parts(hints[field.name]) if dataclasses.is_dataclass(cls)]
        below = f"{path.strip('[]`')}.{field.name}" if path else field.name
        below = f"`[[{below}]]`" if _is_list(hints[field.name]) else f"`[{below}]`"
        inner += [(cls, below, file.kinds.get(cls)) for cls in records]
        value = below if records else _words(hints[field.name])
        row = (f"`{field.name}`", _default(field, value), said.get(field.name, "").replace("\n", " "))
        if field.name == "name" and field.default == kind:
            continue
        if row in places:
            repeated[places[row]].append(row[0])
        else:
            rows.append(row)
            places[row] = f"in {title}" if path else "at the head"
    yield from ("", f"### {title}", "")
    yield from _merged(rows)
    yield from (f"- {', '.join(keys)}: as {where}" for where, keys in repeated.items())
    for cls, below, of_kind in (table for table in inner if table[0] not in WRITTEN):
        yield from _tables(file, cls, below, places, of_kind)


def _merged(rows: list[tuple[str, str, str]]) -> Iterator[str]:
    """Lines of a list, one for neighbours of one meaning."""
    for meaning, group in groupby(rows, key=lambda row: row[2]):
        keys, defaults, _ = zip(*group, strict=True)
        yield f"- {', '.join(keys)} ({', '.join(dict.fromkeys(defaults))}): {meaning}"


def _is_list(hint: Any) -> bool:
    """True for a tuple or list of tables."""
    return get_origin(hint) in (tuple, list) or any(map(_is_list, get_args(hint)))


def _parts(hint: Any) -> list[Any]:
    """The types in a union, a tuple or a list of types."""
    if get_origin(hint) in (Union, types.UnionType, tuple, list):
        return [part for argument in get_args(hint) if argument is not Ellipsis for part in _parts(argument)]
    return [hint]


def _words(hint: Any) -> str:
    """A type as people call it."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Literal:
        return ", ".join(f"`{value}`" for value in arguments)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_words(part) for part in arguments if part is not types.NoneType))
    if origin in (tuple, list):
        return f"list of {_words(arguments[0]).replace('list of', 'lists of').removesuffix('s')}s"
    if origin is dict or hint is dict:
        return "table of names"
    return {float: "number", int: "whole number", str: "text", bool: "true or false"}.get(
        hint, getattr(hint, "__name__", "value")
    )


def _default(field: dataclasses.Field[Any], value: str) -> str:
    """Its default, else its type, in bold where it must be there."""
    if isinstance(field.default, bool):
        return f"`{str(field.default).lower()}`"
    if isinstance(field.default, int | float | str):
        return f"`{field.default!r}`".replace("'", '"')
    required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    return f"**{value}**" if required else value


if __name__ == "__main__":
    main()
