"""Lowering to C99 in single precision: start and step as straight lines, for microcontrollers.

    void NAME_start(NAME_state *state, const NAME_sample *sample, ...);
    void NAME_step(NAME_state *state, const NAME_sample *sample, NAME_output *output);

No heap, no static state, no libm but sqrtf and fabsf; exp, log and their like are those of `elementary`.
Compiled with -ffp-contract=off the results are those of the machine code in "f32" without contraction, bit by bit, on
every processor with IEEE 754 singles. Every symbol begins with NAME_.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ohmward.errors import InputError
from ohmward.trace.bounds import within
from ohmward.trace.elementary import F32, expand
from ohmward.trace.expression import Expression
from ohmward.trace.lower.c_operations import HELPERS, are_bytes, constant_arrays, is_whole, literal, position, template
from ohmward.trace.program import Program, StepStructure, serials
from ohmward.trace.structure import Leaf, Structure, leaves

_WORD = re.compile(r"[a-z][a-z0-9_]*")
#: Outputs that memset writes.
_ZEROS = (literal(0.0), literal(False))

#: With this many zeros or more, memset is shorter than setting each of them.
_WORTH_MEMSET = 8

#: For callers in C++.
_C_LINKAGE = ("#ifdef __cplusplus", 'extern "C" {', "#endif")
_END_OF_C_LINKAGE = ("#ifdef __cplusplus", "}", "#endif")


class CSource(NamedTuple):
    """A library of a step and its start."""

    header: str  #: types and prototypes
    source: str  #: the functions


class Member(NamedTuple):
    """Member of a struct: name, kind ("float" or "bool") and, of an array, its size, else 0."""

    name: str
    kind: str
    size: int

    @property
    def declaration(self) -> str:
        """Its line in the struct."""
        return f"{self.kind} {self.name}{f'[{self.size}]' if self.size else ''};"

    @property
    def places(self) -> list[str]:
        """Each of its scalars in C."""
        return [f"{self.name}[{i}]" for i in range(self.size)] if self.size else [self.name]


def c_source(
    step: Program,
    name: str,
    start: Program | None = None,
    comments: Mapping[str, str] | None = None,
    constants: Mapping[str, int] | None = None,
    loops: Loops | None = None,
) -> CSource:
    """The library of a step(state, sample) -> (state, output) and, where there is one, its start(sample, ...) -> state.

    name:     prefix of all symbols: small letters, digits and underscores.
    start:    its first argument has the structure of a sample, further ones are numbers; it becomes NAME_start.
    comments: meaning and unit of a member, by its path: "sample.current_A", "flags.GAP".
    constants: whole numbers that the header defines as NAME_WORD.
    loops:    the body of the step as loops; None for a straight line.

    Raises:
        InputError: the name is no prefix, or a function has another form.
    """
    if not _WORD.fullmatch(name):
        raise InputError(f"name must be small letters, digits and underscores, and begin with a letter, got {name!r}")
    structs = {word: members(structure) for word, structure in step.step_structure._asdict().items()}
    started = [_start(start, step.step_structure, name, structs)] if start else []
    functions = [*started, _step(step, name, structs)]
    header = _header(name, structs, functions, comments or {}, constants or {})
    return CSource(header, _source_of_loops(name, started, loops) if loops else _source(name, functions))


class Function(NamedTuple):
    """A C function."""

    comment: str  #:   its purpose, for the header
    prototype: str  #: its first line, without the semicolon
    program: Program  #:   its body
    #: the places in C of the program's inputs and outputs; `return` is the value that it returns
    inputs: list[str]
    outputs: list[str]
    #:     pointer to the struct whose members are all among the outputs; memset sets it where most are zero
    fills: str = ""


class Loops(NamedTuple):
    """A step with loops."""

    structs: Mapping[str, Structure]  #:    structs of its functions, by their name without the prefix
    functions: list[Function]  #:  straight lines that it calls
    source: str  #:     C of the step itself
    code_bytes: int  #: size of that in Thumb-2 code


def _step(program: Program, name: str, structs: dict[str, list[Member]]) -> Function:
    state, sample, output = (places(word, structs[word]) for word in ("state", "sample", "output"))
    return Function(
        "One sample: `state` moves on, `output` is filled. Nothing is allocated, nothing remembered elsewhere.",
        f"void {name}_step({name}_state *state, const {name}_sample *sample, {name}_output *output)",
        program,
        state + sample,
        state + output,
    )


def _start(program: Program, step: StepStructure, name: str, structs: dict[str, list[Member]]) -> Function:
    first, *further = program.argument_structure.children
    fits = first == step.sample and program.result_structure == step.state
    if not fits or not all(isinstance(child, Leaf) and not child.shape for child in further):
        raise InputError(f"C needs a start(sample, number, ...) -> state; {program.name} has another form")
    words = list(program.argument_structure.fields[1:])
    arguments = "".join(f", float {word}" for word in words)
    return Function(
        "The state before the first sample, which is looked at; then give that sample to the step.",
        f"void {name}_start({name}_state *state, const {name}_sample *sample{arguments})",
        program,
        places("sample", structs["sample"]) + words,
        places("state", structs["state"]),
        "state",
    )


def places(word: str, struct: list[Member]) -> list[str]:
    """Every scalar in C of a struct whose pointer is called `word`."""
    return [f"{word}->{place}" for part in struct for place in part.places]


def members(structure: Structure) -> list[Member]:
    """Members of the struct for a tree of numbers, in order."""
    found: list[Member] = []
    for path, leaf in leaves(structure):
        word = re.sub(r"\W+", "_", path).strip("_") or "value"
        word = word if word[0].isalpha() else f"x{word}"
        while word in {member.name for member in found}:
            word += "_"
        if leaf.size:
            found.append(Member(word, "bool" if leaf.boolean else "float", leaf.size if leaf.shape else 0))
    return found


def _header(
    name: str,
    structs: dict[str, list[Member]],
    functions: list[Function],
    comments: Mapping[str, str],
    constants: Mapping[str, int],
) -> str:
    guard = f"{name.upper()}_H"
    lines = [f"#ifndef {guard}", f"#define {guard}", "", "#include <stdbool.h>", "", *_C_LINKAGE, ""]
    for word, value in constants.items():
        comment = comments.get(f"flags.{word}")
        lines.append(f"#define {name.upper()}_{word} {value}{f' /* {comment} */' if comment else ''}")
    lines += [""] if constants else []
    for struct, parts in structs.items():
        lines += _typedef(name, struct, parts, comments)
    for function in functions:
        lines += [f"/* {function.comment} */", f"{function.prototype};", ""]
    return "\n".join([*lines, *_END_OF_C_LINKAGE, "", "#endif", ""])


def _typedef(name: str, struct: str, parts: list[Member], comments: Mapping[str, str]) -> list[str]:
    return ["typedef struct {", *_declarations(struct, parts, comments), f"}} {name}_{struct};", ""]


def _declarations(struct: str, parts: list[Member], comments: Mapping[str, str]) -> Iterator[str]:
    for part in parts:
        comment = comments.get(f"{struct}.{part.name}")
        yield f"    {part.declaration}{f' /* {comment} */' if comment else ''}"
    if not parts:
        yield "    char nothing; /* C99 has no empty struct */"


def _source_of_loops(name: str, started: list[Function], loops: Loops) -> str:
    typedefs = [
        line for word, structure in loops.structs.items() for line in _typedef(name, word, members(structure), {})
    ]
    return f"{_source(name, [*started, *loops.functions], typedefs)}\n{loops.source}"


def _source(name: str, functions: list[Function], typedefs: list[str] | None = None) -> str:
    functions = [function._replace(program=expand(function.program, F32)) for function in functions]
    arrays = constant_arrays([function.program for function in functions])
    writer = _CWriter(name, {f"{name}_table{k}": values for k, values in enumerate(arrays)})
    bodies = [line for function in functions for line in ("", *_body(writer, function))]
    includes = [f'#include "{name}.h"', "", "#include <math.h>", "#include <stdint.h>", "#include <string.h>", ""]
    return "\n".join([*includes, *(typedefs or []), *writer.globals(), *bodies[1:], ""])


def _body(writer: _CWriter, function: Function) -> Iterator[str]:
    """Prototype and body: inputs that are used, one line per operation, outputs."""
    program = function.program
    writer.begin()
    for symbol, place in zip(program.inputs, function.inputs, strict=True):
        if symbol.serial in program.used:
            writer.assign(symbol, place)
    floats = _used_as_numbers(program)
    for node in program.nodes:
        only_an_index = is_whole(node) and node.serial not in floats
        if not only_an_index:
            writer.assign(node, writer.formula(node))
    lines = [*writer.lines, *_results(writer, function)]
    lines = [*_unused_arguments(function.prototype, lines), *lines]
    yield from (function.prototype, "{", *(f"    {line}" for line in lines), "}")


def _used_as_numbers(program: Program) -> set[int]:
    """Serials of the values that are needed as floats: by an output, or by an operation other than a look-up."""
    others = [node for node in program.nodes if node.operation.name != "gather"]
    return serials(program.outputs) | {serial for node in others for serial in serials(node.args)}


def _results(writer: _CWriter, function: Function) -> Iterator[str]:
    """Lines that store the outputs, many zeros at once, or return them."""
    pairs = list(zip(function.outputs, map(writer.word, function.program.outputs), strict=True))
    others = [(place, word) for place, word in pairs if word not in _ZEROS]
    if function.fills and len(pairs) - len(others) >= _WORTH_MEMSET:
        yield f"memset({function.fills}, 0, sizeof *{function.fills});"
        pairs = others
    for place, word in pairs:
        yield f"return {word};" if place == "return" else f"{place} = {word};"


def _unused_arguments(prototype: str, lines: list[str]) -> Iterator[str]:
    """Lines that keep compilers from warning of arguments that no line mentions."""
    words = {word for line in lines for word in re.findall(r"\w+", line)}
    for argument in re.findall(r"(\w+)[,)]", prototype):
        if argument not in words:
            yield f"(void){argument};"


class _CWriter:
    """Lines, tables and helpers of a function while it is written.

    words:   names of the values, by serial.
    indices: names of the integers, by what they are the integer of, and the size of the tables that they index.
    """

    def __init__(self, name: str, tables: Mapping[str, tuple[float, ...]]):
        self.name = name
        self.lines: list[str] = []
        self.words: dict[int, str] = {}
        self.indices: dict[tuple[str, int], str] = {}
        self.tables = tables
        self.helpers: set[str] = set()

    def begin(self) -> None:
        """Start another function, with the same tables and helpers."""
        self.lines, self.words, self.indices = [], {}, {}

    def assign(self, node: Expression, formula: str) -> None:
        """Give the value of a node a name."""
        word = self.words[node.serial] = f"t{len(self.lines)}"
        self.lines.append(f"const {'bool' if node.boolean else 'float'} {word} = {formula};")

    def word(self, x: object) -> str:
        """Name of a value, or a literal."""
        return self.words[x.serial] if isinstance(x, Expression) else literal(x)

    def formula(self, node: Expression) -> str:
        """C of an operation."""
        if is_whole(node):
            return f"(float){self.whole(node)}"
        if node.operation.name == "gather":
            return self.entry(node)
        text = template(node)
        self.helpers |= {helper for helper in HELPERS if f"{{name}}_{helper}(" in text}
        return text.format(*(self.word(a) for a in node.args), name=self.name)

    def index(self, index: Expression, count: int) -> str:
        """The index in tables of `count` entries, computed once for all of them."""
        if is_whole(index) and within(index, 0.0, count - 1):
            return self.whole(index)
        word = self.word(index)
        if (word, count) not in self.indices:
            self.helpers.add("index")
            name = self.indices[word, count] = f"i{len(self.indices)}"
            self.lines.append(f"const int32_t {name} = {self.name}_index({word}, {count});")
        return self.indices[word, count]

    def whole(self, node: Expression) -> str:
        """The integer of a value for which `is_whole` holds: an entry of a table of bytes, or a cast for a floor."""
        is_entry = node.operation.name == "gather"
        word = self.entry(node) if is_entry else self.word(node.args[0])
        if (word, 0) not in self.indices:
            name = self.indices[word, 0] = f"i{len(self.indices)}"
            self.lines.append(f"const int32_t {name} = {word if is_entry else f'(int32_t){word}'};")
        return self.indices[word, 0]

    def entry(self, gather: Expression) -> str:
        """Entry of a table, from the constant array that holds its values."""
        values = gather.args[1]
        index = self.index(gather.args[0], len(values))
        for name, array in self.tables.items():
            if are_bytes(array) is are_bytes(values) and (first := position(values, array)) is not None:
                return f"{name}[{index} + {first}]" if first else f"{name}[{index}]"
        raise KeyError(values)

    def globals(self) -> Iterator[str]:
        """Tables, and the helpers that the functions call."""
        for name, values in self.tables.items():
            kind = "uint8_t" if are_bytes(values) else "float"
            texts = (f"{v:.0f}" if kind == "uint8_t" else literal(v) for v in values)
            yield f"static const {kind} {name}[{len(values)}] = {{{', '.join(texts)}}};"
        if self.tables:
            yield ""
        for helper in sorted(self.helpers):
            yield HELPERS[helper].replace("NAME", self.name)
