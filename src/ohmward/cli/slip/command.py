"""`ohmward slip`: speed and wheel slip along a drive, with their uncertainty, and errors where there is a truth."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any, NamedTuple

from ohmward.cli import wording
from ohmward.cli.driving import (
    TRUTHS,
    NotedTruth,
    add_drive_options,
    add_robot_options,
    make_robot,
    make_terrain,
    read_drive_log,
    read_drive_truth,
    truth_columns,
)
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import add_command, add_output_options
from ohmward.cli.progress import progress
from ohmward.filters.consistency import BAND_95

if TYPE_CHECKING:
    import numpy as np

    from ohmward.cli.slip.on_floors import OnFloors
    from ohmward.logs import DriveLog
    from ohmward.traction import Robot, Terrain
    from ohmward.traction.speed_observer.estimate import SlipEstimate
    from ohmward.traction.speed_observer.track import SlipRun

_EXAMPLES = """\
  ohmward slip drive.csv --robot robot.toml
  ohmward slip drive.csv --robot rlma --terrain gravel --truth speed_true_m_s --json
  ohmward slip drive.csv --robot robot.toml -o slip.csv --report slip.html
  ohmward slip gray.parquet --robot robotino --where exp=5 --motor-shaft
  ohmward slip gray.parquet --robot robot.toml --floors floors.toml --where exp=5 --motor-shaft
  ohmward slip husky.csv --robot husky.toml --unit wheel_speed=m/s --column yaw_rate=gyro_up
"""
_MOST_EPISODES = 8


class SlipTask(NamedTuple):
    """One drive to observe: the robot and the ground that is believed at first, and the truth if there is one."""

    robot: Robot
    terrain: Terrain
    log: DriveLog
    truth: NotedTruth | None


class SlipAnswer(NamedTuple):
    """The track of the drive, everything that was assumed for it, and what learnt floors say besides."""

    track: SlipRun
    notes: list[str]
    on_floors: OnFloors | None = None


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "slip", "speed and wheel slip along a drive, with their uncertainty", _EXAMPLES)
    parser.add_argument("log", metavar="LOG", help="a CSV or Parquet file")
    add_robot_options(parser)
    group = parser.add_argument_group("estimation")
    group.add_argument("--filter", default="ukf", metavar="NAME", help="ekf, aekf, ukf or aukf (default %(default)s)")
    group.add_argument(
        "--floors", metavar="FILE.toml", help="floors that `ohmward calibrate` has learnt: slip by motor currents alone"
    )
    group.add_argument(
        "--truth", metavar="COLUMN[,...]", help=f"references in the log to compare with: {', '.join(TRUTHS)}"
    )
    add_drive_options(parser)
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the estimates: .csv or .parquet")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Observe, compare with the truth, write the estimates."""
    check_output("--output", args.output, (".csv", ".parquet"), [args.log, args.robot])
    task = make_task(args)
    answer = observe_task_on_floors(task, args) if args.floors else observe_task(task, args.filter)
    if args.output:
        from ohmward.logs import write_table

        write_table(estimate_table(task, answer.track) | floor_columns(answer), args.output)

    def page():
        from ohmward.cli.slip.report import make_page

        return make_page(task, args.filter, answer)

    figures = summary(task, args.filter, answer)
    text = describe(task, figures)
    return Outcome(figures | {"output": args.output, "report": args.report}, text, answer.notes, page)


def make_task(args: argparse.Namespace) -> SlipTask:
    """Read what the options name."""
    robot = make_robot(args.robot)
    terrain = make_terrain(args.terrain, robot)
    truths = truth_columns(args.truth)
    log = read_drive_log(args.log, robot, args, extra=None if truths else (), leave=truths)
    return SlipTask(robot, terrain, log, read_drive_truth(log, robot, args.truth) if truths else None)


def observe_task(task: SlipTask, name: str) -> SlipAnswer:
    """Run the observer called `name` over the drive."""
    from ohmward.traction.drive_checks import check_drive
    from ohmward.traction.speed_observer.make_observer import make_observer
    from ohmward.traction.speed_observer.track import observe

    faults = check_drive(task.robot, task.log)
    chosen = make_observer(task.robot, task.log, task.terrain, name)
    with progress() as report:
        told = (lambda done, total: report(name, done / total)) if report else None
        track = observe(chosen.observer, task.log, told)
    truth = [f"info: {task.truth.note}"] if task.truth else []
    return SlipAnswer(track, [*(str(note) for note in (*faults, *task.log.notes, *chosen.notes)), *truth])


def observe_task_on_floors(task: SlipTask, args: argparse.Namespace) -> SlipAnswer:
    """Slip as the floors of --floors explain the motor currents."""
    from ohmward.cli.slip.on_floors import observe_on_floors
    from ohmward.traction.drive_checks import check_drive

    faults = check_drive(task.robot, task.log)
    track, on_floors, told = observe_on_floors(task.robot, task.log, args.floors, args.filter)
    truth = [f"info: {task.truth.note}"] if task.truth else []
    return SlipAnswer(track, [*(str(note) for note in (*faults, *task.log.notes)), *told, *truth], on_floors)


def summary(task: SlipTask, name: str, answer: SlipAnswer) -> dict[str, Any]:
    """The object of --json."""
    import numpy as np

    from ohmward.traction.episodes import immobilised_episodes, slip_episodes
    from ohmward.traction.speed_observer.estimate import SlipFlag

    log, track, e = task.log, answer.track, answer.track.estimates
    unobserved = e.flags.astype(int) & SlipFlag.SPEED_UNOBSERVED != 0
    return {
        "command": "slip",
        "log": log.name,
        "robot": task.robot.name,
        "terrain": "learnt floors" if answer.on_floors else task.terrain.name,
        "filter": name,
        "steps": len(log),
        "seconds": track.seconds,
        "duration_s": log.duration_s,
        "distance_m": float(np.trapezoid(travel_speed_m_s(task, answer), log.time_s)),
        "speed_min_m_s": float(e.speed_m_s.min()),
        "speed_max_m_s": float(e.speed_m_s.max()),
        "speed_final_m_s": float(e.speed_m_s[-1]),
        "speed_std_final_m_s": float(e.speed_std_m_s[-1]),
        "slip_episodes": [episode._asdict() for episode in slip_episodes(track, driven_wheels(task.robot))],
        "immobilised_episodes": [episode._asdict() for episode in immobilised_episodes(track)],
        "unobserved_share": float(np.mean(unobserved)),
        **lasting_figures(e),
        "flags": track.counts(),
        **scores(task, track),
        "truth": task.truth.note if task.truth else None,
        "notes": answer.notes,
        **floor_figures(answer),
    }


def travel_speed_m_s(task: SlipTask, answer: SlipAnswer) -> np.ndarray:
    """(T,) in whatever direction."""
    import numpy as np

    from ohmward.traction.speed_observer.track import motion_of

    estimates = answer.track.estimates
    if answer.on_floors:
        return np.abs(estimates.speed_m_s)
    return np.linalg.norm(motion_of(task.robot, estimates)[:, :-1], axis=1)


def floor_figures(answer: SlipAnswer) -> dict[str, Any]:
    """What learnt floors say besides; None without them."""
    from ohmward.cli.slip import on_floors

    return on_floors.figures(answer.on_floors) if answer.on_floors else dict.fromkeys(on_floors.FIGURES)


def floor_columns(answer: SlipAnswer) -> dict[str, np.ndarray]:
    """The same along the drive, (T,) by name."""
    from ohmward.cli.slip import on_floors

    return on_floors.columns(answer.on_floors) if answer.on_floors else {}


def driven_wheels(robot: Robot) -> list[str]:
    """Names of the driven wheels."""
    return [place.name for place in robot.places[: robot.driven]]


def scores(task: SlipTask, track: SlipRun) -> dict[str, Any]:
    """Errors against the truth; every figure None without one."""
    from ohmward.traction.score import DriveScore, score_drive

    if task.truth is None:
        return dict.fromkeys(DriveScore._fields[:-1])
    return dict(list(score_drive(task.robot, track.estimates, task.truth.values)._asdict().items())[:-1])


def lasting_figures(e: SlipEstimate) -> dict[str, float | None]:
    """Friction, grade and radius at the end; None for what is assumed, which has no std."""
    final = {
        ("friction_ratio", "friction_std"): (e.friction_ratio[-1, 0], e.friction_std[-1, 0]),
        ("grade_rad", "grade_std_rad"): (e.grade_rad[-1], e.grade_std_rad[-1]),
        ("radius_ratio", "radius_std"): (e.radius_ratio[-1], e.radius_std[-1]),
    }
    return {
        name: float(value) if pair[1] > 0 else None
        for names, pair in final.items()
        for name, value in zip(names, pair, strict=True)
    }


def describe(task: SlipTask, figures: dict[str, Any]) -> str:
    """The same for people."""
    title = f"{figures['log']} with robot {figures['robot']!r}: {figures['filter']} on {figures['terrain']}"
    return wording.paragraphs(
        title,
        wording.fields(result(figures)),
        episodes(figures),
        wording.fields(errors(figures)) if task.truth else "",
        wording.bullets("Assumed", [note.removeprefix("info: ") for note in figures["notes"]]),
    )


def result(figures: dict[str, Any]) -> dict[str, str]:
    """The key figures of a run with their units, by name."""
    flags = ", ".join(f"{name.replace('_', ' ')} {count:,}" for name, count in figures["flags"].items())
    band_m_s = BAND_95 * figures["speed_std_final_m_s"]
    rows = {
        "drive": f"{figures['distance_m']:.3g} m in {wording.duration(figures['duration_s'])}, "
        f"{figures['speed_min_m_s']:z.2f} to {figures['speed_max_m_s']:z.2f} m/s",
        "speed at the end": f"{figures['speed_final_m_s']:.3g} ± {band_m_s:.2g} m/s (95 %)",
        "friction": _ratio_text(figures, "friction"),
        "grade": _grade_text(figures),
        "radius": _ratio_text(figures, "radius"),
        "speed unobserved": f"{wording.percent(figures['unobserved_share'], 1)} of the time",
        "flagged samples": flags or "none",
        "steps": f"{figures['steps']:,} in {figures['seconds']:.2g} s",
    }
    if figures["floor_share"]:
        from ohmward.cli.slip.on_floors import described

        rows |= described(figures)
    return {name: value for name, value in rows.items() if value}


def _ratio_text(figures: dict[str, Any], name: str) -> str:
    """A ratio to the value believed, with its 95 % band; empty where it was not estimated."""
    ratio, std = figures[f"{name}_ratio"], figures[f"{name}_std"]
    if ratio is None:
        return ""
    relative = BAND_95 * std * (ratio if name == "friction" else 1.0)
    of = "the ground's that was believed" if name == "friction" else "the robot's"
    return f"{wording.percent(ratio, 1)} ± {wording.percent(relative, 1)} of {of}"


def _grade_text(figures: dict[str, Any]) -> str:
    from math import degrees

    if figures["grade_rad"] is None:
        return ""
    return f"{degrees(figures['grade_rad']):.2f} ± {degrees(BAND_95 * figures['grade_std_rad']):.2f} degrees"


def episodes(figures: dict[str, Any]) -> str:
    """When which wheel slipped, the longest first where there are many."""
    found = figures["slip_episodes"]
    longest = sorted(found, key=lambda e: e["start_s"] - e["end_s"])[:_MOST_EPISODES]
    lines = [
        f"{e['wheel'].replace('_', ' ')} slips from {e['start_s']:.2f} s to {e['end_s']:.2f} s, at most by "
        f"{e['greatest_slip_m_s']:.2f} m/s ({wording.percent(e['greatest_slip'], 0)})"
        for e in sorted(longest, key=lambda e: e["start_s"])
    ]
    lines += [f"and {len(found) - len(longest)} shorter ones"] if len(found) > len(longest) else []
    lines += [f"immobilised from {e['start_s']:.2f} s to {e['end_s']:.2f} s" for e in figures["immobilised_episodes"]]
    return wording.bullets("Slip", lines or ["no wheel slips beyond what is allowed"])


def errors(figures: dict[str, Any]) -> dict[str, str]:
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


def estimate_table(task: SlipTask, track: SlipRun) -> dict[str, np.ndarray]:
    """Columns (T,) of the estimates file, by name."""
    e = track.estimates
    columns = {
        "time_s": track.time_s,
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
    return columns | ({"speed_truth_m_s": task.truth.values.speed_m_s} if task.truth else {})
