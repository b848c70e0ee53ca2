"""Compiled functions: one call, live samples, one log, many logs, with the best lowering that is installed."""

import os
from collections.abc import Callable, Collection
from functools import cached_property, partial
from threading import Lock, Thread, main_thread
from typing import Any, TypeVar

import numpy as np

from ohmward.checks import require_one_of
from ohmward.errors import InputError
from ohmward.memory import return_freed
from ohmward.trace import scan
from ohmward.trace.live import FlagTable, Live, MachineLive, PromptLive, PythonLive
from ohmward.trace.lower import (
    code_cache,
    lanes,
    llvm_logs,
    llvm_machine_code,
    numpy_source,
    python_source,
    stored_steps,
)
from ohmward.trace.lower.llvm_run import MachineStep
from ohmward.trace.program import Program, trace
from ohmward.trace.structure import check, flatten, leaves, size

LOWERINGS = ("auto", "python", "machine")

#: Number of steps of all logs of a kernel together from which machine code is faster although it must be compiled
#: first: 0.2 s for 1,500 operations, 0.6 s for 4,500, 1.5 s for 10,400, where one in Python takes 40, 100 and 200 us.
WORTH_STEPS = 10_000
#: Number of steps of all lanes of one call together from which machine code is faster.
WORTH_LANE_STEPS = 400_000

#: Kernels are compiled one after the other behind their live steps, which need the processor too. A fork waits for the
#: compiler, whose own locks would stay closed in the child.
_BEHIND = Lock()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_BEHIND.acquire, after_in_parent=_BEHIND.release, after_in_child=_BEHIND.release)

T = TypeVar("T")
Progress = Callable[[int, int], None]


def repeatable_lowering() -> str:
    """Lowering whose live steps give equal bits for equal samples, whatever has been compiled before."""
    return os.environ.get("OHMWARD_LOWERING") or ("python" if llvm_machine_code.reason_for_none() else "machine")


class Kernel:
    """`function`, traced once with the structure of `examples` and compiled when it is first used.

    function:  written for tracing. For `scan` and `scan_lanes`: `step(state, sample) -> (state, output)`.
    examples:  arguments with the structure of later ones; their values do not matter.
    constants: further arguments, the same for all calls; they are not traced.
    lowering:  "python" needs nothing but NumPy, "machine" needs llvmlite. "auto" uses machine code if it is installed:
               live steps begin in Python while a thread compiles, whole logs wait for it if those so far, with this
               one, are long enough to pay for the compilation.
               None: the environment variable OHMWARD_LOWERING, else "auto".

    Results are those of `function` with floats. In Python: arithmetic, sqrt, comparisons and tables to the last bit;
    exp, log and the like within a few units in the last place (the platform's libm, where NumPy has its own). In
    machine code products and sums are fused, and exp and log are those of `elementary`: 1e-9 relative is usual.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        *examples: Any,
        constants: tuple[Any, ...] = (),
        lowering: str | None = None,
    ):
        self.function, self.examples, self.constants = function, examples, constants
        self.lowering = lowering or os.environ.get("OHMWARD_LOWERING") or "auto"
        require_one_of("lowering", self.lowering, LOWERINGS)
        self._scanned = 0  # steps of all logs; threads may lose some of each other's, which only delays the compilation
        self._key = None if self.lowering == "python" else stored_steps.key_of(function, examples, constants)
        self._at_hand = stored_steps.is_stored(self._key)  # its machine code needs no compilation
        self._behind: Thread | None = None  #: compiles the step behind its first live steps
        if not self._at_hand:
            _ = self.program  # errors in the function surface here

    @cached_property
    def program(self) -> Program:
        """The function, traced."""
        return trace(self.function, *self.examples, constants=self.constants)

    def __call__(self, *args: Any) -> Any:
        """`function(*args, *constants)`: numbers as Python floats, arrays as arrays of float64."""
        try:
            return self._call(*args)
        except (TypeError, ValueError):
            check(self.program.argument_structure, args)
            raise

    def scan(
        self,
        state: Any,
        samples: Any,
        progress: Progress | None = None,
        at_end: Collection[str] = (),
        into: Any = None,
    ) -> tuple[Any, Any]:
        """Step through one log.

        state:    the state before the first sample.
        samples:  the structure of a sample with a leading time axis (T, ...) on every leaf; a leaf without it holds for
                  all times.
        progress: called now and then with (steps done, T).
        at_end:   fields of the output that are stored at the last sample only, which takes less memory.
        into:     arrays of float64 of the shape of the outputs, to which they are written; None makes new ones.
        Returns:  the state after the last sample, and the outputs with a leading time axis: (T, ...), (1, ...) at_end.
        Raises:   InputError if the function is no step, or a shape does not fit.
        """
        worth = self._at_hand
        if not worth:
            self._scanned += self._steps(samples)[0]
            worth = self._scanned >= WORTH_STEPS
        return self._run(
            lambda: llvm_logs.run_log(self._one_machine, state, samples, progress, at_end, into),
            lambda: scan.run(self._scan, self.program.step_structure, state, samples, progress, at_end, into),
            worth,
        )

    def scan_lanes(self, state: Any, samples: Any) -> tuple[Any, Any]:
        """Step through many logs of the same length at once, one per lane.

        state:    every leaf with a trailing lane axis (..., B), or without it: the same for all lanes.
        samples:  every leaf with a leading time axis and a trailing lane axis (T, ..., B), or (T, ...) for all lanes,
                  or neither.
        Returns:  as `scan`, with a trailing lane axis on every leaf; each log is contiguous in memory if those of the
                  samples are, as in the transpose of (B, T).
        Raises:   InputError if the function is no step, or a shape does not fit.
        """
        length, steps = self._steps(samples)
        return self._run(
            lambda: llvm_logs.run_lanes(self.machine, state, samples),
            lambda: lanes.run(self._lanes, self.program.step_structure, state, samples),
            length >= WORTH_STEPS or steps >= WORTH_LANE_STEPS,
        )

    def live(self, state: Any, flags: FlagTable = None) -> Live:
        """The step as an object that keeps its state: `live(state).step(sample) -> output`.

        It runs in machine code if llvmlite is installed, found in the cache, or compiled behind the first steps in
        Python; with the lowering "machine" compiled now, so that equal samples give equal bits.

        flags: value that replaces each number in the output's field `flags`; None leaves the numbers.
        """

        def in_machine_code() -> Live:
            step = self._one_machine
            return MachineLive(step, step.program.step_structure.state, state, flags)

        def in_python() -> Live:
            return PythonLive(self, self.program.step_structure.state, state, flags)

        def in_python_at_first() -> Live:
            _ = self._call  # made from the trace, which is gone once the machine code is there
            first = in_python()
            if not (self._behind and self._behind.is_alive()):
                self._behind = self._begin_behind()
            return PromptLive(first, lambda: self._at_hand, lambda state: self.live(state, flags))

        compiles = self.lowering == "auto" and not llvm_machine_code.reason_for_none()
        return self._run(in_machine_code, in_python_at_first if compiles else in_python, worth=self._at_hand)

    def source(self, lowering: str = "python") -> str:
        """The generated program: "python" (one step), "numpy" (loop over many lanes) or "llvm" (loop over one log)."""
        if lowering == "python":
            return python_source.step_source(python_source.body(self.program))
        if lowering == "numpy":
            return self._lanes.source
        if lowering == "llvm":
            return self.machine.source(1, (False,) * self.machine.columns)
        raise InputError(f'source: lowering must be "python", "numpy" or "llvm", got {lowering!r}')

    def explain(self) -> str:
        """Operations of the program, and the lowering of calls, live samples and logs."""
        kinds = ", ".join(f"{count} {name}" for name, count in self.program.operations.most_common())
        head = f"{self.program.name}: {len(self.program.nodes)} operations ({kinds}). Calls: Python source on floats."
        in_python = "Python source; many at once: NumPy source, one array operation per operation and block of lanes."
        if self.lowering == "python":
            return f"{head}\nLive samples and logs: {in_python}"
        if reason := llvm_machine_code.reason_for_none():
            return f"{head}\nLive samples and logs: {in_python} No machine code: {reason}."
        in_machine_code = f"machine code, {self.machine.width} lanes wide."
        if self.lowering == "machine":
            return f"{head}\nLive samples and logs: {in_machine_code}"
        return f"{head}\nLive samples and long logs: {in_machine_code}\nFirst live samples, and short logs: {in_python}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled as the function and its examples; the other process traces again."""
        make = partial(Kernel, constants=self.constants, lowering=self.lowering)
        return make, (self.function, *self.examples)

    @cached_property
    def machine(self) -> MachineStep:
        """The step in machine code."""
        return MachineStep(self.program, self._state_size)

    @cached_property
    def _one_machine(self) -> MachineStep:
        """The step in machine code for one log and for live samples, from the disk if it is stored there."""
        if self._key is None:
            return self.machine
        step = stored_steps.stored_step(self._key, lambda: self.machine)
        self._at_hand = True
        for traced in ("program", "machine"):  # a process that runs for months does not hold the trace
            self.__dict__.pop(traced, None)
        return step

    def _begin_behind(self) -> Thread:
        """Compile the step for live samples in a thread."""

        def compile_step() -> None:
            with _BEHIND:
                if main_thread().is_alive():  # a process that ends waits for no further step
                    step = self._one_machine
                    step.function(1, (False,) * step.columns)
                    self._at_hand = True
                    return_freed()

        thread = Thread(target=lambda: self._run(compile_step, lambda: None, worth=True), name="compile")
        thread.start()
        return thread

    def _run(self, in_machine_code: Callable[[], T], otherwise: Callable[[], T], worth: bool) -> T:
        """Run in machine code if asked for, or if left open and worth it; warn once where there is none."""
        if self.lowering == "python" or (self.lowering != "machine" and not worth):
            return otherwise()
        try:
            return in_machine_code()
        except llvm_machine_code.NoMachineCodeError as error:
            if self.lowering == "machine":
                raise
            code_cache.warn_once(f"no machine code: {error}; this runs in Python, ten to a hundred times slower")
            return otherwise()

    def _steps(self, samples: Any) -> tuple[int, int]:
        """Number of steps along time, and of all lanes together."""
        structure = self.program.step_structure.sample
        pairs = list(zip(leaves(structure), flatten(structure, samples, "samples"), strict=True))
        lengths = [len(value) for (_, leaf), value in pairs if np.ndim(value) > len(leaf.shape)]
        sizes = [np.size(value) // max(1, leaf.size) for (_, leaf), value in pairs]
        return max(lengths, default=0), max(sizes, default=0)

    @cached_property
    def _call(self) -> Callable[..., Any]:
        return python_source.compile_call(self.program)

    @cached_property
    def _scan(self) -> Callable[..., Any]:
        return python_source.compile_scan(self.program, self._state_size)

    @cached_property
    def _lanes(self) -> numpy_source.Lanes:
        return numpy_source.compile_lanes(self.program, self._state_size)

    @property
    def _state_size(self) -> int:
        return size(self.program.step_structure.state)
