"""Signals that this robot can have, and values that they can have on it."""

from __future__ import annotations

from collections.abc import Sequence

from ohmward.battery.battery import Battery
from ohmward.onboard.quantities import QUANTITIES
from ohmward.traction.robot.robot import Robot

#: Fastest rim of a robot with a known wheel [m/s]: a fast runner.
_FASTEST_M_S = 10.0

#: A battery is charged and discharged by no more than so many times its capacity in an hour: model aircraft are.
_MOST_C = 20.0

#: Voltages beyond those of the battery file by these factors are those of another battery, or in another unit: no
#: battery is used at 70 % of its lowest or charged to 110 % of its highest voltage.
_LOWEST_SHARE, _HIGHEST_SHARE = 0.7, 1.1


def plausible_values(name: str, battery: Battery | None, robot: Robot | None) -> tuple[float, float]:
    """Lowest and highest value of a quantity on this robot."""
    if battery and name in ("battery_voltage_V", "cell_voltage_V"):
        share = 1.0 if name == "battery_voltage_V" else 1.0 / battery.n_series
        return _LOWEST_SHARE * share * battery.voltage_min_V, _HIGHEST_SHARE * share * battery.voltage_max_V
    if battery and name == "battery_current_A":
        return -_MOST_C * battery.capacity_Ah, _MOST_C * battery.capacity_Ah
    if robot and name == "wheel_speed_rad_s":
        return -_FASTEST_M_S / robot.wheel.radius_m, _FASTEST_M_S / robot.wheel.radius_m
    return QUANTITIES[name].lowest, QUANTITIES[name].highest


def wheel_number(signal: str, places: Sequence[str]) -> int | None:
    """Number of the wheel that a signal is of, by the wheel's name or number; None where there is none such."""
    part = signal.partition(".")[2]
    if part in places:
        return places.index(part)
    return int(part) if part.isdecimal() and int(part) < len(places) else None


def no_such_part(signal: str, robot: Robot | None) -> str:
    """Sentence about a wheel or motor that the robot does not have; "" where it has it."""
    each = QUANTITIES[signal.partition(".")[0]].each
    if robot is None or each not in ("wheel", "motor"):
        return ""
    places = [place.name for place in robot.places][: robot.driven if each == "motor" else None]
    if wheel_number(signal, places) is not None:
        return ""
    return f"the robot has no such {each}; it has {', '.join(places)}"
