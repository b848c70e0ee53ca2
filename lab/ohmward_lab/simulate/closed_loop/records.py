"""Records over time, nested NamedTuples of numbers and arrays, stored compactly and stacked into arrays."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from typing import Any, Generic, TypeVar

import numpy as np

T = TypeVar("T")


class Records(Generic[T]):
    """Records of one structure; a field that is None in the first one is None in all."""

    def __init__(self) -> None:
        self._first: Any = None
        self._numbers = array("d")
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, record: T) -> None:
        """Add one record."""
        if self._first is None:
            self._first = record
        self._numbers.extend(numbers(record))
        self._count += 1

    def stacked(self) -> T:
        """All records as one, with time (T,) in front of every leaf; there must be at least one."""
        table = np.array(self._numbers).reshape(self._count, -1)
        return _with_columns(self._first, iter(table.T))


def numbers(record: Any) -> Iterator[float]:
    """Numbers of a record, leaf by leaf."""
    if isinstance(record, tuple):
        for field in record:
            yield from numbers(field)
    elif isinstance(record, np.ndarray):
        yield from record.ravel().tolist()
    elif record is not None:
        yield float(record)


def _with_columns(like: Any, columns: Iterator[np.ndarray]) -> Any:
    """The structure of `like` with the columns (T,) in place of its numbers."""
    if isinstance(like, tuple):
        return type(like)(*(_with_columns(field, columns) for field in like))
    if isinstance(like, np.ndarray):
        taken = [next(columns) for _ in range(like.size)]
        return np.stack(taken, axis=1).reshape(-1, *like.shape)
    return None if like is None else next(columns).copy()
