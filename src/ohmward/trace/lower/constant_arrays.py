"""Tables of several programs in few constant arrays: a table that is part of another one is not stored again."""

from __future__ import annotations

from collections.abc import Iterable

from ohmward.trace.program import Program


def constant_arrays(programs: Iterable[Program]) -> list[tuple[float, ...]]:
    """The arrays that hold every table of the programs: first those of floats, then those of bytes.

    No array is part of another one, and none continues another one by a single value.
    """
    gathers = [node for program in programs for node in program.nodes if node.operation.name == "gather"]
    tables = sorted(dict.fromkeys(node.args[1] for node in gathers), key=len, reverse=True)
    of_floats = [table for table in tables if not are_bytes(table)]
    of_bytes = [table for table in tables if are_bytes(table)]
    return [*_joined(of_floats), *_joined(of_bytes)]


def are_bytes(values: tuple[float, ...]) -> bool:
    """True where all values are whole numbers from 0 to 255: such a table is stored in bytes."""
    return all(0.0 <= v <= 255.0 and v.is_integer() for v in values)


def _joined(tables: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """Arrays that hold tables, the longest of which come first."""
    arrays: list[tuple[float, ...]] = []
    for values in tables:
        if any(position(values, array) is not None for array in arrays):
            continue
        shifted = next((k for k, array in enumerate(arrays) if array[1 - len(values) :] == values[:-1]), None)
        if shifted is None:
            arrays.append(values)
        else:
            arrays[shifted] += values[-1:]
    return arrays


def position(values: tuple[float, ...], array: tuple[float, ...]) -> int | None:
    """Index in an array from which on it holds the values; None if it does not."""
    starts = range(len(array) - len(values) + 1)
    return next((k for k in starts if array[k] == values[0] and array[k : k + len(values)] == values), None)
