"""Flags of a sample: one number from conditions, and how often each occurred along a log."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntFlag
from functools import reduce
from operator import add

import numpy as np

from ohmward.trace import where
from ohmward.trace.expression import Scalar


def flags_of(conditions: Mapping[IntFlag, Scalar | bool]) -> Scalar:
    """Sum of the flags whose condition holds, as a float; each flag occurs once, so the sum is their union."""
    return reduce(add, (where(condition, float(flag), 0.0) for flag, condition in conditions.items()))


def count_flags(flags: np.ndarray, kinds: type[IntFlag]) -> dict[str, int]:
    """Number of samples (T,) that carry each flag, by name; flags that never occur are left out."""
    values = np.asarray(flags).astype(int)
    counted = {kind.name.lower(): int(np.count_nonzero(values & kind)) for kind in kinds if kind.name}
    return {name: count for name, count in counted.items() if count}
