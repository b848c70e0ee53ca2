"""What happened along a log: samples with flags, counted by name."""

from __future__ import annotations

from enum import IntFlag

import numpy as np


def count_flags(flags: np.ndarray, kinds: type[IntFlag]) -> dict[str, int]:
    """How many of the samples (T,) carry each flag, by name; flags that never occur are left out."""
    values = np.asarray(flags).astype(int)
    counted = {kind.name.lower(): int(np.count_nonzero(values & kind)) for kind in kinds if kind.name}
    return {name: count for name, count in counted.items() if count}
