"""A traced function as a straight-line program: inputs, operations in order, outputs, and the structure of both."""

import inspect
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmward.trace.expression import Expression, Scalar, TraceError, number, symbol
from ohmward.trace.operations import INPUT
from ohmward.trace.structure import Branch, Structure, flatten, leaves, scalar_names, shaped, structure_of


@dataclass(frozen=True, eq=False, repr=False)
class Program:
    """What a lowering needs to know of a function.

    inputs:   one symbol per scalar of the arguments.
    nodes:    every operation that an output needs, arguments first, depth first from the outputs (short lives).
    outputs:  one scalar per scalar of the result: a node, an input, or a constant.
    argument_structure, result_structure: how inputs and outputs are nested.
    name:     name of the traced function.
    """

    inputs: tuple[Expression, ...]
    nodes: tuple[Expression, ...]
    outputs: tuple[Scalar, ...]
    argument_structure: Branch
    result_structure: Structure
    name: str

    @property
    def operations(self) -> Counter[str]:
        """How many operations of each kind one run takes."""
        return Counter(node.operation.name for node in self.nodes)


def trace(function: Callable, *examples: Any, constants: tuple = ()) -> Program:
    """Run `function(*examples, *constants)` with symbols in place of the numbers in `examples`.

    examples:  numbers, arrays, tuples and NamedTuples of these; their structure and shapes count, and whether a number
               is a bool, their values do not.
    constants: further arguments, handed over as they are.
    Raises:    TraceError at what cannot be traced, InputError for examples or results that are not made of numbers.
    """
    names = _argument_names(function, len(examples))
    children = tuple(structure_of(example, name) for name, example in zip(names, examples, strict=True))
    structure = Branch(tuple, names, children)
    inputs = symbols(structure)
    result = run_traced(function, *shaped(structure, list(inputs), object), *constants)
    result_structure = structure_of(result, "result")
    outputs = _scalars(result_structure, result)
    return Program(
        inputs, schedule(outputs), outputs, structure, result_structure, getattr(function, "__name__", "function")
    )


def run_traced(function: Callable, *args: Any) -> Any:
    """`function(*args)`, with advice for the one refusal that comes from NumPy itself."""
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

    first: serial below which nodes are left out, and with them all that they need, which is older still.
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
            stack.extend((arg, False) for arg in reversed(node.args) if isinstance(arg, Expression))
    return tuple(order)


def _scalars(structure: Structure, tree: Any) -> tuple[Scalar, ...]:
    """Every scalar of a result: Expressions as they are, numbers as float or bool."""
    scalars: list[Scalar] = []
    for (_, leaf), value in zip(leaves(structure), flatten(structure, tree), strict=True):
        elements = value.flat if isinstance(value, np.ndarray) else (value,)
        scalars += [_boolean(x) if leaf.boolean else number(x) for x in elements]
    return tuple(scalars)


def _boolean(x: Any) -> Scalar:
    return x if isinstance(x, Expression) else bool(x)


def _argument_names(function: Callable, count: int) -> tuple[str, ...]:
    """The names of the first positional parameters, as far as the function tells."""
    try:
        parameters = inspect.signature(function).parameters.values()
        names = [p.name for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    except (TypeError, ValueError):
        names = []
    return tuple(names[i] if i < len(names) else f"argument{i}" for i in range(count))
