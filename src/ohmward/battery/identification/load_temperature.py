"""Temperatures at which current flowed in the logs: what they can have shown of activations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.fit_samples import FitSamples

#: Resistances at temperatures that differ by more show an activation [K]: 10 K change them by a fifth. Days that warm
#: by 6 K change them by less than SoC and current do: they told -2900 to 5700 K of the RC pairs of simulated cells.
_SPREAD_K = 10.0
#: Share of the charge that may have flowed below the low and above the high temperature.
_OUTSIDE_SHARE = 0.02


class LoadTemperature(NamedTuple):
    """Temperatures [degC] between which nearly all charge flowed."""

    low_degC: float
    high_degC: float

    @property
    def shows_activation(self) -> bool:
        """True where they differ by more than 10 K."""
        return self.high_degC - self.low_degC > _SPREAD_K

    def __str__(self) -> str:
        low, high = f"{self.low_degC:.0f}", f"{self.high_degC:.0f}"
        return f"{low} degC" if low == high else f"{low} to {high} degC"


def load_temperature(samples: Sequence[FitSamples]) -> LoadTemperature:
    """Temperatures at which current flowed, of every sample and not only of every log; by the charge that flowed."""
    degC = np.concatenate([s.temperature_degC for s in samples])
    moved = np.concatenate([np.abs(s.mean_current_A) * s.dt_s for s in samples])
    order = np.argsort(degC)
    share = np.cumsum(moved[order]) / max(float(moved.sum()), 1e-12)
    low, high = np.searchsorted(share, [_OUTSIDE_SHARE, 1.0 - _OUTSIDE_SHARE]).clip(0, degC.size - 1)
    return LoadTemperature(float(degC[order[low]]), float(degC[order[high]]))
