"""A function compiled: one call, one log, many logs, with the best lowering that is installed."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.trace import numpy_lanes, python_source
from ohmward.trace.program import Program, trace
from ohmward.trace.structure import Branch, Leaf, Structure, check, flatten, leaves, unflatten

Progress = Callable[[int, int], None]

#: Scalars in memory at a time while a log is turned into Python floats and back.
_CHUNK_SCALARS = 1 << 18


class Kernel:
    """`function`, traced once with the structure of `examples` and compiled when it is first used.

    function:  written for tracing. For `scan` and `scan_lanes`: `step(state, sample) -> (state, output)`.
    examples:  arguments of the structure to come; their values do not matter.
    constants: further arguments, the same for all calls; they are not traced.

    Results are those of `function` with floats: arithmetic, sqrt, comparisons and tables to the last bit, exp, log and
    their like within a few units in the last place (the platform's libm instead of NumPy's).
    """

    def __init__(self, function: Callable, *examples: Any, constants: tuple = ()):
        self.function = function
        self.program: Program = trace(function, *examples, constants=constants)

    def __call__(self, *args: Any) -> Any:
        """What `function(*args, *constants)` returns: numbers as Python floats, arrays as arrays of float64."""
        try:
            return self._call(*args)
        except (TypeError, ValueError):
            check(self.program.argument_structure, args)
            raise

    def scan(self, state: Any, samples: Any, progress: Progress | None = None) -> tuple[Any, Any]:
        """Step through one log.

        state:   the state before the first sample.
        samples: the structure of a sample with a leading time axis (T,) on every leaf; a leaf without it holds for all
                 times.
        Returns: the state after the last sample, and the outputs with a leading time axis.
        """
        columns, count = _time_columns(self._sample, samples)
        row = _state_row(self._state, state)
        outputs: list[np.ndarray] = [np.empty((count, *leaf.shape), leaf.dtype) for _, leaf in leaves(self._output)]
        chunk = max(1, _CHUNK_SCALARS // (len(columns) + _size(self._output)))
        for first in range(0, count, chunk):
            last = min(first + chunk, count)
            row = self._scan_chunk(row, [c[first:last] for c in columns], [o[first:last] for o in outputs])
            if progress:
                progress(last, count)
        return _state_tree(self._state, row), unflatten(self._output, iter(outputs))

    def _scan_chunk(self, row: Any, columns: list[np.ndarray], outputs: list[np.ndarray]) -> Any:
        emitted: list[float] = []
        row = self._scan(row, [c.tolist() for c in columns], emitted.extend)
        table, start = np.array(emitted, dtype=float).reshape(len(columns[0]), -1), 0
        for output in outputs:
            size = output[0].size
            output[:] = table[:, start : start + size].reshape(output.shape)
            start += size
        return row

    def scan_lanes(self, state: Any, samples: Any, progress: Progress | None = None) -> tuple[Any, Any]:
        """Step through many logs at once, one per lane.

        state:   every leaf with a trailing lane axis (B,), or without it: the same for all lanes.
        samples: every leaf with a leading time axis and a trailing lane axis (T, ..., B), or (T, ...) for all lanes, or
                 neither.
        Returns: as `scan`, with a trailing lane axis on every leaf.
        """
        return numpy_lanes.run(self._lanes, self._state, self._sample, self._output, state, samples, progress)

    def source(self, lowering: str = "python") -> str:
        """The generated program: "python" (one step, scalars in, scalars out) or "numpy" (the loop over lanes)."""
        if lowering == "python":
            return python_source.step_source(self.program)
        if lowering == "numpy":
            return self._lanes.source
        raise InputError(f'source: lowering must be "python" or "numpy", got {lowering!r}')

    def explain(self) -> str:
        """Which lowering runs what, and why."""
        kinds = ", ".join(f"{count} {name}" for name, count in self.program.operations.most_common())
        return (
            f"{self.program.name}: {len(self.program.nodes)} operations ({kinds}).\n"
            "One call and one log (scan): Python source, straight-line, on floats.\n"
            "Many logs (scan_lanes): NumPy, one array operation per operation and block of lanes.\n"
            "Both need nothing but NumPy; there is no machine-code lowering yet."
        )

    @cached_property
    def _call(self) -> Callable:
        return python_source.compile_call(self.program)

    @cached_property
    def _scan(self) -> Callable:
        return python_source.compile_scan(self.program, _size(self._state))

    @cached_property
    def _lanes(self) -> numpy_lanes.Lanes:
        return numpy_lanes.compile_lanes(self.program, _size(self._state))

    @property
    def _state(self) -> Structure:
        return self._step_structures[0]

    @property
    def _sample(self) -> Structure:
        return self._step_structures[1]

    @property
    def _output(self) -> Structure:
        return self._step_structures[2]

    @cached_property
    def _step_structures(self) -> tuple[Structure, Structure, Structure]:
        """Structures of state, sample and output; InputError if the function is no step."""
        arguments, result = self.program.argument_structure, self.program.result_structure
        name = self.program.name
        if len(arguments.children) != 2 or not isinstance(result, Branch) or len(result.children) != 2:
            raise InputError(f"scan needs step(state, sample) -> (state, output); {name} has another form")
        before, after = arguments.children[0], result.children[0]
        for (path, old), (_, new) in zip(leaves(before, "state"), leaves(after, "state"), strict=False):
            if old != new:
                raise InputError(f"scan: {name} turns {path} from {_describe(old)} into {_describe(new)}")
        if before != after:
            raise InputError(f"scan: the state that {name} returns has another structure than the one it takes")
        return before, arguments.children[1], result.children[1]


def _describe(leaf: Leaf) -> str:
    kind = "condition" if leaf.boolean else "number"
    return f"an array {leaf.shape} of {kind}s" if leaf.shape else f"a {kind}"


def _size(structure: Structure) -> int:
    return sum(leaf.size for _, leaf in leaves(structure))


def _time_columns(structure: Structure, samples: Any) -> tuple[list[np.ndarray], int]:
    """One column (T,) per scalar of a sample, and T."""
    named = list(leaves(structure, "samples"))
    values = [
        _as_array(value, leaf, path)
        for value, (path, leaf) in zip(flatten(structure, samples, "samples"), named, strict=True)
    ]
    lengths = {v.shape[0] for v, (_, leaf) in zip(values, named, strict=True) if v.ndim == len(leaf.shape) + 1}
    if len(lengths) != 1:
        raise InputError(f"samples must have one common length along time, got {sorted(lengths) or 'none'}")
    (count,) = lengths
    columns: list[np.ndarray] = []
    for value, (path, leaf) in zip(values, named, strict=True):
        if value.shape not in (leaf.shape, (count, *leaf.shape)):
            raise InputError(f"{path} must have the shape {(count, *leaf.shape)} or {leaf.shape}, got {value.shape}")
        columns.extend(np.broadcast_to(value, (count, *leaf.shape)).reshape(count, leaf.size).T)
    return columns, count


def _as_array(value: Any, leaf: Leaf, path: str) -> np.ndarray:
    try:
        return np.asarray(value, dtype=leaf.dtype)
    except (TypeError, ValueError) as error:
        raise InputError(f"{path} must hold numbers, got {value!r:.80}") from error


def _state_row(structure: Structure, state: Any) -> tuple:
    """The state as one tuple of Python scalars."""
    check(Branch(tuple, ("state",), (structure,)), (state,))
    values = zip(leaves(structure), flatten(structure, state), strict=True)
    return tuple(x for (_, leaf), value in values for x in np.asarray(value, dtype=leaf.dtype).ravel().tolist())


def _state_tree(structure: Structure, row: Any) -> Any:
    rest = iter(row)

    def value(leaf: Leaf) -> Any:
        scalars: list[Any] = [leaf.dtype(next(rest)) for _ in range(leaf.size)]
        return np.array(scalars, leaf.dtype).reshape(leaf.shape) if leaf.shape else scalars[0]

    return unflatten(structure, (value(leaf) for _, leaf in leaves(structure)))
