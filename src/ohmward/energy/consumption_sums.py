"""Sums that the belief about a consumption keeps: variances that are learned, and what was driven."""

from __future__ import annotations

from typing import NamedTuple


class Variance(NamedTuple):
    """A variance with an inverse-gamma distribution."""

    dof: float  #: degrees of freedom with which it is known
    scale: float  #: dof times its usual value

    @property
    def value(self) -> float:
        """The variance to compute with."""
        return self.scale / self.dof

    def updated(self, square: float, dof: float) -> Variance:
        """The variance after a squared deviation that counts as `dof` degrees of freedom."""
        return Variance(float(self.dof + dof), float(self.scale + square))


class Visits(NamedTuple):
    """Sums over all that was driven on a terrain."""

    drives: int = 0
    distance_m: float = 0.0
    time_s: float = 0.0
    energy_J: float = 0.0
