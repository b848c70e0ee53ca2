"""Lowering to Python source: one call, or a whole log with the loop inside.

The fast code lets Python raise where IEEE 754 has a result (1/0, sqrt(-1), exp(1000)) and then runs that one step
again in its safe twin, which calls the definitions in `ieee`. Values used once are written into the formula that uses
them.
"""

import keyword
import math
import re
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import ieee
from ohmward.trace.expression import Expression
from ohmward.trace.operations import ATOM, CHOICE, COMPARE, OPERATIONS, SIGN
from ohmward.trace.program import Program
from ohmward.trace.structure import Leaf, Structure

#: Formulas nest no deeper than this; Python's parser has a limit near 100.
_MAX_DEPTH = 12

_FUNCTIONS: dict[str, Any] = {
    **{name: getattr(math, name) for name in ("sqrt", "exp", "expm1", "log", "log1p", "sin", "cos", "tan", "sinh")},
    **{name: getattr(math, name) for name in ("cosh", "tanh", "isfinite", "inf", "nan")},
    "power": math.pow,
    "arctan": math.atan,
    "arctan2": math.atan2,
    "arcsinh": math.asinh,
    "array": np.array,
    "asarray": np.asarray,
    "ERRORS": ieee.ERRORS,
}


class Body(NamedTuple):
    """The straight line of a program.

    inputs:  name of every input.
    lines:   assignments.
    results: names that the lines assign and outputs need.
    outputs: name or literal of every output.
    tables:  values of the gathers, by name.
    """

    inputs: list[str]
    lines: list[str]
    results: list[str]
    outputs: list[str]
    tables: dict[str, tuple]


def body(program: Program, safe: bool = False) -> Body:
    """Names and formulas of every operation; `safe` spells the risky ones as calls of their definitions."""
    inputs = input_names(program)
    text = {s.serial: name for s, name in zip(program.inputs, inputs, strict=True)}
    binding, depth = dict.fromkeys(text, ATOM), dict.fromkeys(text, 0)
    lines: list[str] = []
    tables: dict[str, tuple] = {}
    named = _named(program, safe)
    for node in program.nodes:
        assert node.operation is not None
        arguments = [a for a in node.args if isinstance(a, Expression)]
        text[node.serial], binding[node.serial] = _formula(node, text, binding, tables, safe)
        depth[node.serial] = 1 + max(depth[a.serial] for a in arguments)
        if node.serial in named or depth[node.serial] > _MAX_DEPTH:
            name = f"t{len(lines)}"
            lines.append(f"{name} = {text[node.serial]}")
            text[node.serial], binding[node.serial], depth[node.serial] = name, ATOM, 0
    outputs = [text[y.serial] if isinstance(y, Expression) else repr(y) for y in program.outputs]
    results = [text[y.serial] for y in program.outputs if isinstance(y, Expression) and y.operation is not None]
    return Body(inputs, lines, list(dict.fromkeys(results)), outputs, tables)


def _named(program: Program, safe: bool) -> set[int]:
    """Serials of the nodes that get a variable: used more than once, or an output."""
    uses = Counter(a.serial for node in program.nodes for a in node.args if isinstance(a, Expression))
    repeated = {
        a.serial
        for node in program.nodes
        for place, a in enumerate(node.args)
        if isinstance(a, Expression) and _template(node, safe)[0].count(f"{{{place}}}") > 1
    }
    outputs = {y.serial for y in program.outputs if isinstance(y, Expression)}
    return repeated | outputs | {serial for serial, count in uses.items() if count > 1}


def _template(node: Expression, safe: bool) -> tuple[str, int]:
    operation = node.operation
    assert operation is not None
    if safe and operation.risky:
        return f"{operation.name}({', '.join(f'{{{i}}}' for i in range(operation.arity))})", ATOM
    return operation.python, operation.binding


def _formula(node: Expression, text: dict, binding: dict, tables: dict, safe: bool) -> tuple[str, int]:
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


def _table(tables: dict[str, tuple], values: tuple) -> str:
    for name, known in tables.items():
        if known is values or known == values:
            return name
    name = f"table{len(tables)}"
    tables[name] = values
    return name


def input_names(program: Program) -> list[str]:
    """A Python name for every input: `belief.mean[0]` -> `belief_mean_0`."""
    names: list[str] = []
    for symbol in program.inputs:
        name = re.sub(r"\W+", "_", symbol.name).strip("_") or "x"
        if name[0].isdigit() or keyword.iskeyword(name) or name in _RESERVED or re.fullmatch(r"(t|table)\d+", name):
            name = f"{name}_" if not name[0].isdigit() else f"x_{name}"
        while name in names:
            name += "_"
        names.append(name)
    return names


_RESERVED = {*_FUNCTIONS, *OPERATIONS, "abs", "int", "float", "bool", "zip", "emit", "safe_step", "columns", "state"}


# ---- whole functions


def step_source(program: Program, safe: bool = False) -> str:
    """`step(*inputs) -> (*results)`, flat: what the safe twin is, and what there is to read of a program."""
    code = body(program, safe)
    lines = [f"def step({', '.join(code.inputs)}):", *_indent(code.lines, 1), f"    return {_row(code.results)}"]
    return "\n".join(lines)


def call_source(program: Program) -> str:
    """`call(*arguments)` with the structure of the traced function."""
    code = body(program)
    arguments = [f"argument{i}" for i in range(len(program.argument_structure.children))]
    names = iter(code.inputs)
    unpack = [
        line
        for child, argument in zip(program.argument_structure.children, arguments, strict=True)
        for line in _unpack(child, argument, names)
    ]
    result = _pack(program.result_structure, iter(code.outputs), iter(range(10**9)))
    lines = [
        f"def call({', '.join(arguments)}):",
        *_indent(unpack, 1),
        *_guarded(code, 1),
        f"    return {result}",
    ]
    return "\n".join(lines)


def scan_source(program: Program, state_size: int) -> str:
    """`scan(state, columns, emit) -> state` over rows of samples; the first inputs and outputs are the state."""
    code = body(program)
    state, sample = code.inputs[:state_size], code.inputs[state_size:]
    moved = [(s, n) for s, n in zip(state, code.outputs[:state_size], strict=True) if s != n]
    lines = ["def scan(state, columns, emit):"]
    if state:
        lines.append(f"    {_row(state)} = state")
    lines += [f"    for {_row(sample)} in zip(*columns):", *_guarded(code, 2)]
    if code.outputs[state_size:]:
        lines.append(f"        emit({_row(code.outputs[state_size:])})")
    if moved:
        lines.append(f"        {_row([s for s, _ in moved])} = {_row([n for _, n in moved])}")
    return "\n".join([*lines, f"    return {_row(state)}"])


def _guarded(code: Body, level: int) -> list[str]:
    """The straight line, with its safe twin for the steps in which Python raises."""
    if not code.lines:
        return []
    twin = f"{_row(code.results)} = safe_step({', '.join(code.inputs)})"
    lines = ["try:", *_indent(code.lines, 1), "except ERRORS:", f"    {twin}"]
    return _indent(lines, level)


def _unpack(structure: Structure, source: str, names: Any) -> list[str]:
    """Lines that give every scalar of an argument its name, as a Python float or bool."""
    if isinstance(structure, Leaf):
        kind = structure.dtype.__name__
        if not structure.shape:
            return [f"{next(names)} = {kind}({source})"]
        return [f"{_nested(structure.shape, names)} = asarray({source}, {kind}).tolist()"] if structure.size else []
    parts = [f"{source}_{i}" for i in range(len(structure.children))]
    lines = [f"{_row(parts)} = {source}"] if parts else []
    return lines + [
        line for child, part in zip(structure.children, parts, strict=True) for line in _unpack(child, part, names)
    ]


def _nested(shape: tuple[int, ...], names: Any) -> str:
    """`((a, b), (c, d))` for shape (2, 2)."""
    if not shape:
        return next(names)
    return _row([_nested(shape[1:], names) for _ in range(shape[0])])


def _pack(structure: Structure, outputs: Any, numbers: Any) -> str:
    """The expression that builds the result."""
    if isinstance(structure, Leaf):
        if not structure.shape:
            return next(outputs)
        values = _row([next(outputs) for _ in range(structure.size)])
        reshape = f".reshape({structure.shape})" if len(structure.shape) != 1 else ""
        return f"array({values}, {structure.dtype.__name__}){reshape}"
    kind = "" if structure.type is tuple else f"structure{next(numbers)}"
    parts = [_pack(child, outputs, numbers) for child in structure.children]
    return f"{kind}({', '.join(parts)})" if kind else _row(parts)


def _row(names: list[str]) -> str:
    """A tuple: of no, one or many names."""
    return f"({', '.join(names)}{',' if len(names) == 1 else ''})"


def _indent(lines: list[str], level: int) -> list[str]:
    return ["    " * level + line for line in lines]


# ---- compiled


def compile_step(program: Program, safe: bool = False) -> Callable:
    """The function of `step_source`."""
    code = body(program, safe)
    safe_functions = {o.name: o.compute for o in OPERATIONS.values() if o.risky} if safe else {}
    return _compile(step_source(program, safe), "step", {**_FUNCTIONS, **safe_functions, **code.tables})


def compile_call(program: Program) -> Callable:
    """The function of `call_source`."""
    types = {f"structure{i}": t for i, t in enumerate(_types(program.result_structure))}
    return _compile(call_source(program), "call", {**_namespace(program), **types})


def compile_scan(program: Program, state_size: int) -> Callable:
    """The function of `scan_source`."""
    return _compile(scan_source(program, state_size), "scan", _namespace(program))


def _namespace(program: Program) -> dict[str, Any]:
    twin: list[Callable] = []

    def safe_step(*inputs: float) -> tuple:
        if not twin:
            twin.append(compile_step(program, safe=True))
        return twin[0](*inputs)

    return {**_FUNCTIONS, **body(program).tables, "safe_step": safe_step}


def _types(structure: Structure) -> list[type]:
    """The NamedTuples of a structure, in the order in which `_pack` meets them."""
    if isinstance(structure, Leaf):
        return []
    own = [] if structure.type is tuple else [structure.type]
    return own + [t for child in structure.children for t in _types(child)]


def _compile(source: str, name: str, namespace: dict[str, Any]) -> Callable:
    exec(compile(source, f"<ohmward trace: {name}>", "exec"), namespace)
    return namespace[name]
