"""Battery file: everything that an estimator needs to know about one battery, as TOML that people read and edit."""

from __future__ import annotations

from os import PathLike
from typing import Any

from ohmward.battery.battery import Battery
from ohmward.toml_file import TomlFile

_HEADER = """\
# A battery as ohmward knows it. Edit what you know better; every key carries its unit.
# Currents > 0 charge. SoC runs from 0 (empty) to 1 (full). Voltages and resistances are those of the whole pack.
# A list along SoC stands on a uniform grid from SoC 0 to SoC 1, ends included. *_std are standard deviations.
"""
#: Keys of [sensor] by those that [noise] and [rc_noise] had for them in format 1.
_SENSOR_KEYS = {
    "current_std_A": "noise_std_A",
    "current_offset_std_A": "offset_std_A",
    "current_offset_walk_A": "offset_walk_A",
}


def _from_format_1(table: dict[str, Any]) -> dict[str, Any]:
    """The table of a file of format 1, whose current sensor stood in [noise]; it knew no other ignorance."""
    sensor: dict[str, Any] = {}
    noises = {key: dict(table[key]) for key in ("rc_noise", "noise") if isinstance(table.get(key), dict)}
    for noise in noises.values():
        sensor |= {new: noise.pop(old) for old, new in _SENSOR_KEYS.items() if old in noise}
    return table | noises | ({"sensor": sensor} if sensor else {})


#: Its `dump` and `parse` give and take the text.
BATTERY_FILE = TomlFile(Battery, "ohmward-battery/2", _HEADER, older={"ohmward-battery/1": _from_format_1})


def save_battery(battery: Battery, path: str | PathLike[str]) -> None:
    """Write the battery file; numbers are rounded to 6 digits. The file is either whole or not there.

    Raises:
        OhmwardError: the file cannot be written.
    """
    BATTERY_FILE.save(battery, path)


def load_battery(path: str | PathLike[str]) -> Battery:
    """The battery in a file.

    Raises:
        InputError: the file cannot be read or says something that a battery cannot be; names file, key, rule and fix.
    """
    return BATTERY_FILE.load(path)
