"""`ohmward slip`: speed and wheel slip along a drive, with their uncertainty, and errors where there is a truth."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ohmward.cli import wording
from ohmward.cli.drive_inputs import (
    DriveReference,
    driven_wheels,
    make_terrain,
    read_drive_log,
    read_drive_truth,
    truth_names,
)
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.progress import counting, progress
from ohmward.cli.wording import FOOTER, duration, percent, quantity, with_assumptions
from ohmward.errors import InputError
from ohmward.figures.odometry import path_map
from ohmward.figures.parts import wall_clock
from ohmward.figures.slip import ground_figures, speed_figure
from ohmward.figures.terrain import run_figures as floor_plots
from ohmward.filters.consistency import BAND_95
from ohmward.logs import DriveLog, write_table
from ohmward.logs.write import TABLES
from ohmward.report import Figure, Page
from ohmward.traction import Robot, Terrain, load_robot
from ohmward.traction.observed_drive import (
    FloorFigures,
    ObservedDrive,
    drive_figures,
    floor_figures,
    observe_drive,
    observe_on_floors,
    pose_figures,
)
from ohmward.traction.score import DriveScore, score_drive, true_slip
from ohmward.traction.speed_observer.conclusions import SlipAlarm
from ohmward.traction.terrain.file import load_floors


def run(args: argparse.Namespace) -> Outcome:
    """Observe, compare with the truth, write the estimates; the exit status is 1 if the model does not fit the log."""
    check_output("--output", args.output, TABLES, [args.log, args.robot])
    task = make_task(args)
    observed = observe(task, args)
    if args.output:
        write_table(estimate_table(task, observed), args.output)
    figures = summary(task, args.filter, observed)
    page = partial(make_page, task, observed, figures)
    written = {"output": args.output, "report": args.report}
    return Outcome(figures | written, describe(task, figures), figures["notes"], page, status=int(not observed.fits))


def make_task(args: argparse.Namespace) -> SlipTask:
    """Robot, ground, drive and truth that the options name."""
    if args.floor and not args.floors:
        raise InputError("--floor NAME chooses from --floors FILE.toml; give that too")
    robot = load_robot(args.robot)
    terrain = make_terrain(args.terrain, robot)
    truths = truth_names(args.truth)
    log = read_drive_log(args.log, robot, args, extra=None if truths else (), leave=truths)
    return SlipTask(robot, terrain, log, read_drive_truth(log, robot, args.truth) if truths else None)


def observe(task: SlipTask, args: argparse.Namespace) -> ObservedDrive:
    """Speed and slip by the observer of --filter, on the floors of --floors if they are given."""
    if args.floors:
        return observe_on_floors(task.robot, task.log, load_floors(args.floors), args.filter, args.floor)
    with progress() as report:
        return observe_drive(task.robot, task.log, task.terrain, args.filter, counting(report, args.filter))


_MOST_EPISODES = 8

#: Elements of the pose in the names of its covariances.
POSE = ("x", "y", "yaw")


class SlipTask(NamedTuple):
    """One drive to observe: the robot and the ground that is believed at first, and the truth if there is one."""

    robot: Robot
    terrain: Terrain
    log: DriveLog
    reference: DriveReference | None


def summary(task: SlipTask, name: str, observed: ObservedDrive) -> dict[str, Any]:
    """The object of --json."""
    drive = drive_figures(observed)._asdict()
    for kind in ("slip_episodes", "immobilised_episodes"):
        drive[kind] = [episode._asdict() for episode in drive[kind]]
    return {
        "command": "slip",
        "log": task.log.name,
        "robot": task.robot.name,
        "terrain": "learnt floors" if observed.on_floors else task.terrain.name,
        "filter": name,
        "steps": len(task.log),
        "seconds": observed.track.seconds,
        "duration_s": task.log.duration_s,
        **drive,
        "pose": pose_figures(observed, task.log.yaw_rate_rad_s is not None)._asdict(),
        "fits": observed.fits,
        "flags": observed.track.counts(),
        **_scores(task, observed),
        "truth": task.reference.note if task.reference else None,
        "notes": notes_of(task, observed),
        **_floors(observed),
    }


def notes_of(task: SlipTask, observed: ObservedDrive) -> list[str]:
    """Everything that was assumed."""
    truth = [f"info: {task.reference.note}"] if task.reference else []
    return [*map(str, observed.notes), *truth]


def _scores(task: SlipTask, observed: ObservedDrive) -> dict[str, float | None]:
    """Errors against the truth; every figure None without one."""
    names = [name for name in DriveScore._fields if name != "samples"]
    if task.reference is None:
        return dict.fromkeys(names)
    score = score_drive(task.robot, observed.track.estimates, task.reference.truth)
    return {name: getattr(score, name) for name in names}


def _floors(observed: ObservedDrive) -> dict[str, Any]:
    """Figures of learnt floors; None without them."""
    if observed.on_floors is None:
        return dict.fromkeys(FloorFigures._fields)
    figures = floor_figures(observed.on_floors)
    return figures._asdict() | {"floor_crossings": [crossing._asdict() for crossing in figures.floor_crossings]}


def describe(task: SlipTask, figures: Mapping[str, Any]) -> str:
    """Text for people."""
    title = f"{figures['log']} with robot {figures['robot']!r}: {figures['filter']} on {figures['terrain']}"
    return wording.paragraphs(
        title,
        wording.fields(result(figures)),
        episodes(figures),
        wording.fields(errors(figures)) if task.reference else "",
        wording.assumptions(figures["notes"]),
    )


def result(figures: Mapping[str, Any]) -> dict[str, str]:
    """The key figures of a run with their units, by name."""
    band_m_s = BAND_95 * figures["speed_std_final_m_s"]
    rows = {
        "drive": f"{figures['distance_m']:.3g} m in {wording.duration(figures['duration_s'])}, "
        f"{figures['speed_min_m_s']:z.2f} to {figures['speed_max_m_s']:z.2f} m/s",
        "speed at the end": f"{figures['speed_final_m_s']:.3g} ± {band_m_s:.2g} m/s (95 %)",
        "pose at the end": _pose_text(figures["pose"]),
        "offset of the gyro": _gyro_text(figures["pose"]),
        "friction": _ratio_text(figures, "friction"),
        "grade": _grade_text(figures),
        "radius": _ratio_text(figures, "radius"),
        "speed unobserved": f"{wording.percent(figures['unobserved_share'], 1)} of the time",
        "flagged samples": wording.flagged(figures["flags"]),
        "steps": f"{figures['steps']:,} in {figures['seconds']:.2g} s",
    }
    if figures["floor_share"]:
        rows |= _floor_rows(figures)
    return {name: value for name, value in rows.items() if value}


def _floor_rows(figures: Mapping[str, Any]) -> dict[str, str]:
    """Figures of a drive on learnt floors with their units, by name."""
    std = figures["travel_slip_std"]
    band = wording.percent(None if std is None else BAND_95 * std, 1)
    floors = ", ".join(f"{name} {wording.percent(share, 0)}" for name, share in figures["floor_share"].items())
    times = ", ".join(f"{crossing['time_s']:.1f} s" for crossing in figures["floor_crossings"])
    return {
        "slip of the robot": f"{wording.percent(figures['travel_slip_mean'], 1)} ± {band} (95 %), mean",
        "floors under the wheels": floors,
        "other floor met at": times or "-",
    }


def _ratio_text(figures: Mapping[str, Any], name: str) -> str:
    """A ratio to the value believed, with its 95 % band; empty where it was not estimated."""
    ratio, std = figures[f"{name}_ratio"], figures[f"{name}_std"]
    if ratio is None:
        return ""
    relative = BAND_95 * std * (ratio if name == "friction" else 1.0)
    of = "the ground's that was believed" if name == "friction" else "the robot's"
    return f"{wording.percent(ratio, 1)} ± {wording.percent(relative, 1)} of {of}"


def _pose_text(pose: Mapping[str, Any]) -> str:
    """Pose of the robot in the frame of its start, with the 95 % band of the worst direction."""
    degrees, band = math.degrees(pose["yaw_rad"]), math.degrees(BAND_95 * pose["yaw_std_rad"])
    return (
        f"{pose['x_m']:z.2f} m forward, {pose['y_m']:z.2f} m to the left ± {BAND_95 * pose['position_std_m']:.2g} m, "
        f"turned by {degrees:z.1f} ± {band:.2g} degrees (95 %)"
    )


def _gyro_text(pose: Mapping[str, Any]) -> str:
    if pose["gyro_offset_rad_s"] is None:
        return ""
    return f"{pose['gyro_offset_rad_s']:z.4f} ± {BAND_95 * pose['gyro_offset_std_rad_s']:.2g} rad/s"


def _grade_text(figures: Mapping[str, Any]) -> str:
    if figures["grade_rad"] is None:
        return ""
    return f"{math.degrees(figures['grade_rad']):.2f} ± {math.degrees(BAND_95 * figures['grade_std_rad']):.2f} degrees"


def episodes(figures: Mapping[str, Any]) -> str:
    """Episodes of slip in order of time; only the longest where there are many."""
    found = figures["slip_episodes"]
    longest = sorted(found, key=lambda e: e["start_s"] - e["end_s"])[:_MOST_EPISODES]
    lines = [
        f"{e['wheel'].replace('_', ' ')} slips from {e['start_s']:.2f} s to {e['end_s']:.2f} s, at most by "
        f"{e['greatest_slip_m_s']:.2f} m/s ({wording.percent(e['greatest_slip'], 0)})"
        for e in sorted(longest, key=lambda e: e["start_s"])
    ]
    lines += [f"and {len(found) - len(longest)} shorter ones"] if len(found) > len(longest) else []
    lines += [f"immobilised from {e['start_s']:.2f} s to {e['end_s']:.2f} s" for e in figures["immobilised_episodes"]]
    return wording.bullets("Slip", lines or [_without_episodes(figures)])


def _without_episodes(figures: Mapping[str, Any]) -> str:
    """Sentence for a drive without an episode; on learnt floors a wide band may hide slip."""
    mean, std = figures["travel_slip_mean"], figures["travel_slip_std"]
    if mean is None or mean + BAND_95 * std <= SlipAlarm().allowed_ratio:
        return "no wheel slips beyond what is allowed"
    most = wording.percent(mean + BAND_95 * std, 0)
    return f"no slip beyond what is allowed is certain; the robot may lose up to {most} of the way of its wheels"


def errors(figures: Mapping[str, Any]) -> dict[str, str]:
    """Errors against the truth, by name."""
    return {
        "speed error": f"{wording.quantity(figures['speed_rmse_m_s'], 'm/s RMS')}, at most "
        f"{wording.quantity(figures['speed_max_error_m_s'], 'm/s')}",
        "true speed inside the 95 % band": wording.percent(figures["speed_coverage_95"], 1),
        "slip error": wording.quantity(figures["slip_rmse"], "RMS of the slip ratio"),
        "true slip inside the 95 % band": wording.percent(figures["coverage_95"], 1),
        "false alarms": wording.percent(figures["false_alarm_rate"], 2),
        "slip that was found": wording.percent(figures["detection_rate"], 1),
    }


def estimate_table(task: SlipTask, observed: ObservedDrive) -> dict[str, np.ndarray]:
    """Columns (T,) of the estimates file, by name."""
    e = observed.track.estimates
    columns = {
        "time_s": observed.track.time_s,
        "speed_m_s": e.speed_m_s,
        "speed_std_m_s": e.speed_std_m_s,
        "yaw_rate_rad_s": e.yaw_rate_rad_s,
        "yaw_rate_std_rad_s": e.yaw_rate_std_rad_s,
        "grade_rad": e.grade_rad,
        "grade_std_rad": e.grade_std_rad,
        "radius_ratio": e.radius_ratio,
        "unobserved_s": e.unobserved_s,
        "immobilised": e.immobilised.astype(int),
        "flags": e.flags.astype(int),
    }
    for k, wheel in enumerate(driven_wheels(task.robot)):
        columns |= {
            f"{wheel}_wheel_speed_rad_s": e.wheel_speed_rad_s[:, k],
            f"{wheel}_slip": e.slip_ratio[:, k],
            f"{wheel}_slip_speed_m_s": e.slip_speed_m_s[:, k],
            f"{wheel}_slip_speed_std_m_s": e.slip_speed_std_m_s[:, k],
            f"{wheel}_traction_N": e.traction_N[:, k],
            f"{wheel}_friction_ratio": e.friction_ratio[:, k],
            f"{wheel}_slipping": e.slipping[:, k].astype(int),
        }
    if task.reference:
        columns["speed_truth_m_s"] = task.reference.truth.speed_m_s
    return columns | path_columns(observed) | _floor_columns(task, observed)


def path_columns(observed: ObservedDrive) -> dict[str, np.ndarray]:
    """Columns (T,) of pose and sideways speed, by name; the covariance by its lower triangle."""
    e = observed.path.estimates
    columns = {"x_m": e.x_m, "y_m": e.y_m, "yaw_rad": e.yaw_rad}
    for i, row in enumerate(POSE):
        for j, column in enumerate(POSE[: i + 1]):
            columns[f"cov_{column}_{row}"] = e.pose_cov[:, i, j]
    return columns | {"speed_left_m_s": e.speed_left_m_s, "gyro_offset_rad_s": e.gyro_offset_rad_s}


def _floor_columns(task: SlipTask, observed: ObservedDrive) -> dict[str, np.ndarray]:
    """Columns (T,) that learnt floors add, by name."""
    if observed.on_floors is None:
        return {}
    track = observed.on_floors.track
    columns = {
        "travel_slip": track.travel_slip,
        "travel_slip_std": track.travel_slip_std,
        "speed_over_ground_m_s": track.speed_m_s,
        "speed_over_ground_std_m_s": track.speed_std_m_s,
    }
    for w, wheel in enumerate(driven_wheels(task.robot)):
        for k, floor in enumerate(observed.on_floors.floors):
            columns[f"{wheel}_on_{floor.replace(' ', '_')}"] = track.floor_probability[:, w, k]
    return columns


def make_page(task: SlipTask, observed: ObservedDrive, figures: Mapping[str, Any]) -> Page:
    """Key figures, plots above each other on one clock, episodes, assumptions.

    figures: summary of the drive.
    """
    what = f"Speed and slip by {figures['filter']}, robot {task.robot.name!r}, {duration(task.log.duration_s)}"
    page = Page(task.log.name, what, FOOTER).numbers(_numbers(figures))
    page = page.plot(*_plots(task, observed), clock=wall_clock(task.log))
    page = page.map(path_map(observed.path))
    page = page.heading("Result").table(["Quantity", "Value"], list(result(figures).items()))
    if task.reference:
        page = page.heading("Against the truth").table(["Quantity", "Value"], list(errors(figures).items()))
    return with_assumptions(_with_episodes(page, figures), figures["notes"])


def _numbers(figures: Mapping[str, Any]) -> dict[str, str]:
    numbers = {
        "Distance": quantity(figures["distance_m"], "m"),
        "Greatest speed": quantity(max(-figures["speed_min_m_s"], figures["speed_max_m_s"]), "m/s"),
        "Slip episodes": str(len(figures["slip_episodes"])),
        "Speed unobserved": percent(figures["unobserved_share"], 1),
        "Speed error, RMS": quantity(figures["speed_rmse_m_s"], "mm/s", 1e3),
        "Slip error, RMS": quantity(figures["slip_rmse"], ""),
        "True slip in 95 % band": percent(figures["coverage_95"], 1),
    }
    return {label: value for label, value in numbers.items() if value != "-"}


def _plots(task: SlipTask, observed: ObservedDrive) -> list[Figure]:
    robot = task.robot
    run = observed.track
    e = run.estimates
    truth = task.reference.truth if task.reference else None
    wheels = driven_wheels(robot)
    rolled_m_s = robot.wheel.radius_m * e.wheel_speed_rad_s @ np.linalg.pinv(robot.rolling[: robot.driven])[0]
    plots = [speed_figure(run, rolled_m_s, truth.speed_m_s if truth else None)]
    if observed.on_floors:
        plots += floor_plots(observed.on_floors.track, observed.on_floors.floors, wheels)
    return plots + ground_figures(run, wheels, true_slip(robot, e, truth).speed_m_s if truth else None)


def _with_episodes(page: Page, figures: Mapping[str, Any]) -> Page:
    """The page with a row for each time that a wheel slipped."""
    found = figures["slip_episodes"]
    if not found:
        return page
    rows = [
        [
            e["wheel"].replace("_", " "),
            f"{e['start_s']:.2f} to {e['end_s']:.2f} s",
            quantity(e["greatest_slip_m_s"], "m/s"),
            percent(e["greatest_slip"], 0),
        ]
        for e in found
    ]
    return page.heading("Slip episodes").table(["Wheel", "Time", "Greatest slip speed", "Greatest slip"], rows)
