"""A sample made safe for the filter of the wheels: what cannot be true is taken as missing, and said so.

An encoder that repeats one number to the last bit, and not that of a wheel that stands, while another one moves, has
stopped: it counts as missing until it moves again. One that stops at zero cannot be told from a wheel that stands.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.sanitize import every, is_step, some, within
from ohmward.trace import logical_not, where
from ohmward.traction.speed_observer.clean_sample import LONGEST_STEP_S
from ohmward.traction.terrain.estimate import FloorFlag
from ohmward.traction.terrain.wheel_filter import WheelSample

#: Numbers beyond these are of no wheel [rad/s] and of no motor [A].
MOST_RAD_S, MOST_A = 500.0, 200.0
#: A longer step is a gap [s].
GAP_S = 0.5
#: An encoder has stopped when it has repeated itself for so long [s] while another one moved.
PATIENCE_S = 2.0


class EncoderWatch(NamedTuple):
    """Last speeds (driven,) of the encoders [rad/s], and how long (driven,) each has repeated itself [s]."""

    last_rad_s: np.ndarray
    repeated_s: np.ndarray


class CleanFloorSample(NamedTuple):
    """The sample, nan where there is nothing to use, the encoders as watched, and the sum of `FloorFlag`."""

    sample: WheelSample
    watch: EncoderWatch
    flags: Any


def watch_from(driven: int) -> EncoderWatch:
    """Before the first sample."""
    return EncoderWatch(np.zeros(driven), np.zeros(driven))


def sanitize(sample: WheelSample, before: EncoderWatch) -> CleanFloorSample:
    """The sample made safe."""
    time_good = is_step(sample.dt_s, LONGEST_STEP_S)
    dt_s = where(time_good, sample.dt_s, 0.0)
    turning = [within(w, MOST_RAD_S) for w in sample.wheel_speed_rad_s]
    pushing = [within(i, MOST_A) for i in sample.current_A]
    watch = watched(sample.wheel_speed_rad_s, turning, before, dt_s)
    stopped = [s > PATIENCE_S for s in watch.repeated_s]
    used = [good & logical_not(dead) for good, dead in zip(turning, stopped, strict=True)]
    flags = (
        where(time_good, 0.0, float(FloorFlag.BAD_TIME))
        + where(dt_s > GAP_S, float(FloorFlag.GAP), 0.0)
        + where(every(pushing), 0.0, float(FloorFlag.NO_CURRENT))
        + where(every(turning), 0.0, float(FloorFlag.NO_ENCODER))
        + where(some(stopped), float(FloorFlag.ENCODER_STOPPED), 0.0)
    )
    safe = WheelSample(dt_s, _or_nan(used, sample.wheel_speed_rad_s), _or_nan(pushing, sample.current_A))
    return CleanFloorSample(safe, watch, flags)


def watched(speed_rad_s: np.ndarray, good: list, before: EncoderWatch, dt_s: Any) -> EncoderWatch:
    """The watch after the speeds (driven,), of which some are `good`."""
    moved = [ok & (w != last) for ok, w, last in zip(good, speed_rad_s, before.last_rad_s, strict=True)]
    repeats = [ok & logical_not(m) & (last != 0.0) for ok, m, last in zip(good, moved, before.last_rad_s, strict=True)]
    passed_s = where(some(moved), dt_s, 0.0)
    repeated_s = [
        where(again, t + passed_s, where(m | (last == 0.0), 0.0, t))
        for again, m, t, last in zip(repeats, moved, before.repeated_s, before.last_rad_s, strict=True)
    ]
    return EncoderWatch(where(np.array(good), speed_rad_s, before.last_rad_s), np.array(repeated_s))


def _or_nan(good: list, values: np.ndarray) -> np.ndarray:
    return where(np.array(good), values, math.nan)
