"""Whole logs through machine code: trees of arrays become columns of doubles, and outputs become trees again."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from ohmward.trace import scan
from ohmward.trace.lower import lanes
from ohmward.trace.lower.llvm_run import MachineStep, processors
from ohmward.trace.structure import Structure, flatten, leaves, shaped, unflatten

Progress = Callable[[int, int], None]


def run_log(
    step: MachineStep,
    state: Any,
    samples: Any,
    progress: Progress | None = None,
    at_end: Collection[str] = (),
    into: Any = None,
) -> tuple[Any, Any]:
    """Step through one log; see `Kernel.scan`."""
    structure = step.program.step_structure
    columns, count = scan.sample_columns(structure.sample, samples)
    row = np.array(scan.state_row(structure.state, state), dtype=float)
    arrays = scan.output_arrays(structure.output, count, at_end, float)
    results = arrays if into is None else flatten(structure.output, into)
    scalars = [v for r in results for v in r.reshape(len(r), math.prod(r.shape[1:])).T]
    scalars = [np.broadcast_to(v, count) for v in scalars]  # every step writes a value at the end to the same place
    step.one(row, _doubles(columns), scalars, progress)
    return shaped(structure.state, row.tolist()), _typed(structure.output, results)


def run_lanes(step: MachineStep, state: Any, samples: Any) -> tuple[Any, Any]:
    """Step through many logs; see `Kernel.scan_lanes`."""
    structure = step.program.step_structure
    batch = lanes.make_batch(structure, state, samples)
    rows = np.array(batch.rows, dtype=float).reshape(-1, batch.width)
    results = [o if o.dtype == float else np.empty_like(o, float) for o in batch.outputs]
    scalars = [v for r in results for v in np.moveaxis(r.reshape(batch.steps, -1, batch.width), 1, 0)]
    step.many(rows, _doubles(batch.columns), scalars, processors())
    return lanes.state_tree(structure.state, list(rows), batch.width), _typed(structure.output, results)


def _doubles(columns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Columns as doubles, conditions as 0.0 and 1.0."""
    return [np.asarray(c, dtype=float) for c in columns]


def _typed(structure: Structure, results: Sequence[np.ndarray]) -> Any:
    """The tree of outputs, with bools for conditions."""
    pairs = zip(leaves(structure), results, strict=True)
    return unflatten(structure, (values.astype(leaf.dtype, copy=False) for (_, leaf), values in pairs))
