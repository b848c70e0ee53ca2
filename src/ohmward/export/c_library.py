"""A C99 library as files: source, header, test vectors with their test, build files, a README."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import IntFlag
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward import __version__
from ohmward.atomic import replacing
from ohmward.errors import InputError, OhmwardError
from ohmward.export.comments import field_comments
from ohmward.export.vectors import vectors_header
from ohmward.trace.c_source import Member, c_source, members
from ohmward.trace.elementary import F32, expand
from ohmward.trace.program import Program

#: Bytes of Thumb-2 code for each operation of a straight line, and of one entry of a table.
_BYTES_OF_OPERATION, _BYTES_OF_ENTRY = 7, 4


class Export(NamedTuple):
    """What is exported.

    name:    prefix of the symbols and files.
    title:   what it is, in one line.
    step, start: as traced, see `c_source`.
    types:   classes of state, sample and output, whose docstrings say what their fields are.
    flags:   what the bits of the output's flags mean.
    arguments: values of the further arguments of the start, for the test.
    samples: (T, m) of the test vectors.
    """

    name: str
    title: str
    step: Program
    start: Program
    types: tuple[type, type, type]
    flags: type[IntFlag]
    arguments: tuple[float, ...]
    samples: np.ndarray


class Size(NamedTuple):
    """What a library takes on a microcontroller [bytes]; flash is an estimate for Thumb-2, the state is exact."""

    operations: int
    flash: int
    state: int


def size(export: Export) -> Size:
    """What the library will take."""
    programs = [expand(p, F32) for p in (export.step, export.start)]
    tables = {a for p in programs for n in p.nodes if n.operation.name == "gather" for a in n.args[1:]}
    operations = sum(len(p.nodes) for p in programs)
    entries = sum(len(t) for t in tables)
    state = sum(_bytes(m) for m in members(export.step.argument_structure.children[0]))
    return Size(operations, _BYTES_OF_OPERATION * operations + _BYTES_OF_ENTRY * entries, state)


def check_fits(export: Export, flash_bytes: float | None, ram_bytes: float | None) -> None:
    """Refuse what does not fit.

    Raises:
        InputError: names what is too large, and what is smaller.
    """
    needed = size(export)
    for what, bytes_, limit in (("flash", needed.flash, flash_bytes), ("RAM", needed.state, ram_bytes)):
        if limit is not None and bytes_ > limit:
            raise InputError(
                f"{export.title} needs about {bytes_} bytes of {what}, more than the {limit:g} there are; choose "
                "--filter textbook-ekf or a model with fewer RC pairs, or a larger target"
            )


def library(export: Export) -> dict[str, str]:
    """The text of every file, by its name."""
    comments, needed = _comments(export), size(export)
    flags = {str(flag.name): flag.value for flag in export.flags}
    source = c_source(export.step, export.name, export.start, comments, flags)
    files = {f"{export.name}.h": source.header, f"{export.name}.c": source.source}
    files[f"{export.name}_vectors.h"] = vectors_header(
        export.name, export.step, export.start, export.arguments, export.samples
    )
    words = {
        "NAME": export.name,
        "UPPER": export.name.upper(),
        "VERSION": __version__,
        "TITLE": export.title,
        "STATE_BYTES": str(needed.state),
        "FLASH_BYTES": f"{round(needed.flash, -2)}",
        "ARGUMENTS": "".join(f", {a:g}f" if "." in f"{a:g}" else f", {a:g}.0f" for a in export.arguments),
        "SIGNATURE": "".join(f", float {word}" for word in export.start.argument_structure.fields[1:]),
        "SAMPLE": _table(export.step, 1, "sample", comments),
        "OUTPUT": _table(export.step, 2, "output", comments),
    }
    for template in sorted(t.name for t in _templates().iterdir() if t.name.endswith(".in")):
        name = template.removesuffix(".in").replace("NAME", export.name)
        files[name] = _filled((_templates() / template).read_text(encoding="utf-8"), words)
    return files


def write_library(files: Mapping[str, str], folder: Path) -> list[Path]:
    """Write the files into a folder, which is made if there is none; each is whole or as it was.

    Raises:
        OhmwardError: the folder or a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OhmwardError(f"{folder}: cannot be made ({error.strerror}); choose another folder") from error
    paths = []
    for name, text in files.items():
        paths.append(folder / name)
        with replacing(paths[-1]) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
    return paths


def _templates() -> Any:
    return resources.files("ohmward.export") / "templates"


def _filled(text: str, words: Mapping[str, str]) -> str:
    """The text with @WORD@ replaced."""
    return re.sub(r"@(\w+)@", lambda match: words[match[1]], text)


def _comments(export: Export) -> dict[str, str]:
    """What each member means, by its path."""
    found: dict[str, str] = {}
    for struct, cls in zip(("state", "sample", "output"), export.types, strict=True):
        found |= {f"{struct}.{field}": text for field, text in field_comments(cls).items()}
    return found


def _table(step: Program, part: int, struct: str, comments: Mapping[str, str]) -> str:
    """A table of members in Markdown."""
    structures = (*step.argument_structure.children, step.result_structure.children[1])  # type: ignore[union-attr]
    rows = [f"| `{m.name}` | {comments.get(f'{struct}.{m.name}', '')} |" for m in members(structures[part])]
    return "\n".join(["| member | |", "|---|---|", *rows])


def _bytes(member: Member) -> int:
    return max(1, member.size) * (4 if member.kind == "float" else 1)
