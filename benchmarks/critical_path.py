"""The least time between two steps of one log: what the next state must wait for.

One log is a recurrence. However many operations a processor does at once, it cannot begin what it has no arguments for,
so steps follow each other no faster than the longest cycle through the state: the largest mean weight of a cycle in the
graph whose edges are the longest paths from each state to each state after one step (Karp 1978). It is a lower bound:
operations that wait for nothing, and the processor's limits of how many there may be at once, come on top.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from ohmward.errors import InputError
from ohmward.trace.expression import Expression
from ohmward.trace.program import Program

#: The latency of a fused multiply-add, among those of the operations.
FUSED = "fma"


def least_step_s(program: Program, state_size: int, latencies: Mapping[str, float]) -> float:
    """Least time [s] of a step in a long log, 0 where no step waits for the one before.

    program:    a step(state, sample) -> (state, output).
    state_size: number of its first inputs and outputs that are the state.
    latencies:  of every operation of the program by name [s], and of "fma" where products and sums may become one.
                What else a compiler turns into one instruction counts as that: a smaller or larger of two, a look-up
                that needs no `floor`, twice a number, a division by a power of two.
    Raises:     InputError if an operation has no latency.
    """
    return maximum_cycle_mean(state_paths(program, state_size, latencies))


def state_paths(program: Program, state_size: int, latencies: Mapping[str, float]) -> np.ndarray:
    """Longest paths (n, n) [s] from state i before to state j after a step, -inf where j does not depend on i.

    Arguments and errors are those of `least_step_s`.
    """
    missing = sorted(set(program.operations) - set(latencies))
    if missing:
        raise InputError(f"latencies: every operation needs one, got none of {', '.join(missing)}")
    waits: dict[int, np.ndarray] = {}
    nowhere = np.full(state_size, -np.inf)
    for k, symbol in enumerate(program.inputs[:state_size]):
        waits[symbol.serial] = np.where(np.arange(state_size) == k, 0.0, -np.inf)

    def wait(x: object) -> np.ndarray:
        return waits.get(x.serial, nowhere) if isinstance(x, Expression) else nowhere

    for node in program.nodes:
        plain = (node.args, node.operation.name)
        ways = [(args, name) for args, name in (plain, *_in_one(node)) if name in latencies]
        waits[node.serial] = np.minimum.reduce([_latest(map(wait, args)) + latencies[name] for args, name in ways])
    return np.column_stack([wait(y) for y in program.outputs[:state_size]])


def maximum_cycle_mean(weights: np.ndarray) -> float:
    """Largest mean weight of an edge in any cycle; weights (n, n) from i to j, -inf where there is no edge.

    Karp 1978: max over j, min over k < n, of (W_n(j) - W_k(j)) / (n - k), with W_k(j) the heaviest walk of k edges that
    ends in j. 0 where there is no cycle.
    """
    n = len(weights)
    walks = [np.zeros(n)]
    for _ in range(n):
        walks.append((walks[-1][:, None] + weights).max(axis=0, initial=-np.inf))
    *shorter, last = walks
    ends = np.isfinite(last)
    means = [(last[ends] - walk[ends]) / (n - k) for k, walk in enumerate(shorter)]
    return float(np.min(means, axis=0).max()) if ends.any() else 0.0


def _latest(waits: Iterable[np.ndarray]) -> np.ndarray:
    return np.maximum.reduce(list(waits))


def _in_one(node: Expression) -> Iterator[tuple[tuple, str]]:
    """Single instructions that a compiler could put in the place of a node and of what leads to it: arguments, name."""
    name, args = node.operation.name, node.args
    if name in ("add", "subtract"):
        yield from (((*p.args, other), FUSED) for p, other in (args, args[::-1]) if _is(p, "multiply"))
    if name == "where" and _is(args[0], "less") and {*map(_key, args[0].args)} == {*map(_key, args[1:])}:
        yield args[1:], "minimum"
    if name == "gather" and _is(args[0], "floor"):
        yield args[0].args, "gather"
    if name == "multiply" and 2.0 in map(_size, args):
        yield args, "add"
    if name == "divide" and math.frexp(_size(args[1]))[0] == 0.5:
        yield args, "multiply"


def _is(x: object, name: str) -> bool:
    return isinstance(x, Expression) and x.operation.name == name


def _key(x: object) -> object:
    """Key that equal arguments share."""
    return (x.serial,) if isinstance(x, Expression) else x


def _size(x: object) -> float:
    """Of a constant, nan for anything else."""
    return abs(x) if isinstance(x, float) else math.nan
