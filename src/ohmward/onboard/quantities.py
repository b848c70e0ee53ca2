"""Quantities that a message may carry: one table of names, units, ranges and owners.

A name alone is a quantity of the body or the battery, `battery_current_A`; one for each wheel, motor or cell has the
wheel's name or a number from 0 behind a dot: `wheel_speed_rad_s.front_left`, `motor_current_A.0`, `cell_voltage_V.3`.
"""

from __future__ import annotations

import difflib
import math
from typing import NamedTuple

from ohmward.errors import InputError


class Quantity(NamedTuple):
    """A quantity that sensors measure."""

    name: str  #: with its unit; signs as in docs/conventions.md
    meaning: str  #: in a few words
    #: no sensor that works shows less or more; nan and infinity are not measured
    lowest: float = -math.inf
    highest: float = math.inf
    each: str = ""  #: "wheel", "motor" or "cell" where there are several; "" where there is one


#: Of the battery: what `SocEstimator` and `PackEstimator` take.
BATTERY = (
    Quantity("battery_current_A", "current of the battery, > 0 charges", -5000.0, 5000.0),
    Quantity("battery_voltage_V", "voltage at the terminals of the pack", 0.0, 2000.0),
    Quantity("battery_temperature_degC", "temperature of the battery", -60.0, 120.0),
    Quantity("battery_full", "1 while the charger says that the battery is full, else 0", 0.0, 1.0),
    Quantity("cell_voltage_V", "voltage of each cell", 0.0, 20.0, "cell"),
)

#: Of the drive: what `SensorInbox` takes.
DRIVE = (
    Quantity("wheel_speed_rad_s", "speed of each wheel behind its gear, > 0 drives forward", -1e4, 1e4, "wheel"),
    Quantity("wheel_counts", "count of each wheel's encoder, which may overflow", each="wheel"),
    Quantity("motor_current_A", "current of each motor, > 0 drives forward", -2000.0, 2000.0, "motor"),
    Quantity("yaw_rate_rad_s", "yaw rate from a gyro, > 0 to the left", -50.0, 50.0),
    Quantity("acceleration_m_s2", "acceleration along x, gravity included", -200.0, 200.0),
    Quantity("pitch_rad", "pitch from an attitude filter, > 0 with the nose up", -1.6, 1.6),
    Quantity("speed_m_s", "speed of the body from GNSS, visual or lidar odometry", -50.0, 50.0),
    Quantity("speed_std_m_s", "standard deviation of that speed", 0.0, 50.0),
    Quantity("speed_age_s", "age of that speed", 0.0, 10.0),
    Quantity("heading_rad", "heading from a compass or GNSS antennas, > 0 to the left, from any zero", -1e4, 1e4),
    Quantity("heading_std_rad", "standard deviation of that heading", 0.0, 3.2),
)

#: Of a microcontroller that estimates itself: passed on with the states, and not used.
ESTIMATES = (Quantity("estimate", "estimate of a microcontroller, by its own name", each="estimate"),)

QUANTITIES = {quantity.name: quantity for quantity in (*BATTERY, *DRIVE, *ESTIMATES)}


def quantity_of(signal: str) -> Quantity:
    """The quantity of a signal's name, that before the dot.

    Raises:
        InputError: there is none of that name, or a wheel, motor or cell is named where there is one value, or the
            other way round.
    """
    name, dot, part = signal.partition(".")
    if name not in QUANTITIES:
        near = difflib.get_close_matches(name, QUANTITIES, n=1, cutoff=0.5)
        advice = (
            f"did you mean {near[0]}? Units are part of the names" if near else f"there are: {', '.join(QUANTITIES)}"
        )
        raise InputError(f"{signal!r} is not a quantity; {advice}")
    quantity = QUANTITIES[name]
    if bool(quantity.each) != bool(dot and part):
        fix = f"write {name}.NAME, the name of the {quantity.each} or its number from 0" if quantity.each else "no dot"
        raise InputError(f"{signal!r}: there is {'one for each ' + quantity.each if quantity.each else 'one'}; {fix}")
    return quantity
