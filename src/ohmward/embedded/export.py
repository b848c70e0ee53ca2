"""A filter of a battery, or a filter or controller of a robot, as a C99 library: what `ohmward export` writes."""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path

from ohmward.battery.battery import Battery
from ohmward.embedded.battery import Style, battery_export
from ohmward.embedded.c_library import library, write_library
from ohmward.embedded.traction import robot_export
from ohmward.errors import InputError
from ohmward.traction.friction.terrain import DEFAULT_TERRAIN
from ohmward.traction.robot.robot import Robot

#: Default filter for a microcontroller: the Gaussian sum of three filters takes three times as long.
SMALL = "ekf"


def export(
    what: Battery | Robot,
    folder: str | PathLike[str],
    filter: str = SMALL,
    *,
    name: str | None = None,
    sample_time_s: float | None = None,
    style: Style = "lines",
    curve_error_V: float | None = None,
    terrain: str = DEFAULT_TERRAIN,
) -> list[Path]:
    """Write a C99 library with its build files, test vectors and README; returns the paths of its files.

    >>> battery = ow.load_battery("battery.toml")
    >>> [path.name for path in ow.export(battery, "firmware/soc", "textbook-ekf", sample_time_s=1.0)][:2]
    ['soc.h', 'soc.c']

    what: a battery, or a robot.
    folder: to write to, made if it does not exist.
    filter: of a battery as in `ohmward.available`, or "textbook-joint"; of a robot "ekf", "aekf", "ukf" or "aukf" for
        its speed, "odometry", "slip-controller" or "speed-controller".
    name: prefix of files and symbols; by default the folder's name.
    sample_time_s: constant time between samples [s]: the code is smaller. None for any time.
    style: "lines", the fastest, or "loops", the smallest, which only a few filters have.
    curve_error_V: error of the open-circuit voltage of a textbook filter [V], of the whole pack, for a smaller table.
    terrain: ground that the speed observer of a robot assumes at first.

    Raises:
        InputError: no such filter, style or ground, or neither a battery nor a robot.
        OhmwardError: a file cannot be written.
    """
    name = name or symbol_of(folder)
    if isinstance(what, Robot):
        exported = robot_export(what, filter, name, terrain)
    elif isinstance(what, Battery):
        exported = battery_export(
            what, filter, name, sample_time_s=sample_time_s, style=style, curve_error_V=curve_error_V
        )
    else:
        raise InputError(
            f"export needs a battery or a robot, got {type(what).__name__}; for files: "
            'load_battery("battery.toml"), load_robot("robot.toml")'
        )
    return write_library(library(exported), Path(folder))


def symbol_of(folder: str | PathLike[str]) -> str:
    """The folder's name as a prefix for C: lower-case letters, digits and underscores."""
    word = re.sub(r"[^a-z0-9]+", "_", Path(folder).resolve().name.lower()).strip("_")
    return word if word[:1].isalpha() else f"filter_{word}".rstrip("_")
