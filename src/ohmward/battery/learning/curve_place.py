"""Place on the open-circuit curve of the file that belongs to a charge, if the capacity is another one.

A log shows the voltage over the charge below full, whatever the capacity is. Where logs have shown the curve, down to
the SoC l, it is pinned to that charge. Below, it is known along SoC, so that it stretches to where empty is: at the
charge e = 1 - Q / Q_file, with the capacity Q_file taken for 1,

    z(c) = c                            c >= l
    z(c) = l (c - e) / (l - e)          c <  l

No log has been seen with l = 1: then z is the state of charge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: A shorter stretch than this above empty is not stretched: it is as good as seen.
_SHORTEST = 0.02


class CurvePlace(NamedTuple):
    """Places z on the curve of the file."""

    seen_from_soc: float  #: l; log_ratio: of the capacity over the file's
    log_ratio: float

    @property
    def empty(self) -> float:
        """Charge e at empty."""
        return 1.0 - float(np.exp(self.log_ratio))

    @property
    def stretches(self) -> bool:
        """True where a stretch of the curve has not been seen."""
        return self.seen_from_soc > _SHORTEST and self.seen_from_soc - self.empty > _SHORTEST

    def at(self, charge: np.ndarray) -> np.ndarray:
        """Places (N,) of these charges c."""
        if not self.stretches:
            return charge
        low, empty = self.seen_from_soc, self.empty
        return np.where(charge < low, low * (charge - empty) / (low - empty), charge)

    def by_log_ratio(self, charge: np.ndarray) -> np.ndarray:
        """(N,) derivative of the places by the logarithm of the capacity."""
        if not self.stretches:
            return np.zeros_like(charge)
        low, empty = self.seen_from_soc, self.empty
        return np.where(charge < low, low * (low - charge) * (1.0 - empty) / (low - empty) ** 2, 0.0)


def true_soc(charge: np.ndarray, log_ratio: float) -> np.ndarray:
    """State of charge at the charges c by the capacity of the file."""
    return 1.0 - (1.0 - charge) * np.exp(-log_ratio)


def file_charge(soc: np.ndarray, log_ratio: float) -> np.ndarray:
    """Charges c by the capacity of the file at these states of charge."""
    return 1.0 - (1.0 - soc) * np.exp(log_ratio)
