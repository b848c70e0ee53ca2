"""Latency of every operation on this processor, measured: input of the bound on the time of one step.

A chain in which every operation needs the one before runs as a step over a long log. Where an operation alone would
vanish, or drive the numbers away, one of known latency stands beside it and is taken off again. Each figure is the
least that was seen, and what the compiler may fold into its neighbours counts nothing: a bound must not be too high.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from critical_path import FUSED
from ohmward.trace.expression import apply
from ohmward.trace.functions import floor, minimum, sqrt, where
from ohmward.trace.lower.llvm_run import MachineStep
from ohmward.trace.program import trace

_LINKS = 8
_STEPS = 20_000
#: A circle through a table.
_NEXT = (3.0, 0.0, 1.0, 2.0)


class Chain(NamedTuple):
    """One operation made into a chain.

    link: x and two samples a, b -> the next x.
    beside: the operations on its way besides the one in question.
    values: of x at the start, a and b.
    """

    link: Callable[[Any, Any, Any], Any]
    beside: tuple[str, ...] = ()
    values: tuple[float, float, float] = (1.0, 1.0, 0.0)


#: In the order in which they need each other.
CHAINS: dict[str, Chain] = {
    "add": Chain(lambda x, a, b: x + b),
    "multiply": Chain(lambda x, a, b: x * a),
    FUSED: Chain(lambda x, a, b: x * a + b),
    "divide": Chain(lambda x, a, b: a / x, values=(1.3, 1.7, 0.0)),
    "sqrt": Chain(lambda x, a, b: sqrt(x * a), ("multiply",), (1.3, 1.7, 0.0)),
    "absolute": Chain(lambda x, a, b: abs(x) - b, ("add",)),
    "floor": Chain(lambda x, a, b: floor(x) + b, ("add",)),
    "minimum": Chain(lambda x, a, b: minimum(x * a, 2.0), ("multiply",)),
    "where": Chain(lambda x, a, b: where(b > 0, x * a, b - x), ("multiply",), (1.0, 1.0, 2.0)),
    "less": Chain(lambda x, a, b: where(x < 1.5, b, a), ("where",), (1.0, 1.0, 2.0)),
    "gather": Chain(lambda x, a, b: apply("gather", _place(x), _NEXT), ("minimum", "minimum")),
    "power_of_two": Chain(lambda x, a, b: apply("power_of_two", x) - b, ("add",), (1.0, 1.0, 1.0)),
    "exponent": Chain(lambda x, a, b: apply("exponent", x) + b, ("add",), (1.0, 1.0, 1.0)),
}

#: Operations that are one of these, or several of them.
SAME: dict[str, tuple[str, ...]] = {
    "subtract": ("add",),
    "maximum": ("minimum",),
    "less_equal": ("less",),
    "equal": ("less",),
    "not_equal": ("less",),
    "isfinite": ("less",),
    "sign": ("less",),
    "floor_divide": ("divide", "floor"),
    "remainder": ("divide", "floor", FUSED),
}
#: What costs nothing where it becomes part of another instruction.
FREE = ("negative", "logical_and", "logical_or", "logical_not")


def latencies(precision: str = "f64", repeats: int = 5) -> dict[str, float]:
    """Latency [s] of every operation that machine code has, and of "fma".

    Raises:
        NoMachineCodeError: see `llvm_machine_code.llvm`.
    """
    found: dict[str, float] = dict.fromkeys(FREE, 0.0)
    for name, chain in CHAINS.items():
        found[name] = max(0.0, _link_s(chain, precision, repeats) - _total(found, chain.beside))
    return found | {name: _total(found, parts) for name, parts in SAME.items()}


def _place(x: Any) -> Any:
    """A place in the table, as one that needs not be checked."""
    return floor(minimum(where(x > 0.0, x, 0.0), float(len(_NEXT) - 1)))


def _link_s(chain: Chain, precision: str, repeats: int) -> float:
    """Least time [s] of a link."""

    def step(x: Any, sample: tuple) -> tuple:
        for _ in range(_LINKS):
            x = chain.link(x, *sample)
        return x, x

    code = MachineStep(trace(step, 0.0, (0.0, 0.0)), 1, precision)
    start, *sample = chain.values
    columns, result = [np.full(_STEPS, value) for value in sample], np.empty(_STEPS)
    best = np.inf
    for _ in range(repeats + 1):  # the first one compiles
        state = np.array([start])
        began = time.process_time()
        code.one(state, columns, [result], None)
        best = min(best, time.process_time() - began)
    return best / (_LINKS * _STEPS)


def _total(found: Mapping[str, float], names: tuple[str, ...]) -> float:
    return sum(found[name] for name in names)
