"""Battery file: everything that an estimator needs to know about one battery, as TOML that people read and edit."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from ohmward.atomic import back_up
from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.chemistries import chemistry, chemistry_name
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.errors import InputError
from ohmward.toml_file import TomlFile

_HEADER = """\
# A battery as ohmward knows it. Edit what you know better; every key carries its unit.
# Currents > 0 charge. SoC runs from 0 (empty) to 1 (full). Voltages and resistances are those of the whole pack.
# A list along SoC stands on a uniform grid from SoC 0 to SoC 1, ends included. *_std are standard deviations.
"""
_FORMAT = "ohmward-battery/3"
#: Cells of one chemistry differ in voltage and in resistance times capacity by less than these factors: a wrong number
#: of cells, two to four for one or a pack for its cell, exceeds them, and so does mAh for Ah, a factor of a thousand.
#: Old and cold cells have ten times the usual resistance.
_OTHER_VOLTAGE, _OTHER_RESISTANCE = 1.4, 100.0


#: Format of the file; `dump` returns its text, `parse` reads it.
BATTERY_FILE = TomlFile(
    Battery,
    _FORMAT,
    _HEADER,
    once={"thevenin": ("capacity_Ah",)},
    made_by="`ohmward generic` or `ohmward identify`",
)


def save_battery(battery: Battery, path: str | PathLike[str]) -> None:
    """Write the battery file; numbers are rounded to 6 digits. It is written completely or not at all.

    >>> ow.save_battery(ow.generic_battery("nmc", capacity_Ah=5), "cell.toml")

    Raises:
        InputError: it is not a battery.
        OhmwardError: the file cannot be written.
    """
    require_battery(battery)
    BATTERY_FILE.save(battery, path)


def replace_battery(battery: Battery, path: str | PathLike[str]) -> Path | None:
    """Write the battery file as `save_battery` does; keep a previous one as a backup and return its path, else None.

    Raises:
        OhmwardError: a file cannot be written; the previous one is then where it was.
    """
    backup = back_up(Path(path))
    save_battery(battery, path)
    return backup


def load_battery(path: str | PathLike[str]) -> Battery:
    """The battery in a file.

    >>> ow.load_battery("battery.toml").n_series
    4

    Raises:
        InputError: the file cannot be read or has an impossible value; names file, key, rule and fix.
    """
    battery = BATTERY_FILE.load(path)
    try:
        battery = replace(battery, chemistry=chemistry_name(battery.chemistry))
        _require_agreement(battery)
        _require_credible_sizes(battery)
        return battery
    except InputError as error:
        raise InputError(f"battery file {path}: {error}") from error


def _require_agreement(battery: Battery) -> None:
    """Refuse numbers that contradict each other, such as a key edited in another unit or alone.

    Raises:
        InputError: cells of this chemistry have a far different voltage, or resistance for this capacity.
    """
    if not battery.chemistry:
        return
    usual, model, n = chemistry(battery.chemistry), battery.thevenin, battery.n_series
    middle_V, usual_V = model.ocv.mean_V(0.5, ROOM_DEGC) / n, float(np.interp(0.5, usual.soc, usual.ocv_V))
    if not usual_V / _OTHER_VOLTAGE < middle_V < usual_V * _OTHER_VOLTAGE:
        raise InputError(
            f"thevenin.ocv.voltage_V gives a cell {middle_V:.3g} V at half charge with n_series = {n}, but cells of "
            f"{battery.chemistry} have {usual_V:.3g} V: correct n_series, or the chemistry"
        )
    for key in ("r0_discharge_ohm", "r0_charge_ohm"):
        r0_ohm_Ah = max(getattr(model, key)) * battery.capacity_Ah / n
        if r0_ohm_Ah > _OTHER_RESISTANCE * usual.r0_ohm_Ah:
            raise InputError(
                f"capacity_Ah = {battery.capacity_Ah:g} and {key} do not go together: a cell of {battery.chemistry} of "
                f"that capacity has some {usual.r0_ohm_Ah / battery.capacity_Ah:.2g} ohm, not "
                f"{r0_ohm_Ah / battery.capacity_Ah:.2g}; is the capacity in Ah, not mAh, and the resistance in ohm?"
            )


def _require_credible_sizes(battery: Battery) -> None:
    """Raise InputError for a voltage or current far beyond those of the curve and the capacity."""
    full_V = battery.thevenin.ocv.voltage_V[-1]
    highest_V = 0.0 if battery.voltage_max_V == Battery.voltage_max_V else battery.voltage_max_V
    for key, value, most in (
        ("voltage_max_V", highest_V, 2.0 * full_V),
        ("thevenin.ocv.hysteresis_V", max(battery.thevenin.ocv.hysteresis_V), 0.5 * full_V),
        ("noise.voltage_std_V", battery.noise.voltage_std_V, 0.5 * full_V),
        ("sensor.offset_std_A", battery.sensor.offset_std_A, battery.capacity_Ah),
    ):
        if value > most:
            raise InputError(
                f"{key} must be at most {most:.3g} for a battery of {full_V:.3g} V and {battery.capacity_Ah:g} Ah, got "
                f"{value:.3g}; in V and A, not mV and mA?"
            )
