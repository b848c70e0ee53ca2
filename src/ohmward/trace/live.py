"""One log sample by sample: a kernel that keeps its state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from ohmward.trace import scan
from ohmward.trace.lower import python_source
from ohmward.trace.lower.llvm_run import MachineStep, OneStep
from ohmward.trace.structure import Structure


class Live(Protocol):
    """A step that remembers.

    state: after the last sample, a tree of plain numbers and arrays; what is assigned to it goes on from there.
    """

    state: Any

    def step(self, sample: Any) -> Any:
        """The output after one more sample."""
        ...


class PythonLive:
    """On Python floats."""

    def __init__(self, call: Callable[[Any, Any], tuple[Any, Any]], state: Any):
        self._call = call
        self.state = state

    def step(self, sample: Any) -> Any:
        """The output after one more sample."""
        self.state, output = self._call(self.state, sample)
        return output


class MachineLive:
    """In machine code: the state stays where it is used, only sample and output are moved."""

    def __init__(self, step: MachineStep, structure: Structure, state: Any):

        self._structure = structure
        self._code = OneStep(step, np.array(scan.state_row(structure, state), dtype=float))
        program, size = step.program, step.state_size
        self.step = python_source.compile_live(program, size, self._code, self._code.sample, self._code.output)

    @property
    def state(self) -> Any:
        """The state after the last sample."""
        return scan.state_tree(self._structure, self._code.state.tolist())

    @state.setter
    def state(self, state: Any) -> None:
        self._code.state[:] = scan.state_row(self._structure, state)
