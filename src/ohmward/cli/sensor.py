"""Battery with the current sensor that the options of a command describe, from its data sheet."""

from __future__ import annotations

import argparse
from dataclasses import replace

from ohmward.battery.battery import Battery
from ohmward.battery.file import load_battery
from ohmward.errors import InputError


def with_sensor(battery: Battery, args: argparse.Namespace) -> tuple[Battery, list[str]]:
    """The battery with the sensor of the options, and a sentence for each that contradicts the battery.

    Raises:
        InputError: the offset is larger than the current that empties the battery in an hour.
    """
    known = battery.sensor
    offset_A = known.offset_std_A if args.sensor_offset is None else args.sensor_offset
    gain = known.gain_std if args.sensor_gain is None else args.sensor_gain
    if args.sensor_offset is not None and offset_A > battery.capacity_Ah:
        raise InputError(
            f"--sensor-offset must be below 1 C, {battery.capacity_Ah:g} A, got {offset_A:g} A; for milliamperes write "
            f"{offset_A / 1000:g}"
        )
    said = "was used; the battery file says"
    contradictions = []
    if offset_A != known.offset_std_A:
        contradictions.append(f"--sensor-offset {offset_A:g} A {said} {known.offset_std_A:g} A")
    if gain != known.gain_std:
        contradictions.append(f"--sensor-gain {gain:g} {said} {known.gain_std:g}")
    return replace(battery, sensor=replace(known, offset_std_A=offset_A, gain_std=gain)), contradictions


def load_battery_with_sensor(path: str, args: argparse.Namespace) -> tuple[Battery, list[str]]:
    """The battery in a file with the sensor of the options, and a sentence for each that contradicts the file."""
    return with_sensor(load_battery(path), args)
