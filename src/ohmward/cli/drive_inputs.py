"""Robot, ground, log of a drive and its truth, from the options of a command."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.cli.battery_inputs import read_options
from ohmward.cli.options import TRUTHS
from ohmward.errors import InputError
from ohmward.logs import DriveLog, read_drive
from ohmward.logs.log import ReadOptions
from ohmward.logs.read import open_table
from ohmward.logs.selection import selected_name, split_selection
from ohmward.logs.table import TableFile
from ohmward.logs.units import unit_in_name
from ohmward.logs.wheel_columns import wheel_places
from ohmward.traction import Robot
from ohmward.traction.score import DriveTruth


class DriveReference(NamedTuple):
    """Truth of a drive, and its origin in one sentence."""

    truth: DriveTruth
    note: str


class DriveOptions(NamedTuple):
    """How to read the drives of a robot."""

    robot: Robot | None  #: None where the columns name the wheels and all are driven
    reading: ReadOptions
    motor_shaft: bool
    counts_per_turn: float | None

    def read(
        self,
        text: str,
        extra: Collection[str] | None = None,
        leave: Collection[str] = (),
        file: TableFile | None = None,
    ) -> DriveLog:
        """The drive that an argument names.

        text: a file, or a file and a choice of its rows, `gray.parquet:exp=5`, which becomes part of the log's name.
        extra: further columns to keep; None keeps every numeric one.
        leave: columns that are truths, not sensors, whatever their names suggest.
        file: the same file, if it is open already.

        Raises:
            InputError: the file cannot be read as a drive of this robot.
        """
        path, where = split_selection(text)
        file = file or open_table(path, self.reading.hints)
        places = () if self.robot else wheel_places(file.part("drive").names)
        log = read_drive(
            file,
            self.robot or places,
            len(places) or None,
            at_motor_shaft=self.motor_shaft,
            counts_per_turn=self.counts_per_turn,
            columns=dict(self.reading.columns),
            units=dict(self.reading.units),
            where=dict(self.reading.where) | where,
            extra=extra,
            leave=leave,
            sort_time=self.reading.sort_time,
            hints=self.reading.hints,
        )
        return replace(log, name=selected_name(log.name, where))


def drive_options(args: argparse.Namespace, robot: Robot | None) -> DriveOptions:
    """How to read drives of this robot, from the options of `add_drive_options`."""
    return DriveOptions(robot, read_options(args), args.motor_shaft, args.counts_per_turn)


def read_drive_truth(log: DriveLog, robot: Robot, text: str) -> DriveReference:
    """The truth in the columns that --truth names: speed, then yaw rate, then lateral speed, separated by commas.

    The slip ratios come from the columns `<wheel>_slip_true`, if the log has them for all driven wheels.

    Raises:
        InputError: there is no such column.
    """
    named = dict(zip(TRUTHS, truth_names(text), strict=False))
    known = {kind: _in_SI(log, name, kind) for kind, name in named.items() if name}
    slips = [f"{wheel}_slip_true" for wheel in robot.driven_wheels]
    slip = np.column_stack([log.extra[name] for name in slips]) if set(slips) <= set(log.extra) else None
    truth = DriveTruth(known["speed"], known.get("yaw rate"), known.get("lateral speed"), slip)
    note = ", ".join(f"{kind} from {name!r}" for kind, name in named.items() if name)
    how = "from the speeds of body and wheels" if slip is None else f"from {', '.join(map(repr, slips))}"
    return DriveReference(truth, f"truth: {note}; slip {how}")


def truth_names(text: str | None) -> list[str]:
    """The columns that --truth names, in the order of `TRUTHS`; an empty name leaves one out.

    Raises:
        InputError: too many, or none for the speed.
    """
    if text is None:
        return []
    names = [name.strip() for name in text.split(",")]
    if not names[0] or len(names) > len(TRUTHS):
        raise InputError(f"--truth takes the columns of {', '.join(TRUTHS)}, separated by commas; got {text!r}")
    return names


def _in_SI(log: DriveLog, name: str, kind: str) -> np.ndarray:
    """(T,) column of a truth, converted from the unit in its name; assumed SI where the name has none."""
    unit = unit_in_name(name, (TRUTHS[kind],))
    return log.column(name) * (unit.scale if unit else 1.0)
