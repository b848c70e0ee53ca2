"""Floors that a robot has learnt: slip on them without a sensor of the speed; see docs/calibration.md."""

from ohmward.traction.floors.crossing import Crossing, CrossingTest, crossing_test
from ohmward.traction.floors.estimate import FloorEstimate, FloorFlag
from ohmward.traction.floors.floor import Floor, slip_at_force, unseen_floor
from ohmward.traction.floors.floors_file import Floors, load_floors, save_floors
from ohmward.traction.floors.live import FloorSlipEstimator
from ohmward.traction.floors.recognition import Recognition
from ohmward.traction.floors.slip_on_floors import FloorState, SlipOnFloors, SlipTrack, slip_on_floors
from ohmward.traction.floors.wheel_filter import WheelFilter, WheelSample

__all__ = [
    "Crossing",
    "CrossingTest",
    "Floor",
    "FloorEstimate",
    "FloorFlag",
    "FloorSlipEstimator",
    "FloorState",
    "Floors",
    "Recognition",
    "SlipOnFloors",
    "SlipTrack",
    "WheelFilter",
    "WheelSample",
    "crossing_test",
    "load_floors",
    "save_floors",
    "slip_at_force",
    "slip_on_floors",
    "unseen_floor",
]
