"""Observers: speed, slip and friction of a robot from encoders and motor currents; see docs/traction-observers.md."""

from ohmward.traction.observers.encoder import wheel_speeds
from ohmward.traction.observers.estimate import Estimate, Flag, Sample
from ohmward.traction.observers.noise import Noise, quantisation_std_rad_s
from ohmward.traction.observers.slip_test import SlipTest
from ohmward.traction.observers.speed_observer import ObserverState, SpeedObserver
from ohmward.traction.observers.states import KNOWN_GROUND, States

__all__ = [
    "KNOWN_GROUND",
    "Estimate",
    "Flag",
    "Noise",
    "ObserverState",
    "Sample",
    "SlipTest",
    "SpeedObserver",
    "States",
    "quantisation_std_rad_s",
    "wheel_speeds",
]
