"""The least time between two steps of one log: what the next state must wait for.

One log is a recurrence. However many operations a processor does at once, it cannot begin what it has no arguments for,
so steps follow each other no faster than the longest cycle through the state: the largest mean weight of a cycle in the
graph whose edges are the longest paths from each state to each state after one step (Karp 1978). It is a lower bound:
operations that wait for nothing, and the processor's limits of how many there may be at once, come on top.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ohmward.errors import InputError
from ohmward.trace.expression import Expression
from ohmward.trace.program import Program

#: The latency of a fused multiply-add, among those of the operations.
FUSED = "fma"


def least_step_s(program: Program, state_size: int, latencies: Mapping[str, float]) -> float:
    """Least time [s] of a step in a long log, 0 where no step waits for the one before.

    program:    a step(state, sample) -> (state, output).
    state_size: how many of its first inputs and outputs are the state.
    latencies:  of every operation of the program by name [s], and of "fma" where products and sums may become one.
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
        plain = _latest(map(wait, node.args)) + latencies[node.operation.name]
        fused = (_latest(map(wait, args)) + latencies[FUSED] for args in _fusions(node, latencies))
        waits[node.serial] = np.minimum.reduce([plain, *fused])
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


def _fusions(node: Expression, latencies: Mapping[str, float]) -> list[tuple]:
    """Arguments of the fused multiply-adds that could take the place of a sum: one for each product in it."""
    if FUSED not in latencies or node.operation.name not in ("add", "subtract"):
        return []
    a, b = node.args
    return [(*p.args, other) for p, other in ((a, b), (b, a)) if isinstance(p, Expression) and _is_product(p)]


def _is_product(x: Expression) -> bool:
    return x.operation.name == "multiply"
