"""Tables of several programs in few constant arrays: what stands in another table is not stored again."""

from __future__ import annotations

from collections.abc import Iterable

from ohmward.trace.program import Program


def constant_arrays(programs: Iterable[Program]) -> list[tuple[float, ...]]:
    """The arrays that hold every table of the programs, none within another, none that goes on where another ends.

    Bytes are among themselves.
    """
    gathers = [n for program in programs for n in program.nodes if n.operation.name == "gather"]
    tables = sorted(dict.fromkeys(n.args[1] for n in gathers), key=len, reverse=True)
    return [array for kind in (False, True) for array in _joined([t for t in tables if are_bytes(t) is kind])]


def are_bytes(values: tuple[float, ...]) -> bool:
    """Whether whole numbers from 0 to 255 are all there is: such a table is stored in bytes."""
    return all(0.0 <= v <= 255.0 and v.is_integer() for v in values)


def _joined(tables: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
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
    """Where the values stand in an array, if they do."""
    starts = range(len(array) - len(values) + 1)
    return next((k for k in starts if array[k] == values[0] and array[k : k + len(values)] == values), None)
