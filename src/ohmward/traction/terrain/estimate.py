"""Estimate of the slip on floors after a sample: plain numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.flags import SampleFlag


class FloorEstimate(NamedTuple):
    """Estimate after a sample."""

    rim: np.ndarray  #: (freedoms,) motion of the rims, as if no wheel slipped
    motion: np.ndarray  #: (freedoms,) of the body
    motion_std: np.ndarray  #: its standard deviation
    #: over ground
    speed_m_s: Any
    speed_std_m_s: Any
    travel_slip: Any  #: share of the rims' travel speed that is lost; nan while the wheels hardly turn
    travel_slip_std: Any  #: its standard deviation
    slip_ratio: np.ndarray  #: (driven,) of each wheel, slip speed over the rims' travel speed; likewise nan
    slip_ratio_std: np.ndarray  #: its standard deviation
    force_N: np.ndarray  #: (driven,) of the ground
    floor_probability: np.ndarray  #: (wheels, floors), floors as in `Recognition.names`
    crossing: Any  #: 1 where a wheel has come to another floor, else 0
    #: share of the weight that the ground takes, before the last change and now
    drag_before: Any
    drag_after: Any
    #: (wheels,) mean time until a crossing of each wheel is known, as the robot moves now; inf while none is looked
    #: for, and for a wheel whose floor hardly shows in the forces
    crossing_delay_s: np.ndarray
    flags: Any  #: sum of `FloorFlag` values; 0 is a sample without incident


class FloorFlag(SampleFlag):
    """Events at a sample. None of them stops the estimator."""

    BAD_TIME = 1  # dt_s is not a number, negative or hours: taken as 0
    GAP = 2  # half a second without a sample: floors may have changed
    NO_CURRENT = 4  # of at least one motor: its force wanders on
    NO_ENCODER = 8  # of at least one driven wheel: its speed wanders on
    ENCODER_STOPPED = 16  # one repeats a number to the last bit while others move: not used until it moves again
    MOTION_UNKNOWN = 32  # the wheels hardly turn, or their motion is uncertain: no slip ratio, no floor recognised
    RESTARTED = 64  # in Python: the state was no longer a number, a new one was started from this sample
    SPEED_REFUSED = 128  # an outside speed that no slip of these wheels explains, or older than a second
