"""Logs, ground and earlier knowledge that the options of `ohmward mission` name."""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from ohmward.cli.battery_inputs import read_battery_log
from ohmward.cli.drive_inputs import make_terrain, read_drive_log
from ohmward.cli.options import DEFAULT_TERRAIN, file_hints
from ohmward.cli.parser import split_selection
from ohmward.energy import Consumption, load_consumption, prior_from_mass, prior_from_robot, start
from ohmward.energy.mission import MissionSettings
from ohmward.errors import InputError
from ohmward.logs import DriveLog, Log, Note
from ohmward.logs.clock import date_column, nanosecond_column, read_clock
from ohmward.logs.columns import find_columns
from ohmward.logs.read import open_table
from ohmward.logs.selection import select_rows
from ohmward.logs.table import TableFile
from ohmward.traction import Robot
from ohmward.traction.friction.terrain import ADHESION, ROADS, SOILS

#: Kinds of --column and --unit that are the battery's; all others, and the time, are the drive's.
BATTERY_KINDS = ("time", "current", "voltage", "temperature")
#: Column with the name of the ground under each sample.
TERRAIN_COLUMN = "terrain"

Ground = str | np.ndarray


def check(args: argparse.Namespace) -> None:
    """Refuse what cannot work before anything is read.

    Raises:
        InputError: neither a log nor a plan, no battery, nothing known of the robot, no state of charge.
    """
    if args.log is None and args.plan is None:
        raise InputError("nothing to do: give a LOG, or --plan FILE.toml (--plan-example prints one)")
    if args.battery is None:
        raise InputError("--battery FILE.toml is needed; `ohmward identify` or `ohmward generic` makes one")
    if args.log is None and args.soc is None:
        raise InputError("--soc S is needed with a plan alone: the state of charge now, 0 to 1")
    if not (args.robot or args.consumption or args.mass_kg):
        raise InputError("nothing is known of the robot: give --robot, --consumption or --mass-kg")
    if args.payload_kg < 0:
        raise InputError(f"--payload-kg must be >= 0, got {args.payload_kg:g}")


def settings_of(args: argparse.Namespace, robot: Robot | None) -> MissionSettings:
    """Settings of the analysis."""
    named = args.terrain if args.terrain in {*ADHESION, *ROADS, *SOILS} else DEFAULT_TERRAIN
    return MissionSettings(
        soc=args.soc,
        soc_std=args.soc_std,
        initial_soc=args.initial_soc,
        initial_soc_std=args.initial_soc_std,
        filter=args.filter,
        reserve_soc=args.reserve_soc,
        cutoff_V=args.cutoff_v,
        payload_kg=args.payload_kg,
        speed_column=_speed_column(args),
        believed=make_terrain(named, robot) if robot else None,
        confidence=args.confidence,
    )


def earlier_consumption(args: argparse.Namespace, robot: Robot | None) -> tuple[Consumption, str]:
    """Consumption as known before, and its origin."""
    if args.consumption:
        c = load_consumption(args.consumption)
        return c, f"info: consumption from {args.consumption}: {', '.join(c.terrains) or 'no terrain yet'}"
    if robot:
        return start(prior_from_robot(robot)), f"info: consumption expected from the data of {robot.name!r}: broad"
    expected = start(prior_from_mass(args.mass_kg))
    return expected, f"info: consumption expected from a mass of {args.mass_kg:g} kg: broad"


def read_logs(args: argparse.Namespace, robot: Robot | None) -> tuple[Log | None, DriveLog | None, Ground]:
    """Logs of battery and wheels and the ground, all from one file that is read once."""
    if args.log is None:
        return None, None, args.terrain
    file = open_table(split_selection(args.log)[0], file_hints(args)).read_once()
    log, ground = read_battery(args, file)
    return log, read_wheels(args, file, robot, log), ground


def read_battery(args: argparse.Namespace, file: TableFile) -> tuple[Log, Ground]:
    """The battery's log with all further columns, and the ground under its samples."""
    log = read_battery_log(args.log, _with_kinds(args, BATTERY_KINDS.__contains__), file=file)
    ground = read_ground(args, file, log)
    if isinstance(ground, str):
        return log.with_notes(Note(f"the whole drive on {ground!r}")), ground
    names = ", ".join(sorted(set(ground)))
    return log.with_notes(Note(f"ground from column {TERRAIN_COLUMN!r}: {names}")), ground


def read_wheels(args: argparse.Namespace, file: TableFile, robot: Robot | None, log: Log) -> DriveLog | None:
    """Wheels and motors in the same file; None where there are none and a speed tells enough."""
    if robot is None:
        return None
    try:
        return read_drive_log(args.log, robot, _with_kinds(args, _is_of_drive), extra=(), file=file)
    except InputError:
        if _speed_column(args) in log.extra:
            return None
        raise


def read_ground(args: argparse.Namespace, file: TableFile, log: Log) -> Ground:
    """Name of the ground under each sample (T,), from a column of the file; else that of --terrain for all."""
    if TERRAIN_COLUMN not in file.names:
        return args.terrain
    battery = _with_kinds(args, BATTERY_KINDS.__contains__)
    time = find_columns(file.source, file.names, dict(battery.column), dict(battery.unit))["time"]
    rows = dict(args.where) | split_selection(args.log)[1]
    beside = nanosecond_column(file.names, time.name), date_column(file, time.name)
    wanted = {time.name, TERRAIN_COLUMN, *rows, *(name or "" for name in beside)}
    table = select_rows(file.load(wanted & set(file.names)), rows)
    clock = read_clock(table, time, file.hints, beside[1])
    time_s = clock.time_s if clock.start_unix_s is None else clock.time_s - np.nanmin(clock.time_s)
    order = np.argsort(time_s, kind="stable")
    names = np.array([_name(cell, args.terrain) for cell in table.columns[TERRAIN_COLUMN]], dtype=object)[order]
    return names[np.maximum(np.searchsorted(time_s[order], log.time_s, side="right") - 1, 0)]


def _name(cell: object, otherwise: str) -> str:
    """The name in a cell, or another where it is empty."""
    text = str(cell).strip()
    return otherwise if text.lower() in ("", "nan", "none") else text


def _is_of_drive(kind: str) -> bool:
    return kind == "time" or kind not in BATTERY_KINDS


def _with_kinds(args: argparse.Namespace, wanted: Callable[[str], bool]) -> argparse.Namespace:
    """The arguments with those columns and units only whose kind is wanted."""
    chosen = vars(args).copy()
    for option in ("column", "unit"):
        chosen[option] = [(kind, value) for kind, value in chosen[option] if wanted(kind)]
    return argparse.Namespace(**chosen)


def _speed_column(args: argparse.Namespace) -> str:
    return dict(args.column).get("speed", "speed_m_s")
