"""Trees of tuples, NamedTuples, arrays and numbers as flat rows of scalars, and back."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.trace.expression import Expression


@dataclass(frozen=True)
class Leaf:
    """A number (shape ()) or an array of numbers; `boolean` for conditions."""

    shape: tuple[int, ...]
    boolean: bool

    @property
    def size(self) -> int:
        """Number of scalars."""
        return math.prod(self.shape)

    @property
    def dtype(self) -> type:
        """Type of its values in an array."""
        return bool if self.boolean else float


@dataclass(frozen=True)
class Branch:
    """A tuple or NamedTuple; `fields` are the names that error messages and generated code use."""

    type: type
    fields: tuple[str, ...]
    children: tuple["Structure", ...]


Structure = Leaf | Branch


def structure_of(tree: Any, path: str) -> Structure:
    """Structure of an example. `path` is its name in the InputError about anything that is not a number."""
    if isinstance(tree, tuple):
        fields = getattr(tree, "_fields", None) or tuple(f"[{i}]" for i in range(len(tree)))
        children = (structure_of(child, join(path, field)) for field, child in zip(fields, tree, strict=True))
        return Branch(type(tree), fields, tuple(children))
    if isinstance(tree, np.ndarray) and tree.dtype.kind in "fiubO":
        return Leaf(tree.shape, tree.size > 0 and all(_is_boolean(x, path) for x in tree.flat))
    return Leaf((), _is_boolean(tree, path))


def _is_boolean(x: Any, path: str) -> bool:
    if isinstance(x, Expression):
        return x.boolean
    if isinstance(x, bool | np.bool_):
        return True
    if isinstance(x, int | float | np.number) and not isinstance(x, complex):
        return False
    raise InputError(
        f"{path} must be a number, an array of numbers, or a tuple or NamedTuple of these, got {type(x).__name__}; "
        "hand over anything else through a closure, functools.partial or constants=(...)"
    )


def join(path: str, field: str) -> str:
    """`belief` and `mean` -> `belief.mean`; `belief` and `[0]` -> `belief[0]`."""
    return f"{path}{field}" if field.startswith("[") or not path else f"{path}.{field}"


def leaves(structure: Structure, path: str = "") -> Iterator[tuple[str, Leaf]]:
    """Path and Leaf of every leaf, in order."""
    if isinstance(structure, Leaf):
        yield path, structure
        return
    for field, child in zip(structure.fields, structure.children, strict=True):
        yield from leaves(child, join(path, field))


def size(structure: Structure) -> int:
    """Number of scalars."""
    return sum(leaf.size for _, leaf in leaves(structure))


def scalar_names(structure: Structure) -> list[str]:
    """Name of every scalar, in order: `belief.mean[0]`, ..."""
    names = []
    for name, leaf in leaves(structure):
        for index in np.ndindex(*leaf.shape):
            names.append(f"{name}[{','.join(map(str, index))}]" if index else name)
    return names


def is_finite(structure: Structure, tree: Any) -> bool:
    """True where every number of a tree of this structure is finite."""
    return all(np.isfinite(leaf).all() for leaf in flatten(structure, tree))


def flatten(structure: Structure, tree: Any, path: str = "") -> list[Any]:
    """Leaf values of `tree`, in order, unchanged. InputError where the tree has another structure."""
    if isinstance(structure, Leaf):
        return [tree]
    if not isinstance(tree, tuple) or len(tree) != len(structure.children):
        raise InputError(
            f"{path or 'arguments'} must be a {structure.type.__name__} of {len(structure.children)}, got {tree!r:.80}"
        )
    parts = zip(structure.fields, structure.children, tree, strict=True)
    return [value for field, child, part in parts for value in flatten(child, part, join(path, field))]


def unflatten(structure: Structure, values: Iterator[Any]) -> Any:
    """The inverse of `flatten`; takes one value per leaf from the iterator."""
    if isinstance(structure, Leaf):
        return next(values)
    children = [unflatten(child, values) for child in structure.children]
    return structure.type(*children) if hasattr(structure.type, "_fields") else tuple(children)


def shaped(structure: Structure, values: Sequence[Any], dtype: type | None = None) -> Any:
    """Tree made of one value per scalar: bare scalars and arrays, of bool or float as the leaf; dtype: or of this."""
    row = iter(values)

    def leaf_value(leaf: Leaf) -> Any:
        if not leaf.shape:
            return next(row) if dtype else leaf.dtype(next(row))
        array: np.ndarray = np.empty(leaf.size, dtype or leaf.dtype)
        array[:] = [next(row) for _ in range(leaf.size)]
        return array.reshape(leaf.shape)

    return unflatten(structure, (leaf_value(leaf) for _, leaf in leaves(structure)))


def side_by_side(trees: Sequence[Any]) -> Any:
    """Trees of one structure combined in lanes: every leaf with a trailing axis (..., B)."""
    structure = structure_of(trees[0], "tree")
    values = zip(*(flatten(structure, tree) for tree in trees), strict=True)
    return unflatten(structure, (np.moveaxis(np.asarray(leaf, dtype=float), 0, -1) for leaf in values))


def pick_lanes(tree: Any, index: int | slice) -> Any:
    """One of the trees in the lanes of a tree, or several of them in lanes."""
    structure = structure_of(tree, "tree")
    return unflatten(structure, (values[..., index] for values in flatten(structure, tree)))


def as_array(value: Any, leaf: Leaf, path: str) -> np.ndarray:
    """Value of a leaf as an array of any shape; InputError if it holds no numbers."""
    try:
        if value is not None:  # NumPy would turn None into nan
            return np.asarray(value, dtype=leaf.dtype)
    except (TypeError, ValueError):
        pass
    raise InputError(f"{path} must hold numbers, got {value!r:.80}")


def check(structure: Structure, tree: Any, path: str = "") -> None:
    """Raise InputError with the first place where `tree` does not fit."""
    for (name, leaf), value in zip(leaves(structure, path), flatten(structure, tree, path), strict=True):
        shape = as_array(value, leaf, name).shape
        if shape != leaf.shape:
            raise InputError(f"{name} must have the shape {leaf.shape} that it was traced with, got {shape}")
