"""Programs in single precision on NumPy, operation by operation: slow, and the bit-exact reference of the C code."""

from __future__ import annotations

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
    program = expanded(program)
    now = np.asarray(state, np.float32)
    rows = []
    for sample in np.asarray(samples, np.float32):
        results = evaluate(program, np.concatenate([now, sample]))
        now = results[: now.size]
        rows.append(results[now.size :])
    return now, np.array(rows, np.float32)


def expanded(program: Program) -> Program:
    """The program without exp, log and the like, as `evaluate` needs it."""
    return expand(program, F32)


def evaluate(program: Program, inputs: np.ndarray) -> np.ndarray:
    """Outputs (k,) of inputs (n,) of float32, for a program from `expanded`."""
    values: dict[int, Any] = {
        symbol.serial: bool(x) if symbol.boolean else np.float32(x)
        for symbol, x in zip(program.inputs, inputs, strict=True)
    }
    with np.errstate(all="ignore"):
        for node in program.nodes:
            arguments = [_value(a, values) for a in node.args]
            values[node.serial] = _FUNCTIONS[node.operation.name](*arguments)
        return np.array([_value(y, values) for y in program.outputs], np.float32)


def _value(x: Any, values: dict[int, Any]) -> Any:
    if isinstance(x, Expression):
        return values[x.serial]
    return np.float32(x) if isinstance(x, float) else x


def _gather(index: Any, table: tuple[float, ...]) -> np.float32:
    return np.float32(table[int(min(index, len(table) - 1))] if index > 0 else table[0])


def _exponent(x: np.float32) -> np.float32:
    return np.float32(np.frexp(x)[1] - 1)


def _power_of_two(n: np.float32) -> np.float32:
    return np.ldexp(np.float32(1.0), int(n)) if np.isfinite(n) else np.float32(np.nan)


def _sign(x: np.float32) -> np.float32:
    return x if np.isnan(x) else np.float32(np.sign(x))


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": np.divide,
    "remainder": lambda a, b: a - np.floor(a / b) * b,
    "floor_divide": lambda a, b: np.floor(a / b),
    "negative": lambda a: -a,
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
