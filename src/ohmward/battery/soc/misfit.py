"""Flag of an estimate that only sensors and batteries that do not exist would explain."""

from __future__ import annotations

from typing import Any

from ohmward.battery.models.sensor import CurrentSensor
from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.filters.flags import flags_of
from ohmward.trace.expression import Scalar

#: Capacity over the file's that a battery of the file can have: one that has lost half is at the end of its second
#: life, and none has gained half.
LEAST_CAPACITY, MOST_CAPACITY = 0.5, 1.5


def implausible_capacity(soh_capacity: Scalar) -> Any:
    """True where no battery of the file has this capacity, over the file's."""
    return (soh_capacity < LEAST_CAPACITY) | (soh_capacity > MOST_CAPACITY)


def with_misfit(estimate: SocEstimate, sensor: CurrentSensor) -> SocEstimate:
    """The estimate, flagged where it asks for an offset or a capacity that sensor and battery cannot have."""
    misfit = sensor.contradicts(estimate.current_offset_A) | implausible_capacity(estimate.soh_capacity)
    return estimate._replace(flags=estimate.flags + flags_of({SocFlag.MISFIT: misfit}))
