"""Slip on floors sample by sample, as a robot has it; part of `robotino.py`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ohmward.logs.drive_log import DriveLog
from ohmward.traction.terrain.estimate import FloorEstimate
from ohmward.traction.terrain.slip_on_floors import FloorRun, SlipOnFloors, first_of, wheel_samples
from ohmward.traction.terrain.wheel_filter import WheelSample


def live(estimator: SlipOnFloors, logs: Mapping[int, DriveLog]) -> dict[int, FloorRun]:
    """The track of each log from samples that come one by one."""
    stepper = estimator.kernel.live(estimator.init(estimator.no_sample()))
    found = {}
    for number, log in logs.items():
        samples = wheel_samples(log, estimator.wheels.robot.driven)
        stepper.state = estimator.init(first_of(samples))
        estimates = [stepper.step(WheelSample(*row)) for row in zip(*samples, strict=True)]
        columns = (np.array(values) for values in zip(*estimates, strict=True))
        found[number] = FloorRun(log.time_s, FloorEstimate(*columns), 0.0)
    return found
