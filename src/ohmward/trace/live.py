"""A kernel that keeps its state and takes a log sample by sample."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from ohmward.trace import scan
from ohmward.trace.lower import python_source
from ohmward.trace.lower.llvm_run import MachineStep, OneStep
from ohmward.trace.structure import Structure, is_finite, shaped

#: Value that replaces each number in the output's field `flags`; None leaves the numbers.
FlagTable = Mapping[float, Any] | None


class Live(Protocol):
    """A step that keeps its state.

    state: after the last sample, a tree of plain numbers and arrays; the next step starts from one that is assigned.
    """

    state: Any

    def step(self, sample: Any) -> Any:
        """Output after one more sample."""
        ...

    def is_finite(self) -> bool:
        """True where every number of the state is finite."""
        ...


class PythonLive:
    """Live step on Python floats.

    structure: of the state.  flags: see `Kernel.live`.
    """

    def __init__(self, call: Callable[[Any, Any], tuple[Any, Any]], structure: Structure, state: Any, flags: FlagTable):
        self._call = call
        self._structure = structure
        self._flags = flags
        self.state = state

    def step(self, sample: Any) -> Any:
        """Output after one more sample."""
        self.state, output = self._call(self.state, sample)
        if self._flags is None:
            return output
        values = list(output)
        place = output._fields.index("flags")
        values[place] = self._flags[values[place]]
        return type(output)(*values)

    def is_finite(self) -> bool:
        """True where every number of the state is finite."""
        return is_finite(self._structure, self.state)


class MachineLive:
    """Live step in machine code: the state stays in place, only sample and output are copied.

    structure: of the state.  flags: see `Kernel.live`.
    """

    def __init__(self, step: MachineStep, structure: Structure, state: Any, flags: FlagTable):
        self._structure = structure
        code = OneStep(step, np.array(scan.state_row(structure, state), dtype=float))
        program, size = step.program, step.state_size
        self._code = code
        self._zeros = np.zeros(len(code.state))
        self.step = python_source.compile_live(program, size, code.run, code.sample, code.output, flags)

    @property
    def state(self) -> Any:
        """The state after the last sample."""
        return shaped(self._structure, self._code.state.tolist())

    @state.setter
    def state(self, state: Any) -> None:
        self._code.state[:] = scan.state_row(self._structure, state)

    def is_finite(self) -> bool:
        """True where every number of the state is finite."""
        return math.isfinite(self._code.state.dot(self._zeros))  # 0 * inf is nan; a third of the time of np.isfinite


class PromptLive:
    """Live step on Python floats until its machine code is there.

    is_compiled: true from then on.  in_machine_code: the live step that continues from a state.
    """

    def __init__(self, first: Live, is_compiled: Callable[[], bool], in_machine_code: Callable[[Any], Live]):
        self._live = first
        self._is_compiled, self._in_machine_code = is_compiled, in_machine_code
        self.step = self._step

    def _step(self, sample: Any) -> Any:
        if self._is_compiled():
            self._live = self._in_machine_code(self._live.state)
            self.step = self._live.step
        return self._live.step(sample)

    @property
    def state(self) -> Any:
        """The state after the last sample."""
        return self._live.state

    @state.setter
    def state(self, state: Any) -> None:
        self._live.state = state

    def is_finite(self) -> bool:
        """True where every number of the state is finite."""
        return self._live.is_finite()
