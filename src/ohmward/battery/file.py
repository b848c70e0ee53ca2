"""Battery file: everything that an estimator needs to know about one battery, as TOML that people read and edit."""

from __future__ import annotations

from dataclasses import asdict, replace
from os import PathLike
from pathlib import Path
from typing import Any

from ohmward.atomic import back_up
from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.chemistries import chemistry_name
from ohmward.battery.models.rc import RcModel, equivalent_thevenin
from ohmward.errors import InputError
from ohmward.toml_file import TomlFile

_HEADER = """\
# A battery as ohmward knows it. Edit what you know better; every key carries its unit.
# Currents > 0 charge. SoC runs from 0 (empty) to 1 (full). Voltages and resistances are those of the whole pack.
# A list along SoC stands on a uniform grid from SoC 0 to SoC 1, ends included. *_std are standard deviations.
"""
_FORMAT = "ohmward-battery/3"


def _as_thevenin(table: dict[str, Any]) -> dict[str, Any]:
    """The table of a file that gives its circuit by the elements of the RC model, [rc], with the Thevenin circuit.

    Where [thevenin] stands as well, that is the circuit, and [rc] with its [rc_noise] is left aside.
    """
    rest = {key: value for key, value in table.items() if key not in ("rc", "rc_noise")}
    if "rc" not in table or "thevenin" in table:
        return rest
    model = equivalent_thevenin(TomlFile(RcModel, _FORMAT, "").from_table(table["rc"], "rc"))
    noise = {"noise": table["rc_noise"]} if "rc_noise" in table else {}
    return noise | rest | {"thevenin": asdict(model)}


#: Its `dump` and `parse` give and take the text.
BATTERY_FILE = TomlFile(
    Battery, _FORMAT, _HEADER, once={"thevenin": ("capacity_Ah",), "rc": ("capacity_Ah",)}, normal=_as_thevenin
)


def save_battery(battery: Battery, path: str | PathLike[str]) -> None:
    """Write the battery file; numbers are rounded to 6 digits. The file is either whole or not there.

    >>> ow.save_battery(ow.generic_battery("nmc", capacity_Ah=5), "cell.toml")

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

    >>> ow.load_battery("battery.toml").n_series
    4

    Raises:
        InputError: the file cannot be read or says something that a battery cannot be; names file, key, rule and fix.
    """
    battery = BATTERY_FILE.load(path)
    try:
        return replace(battery, chemistry=chemistry_name(battery.chemistry))
    except InputError as error:
        raise InputError(f"battery file {path}: {error}") from error
