"""Resistance of a battery to short loads, from the sag of its voltage with the current.

The fast parts i and v of current and voltage, their deviations from the means over the last seconds, are related by
the resistance alone: errors of the open-circuit curve or of the temperature law have no effect. Over the last half an
hour, because the battery may warm up,

R = sum i_(k-1) v_k / sum i_(k-1) i_k.

Loads last longer than a sample and the noise of the sensors does not, so that the current one sample before is an
instrument: least squares, with i_k in its place, would give zero for the resistance of a battery whose current is
noise alone.
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
#: Shortest time [s] and least integral of the squared current [A^2 s] that give a resistance.
_SHORTEST_S, _LEAST_A2S = 3.0 * _CORRELATION_S, 1e-12
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
    current4: float = 0.0  #: [A^4 s]
    lagged2: float = 0.0  #: [A^2 s] of the current and that of the sample before
    lagged_product: float = 0.0  #: [A V s] of the voltage and the current of the sample before
    last_A: float = 0.0  #: deviation at the last sample

    def with_sample(self, dt_s: float, current_A: float, voltage_V: float) -> Sag:
        """State after a sample taken dt_s after the previous one; samples without finite values are ignored.

        current_A: > 0 charges.
        """
        if not (math.isfinite(current_A) and math.isfinite(voltage_V)):
            return self
        if not (math.isfinite(self.mean_A) and 0.0 < dt_s <= _INTERRUPTED_S):
            return self._replace(mean_A=current_A, mean_V=voltage_V, last_A=0.0)
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
            decay * self.current4 + dt_s * fast_A**4,
            decay * self.lagged2 + dt_s * fast_A * self.last_A,
            decay * self.lagged_product + dt_s * fast_V * self.last_A,
            fast_A,
        )

    @property
    def ohm(self) -> Normal:
        """The resistance [ohm]; `NO_SAG` before the current has changed, or where the voltage does not sag.

        Its residuals are those under load: quiet time between the loads does not count.
        """
        if self.seconds < _SHORTEST_S or self.lagged2 < _LEAST_A2S or self.lagged_product <= 0.0:
            return NO_SAG
        ohm = self.lagged_product / self.lagged2
        residual_V2s = max(self.voltage2 + ohm * (ohm * self.current2 - 2.0 * self.product), 0.0)
        loaded_s = self.current2**2 / self.current4
        variance = residual_V2s / loaded_s * _CORRELATION_S * self.current2 / self.lagged2**2
        return Normal(ohm, math.sqrt(variance))


def sag_along(log: Log) -> Sag:
    """The sag at the end of a log of the battery."""
    first = int(np.searchsorted(log.time_s, log.time_s[-1] - _COUNTED_S))
    dt_s = np.diff(log.time_s[first:], prepend=math.nan)
    sag = Sag()
    for row in zip(dt_s.tolist(), log.current_A[first:].tolist(), log.voltage_V[first:].tolist(), strict=True):
        sag = sag.with_sample(*row)
    return sag
