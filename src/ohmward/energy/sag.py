"""Resistance of a battery to short loads, as its voltage sags with its current.

The fast parts of current and voltage, what is left of them without their means over the last seconds, are tied by the
resistance alone: neither an error of the open-circuit curve nor one of the temperature's law comes in. Least squares
over the last half an hour, for the battery may warm up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.battery.chemistries import Normal
from ohmward.logs.log import Log

#: Time constant of the means [s], and of forgetting [s].
_FAST_S, _REMEMBERED_S = 10.0, 1800.0
#: Residuals hold on for so long [s].
_CORRELATION_S = 2.0 * _FAST_S
#: After a longer gap [s] the means begin anew.
_INTERRUPTED_S = 10.0
#: Of a log, the end counts: what is older is forgotten but for 5 %.
_COUNTED_S = 3.0 * _REMEMBERED_S
#: Of a battery that has not been loaded yet.
NO_SAG = Normal(0.0, math.inf)


class Sag(NamedTuple):
    """Means of current and voltage, and time integrals of products of what is left without them."""

    mean_A: float = math.nan
    mean_V: float = math.nan
    current2: float = 0.0  #: [A^2 s]
    product: float = 0.0  #: [A V s]
    voltage2: float = 0.0  #: [V^2 s]
    seconds: float = 0.0  #: time in them

    def with_sample(self, dt_s: float, current_A: float, voltage_V: float) -> Sag:
        """The same after a sample, dt_s after the last one; one without numbers is left out.

        current_A: > 0 charges.
        """
        if not (math.isfinite(current_A) and math.isfinite(voltage_V)):
            return self
        if not (math.isfinite(self.mean_A) and 0.0 < dt_s <= _INTERRUPTED_S):
            return self._replace(mean_A=current_A, mean_V=voltage_V)
        share, decay = 1.0 - math.exp(-dt_s / _FAST_S), math.exp(-dt_s / _REMEMBERED_S)
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
        """The resistance [ohm]; nothing is known before the current has changed, or of a voltage that never sags."""
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
