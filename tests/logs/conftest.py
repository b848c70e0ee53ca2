from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def write_text(tmp_path) -> Callable[..., Path]:
    """Write a text file and return its path."""

    def write(text: str, name: str = "log.csv", encoding: str = "utf-8") -> Path:
        path = tmp_path / name
        path.write_bytes(text.encode(encoding))
        return path

    return write


@pytest.fixture
def pulses() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ten minutes of pulses at 1 Hz: time [s], current [A] (> 0 charges) and voltage [V] of a 20 mohm source."""
    time_s = np.arange(600.0)
    current_A = np.where((time_s // 30) % 3 == 1, -10.0, 0.0) + np.where((time_s // 30) % 9 == 5, 14.0, 0.0)
    voltage_V = 12.0 + 0.02 * current_A + 0.001 * np.cos(time_s)
    return time_s, current_A, voltage_V
