"""Flags of a sample: combined into one number, printed by name, and counted along a log."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntFlag
from functools import cache, reduce
from operator import add

import numpy as np

from ohmward.trace import Scalar, where

#: Number of samples whose flags are counted at a time: all of a log of ten million would take most of the memory.
_FLAGS_AT_ONCE = 1 << 20


class SampleFlag(IntFlag):
    """Base of the flags of a sample; printed by name: `NO_CURRENT|GAP`, and `0` without any."""

    def __str__(self) -> str:
        return "|".join(str(flag.name) for flag in self) or "0"

    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self}" if self else "0"

    def __format__(self, spec: str) -> str:
        return format(str(self), spec)


class FlagTable(dict[float, SampleFlag]):
    """Flags by the number that a compiled step returns: `table[32.0]`. Each is made when it first occurs."""

    def __init__(self, kind: type[SampleFlag]):
        super().__init__()
        self.kind = kind

    def __missing__(self, number: float) -> SampleFlag:
        self[number] = self.kind(int(number))
        return self[number]


@cache
def flag_table(kind: type[SampleFlag]) -> FlagTable:
    """The table of a kind of flags, one for all estimators."""
    return FlagTable(kind)


def flags_of(conditions: Mapping[IntFlag, Scalar | bool]) -> Scalar:
    """Sum of the flags whose condition holds, as a float; each flag occurs once, so the sum is their union."""
    return reduce(add, (where(condition, float(flag), 0.0) for flag, condition in conditions.items()))


def count_flags(flags: np.ndarray, kinds: type[IntFlag]) -> dict[str, int]:
    """Number of samples (T,) that carry each flag, by name; flags that never occur are left out."""
    flags = np.asarray(flags).ravel()
    samples = np.zeros(2 * int(max(kinds)), dtype=int)  # by the sum of their flags
    for block in np.array_split(flags, 1 + flags.size // _FLAGS_AT_ONCE):
        samples += np.bincount(block.astype(np.intp), minlength=samples.size)
    sums = np.arange(samples.size)
    counted = {kind.name.lower(): int(samples[sums & int(kind) != 0].sum()) for kind in kinds if kind.name}
    return {name: count for name, count in counted.items() if count}
