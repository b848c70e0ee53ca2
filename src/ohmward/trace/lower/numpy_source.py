"""Lowering to NumPy source over lanes: one array operation per operation of the program, in a loop over time.

Registers are freed after the last use of their value; the state of the next step stays in the array where it was
computed, and only the names change (`s0, r3 = r3, s0`). The loop allocates nothing but views.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ohmward.trace.expression import Expression
from ohmward.trace.operations import INPUT
from ohmward.trace.program import Program


@dataclass(frozen=True)
class Lanes:
    """A compiled loop over time for one block of lanes."""

    scan: Callable[..., list[np.ndarray]]  #:      (states, registers, samples, outputs, index, steps) -> states
    source: str  #:    its text
    registers: tuple[type, ...]  #: dtype of every scratch register


@dataclass
class _Allocator:
    """Names of the arrays that hold values; a register is reused as soon as its value is no longer needed."""

    free: dict[type, list[str]] = field(default_factory=lambda: {float: [], bool: []})
    registers: list[type] = field(default_factory=list)
    kinds: dict[str, type] = field(default_factory=dict)

    def take(self, kind: type) -> str:
        if self.free[kind]:
            return self.free[kind].pop()
        name = f"r{len(self.registers)}"
        self.registers.append(kind)
        self.kinds[name] = kind
        return name

    def give(self, name: str) -> None:
        if name in self.kinds:
            self.free[self.kinds[name]].append(name)


@dataclass
class _LaneLoop:
    """Text of one step while it is written."""

    program: Program
    state_size: int
    arrays: _Allocator = field(default_factory=_Allocator)
    place: dict[int, str] = field(default_factory=dict)  #:     name of the array of every value, by serial
    lines: list[str] = field(default_factory=list)
    #: name and value of constants and tables, by their text
    constants: dict[str, tuple[str, Any]] = field(default_factory=dict)

    def word(self, arg: Any) -> str:
        """Name of an argument: the array of a value, or a constant."""
        if isinstance(arg, Expression):
            return self.place[arg.serial]
        return self.constants.setdefault(repr(arg), (f"c{len(self.constants)}", arg))[0]


#: Operations that are written in two lines, so their result must not overlap an argument.
_STEPWISE = ("where", "gather")


def compile_lanes(program: Program, state_size: int) -> Lanes:
    """The loop of `step(state, sample) -> (state, output)`; the first inputs and outputs are the state."""
    loop = _LaneLoop(program, state_size)
    _place_inputs(loop)
    _write_operations(loop)
    final = _write_results(loop)
    source = _source(loop, final)
    namespace: dict[str, Any] = {
        # as arrays, which NumPy takes without converting
        name: np.array(value, dtype=_kind(value))
        for name, value in loop.constants.values()
    }
    names = {node.operation.name for node in program.nodes} - set(_STEPWISE)
    namespace |= {name: getattr(np, name) for name in names} | {"copyto": np.copyto}
    exec(compile(source, "<ohmward trace: lanes>", "exec"), namespace)
    return Lanes(namespace["scan"], source, tuple(loop.arrays.registers))


def _place_inputs(loop: _LaneLoop) -> None:
    for i, symbol in enumerate(loop.program.inputs):
        name = f"s{i}" if i < loop.state_size else f"x{i - loop.state_size}"
        loop.place[symbol.serial] = name
        if i < loop.state_size:
            loop.arrays.kinds[name] = _kind(symbol)


def _kind(x: Any) -> type:
    return bool if isinstance(x, bool) or (isinstance(x, Expression) and x.boolean) else float


def _write_operations(loop: _LaneLoop) -> None:
    """One line per operation, into its output if it has one, else into a register."""
    program, last = loop.program, _last_uses(loop.program)
    targets = _output_targets(program, loop.state_size)
    for symbol in program.inputs:
        if last.get(symbol.serial, -1) < 0:
            loop.arrays.give(loop.place[symbol.serial])
    for position, node in enumerate(program.nodes):
        taken = {a.serial: a for a in node.args if isinstance(a, Expression)}
        dying = [a for a in taken.values() if last[a.serial] == position]
        if node.operation.name not in _STEPWISE:
            _release(loop, dying)
        target = targets.get(node.serial) or loop.arrays.take(_kind(node))
        _write_operation(loop, node, target)
        loop.place[node.serial] = target
        if node.operation.name in _STEPWISE:
            _release(loop, dying)


def _release(loop: _LaneLoop, nodes: list[Expression]) -> None:
    for node in nodes:
        loop.arrays.give(loop.place[node.serial])


def _last_uses(program: Program) -> dict[int, int]:
    """Position of the last operation that takes a value; values of outputs live to the end."""
    last = {a.serial: i for i, node in enumerate(program.nodes) for a in node.args if isinstance(a, Expression)}
    return last | {y.serial: len(program.nodes) for y in program.outputs if isinstance(y, Expression)}


def _output_targets(program: Program, state_size: int) -> dict[int, str]:
    """The first output row that holds a node's value, by serial."""
    targets: dict[int, str] = {}
    for i, y in enumerate(program.outputs[state_size:]):
        if isinstance(y, Expression) and y.operation is not INPUT:
            targets.setdefault(y.serial, f"y{i}")
    return targets


def _write_operation(loop: _LaneLoop, node: Expression, target: str) -> None:
    words = [loop.word(a) for a in node.args]
    if node.operation.name == "where":
        loop.lines += [f"copyto({target}, {words[2]})", f"copyto({target}, {words[1]}, where={words[0]})"]
    elif node.operation.name == "gather":
        loop.lines += [
            f"copyto(index, {words[0]}, casting='unsafe')",
            f"{words[1]}.take(index, None, {target}, 'clip')",
        ]
    else:
        loop.lines.append(f"{node.operation.name}({', '.join(words)}, out={target})")


def _write_results(loop: _LaneLoop) -> list[str]:
    """Copy outputs and states that share an array with another value; returns the array of each next state."""
    program = loop.program
    for i, y in enumerate(program.outputs[loop.state_size :]):
        if loop.word(y) != f"y{i}":
            loop.lines.append(f"copyto(y{i}, {loop.word(y)})")
    final: list[str] = []
    for y in program.outputs[: loop.state_size]:
        name = loop.word(y)
        if name in final or name not in loop.arrays.kinds:
            register = loop.arrays.take(_kind(y))
            loop.lines.append(f"copyto({register}, {name})")
            name = register
        final.append(name)
    return final


def _renaming(final: list[str]) -> str:
    """`s0, r3 = r3, s0`: every state gets the array with its next value, the registers get the remaining ones."""
    moves = [(f"s{i}", name) for i, name in enumerate(final) if name != f"s{i}"]
    left = [old for old, _ in moves]
    right = [new for _, new in moves]
    orphans = [name for name in right if name not in left]
    leftover = [name for name in left if name not in right]
    return f"{', '.join(left + orphans)} = {', '.join(right + leftover)}" if moves else ""


def _source(loop: _LaneLoop, final: list[str]) -> str:
    states = [f"s{i}" for i in range(loop.state_size)]
    registers = [f"r{i}" for i in range(len(loop.arrays.registers))]
    columns = loop.program.inputs[loop.state_size :]
    samples = range(len(columns))
    outputs = range(len(loop.program.outputs) - loop.state_size)
    body = [
        *(f"x{i} = X{i}[k, ...]" for i in samples if columns[i].serial in loop.program.used),
        *(f"y{i} = Y{i}[k]" for i in outputs),
        *loop.lines,
        *filter(None, [_renaming(final)]),
    ]
    return "\n".join(
        [
            "def scan(states, registers, samples, outputs, index, steps):",
            f"    [{', '.join(states)}] = states",
            f"    [{', '.join(registers)}] = registers",
            f"    [{', '.join(f'X{i}' for i in samples)}] = samples",
            f"    [{', '.join(f'Y{i}' for i in outputs)}] = outputs",
            "    for k in range(steps):",
            *(f"        {line}" for line in body or ["pass"]),
            f"    return [{', '.join(states)}]",
        ]
    )
