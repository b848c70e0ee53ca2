"""A C99 library as files: source, header, test vectors with their test, build files, a README."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntFlag
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward import __version__
from ohmward.atomic import write_text
from ohmward.errors import InputError, OhmwardError
from ohmward.export.comments import flag_comments, member_comments
from ohmward.export.template import filled, template, templates
from ohmward.export.vectors import vectors_header
from ohmward.trace.elementary import F32, expand
from ohmward.trace.lower.c_operations import literal
from ohmward.trace.lower.c_source import Loops, Member, c_source, members
from ohmward.trace.lower.constant_arrays import are_bytes, constant_arrays
from ohmward.trace.program import Program

#: Bytes of Thumb-2 code, compiled with -Os: of an operation, of one that chooses, of a number read or written. Fitted
#: to all filters; `tests/export/test_size.py` holds them to what the compiler makes.
_BYTES_OF_OPERATION, _BYTES_OF_CHOICE, _BYTES_OF_NUMBER = 5.5, 18.0, 2.0
_TIME_OF_LINES = "A step has no loops, and takes nearly the same time for every sample."
_TIME_OF_LOOPS = "A step has loops of fixed length, and takes nearly the same time for every sample."
_CHOICES = frozenset({"minimum", "maximum", "where", "sign"})


class Export(NamedTuple):
    """What is exported.

    name:    prefix of the symbols and files.
    title:   what it is, in one line.
    step, start: as traced, see `c_source`.
    flags:   what the bits of the output's flags mean.
    arguments: values of the further arguments of the start, for the test.
    samples: (T, m) of the test vectors.
    loops:   the step as loops; None where it is a straight line.
    """

    name: str
    title: str
    step: Program
    start: Program
    flags: type[IntFlag]
    arguments: tuple[float, ...]
    samples: np.ndarray
    loops: Loops | None = None


class Size(NamedTuple):
    """What a library takes on a microcontroller [bytes]; the state is exact, flash an estimate for Thumb-2 and -Os.

    operations: of its straight lines.
    flash: code and tables.
    """

    operations: int
    flash: int
    state: int


def size(export: Export) -> Size:
    """What the library will take."""
    loops = export.loops
    steps = [function.program for function in loops.functions] if loops else [export.step]
    programs = [expand(p, F32) for p in (export.start, *steps)]
    code = sum(map(_code_bytes, programs)) + (loops.code_bytes if loops else 0)
    tables = sum(len(array) * (1 if are_bytes(array) else 4) for array in constant_arrays(programs))
    state = sum(_bytes(m) for m in members(export.step.argument_structure.children[0]))
    return Size(sum(len(p.nodes) for p in programs), round(code) + tables, state)


def _code_bytes(program: Program) -> float:
    choices = sum(node.operation.name in _CHOICES for node in program.nodes)
    numbers = len(program.inputs) + len(program.outputs)
    others = len(program.nodes) - choices
    return _BYTES_OF_OPERATION * others + _BYTES_OF_CHOICE * choices + _BYTES_OF_NUMBER * numbers


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
                "--filter textbook-ekf, --style loops, --sample-time, a model with fewer RC pairs or a larger target"
            )


def library(export: Export) -> dict[str, str]:
    """The text of every file, by its name."""
    comments, needed = _comments(export), size(export)
    flags = {str(flag.name): flag.value for flag in export.flags}
    source = c_source(export.step, export.name, export.start, comments, flags, export.loops)
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
        "TIME": _TIME_OF_LOOPS if export.loops else _TIME_OF_LINES,
        "ARGUMENTS": "".join(f", {literal(a)}" for a in export.arguments),
        "SIGNATURE": "".join(f", float {word}" for word in export.start.argument_structure.fields[1:]),
        "SAMPLE": _table(export.step, 1, "sample", comments),
        "OUTPUT": _table(export.step, 2, "output", comments),
        "FLAGS": _flag_table(export, flags, comments),
    }
    for file in templates():
        files[file.removesuffix(".in").replace("NAME", export.name)] = filled(template(file), words)
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
        write_text(paths[-1], text)
    return paths


def _comments(export: Export) -> dict[str, str]:
    """What each member and flag means, by its path."""
    state, sample = export.step.argument_structure.children
    output = export.step.result_structure.children[1]  # type: ignore[union-attr]
    found = {f"flags.{word}": text for word, text in flag_comments(export.flags).items()}
    for struct, structure in (("state", state), ("sample", sample), ("output", output)):
        found |= {f"{struct}.{member}": text for member, text in member_comments(structure).items()}
    return found


def _table(step: Program, part: int, struct: str, comments: Mapping[str, str]) -> str:
    """A table of members in Markdown."""
    structures = (*step.argument_structure.children, step.result_structure.children[1])  # type: ignore[union-attr]
    rows = [f"| `{m.name}` | {comments.get(f'{struct}.{m.name}', '')} |" for m in members(structures[part])]
    return "\n".join(["| member | |", "|---|---|", *rows])


def _flag_table(export: Export, flags: Mapping[str, int], comments: Mapping[str, str]) -> str:
    """What the bits of the flags mean, as a section in Markdown; nothing without flags."""
    if not flags:
        return ""
    output = members(export.step.result_structure.children[1])  # type: ignore[union-attr]
    place, prefix = next(m.name for m in output if m.name.endswith("flags")), export.name.upper()
    asked = f"`{place}` is a sum; `(unsigned)output.{place} & {prefix}_{next(iter(flags))}` asks for one of them."
    rows = [f"| `{prefix}_{word}` | {value} | {comments.get(f'flags.{word}', '')} |" for word, value in flags.items()]
    return "\n".join(["", f"## {prefix}_...", "", asked, "", "| flag | | |", "|---|---|---|", *rows, ""])


def _bytes(member: Member) -> int:
    return max(1, member.size) * (4 if member.kind == "float" else 1)
