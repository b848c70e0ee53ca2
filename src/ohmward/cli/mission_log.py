"""From the log of a drive to what `ohmward mission` learns from it: speed, power, ground, and the charge left."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any, NamedTuple

from ohmward.cli.driving import DEFAULT_TERRAIN, make_terrain, read_drive_log
from ohmward.cli.estimating import within_range
from ohmward.cli.progress import progress
from ohmward.cli.reading import read, split_selection
from ohmward.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from ohmward.battery.battery import Battery
    from ohmward.battery.soc.sample import SocEstimate
    from ohmward.energy.balance import DriveEnergy, EnergyBalance
    from ohmward.energy.recorded import Driven
    from ohmward.logs import DriveLog, Log
    from ohmward.traction import Robot

#: What a column of the battery may be called on the command line; all others are the drive's.
BATTERY_KINDS = ("time", "current", "voltage", "temperature")
#: The column that names the ground under each sample, if there is one.
TERRAIN_COLUMN = "terrain"


class Split(NamedTuple):
    """Where the power went: over time, and added up."""

    time_s: np.ndarray
    power: EnergyBalance
    energy: DriveEnergy


class Recording(NamedTuple):
    """A drive as the energy sees it.

    log: of the battery.
    speed_m_s, battery_W: (T,) at its samples.
    driven: stretches of one ground each.
    split: None without wheels and motor currents.
    soc: estimates along the log; None where --soc was given.
    notes: everything that was assumed.
    """

    log: Log
    speed_m_s: np.ndarray
    battery_W: np.ndarray
    driven: list[Driven]
    split: Split | None
    soc: SocEstimate | None
    notes: list[str]


def record(args: argparse.Namespace, battery: Battery, robot: Robot | None) -> Recording:
    """Read the log of the arguments and cut it into stretches.

    Raises:
        InputError: the log has no battery, no speed, or no stretch in which both were measured.
    """
    from ohmward.energy import cut_drive

    log = within_range(read(args.log, _battery_arguments(args), extra=None), battery)
    soc = None if args.soc is not None else _soc(args, battery, log)
    drive = _drive(args, robot, log)
    motion = _observed(args, robot, drive, log.time_s) if robot and drive else _measured(log, args)
    battery_W = -log.voltage_V * log.current_A
    ground = _ground(args, log)
    driven = cut_drive(log.time_s, motion.speed_m_s, battery_W, ground, motion.grade_rad, args.payload_kg)
    split = _split(drive, motion, log.time_s, battery_W, driven) if drive and motion.track else None
    notes = [*map(str, log.notes), *motion.notes, *_ground_notes(ground), *_idle_notes(split)]
    return Recording(log, motion.speed_m_s, battery_W, driven, split, soc, notes)


class _Motion(NamedTuple):
    """Speed and grade (T,) at the battery's samples, and what an observer said on its own clock."""

    speed_m_s: np.ndarray
    grade_rad: np.ndarray | None
    track: Any
    scene: Any
    notes: list[str]


def _battery_arguments(args: argparse.Namespace) -> argparse.Namespace:
    kinds = {name: [(k, v) for k, v in getattr(args, name) if k in BATTERY_KINDS] for name in ("column", "unit")}
    return argparse.Namespace(**{**vars(args), **kinds})


def _soc(args: argparse.Namespace, battery: Battery, log: Log) -> SocEstimate:
    from ohmward.battery.soc.estimator import SocEstimator
    from ohmward.battery.soc.registry import EstimatorSettings, make_estimator

    estimator = make_estimator(args.filter, battery, EstimatorSettings(idle_current_A=battery.idle_current_A))
    return SocEstimator(estimator, args.initial_soc, args.initial_soc_std).run(log).estimates


def _drive(args: argparse.Namespace, robot: Robot | None, log: Log) -> DriveLog | None:
    """The wheels and motors in the same file; None where there are none and a speed tells enough."""
    if robot is None:
        return None
    kinds = {
        name: [(k, v) for k, v in getattr(args, name) if k not in BATTERY_KINDS[1:]] for name in ("column", "unit")
    }
    try:
        return read_drive_log(args.log, robot, argparse.Namespace(**{**vars(args), **kinds}), extra=())
    except InputError:
        if _speed_column(args) in log.extra:
            return None
        raise


def _observed(args: argparse.Namespace, robot: Robot, drive: DriveLog, time_s: np.ndarray) -> _Motion:
    """Speed and grade as an observer makes them of wheels, motors and whatever else there is."""
    import numpy as np

    from ohmward.traction.friction.terrain import ADHESION, ROADS, SOILS
    from ohmward.traction.speed_observer.make_observer import make_observer
    from ohmward.traction.speed_observer.track import observe

    believed = args.terrain if args.terrain in {*ADHESION, *ROADS, *SOILS} else DEFAULT_TERRAIN
    chosen = make_observer(robot, drive, make_terrain(believed, robot))
    with progress() as report:
        told = (lambda done, total: report("ukf", done / total)) if report else None
        track = observe(chosen.observer, drive, told)
    e = track.estimates
    level = not chosen.observer.states.grade and "pitch_rad" not in drive.channels
    speed, grade = (np.interp(time_s, drive.time_s, values) for values in (e.speed_m_s, e.grade_rad))
    notes = [str(note) for note in (*drive.notes, *chosen.notes)]
    return _Motion(speed, None if level else grade, track, chosen.observer.scene, notes)


def _measured(log: Log, args: argparse.Namespace) -> _Motion:
    """Speed and slope from columns of the log."""
    name = _speed_column(args)
    if name not in log.extra:
        raise InputError(
            f"{log.name}: there is no speed: neither wheels (give --robot) nor a column {name!r}; name it with "
            f"--column speed=NAME. It has: {', '.join(log.extra) or 'nothing but the battery'}"
        )
    slope = next((s for s in ("grade_rad", "pitch_rad") if s in log.extra), None)
    notes = [
        f"info: speed from column {name!r} in m/s" + (f", slope from {slope!r}" if slope else ", ground taken as level")
    ]
    return _Motion(log.extra[name], log.extra[slope] if slope else None, None, None, notes)


def _speed_column(args: argparse.Namespace) -> str:
    return dict(args.column).get("speed", "speed_m_s")


def _ground(args: argparse.Namespace, log: Log) -> np.ndarray | str:
    """The name of the ground under each sample (T,), from a column of the file; else --terrain for all."""
    import numpy as np

    from ohmward.logs.clock import nanosecond_column, read_clock
    from ohmward.logs.columns import find_columns
    from ohmward.logs.read import open_table
    from ohmward.logs.selection import select_rows

    path, where = split_selection(args.log)
    file, rows = open_table(path), dict(args.where) | where
    if TERRAIN_COLUMN not in file.names:
        return args.terrain
    battery = _battery_arguments(args)
    time = find_columns(file.source, file.names, dict(battery.column), dict(battery.unit))["time"]
    wanted = {time.name, TERRAIN_COLUMN, *rows, nanosecond_column(file.names, time.name) or ""}
    table = select_rows(file.load(wanted & set(file.names)), rows)
    clock = read_clock(table, time)
    time_s = clock.time_s if clock.start_unix_s is None else clock.time_s - np.nanmin(clock.time_s)
    order = np.argsort(time_s, kind="stable")
    names = np.array([_name(cell, args.terrain) for cell in table.columns[TERRAIN_COLUMN]], dtype=object)[order]
    return names[np.maximum(np.searchsorted(time_s[order], log.time_s, side="right") - 1, 0)]


def _name(cell: object, otherwise: str) -> str:
    """The name in a cell, or another where it is empty."""
    text = str(cell).strip()
    return otherwise if text.lower() in ("", "nan", "none") else text


def _split(
    drive: DriveLog, motion: _Motion, time_s: np.ndarray, battery_W: np.ndarray, driven: list[Driven]
) -> Split | None:
    """Where the power went; None without motor currents."""
    import numpy as np

    from ohmward.energy import drive_balance, integrate_drive

    if not np.isfinite(drive.motor_current_A).any():
        return None
    track, scene = motion.track, motion.scene
    known = np.isfinite(battery_W)
    at_drive_W = np.interp(drive.time_s, time_s[known], battery_W[known])
    power = drive_balance(drive, track.estimates, scene, at_drive_W, idle_W(driven))
    return Split(drive.time_s, power, integrate_drive(drive, power, track.estimates, scene.robot))


def _ground_notes(ground: np.ndarray | str) -> list[str]:
    if isinstance(ground, str):
        return [f"info: the whole drive on {ground!r}"]
    return [f"info: ground from column {TERRAIN_COLUMN!r}: {', '.join(sorted(set(ground)))}"]


def _idle_notes(split: Split | None) -> list[str]:
    if split is None or split.energy.balance.idle > 0:
        return []
    return [
        "warning: the idle power is not known (robot.idle_W is 0, and the robot never stood): it is part of 'residual'"
    ]


def idle_W(driven: list[Driven]) -> float | None:
    """What the battery gave while the robot stood [W]; None where it never did."""
    standing = [d for d in driven if not d.stretch.terrain]
    standing_s = sum(d.stretch.time_s for d in standing)
    return sum(d.energy_J for d in standing) / standing_s if standing_s else None


def last_unix_s(log: Log) -> float | None:
    """When the drive ended, where the log has a wall clock."""
    return None if log.start_unix_s is None else log.start_unix_s + float(log.time_s[-1])
