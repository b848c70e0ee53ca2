"""A function compiled: one call, live samples, one log, many logs, with the best lowering that is installed."""

import os
import warnings
from collections.abc import Callable
from functools import cache, cached_property
from typing import Any

import numpy as np

from ohmward.errors import InputError, OhmwardError
from ohmward.trace import scan
from ohmward.trace.live import Live, MachineLive, PythonLive
from ohmward.trace.lower import lanes, numpy_source, python_source
from ohmward.trace.program import Program, trace
from ohmward.trace.structure import Branch, Leaf, Structure, check, flatten, leaves, size

LOWERINGS = ("auto", "python", "machine")

#: From so many steps on, machine code is faster although it must be compiled first: of a log, of all lanes together.
WORTH_STEPS, WORTH_LANE_STEPS = 10_000, 400_000


class Kernel:
    """`function`, traced once with the structure of `examples` and compiled when it is first used.

    function:  written for tracing. For `scan` and `scan_lanes`: `step(state, sample) -> (state, output)`.
    examples:  arguments of the structure to come; their values do not matter.
    constants: further arguments, the same for all calls; they are not traced.
    lowering:  of whole logs: "python" needs nothing but NumPy, "machine" needs llvmlite, "auto" takes machine code
               where it is installed and the log is long enough to pay for the compilation. None: as the environment
               variable OHMWARD_LOWERING says, else "auto".

    Results are those of `function` with floats. In Python: arithmetic, sqrt, comparisons and tables to the last bit;
    exp, log and their like within a few units in the last place (the platform's libm, where NumPy has its own). In
    machine code products and sums are fused, and exp and log are those of `elementary`: 1e-9 relative is usual.
    """

    def __init__(self, function: Callable, *examples: Any, constants: tuple = (), lowering: str | None = None):
        self.function, self.examples, self.constants = function, examples, constants
        self.lowering = lowering or os.environ.get("OHMWARD_LOWERING") or "auto"
        if self.lowering not in LOWERINGS:
            raise InputError(f"lowering must be one of {', '.join(LOWERINGS)}, got {self.lowering!r}")
        self.program: Program = trace(function, *examples, constants=constants)

    def __call__(self, *args: Any) -> Any:
        """What `function(*args, *constants)` returns: numbers as Python floats, arrays as arrays of float64."""
        try:
            return self._call(*args)
        except (TypeError, ValueError):
            check(self.program.argument_structure, args)
            raise

    def scan(self, state: Any, samples: Any, progress: Callable[[int, int], None] | None = None) -> tuple[Any, Any]:
        """Step through one log.

        state:    the state before the first sample.
        samples:  the structure of a sample with a leading time axis (T, ...) on every leaf; a leaf without it holds for
                  all times.
        progress: called now and then with (steps done, T).
        Returns:  the state after the last sample, and the outputs with a leading time axis.
        Raises:   InputError if the function is no step, or a shape does not fit.
        """

        def in_machine_code() -> tuple[Any, Any]:
            from ohmward.trace.lower.llvm_logs import run_log

            return run_log(self.machine, self._step_structures, state, samples, progress)

        def in_python() -> tuple[Any, Any]:
            return scan.run(self._scan, *self._step_structures, state, samples, progress)

        return self._run(in_machine_code, in_python, self._worth(samples, WORTH_STEPS))

    def scan_lanes(
        self, state: Any, samples: Any, progress: Callable[[int, int], None] | None = None
    ) -> tuple[Any, Any]:
        """Step through many logs of the same length at once, one per lane.

        state:    every leaf with a trailing lane axis (..., B), or without it: the same for all lanes.
        samples:  every leaf with a leading time axis and a trailing lane axis (T, ..., B), or (T, ...) for all lanes,
                  or neither.
        progress: called now and then with (steps done, T times the number of blocks of lanes).
        Returns:  as `scan`, with a trailing lane axis on every leaf.
        Raises:   InputError if the function is no step, or a shape does not fit.
        """

        def in_machine_code() -> tuple[Any, Any]:
            from ohmward.trace.lower.llvm_logs import run_lanes

            return run_lanes(self.machine, self._step_structures, state, samples, progress)

        def in_numpy() -> tuple[Any, Any]:
            return lanes.run(self._lanes, *self._step_structures, state, samples, progress)

        return self._run(in_machine_code, in_numpy, self._worth(samples, WORTH_LANE_STEPS))

    def live(self, state: Any) -> Live:
        """The step as an object that remembers: `live(state).step(sample) -> output`.

        In machine code where it is installed, which is compiled now, or found in the cache.
        """
        return self._run(
            lambda: MachineLive(self.machine, self._step_structures[0], state),
            lambda: PythonLive(self, state),
            worth=not _no_machine_code(),
        )

    def source(self, lowering: str = "python") -> str:
        """The generated program: "python" (one step), "numpy" (the loop of many lanes) or "llvm" (that of one log)."""
        if lowering == "python":
            return python_source.step_source(python_source.body(self.program))
        if lowering == "numpy":
            return self._lanes.source
        if lowering == "llvm":
            return self.machine.source(1, (False,) * self.machine.columns)
        raise InputError(f'source: lowering must be "python", "numpy" or "llvm", got {lowering!r}')

    def explain(self) -> str:
        """Which lowering runs what, and why."""
        kinds = ", ".join(f"{count} {name}" for name, count in self.program.operations.most_common())
        return (
            f"{self.program.name}: {len(self.program.nodes)} operations ({kinds}).\n"
            "One call and one log (scan): straight-line Python source on floats.\n"
            "Many logs (scan_lanes): NumPy source, one array operation per operation and block of lanes.\n"
            f"Long logs: {self._machine_code_in_words()}."
        )

    def __reduce__(self) -> tuple:
        """Pickled as the function and its examples; the other process traces again."""
        return _rebuild, (self.function, self.examples, self.constants, self.lowering)

    @cached_property
    def machine(self) -> Any:
        """The step in machine code, an `ohmward.trace.lower.llvm_run.MachineStep`."""
        from ohmward.trace.lower.llvm_run import MachineStep

        return MachineStep(self.program, size(self._step_structures[0]))

    def _run(self, in_machine_code: Callable[[], Any], otherwise: Callable[[], Any], worth: bool) -> Any:
        """The first where it is asked for, or left open and worth it; where it cannot be had, that is said once."""
        if self.lowering == "python" or (self.lowering == "auto" and not worth):
            return otherwise()
        from ohmward.trace.lower.llvm_machine_code import NoMachineCodeError

        try:
            return in_machine_code()
        except NoMachineCodeError as error:
            if self.lowering == "machine":
                raise
            _say_once(f"no machine code: {error}; this runs in Python, ten to a hundred times slower")
            return otherwise()

    def _worth(self, samples: Any, steps_worth: int) -> bool:
        """Whether these samples are so many that machine code pays for its compilation."""
        structure = self._step_structures[1]
        pairs = list(zip(leaves(structure), flatten(structure, samples, "samples"), strict=True))
        steps = max((np.size(value) // max(1, leaf.size) for (_, leaf), value in pairs), default=0)
        length = max((len(value) for (_, leaf), value in pairs if np.ndim(value) > len(leaf.shape)), default=0)
        return steps >= steps_worth or length >= WORTH_STEPS

    def _machine_code_in_words(self) -> str:
        reason = _no_machine_code()
        return f"no machine code, {reason}" if reason else f"machine code, {self.machine.width} lanes wide"

    @cached_property
    def _call(self) -> Callable:
        return python_source.compile_call(self.program)

    @cached_property
    def _scan(self) -> Callable:
        return python_source.compile_scan(self.program, size(self._step_structures[0]))

    @cached_property
    def _lanes(self) -> numpy_source.Lanes:
        return numpy_source.compile_lanes(self.program, size(self._step_structures[0]))

    @cached_property
    def _step_structures(self) -> tuple[Structure, Structure, Structure]:
        """Structures of state, sample and output; InputError if the function is no step."""
        arguments, result, name = self.program.argument_structure, self.program.result_structure, self.program.name
        if len(arguments.children) != 2 or not isinstance(result, Branch) or len(result.children) != 2:
            raise InputError(f"a scan needs step(state, sample) -> (state, output); {name} has another form")
        (before, sample), (after, output) = arguments.children, result.children
        for (path, old), (_, new) in zip(leaves(before, "state"), leaves(after, "state"), strict=False):
            if old != new:
                raise InputError(f"{name} turns {path} from {_describe(old)} into {_describe(new)}; they must be alike")
        if before != after:
            raise InputError(f"the state that {name} returns must have the structure of the one that it takes")
        return before, sample, output


def _describe(leaf: Leaf) -> str:
    kind = "condition" if leaf.boolean else "number"
    return f"an array {leaf.shape} of {kind}s" if leaf.shape else f"a {kind}"


def _rebuild(function: Callable, examples: tuple, constants: tuple, lowering: str) -> Kernel:
    return Kernel(function, *examples, constants=constants, lowering=lowering)


def _no_machine_code() -> str:
    """Why there is no machine code; empty if there is."""
    from ohmward.trace.lower.llvm_machine_code import llvm

    try:
        llvm()
    except OhmwardError as error:
        return str(error)
    return ""


@cache
def _say_once(what: str) -> None:
    warnings.warn(what, RuntimeWarning, stacklevel=2)
