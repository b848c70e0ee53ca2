"""Programs in single precision on NumPy, operation by operation: slow, and the bit-exact reference of the C code."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from ohmward.trace.elementary import F32, expand
from ohmward.trace.expression import Expression
from ohmward.trace.program import Program


def run(program: Program, state: np.ndarray, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Step through a log.

    program: a step(state, sample) -> (state, output), as traced.
    state:   (n,) before the first sample.
    samples: (T, m).
    Returns: the state (n,) after the last sample and the outputs (T, k), all float32; conditions are 0 and 1.
    """
    step, now = evaluator(program), np.asarray(state, np.float32)
    rows = []
    for sample in np.asarray(samples, np.float32):
        results = step(np.concatenate([now, sample]))
        now = results[: now.size]
        rows.append(results[now.size :])
    return now, np.array(rows, np.float32)


def evaluator(program: Program) -> Callable[[np.ndarray], np.ndarray]:
    """The function from the inputs (n,) of float32 to the outputs (k,) of a program, as traced."""
    program = expand(program, F32)
    places = {x.serial: k for k, x in enumerate((*program.inputs, *program.nodes))}
    constants: list[Any] = []

    def place_of(x: Any) -> int:
        """Index of a value: constants are the last, counted from the end."""
        if isinstance(x, Expression):
            return places[x.serial]
        constants.insert(0, np.float32(x) if isinstance(x, float) else x)
        return -len(constants)

    steps = []
    for x in program.nodes:
        arguments = [place_of(argument) for argument in x.args]
        steps.append((places[x.serial], _FUNCTIONS[x.operation.name], arguments))
    outputs = [place_of(y) for y in program.outputs]

    def evaluate(inputs: np.ndarray) -> np.ndarray:
        singles = zip(program.inputs, np.asarray(inputs, np.float32), strict=True)
        given = [bool(x) if symbol.boolean else x for symbol, x in singles]
        values: list[Any] = [*given, *([None] * len(steps)), *constants]
        with np.errstate(all="ignore"):
            for place, function, arguments in steps:
                values[place] = function(*[values[k] for k in arguments])
            return np.array([values[k] for k in outputs], np.float32)

    return evaluate


def _gather(index: Any, table: tuple[float, ...]) -> np.float32:
    return np.float32(table[int(min(index, len(table) - 1))] if index > 0 else table[0])


def _exponent(x: np.float32) -> np.float32:
    return np.float32(np.frexp(x)[1] - 1)


def _power_of_two(n: np.float32) -> np.float32:
    return np.ldexp(np.float32(1.0), int(n)) if np.isfinite(n) else np.float32(np.nan)


def _sign(x: np.float32) -> np.float32:
    return x if np.isnan(x) else np.float32(np.sign(x))


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": np.divide,
    "remainder": lambda a, b: a - np.floor(a / b) * b,
    "floor_divide": lambda a, b: np.floor(a / b),
    "negative": operator.neg,
    "absolute": abs,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "minimum": lambda a, b: a if a < b or a != a else b,
    "maximum": lambda a, b: a if a > b or a != a else b,
    "where": lambda c, a, b: a if c else b,
    "sign": _sign,
    "gather": _gather,
    "power_of_two": _power_of_two,
    "exponent": _exponent,
    "less": lambda a, b: bool(a < b),
    "less_equal": lambda a, b: bool(a <= b),
    "equal": lambda a, b: bool(a == b),
    "not_equal": lambda a, b: bool(a != b),
    "logical_and": lambda a, b: a and b,
    "logical_or": lambda a, b: a or b,
    "logical_not": lambda a: not a,
    "isfinite": lambda a: bool(np.isfinite(a)),
}
