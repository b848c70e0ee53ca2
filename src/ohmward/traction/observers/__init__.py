"""Observers: speed, slip and friction of a robot from encoders and motor currents; see docs/traction-observers.md."""

from ohmward.traction.observers.encoder import wheel_speeds
from ohmward.traction.observers.estimate import Estimate, Flag, Sample
from ohmward.traction.observers.momentum_estimate import AngleSample, MomentumEstimate, MomentumFlag
from ohmward.traction.observers.momentum_noise import MomentumNoise, count_std_rad
from ohmward.traction.observers.momentum_observer import MomentumObserver
from ohmward.traction.observers.noise import Noise, quantisation_std_rad_s
from ohmward.traction.observers.observer_for import FILTERS, Chosen, observer_for
from ohmward.traction.observers.slip_test import SlipTest
from ohmward.traction.observers.speed_observer import ObserverState, SpeedObserver
from ohmward.traction.observers.states import KNOWN_GROUND, States
from ohmward.traction.observers.track import SlipEstimator, Track, observe

__all__ = [
    "FILTERS",
    "KNOWN_GROUND",
    "AngleSample",
    "Chosen",
    "Estimate",
    "Flag",
    "MomentumEstimate",
    "MomentumFlag",
    "MomentumNoise",
    "MomentumObserver",
    "Noise",
    "ObserverState",
    "Sample",
    "SlipEstimator",
    "SlipTest",
    "SpeedObserver",
    "States",
    "Track",
    "count_std_rad",
    "observe",
    "observer_for",
    "quantisation_std_rad_s",
    "wheel_speeds",
]
