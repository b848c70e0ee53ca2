"""A step in machine code over one log, over many logs in lanes, and sample by sample."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from threading import Lock
from typing import Any

import numpy as np

from ohmward.trace.elementary import PRECISIONS, expand
from ohmward.trace.lower.lanes import lanes_apart
from ohmward.trace.lower.llvm_instructions import Target
from ohmward.trace.lower.llvm_machine_code import compile_scan, vector_bits
from ohmward.trace.lower.llvm_source import scan_source
from ohmward.trace.program import Program

_DOUBLE = 8
#: Name of the compiled loop.
STEP_NAME = "ohmward_scan"
_ONE_AT_A_TIME = Lock()
#: Steps between two reports of progress.
_REPORTED_MACHINE_STEPS = 1 << 16
#: Bytes of samples and outputs that all lanes process before the next steps: they should stay in the cache.
_CACHE = 1 << 20
#: Smallest number of steps at a time. Fewer would load and store the state too often: 16 take a seventh longer with
#: 1024 logs and 7 states.
_LEAST_STEPS = 64
#: Doubles between the rows of the state of many logs: one cache line.
_PADDING = 8

#: Called with (steps done, all steps).
Progress = Callable[[int, int], None]

Columns = Sequence[np.ndarray]


@dataclass(frozen=True)
class MachineStep:
    """A program `step(state, sample) -> (state, output)` in machine code, compiled when it is first run."""

    program: Program  #:    as traced
    state_size: int  #: number of its first inputs and outputs that are the state
    precision: str = "f64"  #:  "f64" or "f32", of the arithmetic
    contract: bool = True  #:   see `Target`

    @classmethod
    def of_code(cls, program: Program, state_size: int, code: tuple[Callable[..., None], Any]) -> MachineStep:
        """The step whose loop for one log was compiled before; the program may come without its operations."""
        step = cls(program, state_size)
        step._compiled[1, (False,) * step.columns] = code
        return step

    @property
    def expanded(self) -> Program:
        """The program without exp, log and the like."""
        return expand(self.program, PRECISIONS[self.precision])

    @property
    def columns(self) -> int:
        """Number of scalars of a sample."""
        return len(self.program.inputs) - self.state_size

    @cached_property
    def width(self) -> int:
        """Number of lanes in a vector of this processor."""
        return vector_bits() // (64 if self.precision == "f64" else 32)

    @cached_property
    def _compiled(self) -> dict[tuple[int, tuple[bool, ...]], tuple[Callable[..., None], Any]]:
        return {}

    def function(self, width: int, own: tuple[bool, ...]) -> Callable[..., None]:
        """The compiled loop; own: for each column True where every lane has its own value."""
        key = width, own
        with _ONE_AT_A_TIME:  # a second compilation would free the code of the first while it runs
            if key not in self._compiled:
                self._compiled[key] = compile_scan(self.source(width, own), STEP_NAME)
            run, _ = self._compiled[key]
            return run

    def source(self, width: int, own: tuple[bool, ...]) -> str:
        """IR of the loop."""
        target = Target(PRECISIONS[self.precision], width, self.contract)
        return scan_source(self.expanded, self.state_size, target, own, STEP_NAME)

    def one(self, state: np.ndarray, columns: Columns, outputs: Columns, progress: Progress | None) -> None:
        """Step through one log; state (n,) is changed, outputs are filled; columns and outputs (T,) of float64."""
        count = len(columns[0])
        run = self.function(1, (False,) * self.columns)
        arrays = _Arrays(columns), _Arrays(outputs)
        for first in range(0, count, _REPORTED_MACHINE_STEPS):
            last = min(first + _REPORTED_MACHINE_STEPS, count)
            _call(run, state, _DOUBLE, *arrays, first, last, 0, 1)
            if progress:
                progress(last, count)

    def many(self, state: np.ndarray, columns: Columns, outputs: Columns, threads: int) -> None:
        """Step through logs of one length, a log in each lane; state (n, B), columns (T, B) or (T,), outputs (T, B)."""
        lanes = state.shape[1]
        full = lanes - lanes % self.width
        parts = [slice(a, b) for a, b in _shares(full, self.width, threads)]
        rows = _apart(state)
        run = partial(self._blocks, rows, columns, outputs)
        if len(parts) > 1:
            with ThreadPoolExecutor(len(parts)) as pool:
                list(pool.map(run, parts))
        else:  # another thread would begin with an empty cache
            list(map(run, parts))
        if full < lanes:
            self._rest(rows, columns, outputs, slice(full, lanes))
        state[:] = rows

    def _blocks(self, state: np.ndarray, columns: Columns, outputs: Columns, part: slice) -> None:
        """Step the lanes of a part, in chunks of steps whose samples and outputs stay in the cache.

        Columns and outputs whose lanes are not adjacent in memory, as with whole logs, go through a table of that size.
        """
        count, width = len(columns[0]), part.stop - part.start
        run = self.function(self.width, tuple(c.ndim == 2 for c in columns))
        bytes_of_step = _DOUBLE * width * (len(columns) + len(outputs))
        chunk = min(max(_LEAST_STEPS, _CACHE // max(1, bytes_of_step)), count)
        tables = {id(c): np.empty((chunk, width)) for c in (*columns, *outputs) if c.ndim == 2 and lanes_apart(c)}
        rows = state[:, part]

        def memory_of(c: np.ndarray, steps: slice) -> np.ndarray:
            if id(c) in tables:
                return tables[id(c)]
            return c[steps] if c.ndim == 1 else c[steps, part]

        for first in range(0, count, chunk):
            steps = slice(first, min(first + chunk, count))
            size = steps.stop - steps.start
            for c in columns:
                if id(c) in tables:
                    tables[id(c)][:size] = c[steps, part]
            here, there = (_Arrays([memory_of(c, steps) for c in group]) for group in (columns, outputs))
            _call(run, rows, rows.strides[0], here, there, 0, size, 0, width)
            for c in outputs:
                if id(c) in tables:
                    c[steps, part] = tables[id(c)][:size]

    def _rest(self, state: np.ndarray, columns: Columns, outputs: Columns, part: slice) -> None:
        """Step the last lanes, too few for a vector, in a vector filled up with copies of the last of them."""
        lanes = part.stop - part.start
        count = len(columns[0])

        def filled_up(values: np.ndarray) -> np.ndarray:
            return np.pad(values[:, part], ((0, 0), (0, self.width - lanes)), mode="edge")

        padded = filled_up(state)
        own = [filled_up(c) if c.ndim == 2 else c for c in columns]
        results = [np.empty((count, self.width)) for _ in outputs]
        self._blocks(padded, own, results, slice(0, self.width))
        state[:, part] = padded[:, :lanes]
        for whole, result in zip(outputs, results, strict=True):
            whole[:, part] = result[:, :lanes]


class OneStep:
    """A step that has its state, sample and output in memory of its own: (n,) of float64 each.

    run: makes one step from `state` and `sample` to `state` and `output`.
    """

    def __init__(self, step: MachineStep, state: np.ndarray):
        self.state = np.array(state, dtype=float)
        self.sample = np.zeros(step.columns)
        self.output = np.zeros(len(step.program.outputs) - step.state_size)
        columns = _Arrays(list(self.sample[:, None]))
        results = _Arrays(list(self.output[:, None]))
        addresses = [*columns.addresses, *results.addresses]
        self.run = partial(
            step.function(1, (False,) * step.columns),
            ctypes.c_void_p(self.state.ctypes.data),
            ctypes.c_int64(_DOUBLE),
            *map(ctypes.c_void_p, addresses),
            *map(ctypes.c_int64, (0, 1, 0, 1)),  # steps and lanes: from 0 to 1
        )
        self.run.__dict__["memory"] = step, self.state, columns, results  # code and data live as long as `run`


class _Arrays:
    """Pointers to arrays and the bytes between their rows, in the form that the machine code takes.

    addresses: of the pointers and of the strides; they are valid as long as this object lives.
    """

    def __init__(self, arrays: Sequence[np.ndarray]):
        self._arrays = list(arrays)
        self._pointers = (ctypes.c_void_p * len(arrays))(*(a.ctypes.data for a in arrays))
        self._strides = (ctypes.c_int64 * len(arrays))(*(a.strides[0] for a in arrays))
        self.addresses = ctypes.addressof(self._pointers), ctypes.addressof(self._strides)


def _call(
    run: Callable[..., None], state: np.ndarray, row: int, columns: _Arrays, outputs: _Arrays, *numbers: int
) -> None:
    run(state.ctypes.data, row, *columns.addresses, *outputs.addresses, *numbers)


def _apart(rows: np.ndarray) -> np.ndarray:
    """A copy with a gap between the rows: a power of two apart, they would share the same few cache lines."""
    spaced = np.empty((len(rows), rows.shape[1] + _PADDING))[:, : rows.shape[1]]
    spaced[:] = rows
    return spaced


def _shares(lanes: int, width: int, threads: int) -> Iterator[tuple[int, int]]:
    """First lane and end of each thread's part: whole blocks of lanes."""
    blocks = lanes // width
    parts = min(threads, blocks)
    edges = [round(k * blocks / max(1, parts)) * width for k in range(parts + 1)]
    return pairwise(edges)


def processors() -> int:
    """Processors that this process may use: OHMWARD_THREADS, else all that it is allowed."""
    if named := os.environ.get("OHMWARD_THREADS", ""):
        return max(1, int(named)) if named.isdigit() else 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
