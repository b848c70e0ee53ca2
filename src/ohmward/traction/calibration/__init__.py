"""Calibration of a robot from drives whose true motion is known: radius, motors, floors; see docs/calibration.md."""

from ohmward.traction.calibration.floor import learn_floor
from ohmward.traction.calibration.motor import calibrate_motor
from ohmward.traction.calibration.parameter import Parameter, with_parameters
from ohmward.traction.calibration.radius import calibrate_radius
from ohmward.traction.calibration.truth import CalibrationDrive, motion_from_pose, motion_from_speed

__all__ = [
    "CalibrationDrive",
    "Parameter",
    "calibrate_motor",
    "calibrate_radius",
    "learn_floor",
    "motion_from_pose",
    "motion_from_speed",
    "with_parameters",
]
