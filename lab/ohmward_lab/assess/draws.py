"""Random draws of the studies: generators seeded by words, and alternating signs."""

from __future__ import annotations

import zlib

import numpy as np


def generator(*words: object) -> np.random.Generator:
    """Random generator seeded by these words alone: the same on every machine and in every process."""
    return np.random.default_rng([zlib.crc32(str(word).encode()) for word in words])


def signs(runs: int) -> np.ndarray:
    """Alternating signs (B,) for the errors of sensors and starts, so that no method profits from a lucky sign."""
    return np.where(np.arange(runs) % 2 == 0, -1.0, 1.0)
