"""Lowering to Python source: one call, or a whole log with the loop inside.

The fast code lets Python raise where IEEE 754 has a result (1/0, sqrt(-1), exp(1000)), and that one step runs again in
a safe twin, which calls the definitions in `ieee`. A value that is used once is written into the formula that uses it.
"""

import keyword
import math
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import count
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import ieee
from ohmward.trace.expression import Expression
from ohmward.trace.operations import ATOM, CHOICE, COMPARE, INPUT, OPERATIONS, SIGN
from ohmward.trace.program import Program
from ohmward.trace.structure import Leaf, Structure, leaves

#: Formulas nest no deeper than this; Python's parser has a limit near 100.
_MAX_DEPTH = 12

_FUNCTIONS: dict[str, Any] = {
    **{name: getattr(math, name) for name in ("sqrt", "exp", "expm1", "log", "log1p", "sin", "cos", "tan", "sinh")},
    **{name: getattr(math, name) for name in ("cosh", "tanh", "isfinite", "inf", "nan", "ldexp", "frexp")},
    "power": math.pow,
    "arctan": math.atan,
    "arctan2": math.atan2,
    "arcsinh": math.asinh,
    "array": np.array,
    "asarray": np.asarray,
}


Table = tuple[float, ...]


class Body(NamedTuple):
    """The straight-line code of a program."""

    inputs: list[str]  #:  name of every input
    lines: list[str]  #:   assignments
    results: list[str]  #: names that the lines assign and outputs need
    outputs: list[str]  #: name or literal of every output
    tables: dict[str, Table]  #:  values of the gathers, by name


def body(program: Program, safe: bool = False) -> Body:
    """Names and formulas of every operation; `safe` spells the risky ones as calls of their definitions."""
    inputs = input_names(program)
    text = {s.serial: name for s, name in zip(program.inputs, inputs, strict=True)}
    binding, depth = dict.fromkeys(text, ATOM), dict.fromkeys(text, 0)
    lines: list[str] = []
    tables: dict[str, Table] = {}
    named = _named(program, safe)
    for node in program.nodes:
        arguments = [a for a in node.args if isinstance(a, Expression)]
        text[node.serial], binding[node.serial] = _formula(node, text, binding, tables, safe)
        depth[node.serial] = 1 + max(depth[a.serial] for a in arguments)
        if node.serial in named or depth[node.serial] > _MAX_DEPTH:
            name = f"t{len(lines)}"
            lines.append(f"{name} = {text[node.serial]}")
            text[node.serial], binding[node.serial], depth[node.serial] = name, ATOM, 0
    outputs = [text[y.serial] if isinstance(y, Expression) else repr(y) for y in program.outputs]
    results = [text[y.serial] for y in program.outputs if isinstance(y, Expression) and y.operation is not INPUT]
    return Body(inputs, lines, list(dict.fromkeys(results)), outputs, tables)


def _named(program: Program, safe: bool) -> set[int]:
    """Serials of the nodes that get a variable: used more than once, or an output."""
    uses = Counter({y.serial: 2 for y in program.outputs if isinstance(y, Expression)})
    for node in program.nodes:
        template, _ = _template(node, safe)
        for place, argument in enumerate(node.args):
            if isinstance(argument, Expression):
                uses[argument.serial] += max(template.count(f"{{{place}}}"), 1)
    return {serial for serial, count in uses.items() if count > 1}


def _template(node: Expression, safe: bool) -> tuple[str, int]:
    operation = node.operation
    if safe and operation.risky:
        return f"{operation.name}({', '.join(f'{{{i}}}' for i in range(operation.arity))})", ATOM
    return operation.python, operation.binding


def _formula(
    node: Expression, text: dict[int, str], binding: dict[int, int], tables: dict[str, Table], safe: bool
) -> tuple[str, int]:
    """Source of a node in terms of its arguments, and its binding strength."""
    template, strength = _template(node, safe)
    words = []
    for place, arg in enumerate(node.args):
        if isinstance(arg, Expression):
            word, weak = text[arg.serial], _needs_parentheses(binding[arg.serial], strength, place)
            words.append(f"({word})" if weak else word)
        else:
            words.append(_table(tables, arg) if isinstance(arg, tuple) else repr(arg))
    return template.format(*words), strength


def _needs_parentheses(inner: int, outer: int, place: int) -> bool:
    if outer == ATOM:
        return False
    left_of_arithmetic = place == 0 and outer not in (CHOICE, COMPARE, SIGN)
    return inner < outer if left_of_arithmetic else inner <= outer


def _table(tables: dict[str, Table], values: Table) -> str:
    for name, known in tables.items():
        if known is values or known == values:
            return name
    name = f"table{len(tables)}"
    tables[name] = values
    return name


def input_names(program: Program) -> list[str]:
    """A Python name for every input: `belief.mean[0]` -> `belief_mean_0`; none begins with `_`."""
    names: list[str] = []
    for symbol in program.inputs:
        name = re.sub(r"\W+", "_", symbol.name).strip("_")
        name = name if name[:1].isalpha() else f"x{name}"
        while name in names or name in _RESERVED or keyword.iskeyword(name) or re.fullmatch(r"(t|table)\d+", name):
            name += "_"
        names.append(name)
    return names


_RESERVED = {*_FUNCTIONS, *OPERATIONS, "abs", "int", "float", "bool", "zip", "emit", "columns", "state"}


# ---- whole functions


def step_source(code: Body) -> str:
    """`step(*inputs) -> (*results)`, all scalars: the program to read, and the form of the safe twin."""
    return "\n".join([f"def step({', '.join(code.inputs)}):", *_indent(code.lines), f"    return {_row(code.results)}"])


def call_source(code: Body, program: Program) -> str:
    """`call(*arguments)` with the structure of the traced function."""
    children = program.argument_structure.children
    arguments = [f"_{i}" for i in range(len(children))]
    names = iter(code.inputs)
    unpack = [line for child, a in zip(children, arguments, strict=True) for line in _unpack(child, a, names)]
    result = _pack(program.result_structure, iter(code.outputs), count())
    lines = [*unpack, *_guarded(code), f"return {result}"]
    return "\n".join([f"def call({', '.join(arguments)}):", *_indent(lines)])


def scan_source(code: Body, state_size: int) -> str:
    """`scan(state, columns, emit) -> state` over rows of samples; the first inputs and outputs are the state."""
    state, sample = code.inputs[:state_size], code.inputs[state_size:]
    after, output = code.outputs[:state_size], code.outputs[state_size:]
    moved = [(old, new) for old, new in zip(state, after, strict=True) if old != new]
    loop = [
        *_guarded(code),
        *([f"emit({_row(output)})"] if output else []),
        *([f"{_row([old for old, _ in moved])} = {_row([new for _, new in moved])}"] if moved else []),
    ]
    lines = [
        f"{_row(state)} = state",
        f"for {_row(sample)} in zip(*columns):",
        *_indent(loop or ["pass"]),
        f"return {_row(state)}",
    ]
    return "\n".join(["def scan(state, columns, emit):", *_indent(lines)])


def live_source(program: Program, state_size: int, flags: bool) -> str:
    """`live(sample) -> output` around machine code that has its samples, outputs and state in memory of its own.

    flags: the output's field `flags` is looked up in the table `_flags`.
    """
    _, sample, output = program.step_structure
    inputs = input_names(program)[state_size:]
    results = [f"y{i}" for i in range(len(program.outputs) - state_size)]
    kinds = ((name, leaf.boolean) for name, leaf in leaves(output) for _ in range(leaf.size))
    named = zip(results, kinds, strict=True)
    typed = iter([_typed(y, boolean, flags and name == "flags") for y, (name, boolean) in named])
    lines = [
        *_unpack(sample, "_sample", iter(inputs), "{}"),
        f"_write(_inputs, 0, {', '.join(inputs)})",
        "_run()",
        *([f"{_row(results)} = _read(_outputs)"] if results else []),
        f"return {_pack(output, typed, count())}",
    ]
    return "\n".join(["def live(_sample):", *_indent(lines)])


def _guarded(code: Body) -> list[str]:
    """The straight-line code, and its safe twin for the steps in which Python raises."""
    if not code.lines:
        return []
    twin = f"{_row(code.results)} = _safe_step({', '.join(code.inputs)})"
    return ["try:", *_indent(code.lines), "except _ERRORS:", f"    {twin}"]


def _typed(name: str, boolean: bool, flag: bool) -> str:
    """A number from machine code as the flag, condition or number that it represents."""
    if flag:
        return f"_flags[{name}]"
    return f"{name} != 0.0" if boolean else name


def _unpack(structure: Structure, source: str, names: Iterator[str], number: str = "float({})") -> list[str]:
    """Lines that give every scalar of an argument its name, as a Python float or bool.

    number: template that converts a bare number to a float; "{}" where the user of the names does so.
    """
    if isinstance(structure, Leaf):
        kind = structure.dtype.__name__
        if not structure.shape:
            convert = "bool({})" if structure.boolean else number
            return [f"{next(names)} = {convert.format(source)}"]
        return [f"{_nested(structure.shape, names)} = asarray({source}, {kind}).tolist()"]
    parts = [f"{source}_{i}" for i in range(len(structure.children))]
    children = zip(structure.children, parts, strict=True)
    return [f"{_row(parts)} = {source}", *(line for child, p in children for line in _unpack(child, p, names, number))]


def _nested(shape: tuple[int, ...], names: Iterator[str]) -> str:
    """`((a, b), (c, d))` for shape (2, 2)."""
    return _row([_nested(shape[1:], names) for _ in range(shape[0])]) if shape else next(names)


def _pack(structure: Structure, outputs: Iterator[str], numbers: Iterator[int]) -> str:
    """The expression that builds the result."""
    if isinstance(structure, Leaf):
        if not structure.shape:
            return next(outputs)
        values = _row([next(outputs) for _ in range(structure.size)])
        reshape = f".reshape({structure.shape})" if len(structure.shape) != 1 else ""
        return f"array({values}, {structure.dtype.__name__}){reshape}"
    name = f"_structure{next(numbers)}" if structure.type is not tuple else ""
    return name + _row([_pack(child, outputs, numbers) for child in structure.children])


def _row(names: list[str]) -> str:
    """Source of a tuple of any number of names."""
    return f"({', '.join(names)}{',' if len(names) == 1 else ''})"


def _indent(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]


# ---- compiled


def compile_call(program: Program) -> Callable[..., Any]:
    """The function of `call_source`."""
    code = body(program)
    types = {f"_structure{i}": t for i, t in enumerate(_types(program.result_structure))}
    return _compile(call_source(code, program), "call", {**_namespace(program, code), **types})


def compile_live(
    program: Program,
    state_size: int,
    run: Callable[[], None],
    inputs: np.ndarray,
    outputs: np.ndarray,
    flags: Mapping[float, Any] | None,
) -> Callable[..., Any]:
    """The function of `live_source`.

    run: one step of the machine code from inputs to outputs (n,) of float64.
    flags: values for the output's field `flags`; None leaves it a number.
    """
    types = {f"_structure{i}": t for i, t in enumerate(_types(program.step_structure.output))}
    samples, results = len(program.inputs) - state_size, len(program.outputs) - state_size
    namespace = {
        **_FUNCTIONS,
        **types,
        "_write": struct.Struct(f"{samples}d").pack_into,
        "_read": struct.Struct(f"{results}d").unpack_from,
        "_run": run,
        "_inputs": inputs,
        "_outputs": outputs,
        "_flags": flags,
    }
    return _compile(live_source(program, state_size, flags is not None), "live", namespace)


def compile_scan(program: Program, state_size: int) -> Callable[..., Any]:
    """The function of `scan_source`."""
    code = body(program)
    return _compile(scan_source(code, state_size), "scan", _namespace(program, code))


def _namespace(program: Program, code: Body) -> dict[str, Any]:
    @cache
    def twin() -> Callable[..., Any]:
        safe_functions = {o.name: o.compute for o in OPERATIONS.values() if o.risky}
        safe = body(program, safe=True)
        return _compile(step_source(safe), "step", {**_FUNCTIONS, **safe_functions, **safe.tables})

    return {**_FUNCTIONS, **code.tables, "_ERRORS": ieee.ERRORS, "_safe_step": lambda *inputs: twin()(*inputs)}


def _types(structure: Structure) -> list[type]:
    """The NamedTuples of a structure, in the order in which `_pack` meets them."""
    if isinstance(structure, Leaf):
        return []
    own = [] if structure.type is tuple else [structure.type]
    return own + [t for child in structure.children for t in _types(child)]


def _compile(source: str, name: str, namespace: dict[str, Any]) -> Callable[..., Any]:
    exec(compile(source, f"<ohmward trace: {name}>", "exec"), namespace)
    function: Callable[..., Any] = namespace[name]
    return function
