"""Capacity over the logs of a battery from the estimates of its filter, and whether the logs show it.

The estimate at the end of log k, N(m_k, P_k), settles over the first logs: its change is no ageing. Given all n logs,
for a random walk with the variance Q_k between the ends of logs k and k + 1 (Rauch, Tung and Striebel, AIAA J. 3,
1965):

    C_k = P_k / (P_k + Q_k)
    m_k|n = m_k + C_k (m_k+1|n - m_k),        P_k|n = P_k + C_k^2 (P_k+1|n - P_k - Q_k)

and the covariance of the capacities at the ends of logs k and n is C_k C_k+1 ... C_n-1 P_n.

The filter counts what the curve shows of the capacity once, most of it in the first logs, and no walk between logs far
apart. So the capacity of a later log errs by what a battery may have aged since the first, as that of a file with a
date does.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal
from ohmward.battery.models.noise import AGED_CAPACITY_STD, age_after
from ohmward.quantities import DAY_S

#: Logs show the capacity if they have halved the variance that the battery file gives it; or it is known this well, or
#: is off by this many standard deviations.
_HALVED, _KNOWN_STD, _IS_ANOTHER_STDS = math.sqrt(0.5), 0.05, 2.0


def shows_capacity(battery: Battery, log_capacity: Normal) -> bool:
    """True where ln(capacity over the battery file's) is known from more than the file."""
    of_file = math.hypot(battery.noise.capacity_std, battery.sensor.gain_std)
    is_another = abs(log_capacity.mean) > _IS_ANOTHER_STDS * log_capacity.std
    return is_another or log_capacity.std <= max(_HALVED * of_file, _KNOWN_STD)


class CapacityOverLogs(NamedTuple):
    """Capacity over the battery file's at the end of each log, given all of them."""

    mean: np.ndarray  #: (n,)
    std: np.ndarray  #: (n,)
    change: Normal  #: from the end of the first log to that of the last


def capacity_over_logs(battery: Battery, time_s: ArrayLike, mean: ArrayLike, std: ArrayLike) -> CapacityOverLogs:
    """The estimates of the filter at the ends of the n logs, each with what all logs show.

    battery: for the random walk of its capacity.
    time_s: (n,) ascending; mean, std: (n,) of the capacity over the battery file's, as the filter had it then.
    """
    m, P, at_s = np.array(mean, dtype=float), np.square(std), np.asarray(time_s, dtype=float)
    span_s: Any = np.diff(at_s)
    Q = np.asarray(battery.noise.capacity_walk_variance(span_s))
    smooth_m, smooth_P = m.copy(), P.copy()
    C = P[:-1] / (P[:-1] + Q)
    for k in reversed(range(len(Q))):
        smooth_m[k] = m[k] + C[k] * (smooth_m[k + 1] - m[k])
        smooth_P[k] = P[k] + C[k] ** 2 * (smooth_P[k + 1] - P[k] - Q[k])
    variance = smooth_P[0] + P[-1] - 2.0 * np.prod(C) * P[-1]
    aged_std = AGED_CAPACITY_STD * np.array([age_after(days) for days in ((at_s - at_s[0]) / DAY_S).tolist()])
    change_std = math.hypot(math.sqrt(max(float(variance), 0.0)), float(aged_std[-1]))
    change = Normal(float(smooth_m[-1] - smooth_m[0]), change_std)
    return CapacityOverLogs(smooth_m, np.hypot(np.sqrt(smooth_P), aged_std), change)
