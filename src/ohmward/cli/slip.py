"""`ohmward slip`: speed and wheel slip along a drive, with their uncertainty, and errors where there is a truth."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

from ohmward.cli.drive_inputs import DriveReference, drive_options, read_drive_truth, truth_names
from ohmward.cli.outcome import Outcome, check_results, counting, progress
from ohmward.cli.wording import bullets, fields, known_rows, paragraphs
from ohmward.errors import InputError
from ohmward.figures.numbers import flagged, percent, quantity
from ohmward.figures.parts import wall_clock
from ohmward.figures.slip import floor_plots, ground_figures, path_map, speed_figure
from ohmward.filters.consistency import BAND_95
from ohmward.logs import DriveLog, write_table
from ohmward.logs.write import TABLES
from ohmward.report import Figure, Page
from ohmward.runs import duration
from ohmward.traction import Robot, Terrain, load_robot, observed_drive
from ohmward.traction.friction.terrain import terrain_named
from ohmward.traction.robot.robot import motion_from_wheels
from ohmward.traction.score import score_drive, score_figures, true_slip
from ohmward.traction.speed_observer.estimate import SlipAlarm
from ohmward.traction.terrain.floor import load_floors

_MOST_EPISODES = 8
#: Factor within which, at 95 %, a drive must determine the friction for its value to be reported.
_KNOWN_WITHIN = 2.0


class SlipTask(NamedTuple):
    """One drive to observe: the robot and the ground that is assumed at first, and the truth if there is one."""

    robot: Robot
    terrain: Terrain
    log: DriveLog
    reference: DriveReference | None


def run(args: argparse.Namespace) -> Outcome:
    """Observe, compare with the truth, write the estimates; the exit status is 1 if the model does not fit the log."""
    check_results(args.output, TABLES, [args.log, args.robot], "speed_std_m_s")
    if args.floor and not args.floors:
        raise InputError("--floor NAME chooses from --floors FILE.toml; give that too")
    robot = load_robot(args.robot)
    terrain = terrain_named(args.terrain, robot.wheel)
    truths = truth_names(args.truth)
    log = drive_options(args, robot).read(args.log, extra=None if truths else (), leave=truths)
    task = SlipTask(robot, terrain, log, read_drive_truth(log, robot, args.truth) if truths else None)
    with progress() as report:
        if args.floors:
            observed = observed_drive.observe_on_floors(robot, log, load_floors(args.floors), args.filter, args.floor)
        else:
            observed = observed_drive.observe_drive(robot, log, terrain, args.filter, counting(report, args.filter))
    if args.output:
        truth = {"speed_truth_m_s": task.reference.truth.speed_m_s} if task.reference else {}
        write_table(observed.columns() | truth, args.output)
    figures = summary(task, observed) | {"output": args.output, "report": args.report}
    page = partial(make_page, task, observed, figures)
    return Outcome(figures, describe(figures), figures["notes"], page, status=int(not observed.fits))


def summary(task: SlipTask, observed: observed_drive.ObservedDrive) -> dict[str, Any]:
    """The object of --json, but for the files."""
    score, truth = None, []
    if task.reference:
        score = score_drive(task.robot, observed.track.estimates, task.reference.truth)
        truth = [f"info: {task.reference.note}"]
    on_floors = observed_drive.floor_figures(observed.on_floors)._asdict() if observed.on_floors else {}
    assumed = None if observed.method == observed_drive.ODOMETRY else task.terrain.name
    return {
        "command": "slip",
        "log": task.log.name,
        "robot": task.robot.name,
        "terrain": "learnt floors" if observed.on_floors else assumed,
        "filter": observed.method,
        "steps": len(task.log),
        "seconds": observed.track.seconds,
        "duration_s": task.log.duration_s,
        **observed_drive.drive_figures(observed)._asdict(),
        "pose": observed_drive.pose_figures(observed, task.log.yaw_rate_rad_s is not None),
        "fits": observed.fits,
        "flags": observed.track.counts(),
        **score_figures(score),
        "truth": task.reference.note if task.reference else None,
        "notes": [*map(str, observed.notes), *truth],
        **(dict.fromkeys(observed_drive.FloorFigures._fields) | on_floors),
    }


def describe(f: Mapping[str, Any]) -> str:
    """Text for people.

    f: the summary of the drive, here and in all functions below.
    """
    return paragraphs(
        f"{f['log']} with robot {f['robot']!r}: {f['filter']}" + (f" on {f['terrain']}" if f["terrain"] else ""),
        fields(result(f)),
        bullets("Slip", episodes(f)),
        fields(errors(f)) if f["truth"] else "",
    )


def result(f: Mapping[str, Any]) -> dict[str, str]:
    """The key figures of a run with their units, by name."""
    pose: observed_drive.PoseFigures = f["pose"]
    grade, radius = f["grade_rad"] is not None, percent(f["radius_ratio"], 1)
    offset, offset_std = pose.gyro_offset_rad_s, pose.gyro_offset_std_rad_s
    gyro = f"{offset:z.4f} ± {BAND_95 * offset_std:.2g} rad/s" if offset is not None and offset_std is not None else ""
    rows = {
        "drive": f"{f['distance_m']:.3g} m in {duration(f['duration_s'])}, "
        f"{f['speed_min_m_s']:z.2f} to {f['speed_max_m_s']:z.2f} m/s",
        "speed at the end": f"{f['speed_final_m_s']:z.3f} ± {BAND_95 * f['speed_std_final_m_s']:.2g} m/s (95 %)",
        "pose at the end": f"{pose.x_m:z.2f} m forward, {pose.y_m:z.2f} m to the left "
        f"± {quantity(pose.position_std_m, 'm', BAND_95, 2)}, {_turn(pose.yaw_rad, pose.yaw_std_rad)} (95 %)",
        "offset of the gyro": gyro,
        "friction": _friction(f["friction_ratio"], f["friction_std"]),
        "grade": f"{_degrees(f['grade_rad'], f['grade_std_rad'], '.2f', '.2f')} degrees" if grade else "",
        "radius": f"{radius} ± {percent(BAND_95 * f['radius_std'], 1)} of the robot's" if f["radius_ratio"] else "",
        "speed unobserved": f"{percent(f['unobserved_share'], 1)} of the time",
        "flagged samples": flagged({name: count for name, count in f["flags"].items() if count < f["steps"]}),
        "steps": f"{f['steps']:,} in {f['seconds']:.2g} s",
    }
    if f["floor_share"]:
        std = f["travel_slip_std"]
        slip_band = percent(None if std is None else BAND_95 * std, 1)
        floors = (f"{name} {percent(share, 0)}" for name, share in f["floor_share"].items())
        times = ", ".join(f"{crossing.time_s:.1f} s" for crossing in f["floor_crossings"])
        rows |= {
            "slip of the robot": f"{percent(f['travel_slip_mean'], 1)} ± {slip_band} (95 %), mean",
            "floors under the wheels": ", ".join(floors),
            "other floor met at": times or "-",
        }
    return {name: value for name, value in rows.items() if value}


def _turn(yaw_rad: float, std_rad: float) -> str:
    """The turn with its band; no number where it can be any."""
    if BAND_95 * std_rad > math.pi:
        return "turn not known"
    return f"turned by {_degrees(yaw_rad, std_rad, 'z.1f', '.2g')} degrees"


def _friction(ratio: float | None, relative_std: float) -> str:
    """Friction relative to that of the assumed ground; no number where the drive does not determine it well enough."""
    if ratio is None:
        return ""
    factor = math.exp(BAND_95 * relative_std)
    if factor > _KNOWN_WITHIN:
        return f"not known from this drive (within a factor of {factor:.2g}): no wheel pushed hard enough"
    return f"{percent(ratio, 1)} ({percent(ratio / factor, 1)} to {percent(ratio * factor, 1)}) of the ground's"


def _degrees(angle_rad: float, std_rad: float, form: str, form_of_band: str) -> str:
    return f"{math.degrees(angle_rad):{form}} ± {math.degrees(BAND_95 * std_rad):{form_of_band}}"


def episodes(f: Mapping[str, Any]) -> list[str]:
    """Sentences on the episodes of slip in order of time; only the longest where there are many."""
    found = f["slip_episodes"]
    longest = sorted(found, key=lambda e: e.start_s - e.end_s)[:_MOST_EPISODES]
    lines = [
        f"{e.wheel.replace('_', ' ')} slips from {e.start_s:.2f} s to {e.end_s:.2f} s, at most by "
        f"{e.greatest_slip_m_s:.2f} m/s ({percent(e.greatest_slip, 0)})"
        for e in sorted(longest, key=lambda e: e.start_s)
    ]
    lines += [f"and {len(found) - len(longest)} shorter ones"] if len(found) > len(longest) else []
    lines += [f"immobilised from {e.start_s:.2f} s to {e.end_s:.2f} s" for e in f["immobilised_episodes"]]
    if lines:
        return lines
    mean, std = f["travel_slip_mean"], f["travel_slip_std"]
    if mean is None or mean + BAND_95 * std <= SlipAlarm().allowed_ratio:
        return ["no wheel slips beyond the limit"]
    # on learnt floors a wide band may hide slip
    most = percent(mean + BAND_95 * std, 0)
    return [f"no slip beyond the limit is certain; the robot may lose up to {most} of the way of its wheels"]


def errors(f: Mapping[str, Any]) -> dict[str, str]:
    """Errors against the truth, by name."""
    most = quantity(f["speed_max_error_m_s"], "m/s")
    return {
        "speed error": f"{quantity(f['speed_rmse_m_s'], 'm/s RMS')}, at most {most}",
        "true speed inside the 95 % band": percent(f["speed_coverage_95"], 1),
        "slip error": quantity(f["slip_rmse"], "RMS of the slip ratio"),
        "true slip inside the 95 % band": percent(f["coverage_95"], 1),
        "false alarms": percent(f["false_alarm_rate"], 2),
        "slip that was found": percent(f["detection_rate"], 1),
    }


def make_page(task: SlipTask, observed: observed_drive.ObservedDrive, f: Mapping[str, Any]) -> Page:
    """Key figures, plots on a common time axis, episodes, assumptions."""
    what = f"Speed and slip by {f['filter']}, robot {task.robot.name!r}, {duration(task.log.duration_s)}"
    numbers = {
        "Distance": quantity(f["distance_m"], "m"),
        "Greatest speed": quantity(max(-f["speed_min_m_s"], f["speed_max_m_s"]), "m/s"),
        "Slip episodes": str(len(f["slip_episodes"])),
        "Speed unobserved": percent(f["unobserved_share"], 1),
        "Speed error, RMS": quantity(f["speed_rmse_m_s"], "mm/s", 1e3),
        "Slip error, RMS": quantity(f["slip_rmse"], ""),
        "True slip in 95 % band": percent(f["coverage_95"], 1),
    }
    page = Page(task.log.name, what).numbers(known_rows(numbers))
    page = page.plot(*_plots(task, observed), clock=wall_clock(task.log))
    page = page.map(path_map(observed.path))
    page = page.heading("Result").table(["Quantity", "Value"], list(result(f).items()))
    if task.reference:
        page = page.heading("Against the truth").table(["Quantity", "Value"], list(errors(f).items()))
    rows = [
        [
            e.wheel.replace("_", " "),
            f"{e.start_s:.2f} to {e.end_s:.2f} s",
            quantity(e.greatest_slip_m_s, "m/s"),
            percent(e.greatest_slip, 0),
        ]
        for e in f["slip_episodes"]
    ]
    if rows:
        page = page.heading("Slip episodes").table(["Wheel", "Time", "Greatest slip speed", "Greatest slip"], rows)
    return page


def _plots(task: SlipTask, observed: observed_drive.ObservedDrive) -> list[Figure]:
    robot, run = task.robot, observed.track
    e = run.estimates
    truth = task.reference.truth if task.reference else None
    wheels = robot.driven_wheels
    rolled_m_s = motion_from_wheels(robot, e.wheel_speed_rad_s)[:, 0]
    plots = [speed_figure(run, rolled_m_s, truth.speed_m_s if truth else None)]
    if observed.on_floors:
        plots += floor_plots(observed.on_floors.track, observed.on_floors.floors, wheels)
    return plots + ground_figures(run, wheels, true_slip(robot, e, truth).speed_m_s if truth else None)
