"""Run one log through the compiled Python loop, in chunks that keep the memory bounded."""

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.trace.program import StepStructure
from ohmward.trace.structure import Leaf, Structure, as_array, check, flatten, leaves, shaped, size, unflatten

#: Number of scalars that are Python floats at the same time: about 10 MB.
_CHUNK_SCALARS = 1 << 18

#: The compiled loop: (state, columns, emit) -> state.
Scan = Callable[[Sequence[Any], Sequence[list[Any]], Callable[[Sequence[float]], None]], Sequence[Any]]


def run(
    scan: Scan,
    structure: StepStructure,
    state: Any,
    samples: Any,
    progress: Callable[[int, int], None] | None = None,
    at_end: Collection[str] = (),
    into: Any = None,
) -> tuple[Any, Any]:
    """Step through a log; see `Kernel.scan`."""
    columns, count = sample_columns(structure.sample, samples)
    row: Sequence[Any] = state_row(structure.state, state)
    arrays = output_arrays(structure.output, count, at_end)
    outputs = arrays if into is None else flatten(structure.output, into)
    chunk = max(1, _CHUNK_SCALARS // (len(columns) + size(structure.output)))
    for first in range(0, count, chunk):
        part = slice(first, min(first + chunk, count))
        emitted: list[float] = []
        row = scan(row, [c[part].tolist() for c in columns], emitted.extend)
        _store(emitted, [o[part] if len(o) == count else o for o in outputs])
        if progress:
            progress(part.stop, count)
    return shaped(structure.state, row), unflatten(structure.output, iter(outputs))


def output_arrays(
    structure: Structure, count: int, at_end: Collection[str] = (), dtype: type | None = None
) -> list[np.ndarray]:
    """Memory for every leaf of the output along a log of `count` samples, of one value where that is `at_end`.

    dtype: of all of them; None takes that of each leaf.
    """
    return [
        np.empty((min(count, 1) if path in at_end else count, *leaf.shape), dtype or leaf.dtype)
        for path, leaf in leaves(structure)
    ]


def _store(emitted: Sequence[float], outputs: Sequence[np.ndarray]) -> None:
    """Write rows of scalars, one after the other, into the output arrays (chunk, ...), or the last of them (1, ...)."""
    width = sum(o[0].size for o in outputs)
    table = np.array(emitted, dtype=float).reshape(-1, max(1, width))
    first = 0
    for output in outputs:
        last = first + output[0].size
        output[:] = table[-len(output) :, first:last].reshape(output.shape)
        first = last


def sample_columns(structure: Structure, samples: Any) -> tuple[list[np.ndarray], int]:
    """One column (T,) per scalar of a sample, and T."""
    values = leaf_arrays(structure, samples, "samples")
    count = common_length(values)
    return [c for leaf, value, path in values for c in _leaf_columns(leaf, value, path, count)], count


#: A leaf of a tree, its values, and its name in messages.
LeafArray = tuple[Leaf, np.ndarray, str]


def leaf_arrays(structure: Structure, tree: Any, path: str) -> list[LeafArray]:
    """Every leaf of a tree called `path`, with its values as an array of any shape."""
    named = zip(leaves(structure, path), flatten(structure, tree, path), strict=True)
    return [(leaf, as_array(value, leaf, name), name) for (name, leaf), value in named]


def common_length(samples: Iterable[LeafArray]) -> int:
    """Number of steps T, from the samples that have a time axis."""
    lengths: set[int] = {value.shape[0] for leaf, value, _ in samples if value.ndim > len(leaf.shape)}
    if len(lengths) != 1:
        raise InputError(f"samples must have one common length along time, got {sorted(lengths) or 'none'}")
    return lengths.pop()


def _leaf_columns(leaf: Leaf, value: np.ndarray, path: str, count: int) -> np.ndarray:
    shape = (count, *leaf.shape)
    if value.shape not in (shape, leaf.shape):
        raise InputError(f"{path} must have the shape {shape}, or {leaf.shape} for all times, got {value.shape}")
    return np.broadcast_to(value, shape).reshape(count, leaf.size).T


def state_row(structure: Structure, state: Any) -> tuple[Any, ...]:
    """The state as one tuple of Python scalars."""
    check(structure, state, "state")
    values = zip(leaves(structure), flatten(structure, state), strict=True)
    arrays: list[np.ndarray] = [np.asarray(value, dtype=leaf.dtype) for (_, leaf), value in values]
    return tuple(x for array in arrays for x in array.ravel().tolist())
