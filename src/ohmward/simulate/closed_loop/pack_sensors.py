"""Sensors of the battery: a Hall sensor and a voltage divider, averaged over the interval of the log."""

from __future__ import annotations

import numpy as np

from ohmward.simulate.closed_loop.supply import Supplied
from ohmward.simulate.sensors import Sensor

PACK_CURRENT = Sensor(low=-150.0, high=150.0, resolution=0.012, noise_std=0.02, offset=0.02)
PACK_VOLTAGE = Sensor(low=0.0, high=60.0, resolution=0.004, noise_std=0.004)


class PackSensors:
    """Current and voltage of a battery, averaged between two samples.

    Args:
        first: output of the battery before the first step.
        rng: draws the noise.
    """

    def __init__(self, first: Supplied, rng: np.random.Generator) -> None:
        self._rng = rng
        self._sum, self._count = np.zeros(2), 0
        self.add_step(first)

    def add_step(self, supplied: Supplied) -> None:
        """Take one step of the battery into the mean."""
        self._sum = self._sum + np.array([supplied.current_A, supplied.voltage_V])
        self._count += 1

    def sample(self) -> tuple[float, float]:
        """Measured mean current [A] and voltage [V] since the last sample; at least one step must lie between."""
        mean = self._sum / self._count
        self._sum, self._count = np.zeros(2), 0
        now = np.zeros(1)
        current_A = PACK_CURRENT.measure(mean[:1], now, self._rng)
        voltage_V = PACK_VOLTAGE.measure(mean[1:], now, self._rng)
        return float(current_A[0]), float(voltage_V[0])
