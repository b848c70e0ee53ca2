"""Resistance of a battery to short loads, from the sag of its voltage with the current.

The fast parts of current and voltage, their deviations from the means over the last seconds, are related by the
resistance alone: errors of the open-circuit curve or of the temperature law have no effect. Least squares over the
last half an hour, because the battery may warm up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.battery.chemistries import Normal
from ohmward.logs.log import Log

#: Time constant of the means [s], and of forgetting [s].
_MEAN_S, _REMEMBERED_S = 10.0, 1800.0
#: Correlation time of the residuals [s].
_CORRELATION_S = 2.0 * _MEAN_S
#: Longest gap [s] over which the means continue; after a longer one they restart.
_INTERRUPTED_S = 10.0
#: Length [s] of the end of a log that is used: older samples would have a weight below 5 %.
_COUNTED_S = 3.0 * _REMEMBERED_S
#: Sag of a battery before its first load.
NO_SAG = Normal(0.0, math.inf)


class Sag(NamedTuple):
    """Means of current and voltage, and time integrals of products of the deviations from them."""

    mean_A: float = math.nan
    mean_V: float = math.nan
    current2: float = 0.0  #: [A^2 s]
    product: float = 0.0  #: [A V s]
    voltage2: float = 0.0  #: [V^2 s]
    seconds: float = 0.0  #: time in the integrals

    def with_sample(self, dt_s: float, current_A: float, voltage_V: float) -> Sag:
        """State after a sample taken dt_s after the previous one; samples without finite values are ignored.

        current_A: > 0 charges.
        """
        if not (math.isfinite(current_A) and math.isfinite(voltage_V)):
            return self
        if not (math.isfinite(self.mean_A) and 0.0 < dt_s <= _INTERRUPTED_S):
            return self._replace(mean_A=current_A, mean_V=voltage_V)
        share, decay = 1.0 - math.exp(-dt_s / _MEAN_S), math.exp(-dt_s / _REMEMBERED_S)
        mean_A = self.mean_A + share * (current_A - self.mean_A)
        mean_V = self.mean_V + share * (voltage_V - self.mean_V)
        fast_A, fast_V = current_A - mean_A, voltage_V - mean_V
        return Sag(
            mean_A,
            mean_V,
            decay * self.current2 + dt_s * fast_A**2,
            decay * self.product + dt_s * fast_A * fast_V,
            decay * self.voltage2 + dt_s * fast_V**2,
            decay * self.seconds + dt_s,
        )

    @property
    def ohm(self) -> Normal:
        """The resistance [ohm]; `NO_SAG` before the current has changed, or where the voltage does not sag."""
        if not (self.current2 > 0.0 and self.product > 0.0):
            return NO_SAG
        ohm = self.product / self.current2
        residual_V2 = max(self.voltage2 - ohm * self.product, 0.0) / self.seconds
        return Normal(ohm, math.sqrt(residual_V2 * _CORRELATION_S / self.current2))


def sag_along(log: Log) -> Sag:
    """The sag at the end of a log of the battery."""
    first = int(np.searchsorted(log.time_s, log.time_s[-1] - _COUNTED_S))
    dt_s = np.diff(log.time_s[first:], prepend=math.nan)
    sag = Sag()
    for row in zip(dt_s.tolist(), log.current_A[first:].tolist(), log.voltage_V[first:].tolist(), strict=True):
        sag = sag.with_sample(*row)
    return sag
