"""Traced functions as straight-line programs: inputs, operations in order, outputs, and the structure of both."""

import inspect
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from heapq import heapify, heappop, heappush
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.trace.expression import Expression, Scalar, TraceError, condition, number, symbol
from ohmward.trace.operations import INPUT
from ohmward.trace.origins import OriginRecorder
from ohmward.trace.structure import Branch, Leaf, Structure, flatten, leaves, scalar_names, shaped, structure_of


class StepStructure(NamedTuple):
    """Structures of the parts of a step(state, sample) -> (state, output)."""

    state: Structure
    sample: Structure
    output: Structure


@dataclass(frozen=True, eq=False, repr=False)
class Program:
    """A traced function."""

    inputs: tuple[Expression, ...]  #:   one symbol per scalar of the arguments
    #:    every operation that an output needs, arguments first, depth first from the outputs (short live ranges)
    nodes: tuple[Expression, ...]
    outputs: tuple[Scalar, ...]  #:  one scalar per scalar of the result: a node, an input, or a constant
    #: how inputs and outputs are nested
    argument_structure: Branch
    result_structure: Structure
    name: str  #:     name of the traced function
    origins: OriginRecorder | None = None  #: where its values come from, if that was recorded

    @cached_property
    def expansions(self) -> dict[str, "Program"]:
        """The program without elementary functions by the name of a precision, see `elementary.expand`."""
        return {}

    @property
    def operations(self) -> Counter[str]:
        """Number of operations of each kind in one run."""
        return Counter(node.operation.name for node in self.nodes)

    @cached_property
    def used(self) -> set[int]:
        """Serials of the inputs and operations whose value another operation or an output takes."""
        return serials(self.outputs) | {serial for node in self.nodes for serial in serials(node.args)}

    @property
    def in_order_made(self) -> list[Expression]:
        """The operations in the order of the traced code, each after its arguments."""
        place = self.origins.place if self.origins else lambda serial: serial
        order = {node.serial: (place(node.serial), node.serial) for node in self.nodes}
        waiting = {node.serial: len(serials(node.args) & order.keys()) for node in self.nodes}
        users: dict[int, list[Expression]] = {serial: [] for serial in order}
        for node in self.nodes:
            for serial in serials(node.args) & order.keys():
                users[serial].append(node)
        ready = [(order[node.serial], node) for node in self.nodes if not waiting[node.serial]]
        heapify(ready)
        done = []
        while ready:
            done.append(heappop(ready)[1])
            for user in users[done[-1].serial]:
                waiting[user.serial] -= 1
                if not waiting[user.serial]:
                    heappush(ready, (order[user.serial], user))
        return done

    @cached_property
    def step_structure(self) -> StepStructure:
        """Structures of state, sample and output.

        Raises:
            InputError: it is not a step(state, sample) -> (state, output), or the state changes its structure.
        """
        arguments, result, name = self.argument_structure, self.result_structure, self.name
        if len(arguments.children) != 2 or not isinstance(result, Branch) or len(result.children) != 2:
            raise InputError(f"this needs step(state, sample) -> (state, output); {name} has another form")
        (before, sample), (after, output) = arguments.children, result.children
        for (path, old), (_, new) in zip(leaves(before, "state"), leaves(after, "state"), strict=False):
            if old != new:
                raise InputError(f"{name} turns {path} from {_describe(old)} into {_describe(new)}; they must be alike")
        if before != after:
            raise InputError(f"the state that {name} returns must have the structure of the one that it takes")
        return StepStructure(before, sample, output)


def _describe(leaf: Leaf) -> str:
    kind = "condition" if leaf.boolean else "number"
    return f"an array {leaf.shape} of {kind}s" if leaf.shape else f"a {kind}"


def serials(values: Iterable[Any]) -> set[int]:
    """Serials of those values that are traced."""
    return {x.serial for x in values if isinstance(x, Expression)}


def trace(
    function: Callable[..., Any], *examples: Any, constants: tuple[Any, ...] = (), with_origins: bool = False
) -> Program:
    """Run `function(*examples, *constants)` with symbols in place of the numbers in `examples`.

    examples:  numbers, arrays, tuples and NamedTuples of these. Their structure, shapes and kinds (number or bool)
               count, not their values.
    constants: further arguments, handed over unchanged.
    with_origins: record the variable names of the values, and the function that made each.
    Raises:    TraceError for code that cannot be traced, InputError for examples or results not made of numbers.
    """
    names = _argument_names(function, len(examples))
    children = tuple(structure_of(example, name) for name, example in zip(names, examples, strict=True))
    structure = Branch(tuple, names, children)
    inputs = symbols(structure)
    origins = OriginRecorder() if with_origins else None
    with origins or nullcontext():
        result = run_traced(function, *shaped(structure, inputs, object), *constants)
    result_structure = structure_of(result, "result")
    outputs = _scalars(result_structure, result)
    name = getattr(function, "__name__", "function")
    return Program(inputs, schedule(outputs), outputs, structure, result_structure, name, origins)


def run_traced(function: Callable[..., Any], *args: Any) -> Any:
    """`function(*args)`, with advice where NumPy itself refuses an array of traced values and floats."""
    try:
        return function(*args)
    except TypeError as error:
        if "which has no callable" not in str(error):
            raise
        raise TraceError(
            f"{_last_line(error)}: {error}. The array mixes traced values with floats: use exp, log, sqrt, tanh, sin "
            "or cos from ohmward.trace, which take both"
        ) from error


def _last_line(error: Exception) -> str:
    """File and line where an error was raised."""
    trail = error.__traceback__
    while trail is not None and trail.tb_next is not None:
        trail = trail.tb_next
    return f"{trail.tb_frame.f_code.co_filename}:{trail.tb_lineno}" if trail else "unknown"


def symbols(structure: Structure) -> tuple[Expression, ...]:
    """Fresh inputs, one per scalar."""
    kinds = (leaf.boolean for _, leaf in leaves(structure) for _ in range(leaf.size))
    return tuple(symbol(name, boolean) for name, boolean in zip(scalar_names(structure), kinds, strict=True))


def schedule(outputs: Iterable[Any], first: int = 0) -> tuple[Expression, ...]:
    """The operations that `outputs` need, each after its arguments, depth first.

    first: serial below which nodes are left out, together with all that they need, which is older still.
    """
    done: set[int] = set()
    order: list[Expression] = []
    stack = [(node, False) for node in reversed(list(outputs)) if isinstance(node, Expression)]
    while stack:
        node, ready = stack.pop()
        if ready:
            order.append(node)
        elif node.serial not in done and node.serial >= first and node.operation is not INPUT:
            done.add(node.serial)
            stack.append((node, True))
            args = [arg for arg in reversed(node.args) if isinstance(arg, Expression) and arg.serial not in done]
            stack += [(arg, False) for arg in args]
    return tuple(order)


def _scalars(structure: Structure, tree: Any) -> tuple[Scalar, ...]:
    """Every scalar of a result: Expressions as they are, numbers as float or bool."""
    scalars: list[Scalar] = []
    for (_, leaf), value in zip(leaves(structure), flatten(structure, tree), strict=True):
        elements = value.flat if isinstance(value, np.ndarray) else (value,)
        scalars += [condition(x) if leaf.boolean else number(x) for x in elements]
    return tuple(scalars)


def _argument_names(function: Callable[..., Any], count: int) -> tuple[str, ...]:
    """Names of the first positional parameters, argument0, argument1, ... where the function has none."""
    try:
        parameters = inspect.signature(function).parameters.values()
        names = [p.name for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    except (TypeError, ValueError):
        names = []
    return tuple(names[i] if i < len(names) else f"argument{i}" for i in range(count))
