"""Lowering to C99 in single precision: start and step as straight-line code, for microcontrollers and code reviewers.

    void NAME_start(NAME_state *state, const NAME_sample *sample, ...);
    void NAME_step(NAME_state *state, const NAME_sample *sample, NAME_output *output);

Values have the names of the variables that held them in the traced code, and come in its order; a comment marks where
another of its functions begins (see `origins`). A value without a name that is used once is written where it is used.

No heap, no static state, no libm but sqrtf and fabsf; exp, log and the like are those of `elementary`.
Compiled with -ffp-contract=off, the results match the machine code in "f32" without contraction, bit for bit, on
every processor with IEEE 754 singles. Every symbol begins with NAME_.
"""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, count
from typing import NamedTuple

from ohmward.errors import InputError
from ohmward.trace.bounds import within
from ohmward.trace.elementary import F32, expand
from ohmward.trace.expression import Expression
from ohmward.trace.lower.c_operations import (
    ATOM,
    HELPERS,
    NO_NAMES,
    UNARY,
    Formula,
    are_bytes,
    comment_text,
    constant_arrays,
    is_whole,
    literal,
    position,
    template,
)
from ohmward.trace.operations import INPUT
from ohmward.trace.origins import Origin
from ohmward.trace.program import Program, StepStructure, serials
from ohmward.trace.structure import Leaf, Structure, leaves

_WORD = re.compile(r"[a-z][a-z0-9_]*")
#: Literals of outputs that memset can write.
_ZEROS = (literal(0.0), literal(False))

#: With this many zeros or more, memset is shorter than setting each of them.
_WORTH_MEMSET = 8

#: Width of tables and comments, and of the longest formula that is written inside another one.
_LINE_WIDTH, _LONGEST_INLINE = 110, 60

#: Clang fuses a product and a sum of one expression unless this forbids it; GCC does not know the pragma.
_NO_CONTRACTION = ("#if defined(__clang__)", "#pragma STDC FP_CONTRACT OFF", "#endif", "")

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
    comments: meaning and unit of a member, by its path: "sample.current_A", "flags.GAP"; "start": of its arguments.
    constants: whole numbers that the header defines as NAME_WORD.
    loops:    the body of the step as loops; None for straight-line code.

    Raises:
        InputError: the name cannot be a prefix, or a function has another form.
    """
    if not _WORD.fullmatch(name):
        raise InputError(f"name must be small letters, digits and underscores, and begin with a letter, got {name!r}")
    structs = {word: members(structure) for word, structure in step.step_structure._asdict().items()}
    note = (comments or {}).get("start", "")
    started = [_start(start, step.step_structure, name, structs, note)] if start else []
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
    #:     pointer to the struct whose members are all among the outputs; memset clears it where many are zero
    fills: str = ""


class Loops(NamedTuple):
    """A step with loops."""

    structs: Mapping[str, Structure]  #:    structs of its functions, by their name without the prefix
    functions: list[Function]  #:  straight-line functions that it calls
    source: str  #:     C of the step itself
    code_bytes: int  #: its size in Thumb-2 code


def _step(program: Program, name: str, structs: dict[str, list[Member]]) -> Function:
    state, sample, output = (places(word, structs[word]) for word in ("state", "sample", "output"))
    return Function(
        "One sample: `state` moves on, `output` is filled. Nothing is allocated, nothing remembered elsewhere.",
        f"void {name}_step({name}_state *state, const {name}_sample *sample, {name}_output *output)",
        program,
        state + sample,
        state + output,
    )


def _start(program: Program, step: StepStructure, name: str, structs: dict[str, list[Member]], note: str) -> Function:
    first, *further = program.argument_structure.children
    fits = first == step.sample and program.result_structure == step.state
    if not fits or not all(isinstance(child, Leaf) and not child.shape for child in further):
        raise InputError(f"C needs a start(sample, number, ...) -> state; {program.name} has another form")
    words = list(program.argument_structure.fields[1:])
    arguments = "".join(f", float {word}" for word in words)
    return Function(
        f"The state before the first sample; then give that sample to the step.{note}",
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
        lines += _comment(function.comment)
        lines += [f"{function.prototype};", ""]
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
    structs = [_typedef(name, word, members(structure), {}) for word, structure in loops.structs.items()]
    typedefs = list(chain.from_iterable(structs))
    return f"{_source(name, [*started, *loops.functions], typedefs)}\n{loops.source}"


def _source(name: str, functions: list[Function], typedefs: list[str] | None = None) -> str:
    functions = [function._replace(program=expand(function.program, F32)) for function in functions]
    programs = [function.program for function in functions]
    arrays = constant_arrays(programs)
    tables = {f"{name}_table{k}": values for k, values in enumerate(arrays)}
    writer = _CWriter(name, tables, table_users(programs))
    bodies: list[str] = []
    for function in functions:
        bodies += ["", *_body(writer, function)]
    includes = [f'#include "{name}.h"', "", "#include <math.h>", "#include <stdint.h>", "#include <string.h>", ""]
    includes += _NO_CONTRACTION
    return "\n".join([*includes, *(typedefs or []), *writer.globals(), *bodies[1:], ""])


def _body(writer: _CWriter, function: Function) -> Iterator[str]:
    """Prototype and body: inputs that are used, statements in the order of the traced code, outputs."""
    program = function.program
    writer.begin(program, re.findall(r"(\w+)[,)]", function.prototype))
    made, others = _outputs(function)
    used = serials(x for _, x in others).union(*(serials(node.args) for node in program.nodes))
    for symbol, place in zip(program.inputs, function.inputs, strict=True):
        if symbol.serial in used:
            writer.read(symbol, place)
    if function.fills and len(zeros := [pair for pair in others if writer.word(pair[1]) in _ZEROS]) >= _WORTH_MEMSET:
        writer.lines.append(f"(void)memset({function.fills}, 0, sizeof *{function.fills});")
        others = [pair for pair in others if pair not in zeros]
    floats, places = _used_as_numbers(program), _places(program)
    for node in program.in_order_made:
        only_an_index = is_whole(node) and node.serial not in floats
        if not only_an_index:
            writer.write(node, places[node.serial] == 1, node.serial in made)
        for place in made.get(node.serial, ()):
            writer.explain(node)
            writer.store(place, node)
    for place, x in others:
        writer.store(place, x)
    lines = [*_unused_arguments(function.prototype, writer.lines), *writer.lines]
    yield from (function.prototype, "{", *(f"    {line}" for line in lines), "}")


def _outputs(function: Function) -> tuple[dict[int, list[str]], list[tuple[str, object]]]:
    """Places of the outputs that an operation computes, by its serial; and of the others, inputs and constants.

    An input that stays in its place is in neither.
    """
    made: dict[int, list[str]] = {}
    others: list[tuple[str, object]] = []
    own = {symbol.serial: place for symbol, place in zip(function.program.inputs, function.inputs, strict=True)}
    for place, x in zip(function.outputs, function.program.outputs, strict=True):
        if isinstance(x, Expression) and x.operation is not INPUT:
            made.setdefault(x.serial, []).append(place)
        elif not isinstance(x, Expression) or own[x.serial] != place:
            others.append((place, x))
    return made, others


def _places(program: Program) -> Counter[int]:
    """Number of places in which the value of a serial is written."""
    places: Counter[int] = Counter(x.serial for x in program.outputs if isinstance(x, Expression))
    for node in program.nodes:
        plain = node.operation.name != "gather" and not is_whole(node)
        for k, argument in enumerate(node.args):
            if isinstance(argument, Expression):
                # an index gets a line of its own: GCC makes more code for the cast of a choice
                places[argument.serial] += template(node).text.count(f"{{{k}}}") if plain else 2
    return places


def _used_as_numbers(program: Program) -> set[int]:
    """Serials of the values that are needed as floats: by an output, or by an operation other than a look-up."""
    others = [node for node in program.nodes if node.operation.name != "gather"]
    return serials(program.outputs) | {serial for node in others for serial in serials(node.args)}


def _unused_arguments(prototype: str, lines: list[str]) -> Iterator[str]:
    """Lines that keep compilers from warning of arguments that no line mentions."""
    words = {word for line in lines for word in re.findall(r"\w+", line)}
    for argument in re.findall(r"(\w+)[,)]", prototype):
        if argument not in words:
            yield f"(void){argument};"


def table_users(programs: Iterable[Program]) -> dict[tuple[float, ...], list[str]]:
    """Functions of the traced code that look into each table."""
    users: dict[tuple[float, ...], list[str]] = {}
    for program in programs:
        for node in program.in_order_made:
            origin = program.origins.origin(node.serial) if program.origins else None
            if node.operation.name == "gather" and origin:
                users.setdefault(node.args[1], []).append(f"{origin.name} ({origin.file})")
    return users


def _holds(array: tuple[float, ...], table: tuple[float, ...]) -> bool:
    """True where an array holds the values of a table in the same type of numbers."""
    return are_bytes(array) is are_bytes(table) and position(table, array) is not None


def _comment(text: str) -> list[str]:
    """Lines of a comment."""
    return textwrap.wrap(f"/* {comment_text(text)} */", _LINE_WIDTH, subsequent_indent="   ")


class _CWriter:
    """Lines, tables and helpers of a function while it is written."""

    def __init__(
        self, name: str, tables: Mapping[str, tuple[float, ...]], users: Mapping[tuple[float, ...], list[str]]
    ):
        self.name = name
        self.tables = tables
        self.users = users  # functions of the traced code, by the table that they look into
        self.helpers: set[str] = set()

    def begin(self, program: Program, taken: Iterable[str]) -> None:
        """Start another function, with the same tables and helpers; taken: words that cannot name values."""
        self.lines: list[str] = []
        self.origins = program.origins
        self.block: Origin | None = None
        self.explained: set[Origin] = set()
        self.formulas: dict[int, Formula] = {}  # of the values, by serial: names, or formulas in their places
        self.words: set[str] = {*taken, *NO_NAMES}
        self.free_numbers: dict[str, int] = {}  # by name, the least suffix that may be free
        #: names of the integers, by the value that they convert and the size of the tables that they index
        self.indices: dict[tuple[str, int], str] = {}

    def read(self, symbol: Expression, place: str) -> None:
        """Read an input: an argument by its own name, a member of a struct by a name like it."""
        if "->" in place:
            _, _, member = place.partition("->")
            self.declare(symbol, Formula(place, ATOM), re.sub(r"\W+", "_", member).strip("_"))
        else:
            self.formulas[symbol.serial] = Formula(place, ATOM)

    def write(self, node: Expression, only_once: bool, is_output: bool) -> None:
        """Write a value: inside its only use if it is short and has no name or is an output, else on a line."""
        formula = self.formula(node)
        name = self.origins.name(node.serial) if self.origins else ""
        if only_once and (is_output or not name) and len(formula.text) <= _LONGEST_INLINE:
            self.formulas[node.serial] = formula
        else:
            self.explain(node)
            self.declare(node, formula, name)

    def store(self, place: str, x: object) -> None:
        """Store an output, or return it."""
        self.lines.append(f"return {self.word(x)};" if place == "return" else f"{place} = {self.word(x)};")

    def explain(self, node: Expression) -> None:
        """Write a comment where another function of the traced code begins."""
        origin = self.origins.origin(node.serial) if self.origins else None
        if origin and origin != self.block:
            text = origin.name if origin in self.explained else f"{origin.name} ({origin.file}): {origin.summary}"
            self.lines += _comment(text)
            self.explained.add(origin)
            self.block = origin

    def declare(self, node: Expression, formula: Formula, name: str) -> None:
        """Give a value a name."""
        word = self.formulas[node.serial] = Formula(self.new_word(name), ATOM)
        self.lines.append(f"const {'bool' if node.boolean else 'float'} {word.text} = {formula.text};")

    def new_word(self, name: str) -> str:
        """The name, with a number if it is taken."""
        name = name if re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) else "t"
        if name != "t" and name not in self.words:
            self.words.add(name)
            return name
        joint = "_" if name[-1].isdigit() else ""
        number = next(k for k in count(self.free_numbers.get(name, 2)) if f"{name}{joint}{k}" not in self.words)
        self.free_numbers[name] = number + 1  # words are never given back
        self.words.add(word := f"{name}{joint}{number}")
        return word

    def word(self, x: object) -> str:
        """C of a value where it is used."""
        return self.formula_of(x).text

    def formula_of(self, x: object) -> Formula:
        """Formula of a value where it is used: its name, its formula or a literal."""
        return self.formulas[x.serial] if isinstance(x, Expression) else Formula(literal(x), ATOM)

    def formula(self, node: Expression) -> Formula:
        """C of an operation."""
        if is_whole(node):
            return Formula(f"(float){self.whole(node)}", UNARY)
        if node.operation.name == "gather":
            return Formula(self.entry(node), ATOM)
        how = template(node)
        self.helpers |= {helper for helper in HELPERS if f"{{name}}_{helper}(" in how.text}
        words = [
            f"({f.text})" if f.rank > most else f.text
            for f, most in zip(map(self.formula_of, node.args), how.most, strict=False)
        ]
        return Formula(how.text.format(*words, name=self.name), how.rank)

    def index(self, index: Expression, count: int) -> str:
        """The index in tables of `count` entries, computed once for all of them."""
        if is_whole(index) and within(index, 0.0, count - 1):
            return self.whole(index)
        word = self.word(index)
        if (word, count) not in self.indices:
            self.helpers.add("index")
            self.integer((word, count), f"{self.name}_index({word}, {count})")
        return self.indices[word, count]

    def whole(self, node: Expression) -> str:
        """The integer of a value for which `is_whole` holds: an entry of a table of bytes, or a cast for a floor."""
        is_entry = node.operation.name == "gather"
        value = Formula(self.entry(node), ATOM) if is_entry else self.formula_of(node.args[0])
        if (value.text, 0) not in self.indices:
            cast = f"(int32_t){value.text}" if value.rank <= UNARY else f"(int32_t)({value.text})"
            self.integer((value.text, 0), value.text if is_entry else cast)
        return self.indices[value.text, 0]

    def integer(self, of: tuple[str, int], formula: str) -> None:
        """Give an integer a name."""
        name = self.indices[of] = self.new_word("i0") if not self.indices else self.new_word(f"i{len(self.indices)}")
        self.lines.append(f"const int32_t {name} = {formula};")

    def entry(self, gather: Expression) -> str:
        """Entry of a table, from the constant array that holds its values."""
        values = gather.args[1]
        index = self.index(gather.args[0], len(values))
        name, array = next((name, array) for name, array in self.tables.items() if _holds(array, values))
        first = position(values, array)
        return f"{name}[{index} + {first}]" if first else f"{name}[{index}]"

    def globals(self) -> Iterator[str]:
        """Tables, and the helpers that the functions call."""
        for name, values in self.tables.items():
            kind = "uint8_t" if are_bytes(values) else "float"
            texts = (f"{v:.0f}" if kind == "uint8_t" else literal(v) for v in values)
            users = [word for table, words in self.users.items() if _holds(values, table) for word in words]
            yield from _comment(", ".join(dict.fromkeys(users))) if users else ()
            yield f"static const {kind} {name}[{len(values)}] = {{"
            yield from textwrap.wrap(", ".join(texts), _LINE_WIDTH, initial_indent="    ", subsequent_indent="    ")
            yield "};"
        if self.tables:
            yield ""
        for helper in sorted(self.helpers):
            yield HELPERS[helper].replace("NAME", self.name)
