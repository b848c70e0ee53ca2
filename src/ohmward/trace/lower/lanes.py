"""Many logs at once through the compiled NumPy loop.

A block of lanes runs through its whole log before the next block starts, so that its registers stay in the cache.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.trace.lower.numpy_source import Lanes
from ohmward.trace.program import StepStructure
from ohmward.trace.scan import LeafArray, common_length, leaf_arrays
from ohmward.trace.structure import Leaf, Structure, leaves, unflatten

#: Number of lanes that run together: the overhead of a NumPy call equals its work on 1000 to 2000 lanes, and the
#: registers of a seven-state filter with 4096 lanes take 3 MB of the cache.
BLOCK_LANES = 4096


def run(lanes: Lanes, structure: StepStructure, state: Any, samples: Any) -> tuple[Any, Any]:
    """Run every lane through its whole log, block after block; see `Kernel.scan_lanes`."""
    batch = make_batch(structure, state, samples)
    final = [np.empty(batch.width, r.dtype) for r in batch.rows]
    for start in range(0, batch.width, BLOCK_LANES):
        _run_block(lanes, batch, final, slice(start, min(start + BLOCK_LANES, batch.width)))
    return state_tree(structure.state, final, batch.width), unflatten(structure.output, iter(batch.outputs))


class Batch(NamedTuple):
    """Many logs as rows and columns of scalars."""

    rows: list[np.ndarray]  #:    (B,) for each scalar of the state
    columns: list[np.ndarray]  #: (T, B), or (T,) for all lanes, for each scalar of a sample
    outputs: list[np.ndarray]  #: (T, ..., B) for each leaf of the output, to be filled
    views: list[np.ndarray]  #:   (T, B) for each scalar of the outputs
    #: T and B
    steps: int
    width: int


def make_batch(structure: StepStructure, state: Any, samples: Any) -> Batch:
    """Rows and columns of the arguments of `Kernel.scan_lanes`; InputError where a shape does not fit."""
    states = leaf_arrays(structure.state, state, "state")
    values = leaf_arrays(structure.sample, samples, "samples")
    count = common_length(values)
    width = _lane_count(states, values)
    rows = [r for leaf, v, path in states for r in _state_rows(leaf, v, path, width)]
    columns = [c for leaf, v, path in values for c in _sample_columns(leaf, v, path, count, width)]
    by_log = any(c.ndim == 2 and lanes_apart(c) for c in columns)
    outputs = [_output(leaf, count, width, by_log) for _, leaf in leaves(structure.output)]
    views = [v for o in outputs for v in np.moveaxis(o.reshape(count, -1, width), 1, 0)]
    return Batch(rows, columns, outputs, views, count, width)


def lanes_apart(values: np.ndarray) -> bool:
    """True where the lanes of a step in (T, B) are not adjacent in memory."""
    return values.shape[1] > 1 and values.strides[1] != values.itemsize


def _output(leaf: Leaf, count: int, width: int, by_log: bool) -> np.ndarray:
    """An output (T, ..., B) to be filled; by_log: each log is contiguous in memory, like those of the samples."""
    if by_log:
        return np.swapaxes(np.empty((width, *leaf.shape, count), leaf.dtype), 0, -1)
    return np.empty((count, *leaf.shape, width), leaf.dtype)


def _run_block(lanes: Lanes, batch: Batch, final: list[np.ndarray], part: slice) -> None:
    width = part.stop - part.start
    states = _rows(width, [r.dtype for r in batch.rows])
    for state, row in zip(states, batch.rows, strict=True):
        state[:] = row[part]
    registers = _rows(width, lanes.registers)
    samples = [c[:, part] if c.ndim == 2 else c for c in batch.columns]
    outputs = [v[:, part] for v in batch.views]
    index = np.empty(width, dtype=np.intp)
    with np.errstate(all="ignore"):
        states = lanes.scan(states, registers, samples, outputs, index, batch.steps)
    for whole, block in zip(final, states, strict=True):
        whole[part] = block


def _rows(width: int, kinds: Sequence[Any]) -> list[np.ndarray]:
    """Uninitialised arrays (width,), side by side in memory."""
    floats, flags = iter(np.empty((len(kinds), width))), iter(np.empty((len(kinds), width), dtype=bool))
    return [next(flags if np.dtype(kind) == np.bool_ else floats) for kind in kinds]


def _lane_count(states: Iterable[LeafArray], values: Iterable[LeafArray]) -> int:
    """B, from the leaves that have a lane axis: last in a state, last in samples that also have a time axis."""
    of_states: set[int] = {v.shape[-1] for leaf, v, _ in states if v.ndim == len(leaf.shape) + 1}
    of_samples: set[int] = {v.shape[-1] for leaf, v, _ in values if v.ndim == len(leaf.shape) + 2}
    widths = of_states | of_samples
    if len(widths) != 1:
        raise InputError(f"state and samples must have one common number of lanes, got {sorted(widths) or 'none'}")
    return widths.pop()


def _state_rows(leaf: Leaf, value: np.ndarray, path: str, width: int) -> Iterator[np.ndarray]:
    """One row (B,) per scalar of a state leaf."""
    if value.shape not in (leaf.shape, (*leaf.shape, width)):
        raise InputError(f"{path} must have the shape {(*leaf.shape, width)} or {leaf.shape}, got {value.shape}")
    lanes = value if value.ndim > len(leaf.shape) else np.broadcast_to(value[..., None], (*leaf.shape, width))
    return iter(lanes.reshape(leaf.size, width))


def _sample_columns(leaf: Leaf, value: np.ndarray, path: str, count: int, width: int) -> Iterator[np.ndarray]:
    """One column (T, B), or (T,) for all lanes, per scalar of a sample leaf."""
    own, shared = (count, *leaf.shape, width), (count, *leaf.shape)
    if value.shape == own:
        return iter(np.moveaxis(value.reshape(count, leaf.size, width), 1, 0))
    if value.shape not in (shared, leaf.shape):
        raise InputError(f"{path} must have the shape {own}, {shared} or {leaf.shape}, got {value.shape}")
    return iter(np.broadcast_to(value, shared).reshape(count, leaf.size).T)


def state_tree(structure: Structure, final: Sequence[np.ndarray], width: int) -> Any:
    """The state rebuilt from its rows (B,): every leaf with a trailing lane axis."""
    rows = iter(final)

    def value(leaf: Leaf) -> np.ndarray:
        return np.array([next(rows) for _ in range(leaf.size)], leaf.dtype).reshape(*leaf.shape, width)

    return unflatten(structure, (value(leaf) for _, leaf in leaves(structure)))
