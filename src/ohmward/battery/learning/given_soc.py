"""State of charge that something else than the voltage tells: anchors, the user, or the log before.

A log that goes on where another one ended starts with its charge: days that are cut at midnight teach as one log does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.learning.samples import Samples
from ohmward.battery.learning.solve import SocAnchor
from ohmward.battery.soc.anchors import Anchor
from ohmward.logs.log import SECONDS_PER_HOUR, Log

#: Standard deviation of a state of charge that the user gives for the start of a log, as the filter takes it.
_GIVEN_STD = 0.03
#: A log goes on with the charge of the one before if no longer than this [s] lies between them, and then that charge is
#: as unsure as this at least.
_CONTINUES_S, _CONTINUED_STD = 1800.0, 0.01
#: Between the two the current of either side may have gone on, and this multiple of the capacity per hour besides.
_BETWEEN_C = 0.05
#: Currents below this multiple of the capacity per hour are a rest, whose voltage at full is full within this.
_REST_C, _FULL_AT_REST_STD = 0.01, 0.03


def given_at_start(battery: Battery, log: Log, initial_soc: float | None) -> tuple[SocAnchor, ...]:
    """State of charge at the first sample by the user, or by the log that ended just before; () where neither tells.

    The current of either log may have gone on between the two.
    """
    if initial_soc is not None:
        return (SocAnchor(0, initial_soc, _GIVEN_STD),)
    start, _ = span_of(log)
    if start is None or battery.knowledge is None:
        return ()
    for seen in reversed(battery.knowledge.logs):
        if seen.end_unix_s is None or seen.end_soc is None or seen.end_soc_std is None:
            continue
        gap_s = start - seen.end_unix_s
        if abs(gap_s) <= _CONTINUES_S:
            rate_C = max(abs(seen.end_current_A), abs(float(log.current_A[0]))) / battery.capacity_Ah
            unknown = (rate_C + _BETWEEN_C) * abs(gap_s) / SECONDS_PER_HOUR
            return (SocAnchor(0, seen.end_soc, math.hypot(seen.end_soc_std, _CONTINUED_STD, unknown)),)
    return ()


def full_at_start(battery: Battery, samples: Samples) -> tuple[SocAnchor, ...]:
    """State of charge of a part that starts at rest at the voltage of a full battery or above; () for another one."""
    full_V = float(require_thevenin(battery).ocv.mean_V(1.0, samples.temperature_degC[0]))
    resting = abs(samples.current_A[0]) <= _REST_C * battery.capacity_Ah
    if not (resting and samples.voltage_V[0] >= full_V):
        return ()
    return (SocAnchor(0, 1.0, math.hypot(_FULL_AT_REST_STD, battery.noise.soc_axis_std)),)


def soc_anchors(anchors: Sequence[Anchor], samples: Samples) -> tuple[SocAnchor, ...]:
    """The anchors within a part; a rest tells no more than its voltage, which is used anyway."""
    inside = [a for a in anchors if a.kind != "rest" and samples.time_s[0] <= a.time_s <= samples.time_s[-1]]
    return tuple(SocAnchor(int(np.searchsorted(samples.time_s, a.time_s)), a.soc, a.soc_std) for a in inside)


def span_of(log: Log) -> tuple[float | None, float | None]:
    """Unix time of the first and the last sample."""
    if log.start_unix_s is None:
        return None, None
    return log.start_unix_s + float(log.time_s[0]), log.start_unix_s + float(log.time_s[-1])
