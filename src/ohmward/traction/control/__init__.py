"""Slip control: laws, the shell around them, speed within slip bounds; see docs/slip-control.md."""

from ohmward.traction.control.force_filter import ForceFilter
from ohmward.traction.control.signals import (
    ControlFlag,
    Limits,
    Measurement,
    Report,
    SlipCommand,
    SpeedCommand,
    driven_wheel,
)
from ohmward.traction.control.sliding_mode import SlidingMode, Uncertainty
from ohmward.traction.control.slip_controller import SlipController
from ohmward.traction.control.speed_controller import SpeedController

__all__ = [
    "ControlFlag",
    "ForceFilter",
    "Limits",
    "Measurement",
    "Report",
    "SlidingMode",
    "SlipCommand",
    "SlipController",
    "SpeedCommand",
    "SpeedController",
    "Uncertainty",
    "driven_wheel",
]
