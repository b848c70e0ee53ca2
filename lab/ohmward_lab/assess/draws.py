"""Draws of the studies: random numbers by words, and signs in turn."""

from __future__ import annotations

import zlib

import numpy as np


def generator(*words: object) -> np.random.Generator:
    """Random numbers that depend on these words alone, the same on every machine and in every process."""
    return np.random.default_rng([zlib.crc32(str(word).encode()) for word in words])


def signs(runs: int) -> np.ndarray:
    """Signs (B,) of errors of sensors and starts: in turn, so that no method is lucky with one."""
    return np.where(np.arange(runs) % 2 == 0, -1.0, 1.0)
