"""Slip on floors sample by sample, as a robot has it; part of `robotino.py`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ohmward.filters.estimator import rows_of
from ohmward.logs.drive_log import DriveLog
from ohmward.traction.motion.sample import first_of
from ohmward.traction.terrain.slip_on_floors import FloorEstimate, FloorRun, SlipOnFloors, floor_samples


def live(estimator: SlipOnFloors, logs: Mapping[int, DriveLog]) -> dict[int, FloorRun]:
    """The track of each log from samples that come one by one."""
    stepper = estimator.kernel.live(estimator.init(estimator.no_sample()))
    found = {}
    for number, log in logs.items():
        samples = floor_samples(log, estimator.wheels.robot)
        stepper.state = estimator.init(first_of(samples))
        estimates = [stepper.step(row) for row in rows_of(samples)]
        columns = (np.array(values) for values in zip(*estimates, strict=True))
        found[number] = FloorRun(log.time_s, FloorEstimate(*columns), 0.0)
    return found
