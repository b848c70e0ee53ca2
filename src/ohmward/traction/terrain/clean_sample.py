"""Sanitise a sample for the filter of the wheels: a value that is not credible counts as missing.

An encoder that repeats one number to the last bit, and not that of a wheel that stands, while another one moves, has
stopped: it counts as missing until it moves again. One that stops at zero cannot be told from a wheel that stands.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.filters.flags import flags_of
from ohmward.filters.sanitize import every, sanitize_step, some, within
from ohmward.quantities import MOST_MOTOR_A, MOST_WHEEL_RAD_S
from ohmward.trace import logical_not, where
from ohmward.trace.expression import Scalar
from ohmward.traction.speed_observer.clean_sample import LONGEST_STEP_S
from ohmward.traction.terrain.estimate import FloorFlag
from ohmward.traction.terrain.wheel_filter import WheelSample

#: A longer step is a gap [s].
FLOOR_GAP_S = 0.5
#: An encoder has stopped when it has repeated itself for so long [s] while another one moved.
STOPPED_AFTER_S = 2.0


class EncoderWatch(NamedTuple):
    """Last speeds (driven,) of the encoders [rad/s], and time (driven,) for which each has repeated itself [s]."""

    last_rad_s: np.ndarray
    repeated_s: np.ndarray


class CleanFloorSample(NamedTuple):
    """The sample, nan where there is nothing to use, the encoders as watched, and the sum of `FloorFlag`."""

    sample: WheelSample
    watch: EncoderWatch
    flags: Scalar


def new_watch(driven: int) -> EncoderWatch:
    """Watch before the first sample."""
    return EncoderWatch(np.zeros(driven), np.zeros(driven))


def sanitize(sample: WheelSample, before: EncoderWatch) -> CleanFloorSample:
    """The sample with nan in place of what no sensor can have shown."""
    time = sanitize_step(sample.dt_s, LONGEST_STEP_S, FLOOR_GAP_S)
    speed_credible = [within(speed, MOST_WHEEL_RAD_S) for speed in sample.wheel_speed_rad_s]
    current_credible = [within(current, MOST_MOTOR_A) for current in sample.current_A]
    watch = watched(sample.wheel_speed_rad_s, speed_credible, before, time.dt_s)
    stopped = [repeated_s > STOPPED_AFTER_S for repeated_s in watch.repeated_s]
    used = [good & logical_not(dead) for good, dead in zip(speed_credible, stopped, strict=True)]
    flags = flags_of({
        FloorFlag.BAD_TIME: logical_not(time.credible),
        FloorFlag.GAP: time.gap,
        FloorFlag.NO_CURRENT: logical_not(every(current_credible)),
        FloorFlag.NO_ENCODER: logical_not(every(speed_credible)),
        FloorFlag.ENCODER_STOPPED: some(stopped),
    })  # fmt: skip
    speed_rad_s = where(np.array(used), sample.wheel_speed_rad_s, math.nan)
    current_A = where(np.array(current_credible), sample.current_A, math.nan)
    return CleanFloorSample(
        sample._replace(dt_s=time.dt_s, wheel_speed_rad_s=speed_rad_s, current_A=current_A), watch, flags
    )


def watched(speed_rad_s: np.ndarray, credible: Sequence[Scalar], before: EncoderWatch, dt_s: Scalar) -> EncoderWatch:
    """The watch after the speeds (driven,) of a sample."""
    wheels = list(zip(credible, speed_rad_s, before.last_rad_s, strict=True))
    moved = [good & (speed != last) for good, speed, last in wheels]
    repeats = [good & logical_not(speed != last) & (last != 0.0) for good, speed, last in wheels]
    stood = [last == 0.0 for last in before.last_rad_s]
    passed_s = where(some(moved), dt_s, 0.0)
    repeated_s = [
        where(again, t + passed_s, where(some([moves, stands]), 0.0, t))
        for again, moves, stands, t in zip(repeats, moved, stood, before.repeated_s, strict=True)
    ]
    return EncoderWatch(where(np.array(credible), speed_rad_s, before.last_rad_s), np.array(repeated_s))
