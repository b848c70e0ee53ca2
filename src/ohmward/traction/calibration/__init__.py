"""Calibration of a robot from drives whose true motion is known: radius, motors, floors; see docs/calibration.md."""

from ohmward.traction.calibration.calibrate import Calibration, calibrate, with_wheel_loads
from ohmward.traction.calibration.floor import learn_floor
from ohmward.traction.calibration.parameters import (
    Parameter,
    calibrate_motor,
    calibrate_radius,
    calibrate_track,
    with_parameters,
)
from ohmward.traction.calibration.stretches import (
    CalibrationDrive,
    motion_from_pose,
    motion_from_speed,
    motion_from_truth,
)

__all__ = [
    "Calibration",
    "CalibrationDrive",
    "Parameter",
    "calibrate",
    "calibrate_motor",
    "calibrate_radius",
    "calibrate_track",
    "learn_floor",
    "motion_from_pose",
    "motion_from_speed",
    "motion_from_truth",
    "with_parameters",
    "with_wheel_loads",
]
