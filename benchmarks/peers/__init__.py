"""Who else can run the same filters: one file for each peer, all of them optional.

A peer's module offers `cell(problem)` and `joint(problem)`, either of them None where the peer has no such filter, and
where it can run many logs at once `cell_lanes` and `joint_lanes`. What is not installed is said in the table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any, NamedTuple

from workloads import CellProblem, JointProblem, Posterior


class Contestant(NamedTuple):
    """One implementation of a problem, ready to run.

    who, how: its name, and the variant or the way it is run.
    steps: samples in a timed run; few for the slow ones.
    run: filters the first so many samples and returns the belief after them.
    redrawn: whether sigma points are drawn anew after the prediction.
    prepared_s: what building and compiling it took, nan where there is nothing of the kind.
    """

    who: str
    how: str
    steps: int
    run: Callable[[int], Posterior]
    redrawn: bool = False
    prepared_s: float = float("nan")


class Peer(NamedTuple):
    """A package to compare with: what it is called, what installs it, the module here that runs it."""

    title: str
    package: str
    module: str


PEERS = (
    Peer("NumPy by hand", "numpy", "numpy_by_hand"),
    Peer("FilterPy", "filterpy", "in_filterpy"),
    Peer("pykalman", "pykalman", "in_pykalman"),
    Peer("Stone Soup", "stonesoup", "in_stonesoup"),
    Peer("CasADi", "casadi", "in_casadi"),
    Peer("Numba", "numba", "in_numba"),
    Peer("JAX", "jax", "in_jax"),
    Peer("dynamax", "dynamax", "in_dynamax"),
)


class Absent(NamedTuple):
    """A peer that is not installed."""

    title: str
    package: str


def contestants(problem: CellProblem | JointProblem, lanes: bool = False) -> Iterator[Contestant | Absent]:
    """Every peer that has this filter."""
    name = ("cell" if isinstance(problem, CellProblem) else "joint") + ("_lanes" if lanes else "")
    for peer in PEERS:
        try:
            make: Any = getattr(import_module(f"peers.{peer.module}"), name, None)
        except ModuleNotFoundError as error:
            if str(error.name).startswith("peers"):
                raise
            yield Absent(peer.title, peer.package)
            continue
        if make is not None:
            yield from make(problem)
