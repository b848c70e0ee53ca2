"""Belief in the slip of wheels on a floor, as curves over their force: `floor.slip_belief` for a traced step.

    mean m(F/N),   variance v(F/N),   covariance of two wheels  c(F_i/N_i, F_j/N_j) = sum over k of phi_k phi_k

Friction and stiffness of a floor are common to all wheels, so their slips err together. The phi_k are the first
functions of Karhunen and Loeve's expansion of the slip over all floors that this one may be. The variance is exact;
the part of the left-out functions counts as each wheel's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ohmward.trace import minimum, table
from ohmward.traction.friction.odd_functions import direction_and_size
from ohmward.traction.terrain.floor import AS_LEARNT, Floor, SlipBelief, SlipScale, scaled, slips_of_floors

#: Largest force over load of the curves, more than any floor gives, and the distance of their points.
MOST, SPACING = 2.0, 0.01
#: Functions of the expansion.
MODES = 5


@dataclass(frozen=True)
class SlipCurves:
    """The curves of a floor."""

    floor: Floor

    @cached_property
    def values(self) -> np.ndarray:
        """Mean, variance, and the functions of the expansion, (2 + MODES, points)."""
        slip, weights = slips_of_floors(self.floor, np.arange(0.0, MOST + SPACING / 2, SPACING))
        mean = (weights * slip).sum(axis=0)
        off = np.sqrt(weights) * (slip - mean)
        cov = off.T @ off
        size, functions = np.linalg.eigh(cov)
        strongest = functions[:, : -MODES - 1 : -1] * np.sqrt(np.maximum(size[: -MODES - 1 : -1], 0.0))
        return np.vstack([mean, np.diag(cov), strongest.T])

    def belief(self, force_share: np.ndarray, force_std: np.ndarray, scale: SlipScale = AS_LEARNT) -> SlipBelief:
        """The slip of n wheels; force_share, force_std: (n,) traction over load, and its standard deviation."""
        mean = np.array([self.mean(share) for share in force_share])
        modes = np.array([self.modes(share) for share in force_share])
        cov = modes @ modes.T
        for i, (share, std) in enumerate(zip(force_share, force_std, strict=True)):
            by_force = (self.mean(share + std) - self.mean(share - std)) / 2
            cov[i, i] = self.variance(share) + by_force * by_force
        return scaled(SlipBelief(mean, cov), scale, self.floor)

    def mean(self, force_share: Any) -> Any:
        """Mean slip ratio of a wheel at a force over its load."""
        sign, size = direction_and_size(force_share)
        return sign * self._at(0, size)

    def variance(self, force_share: Any) -> Any:
        """Variance of the slip ratio over the floors that this one may be."""
        _, size = direction_and_size(force_share)
        return self._at(1, size)

    def modes(self, force_share: Any) -> np.ndarray:
        """Functions (MODES,) of the expansion."""
        sign, size = direction_and_size(force_share)
        return np.array([sign * self._at(2 + k, size) for k in range(MODES)])

    def _at(self, row: int, size: Any) -> Any:
        return table(self.values[row], 0.0, SPACING, minimum(size, MOST))
