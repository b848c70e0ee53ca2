"""Battery file: everything that an estimator needs to know about one battery, as TOML that people read and edit."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path

from ohmward.atomic import back_up
from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.chemistries import chemistry_name
from ohmward.errors import InputError
from ohmward.toml_file import TomlFile

_HEADER = """\
# A battery as ohmward knows it. Edit what you know better; every key carries its unit.
# Currents > 0 charge. SoC runs from 0 (empty) to 1 (full). Voltages and resistances are those of the whole pack.
# A list along SoC stands on a uniform grid from SoC 0 to SoC 1, ends included. *_std are standard deviations.
"""
#: Its `dump` and `parse` give and take the text.
BATTERY_FILE = TomlFile(
    Battery,
    "ohmward-battery/3",
    _HEADER,
    once={"thevenin": ("capacity_Ah",), "rc": ("capacity_Ah",)},
)


def save_battery(battery: Battery, path: str | PathLike[str]) -> None:
    """Write the battery file; numbers are rounded to 6 digits. The file is either whole or not there.

    Raises:
        InputError: it is no battery.
        OhmwardError: the file cannot be written.
    """
    require_battery(battery)
    BATTERY_FILE.save(battery, path)


def replace_battery(battery: Battery, path: str | PathLike[str]) -> Path | None:
    """Write the battery file as `save_battery` does, and keep the one before beside it; its path, None for none.

    Raises:
        OhmwardError: a file cannot be written; the one before is then where it was.
    """
    backup = back_up(Path(path))
    save_battery(battery, path)
    return backup


def load_battery(path: str | PathLike[str]) -> Battery:
    """The battery in a file.

    Raises:
        InputError: the file cannot be read or says something that a battery cannot be; names file, key, rule and fix.
    """
    battery = BATTERY_FILE.load(path)
    try:
        return replace(battery, chemistry=chemistry_name(battery.chemistry))
    except InputError as error:
        raise InputError(f"battery file {path}: {error}") from error
