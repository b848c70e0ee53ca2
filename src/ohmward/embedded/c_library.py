"""A C99 library as files: source, header, test vectors with their test, build files, a README."""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from enum import IntFlag
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward import __version__
from ohmward.atomic import write_text
from ohmward.embedded.comments import flag_comments, member_comments
from ohmward.errors import InputError, OhmwardError
from ohmward.trace import Program, single_precision
from ohmward.trace.elementary import F32, expand
from ohmward.trace.lower.c_operations import are_bytes, constant_arrays, literal
from ohmward.trace.lower.c_source import Loops, c_source, members
from ohmward.trace.structure import Structure


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
    return resources.files("ohmward.embedded") / "templates"


# Bytes of Thumb-2 code, compiled with -Os: of an operation, of a selection, of a number read or written. Fitted
# to all filters; `tests/embedded/test_size.py` compares them with the compiler's.
_BYTES_OF_OPERATION = 5.5
_BYTES_OF_CHOICE = 18.0
_BYTES_OF_NUMBER = 2.0
_CHOICES = frozenset({"minimum", "maximum", "where", "sign"})

#: Number of samples of an export with which Python and C are compared.
VECTORS = 64


class VoltageStartPrograms(NamedTuple):
    """Start from the first voltage, see `VoltageStart`."""

    expected: Program  #: voltage expected at one state of charge, (soc, sample) -> `ExpectedVoltage`
    state: Program  #:    (sample, *hypotheses) -> state


class Export(NamedTuple):
    """An estimator or controller, traced for export."""

    name: str  #:    prefix of the symbols and files
    title: str  #:   its description in one line
    #: as traced, see `c_source`
    step: Program
    start: Program
    flags: type[IntFlag]  #:   meanings of the bits of the output's flags
    arguments: tuple[float, ...]  #: values of the start's arguments after the sample, for the test
    samples: np.ndarray  #: (T, m) of the test vectors
    loops: Loops | None = None  #:   the step as loops; None for straight-line code
    #: start from the first voltage, for a Python file; None where it cannot be traced
    voltage_start: VoltageStartPrograms | None = None
    start_note: str = ""  #:   meaning of the start's arguments, a sentence


class Size(NamedTuple):
    """Memory of a library on a microcontroller [bytes]; the state is exact, flash an estimate for Thumb-2 and -Os."""

    operations: int  #: number of operations in its straight-line code
    flash: int  #: code and tables
    state: int  #: one state


def size(export: Export) -> Size:
    """Memory that the library will take."""
    loops = export.loops
    steps = [function.program for function in loops.functions] if loops else [export.step]
    programs = [expand(p, F32) for p in (export.start, *steps)]
    code = sum(map(_code_bytes, programs)) + (loops.code_bytes if loops else 0)
    tables = sum(len(array) * (1 if are_bytes(array) else 4) for array in constant_arrays(programs))
    places = [(max(1, m.size), m.kind) for m in members(export.step.step_structure.state)]
    state = sum(count * (4 if kind == "float" else 1) for count, kind in places)
    return Size(sum(len(p.nodes) for p in programs), round(code) + tables, state)


def _code_bytes(program: Program) -> float:
    choices = sum(node.operation.name in _CHOICES for node in program.nodes)
    numbers = len(program.inputs) + len(program.outputs)
    others = len(program.nodes) - choices
    return _BYTES_OF_OPERATION * others + _BYTES_OF_CHOICE * choices + _BYTES_OF_NUMBER * numbers


def check_fits(export: Export, flash_bytes: float | None, ram_bytes: float | None) -> None:
    """Raise InputError if the library takes more flash or RAM than there is; the message names smaller choices."""
    needed = size(export)
    for what, bytes_, limit in (("flash", needed.flash, flash_bytes), ("RAM", needed.state, ram_bytes)):
        if limit is not None and bytes_ > limit:
            raise InputError(
                f"{export.title} needs about {bytes_} bytes of {what}, more than the {limit:g} there are; choose "
                "--filter textbook-ekf, --style loops, --sample-time, a model with fewer RC pairs or a larger target"
            )


def library(export: Export) -> dict[str, str]:
    """Text of every file, by its name."""
    comments = _comments(export)
    flags = {str(flag.name): flag.value for flag in export.flags}
    source = c_source(export.step, export.name, export.start, comments, flags, export.loops)
    files = {f"{export.name}.h": source.header, f"{export.name}.c": source.source}
    words = _words(export, flags, comments)
    words["IDENTITY"] = f"0x{zlib.crc32((source.header + source.source).encode()):08X}"
    words |= vector_words(export.step, export.start, export.arguments, export.samples)
    for file in templates():
        files[file.removesuffix(".in").replace("NAME", export.name)] = filled(template(file), words)
    return files


def _words(export: Export, flags: Mapping[str, int], comments: Mapping[str, str]) -> dict[str, str]:
    needed, structure = size(export), export.step.step_structure
    return {
        "NAME": export.name,
        "UPPER": export.name.upper(),
        "VERSION": __version__,
        "TITLE": export.title,
        "STATE_BYTES": str(needed.state),
        "FLASH_BYTES": f"{round(needed.flash, -2)}",
        "LOOPS": "loops of fixed length" if export.loops else "no loops",
        "ARGUMENTS": "".join(f", {literal(a)}" for a in export.arguments),
        "START": comments["start"],
        "SIGNATURE": "".join(f", float {word}" for word in export.start.argument_structure.fields[1:]),
        "SAMPLE": _table(structure.sample, "sample", comments),
        "OUTPUT": _table(structure.output, "output", comments),
        "SAMPLE_VALUES": str(len(scalars(structure.sample))),
        "OUTPUT_VALUES": str(len(scalars(structure.output))),
        "SAMPLE_TO_VALUES": _to_values(structure.sample, "sample"),
        "OUTPUT_TO_VALUES": _to_values(structure.output, "output"),
        "FLAGS": _flag_table(export, flags, comments),
    }


#: The file that names ohmward as its author, where there are several.
_SIGNED = "README.md"
#: How it does so, with the version; other texts may mention ohmward too.
_AUTHOR = re.compile(r"(exported|Written) by ohmward \d")
#: Number of characters at its beginning that are searched for that.
_HEAD = 500


def write_library(files: Mapping[str, str], folder: Path) -> list[Path]:
    """Write the files into a folder, which is made if it does not exist; each file is complete or unchanged.

    Raises:
        OhmwardError: the folder or a file cannot be written, or a file of that name exists that no export wrote.
    """
    there = [folder / name for name in files if (folder / name).exists()]
    signed = folder / (_SIGNED if _SIGNED in files else next(iter(files)))
    head = signed.read_text(encoding="utf-8", errors="replace")[:_HEAD] if signed.is_file() else ""
    if there and not _AUTHOR.search(head):
        raise OhmwardError(f"{there[0]} was not written by ohmward, and is kept; choose another folder with -o")
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
    """Meaning of each member and flag, by its path."""
    found = {f"flags.{word}": text for word, text in flag_comments(export.flags).items()}
    for struct, structure in export.step.step_structure._asdict().items():
        found |= {f"{struct}.{member}": text for member, text in member_comments(structure).items()}
    sum_of_flags, of_c = f"`{export.flags.__name__}`", f"{export.name.upper()}_..."
    found = {member: text.replace(sum_of_flags, of_c) for member, text in found.items()}
    return found | {"start": f" {export.start_note}" if export.start_note else ""}


def _to_values(structure: Structure, struct: str) -> str:
    """Lines of C that copy every scalar of a struct into an array of floats."""
    lines = []
    for k, (place, kind) in enumerate(scalars(structure)):
        value = f"{struct}->{place}"
        lines.append(f"    values[{k}] = {f'{value} ? 1.0f : 0.0f' if kind == 'bool' else value};")
    return "\n".join(lines)


def _table(structure: Structure, struct: str, comments: Mapping[str, str]) -> str:
    rows = [f"| `{m.name}` | {comments.get(f'{struct}.{m.name}', '')} |" for m in members(structure)]
    return "\n".join(["| member | |", "|---|---|", *rows])


def _flag_table(export: Export, flags: Mapping[str, int], comments: Mapping[str, str]) -> str:
    """Section in Markdown with the meanings of the bits of the flags; nothing without flags."""
    if not flags:
        return ""
    prefix = export.name.upper()
    place = next(m.name for m in members(export.step.step_structure.output) if m.name.endswith("flags"))
    asked = f"`{place}` is a sum; `(unsigned)output.{place} & {prefix}_{next(iter(flags))}` asks for one of them."
    rows = [f"| `{prefix}_{word}` | {value} | {comments.get(f'flags.{word}', '')} |" for word, value in flags.items()]
    return "\n".join(["", f"## {prefix}_...", "", asked, "", "| flag | | |", "|---|---|---|", *rows, ""])


def vector_words(step: Program, start: Program, arguments: tuple[float, ...], samples: np.ndarray) -> dict[str, str]:
    """Words of templates/NAME_vectors.h.in: samples (T, m), the outputs (T, k) after them, filling and comparing.

    arguments: of the start, after the sample.
    """
    singles = np.asarray(samples, np.float32)
    first = np.concatenate([singles[0], np.array(arguments, np.float32)])
    state = single_precision.evaluator(start)(first)
    _, outputs = single_precision.run(step, state, singles)
    filled_with = {"bool": "*bits++ != 0u", "float": "from_bits(*bits++)"}
    same = {"bool": "output->{} == (*bits++ != 0u)", "float": "is(output->{}, *bits++)"}
    sample, output = (scalars(of) for of in (step.step_structure.sample, step.step_structure.output))
    return {
        "VECTORS": str(len(singles)),
        "SAMPLE_BITS": _array_of_bits(singles),
        "OUTPUT_BITS": _array_of_bits(outputs),
        "FILL_SAMPLE": "\n".join(f"    sample->{place} = {filled_with[kind]};" for place, kind in sample),
        "COMPARE_OUTPUT": "\n".join(f"    same = same && {same[kind].format(place)};" for place, kind in output),
    }


def scalars(structure: Structure) -> list[tuple[str, str]]:
    """Place in the struct and kind, "float" or "bool", of every scalar."""
    return [(place, member.kind) for member in members(structure) for place in member.places]


def _array_of_bits(values: np.ndarray) -> str:
    """Size and rows of an array of numbers as their bits; nan is nan, whatever its sign."""
    bits = np.where(np.isnan(values), np.float32(np.nan), values).astype(np.float32).view(np.uint32)
    rows = [f"    {{{', '.join(f'0x{b:08X}u' for b in row)}}}," for row in bits]
    return "\n".join([f"[{len(bits)}][{bits.shape[1]}] = {{", *rows, "}"])
