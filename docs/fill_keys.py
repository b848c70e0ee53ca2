"""Write `docs/keys.md`, every key of the files that people edit, from their records: `python docs/fill_keys.py`."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from ohmward.battery.file import BATTERY_FILE
from ohmward.embedded.comments import field_comments
from ohmward.energy.mission import PLAN_FILE
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.toml_file import TomlFile
from ohmward.traction.robot.robot import ROBOT_FILE

PAGE = Path(__file__).parent / "keys.md"
INTRODUCTION = """\
# Every key of every file

Written by `python docs/fill_keys.py` from the records that read the files. A key without a default must be there. Every
key carries its unit; an unknown key is refused with the nearest that there is. `ohmward setup`, `robot`, `generic` and
`identify` write these files, so that none of them has to be typed.
"""
FILES: tuple[tuple[str, str, TomlFile[Any]], ...] = (
    ("battery.toml", "[How a battery file comes about](identification.md).", BATTERY_FILE),
    ("robot.toml", "[How a robot is described](slip.md).", ROBOT_FILE),
    (
        "setup.toml",
        "[The process on the robot](on-board.md): which messages there are, and who gets the estimates.",
        SETUP_FILE,
    ),
    ("plan.toml", "[The way ahead](energy.md).", PLAN_FILE),
)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """The text of the page."""
    blocks = [INTRODUCTION]
    for name, about, file in FILES:
        blocks.append(
            "\n".join([f"## {name}", "", f'`format = "{file.format}"`. {about}', *_tables(file, file.cls, "")])
        )
    return "\n\n".join(blocks) + "\n"


def _tables(file: TomlFile[Any], record: type, path: str, kind: str | None = None) -> Iterator[str]:
    """Lines of the table of a record, then of those that stand in it."""
    hints, said = get_type_hints(record), _meanings(record)
    yield from ("", f"### {path or 'At the head'}" + (f', kind = "{kind}"' if kind else ""), "")
    yield from ("| key | value | default | meaning |", "|---|---|---|---|")
    inner = []
    for field in dataclasses.fields(record):
        records = [cls for cls in _parts(hints[field.name]) if dataclasses.is_dataclass(cls)]
        below = f"{path.strip('[]`')}.{field.name}" if path else field.name
        below = f"`[[{below}]]`" if _is_list(hints[field.name]) else f"`[{below}]`"
        inner += [(cls, below, file.kinds.get(cls)) for cls in records]
        value = f"table {below}" if records else _words(hints[field.name])
        yield f"| `{field.name}` | {value} | {_default(field)} | {_cell(said.get(field.name, ''))} |"
    for cls, below, of_kind in inner:
        yield from _tables(file, cls, below, of_kind)


def _meanings(record: type) -> dict[str, str]:
    """Field -> meaning, of a record and of those that it is made from."""
    found: dict[str, str] = {}
    for cls in reversed(record.__mro__):
        found |= field_comments(cls) if dataclasses.is_dataclass(cls) else {}
    return found


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


def _default(field: dataclasses.Field[Any]) -> str:
    """Its default, empty where it must be there."""
    if field.default is dataclasses.MISSING:
        return "" if field.default_factory is dataclasses.MISSING else "empty"
    if field.default is None:
        return "none"
    if isinstance(field.default, bool):
        return f"`{str(field.default).lower()}`"
    if isinstance(field.default, int | float | str):
        return f"`{field.default!r}`".replace("'", '"')
    return "as usual"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


if __name__ == "__main__":
    main()
