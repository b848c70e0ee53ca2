"""Inputs and outputs of the controllers: measurement, commands, report and flags.

Every field is a number, or (n,) for n driven wheels: the controllers work element by element. x points forward.
"""

import math
from enum import IntFlag
from typing import Any, NamedTuple


class ControlFlag(IntFlag):
    """Conditions of a step of a controller; `Report.flags` is their sum."""

    STALE = 1  #: the measurement is too old, too uncertain or no number: torque goes to zero
    STOPPED = 2  #: too slow for slip to mean anything: a slip controller gives no torque, the speed controller holds
    TORQUE_LIMITED = 4  #: the torque asked for is above its limit, or changes faster than its limit
    SLIP_BOUND = 8  #: the speed controller gives less torque than the speed asks for, to stay within the slip bound
    UNREACHABLE = 16  #: the slip asked for does not come about although the torque has been at its limit for a while
    BAD_COMMAND = 32  #: the command is no number or out of its range: torque goes to zero


class Measurement(NamedTuple):
    """Measured or estimated motion of a driven wheel."""

    wheel_speed_rad_s: Any  #:    of the wheel, > 0 forward
    travel_speed_m_s: Any  #:     of the wheel's centre along the wheel, measured or estimated
    age_s: Any = 0.0  #:                of the travel speed, >= 0
    travel_speed_std_m_s: Any = 0.0  #: its standard deviation
    force_N: Any = math.nan  #:              of the ground on the wheel, from an estimator; nan where there is none
    acceleration_m_s2: Any = math.nan  #:    of the wheel's centre, likewise


class SlipCommand(NamedTuple):
    """A slip to hold."""

    slip_ratio: Any  #: in (-1, 1), > 0 drives and < 0 brakes, whichever way the robot goes
    direction: Any = 1.0  #:  >= 0 forward, < 0 reverse


class SpeedCommand(NamedTuple):
    """A speed to hold, within bounds of slip."""

    speed_m_s: Any  #:  of the wheel's centre, < 0 in reverse
    slip_bound: Any = 0.12  #: largest slip ratio in size, driving and braking, at least 0.001 and below 1


class Report(NamedTuple):
    """Slip, force and torque of a step, with flags."""

    slip_ratio: Any  #:  driving > 0 and braking < 0; nan below `slip.REPORT_FLOOR`
    slip_target: Any  #: slip ratio that is held now, or the bound
    surface_m_s: Any  #: distance from it as a slip speed, > 0 where slip is too large; see `surface`
    force_N: Any  #:     of the ground on the wheel, along x, as estimated
    demanded_Nm: Any  #: torque without limits
    flags: Any  #:       sum of `ControlFlag`
