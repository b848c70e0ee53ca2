"""`ohmward fleet`: the robots of a fleet by their logs, or thousands of logs of one battery type, one row for each."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ohmward import fleet
from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.soc.registry import chosen_name, make_estimator
from ohmward.cli.battery_inputs import load_with_sensor, log_files, read_options
from ohmward.cli.outcome import Outcome, Report, progress, write_page
from ohmward.cli.wording import bullets, fields, paragraphs, table
from ohmward.errors import InputError
from ohmward.figures.health import battery_map, trend_figure
from ohmward.figures.numbers import percent
from ohmward.filters.consistency import BAND_95
from ohmward.fleet.robots import ALONE, FOLDER, NAME, SERIAL, with_band
from ohmward.fleet.run import Executor
from ohmward.logs.table import counted
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.report import Page

#: Largest numbers of logs of one kind and of robots that the text lists.
_MOST_LISTED, _MOST_RANKED = 10, 30
PAGE = "report.html"
ROBOTS = ["robot", "logs", "hours", "last log", "charge", "capacity", "change", "resistance", "alarms"]
_CAPTION = (
    "Charge at the end of the last log; capacity and resistance over those of the battery file; change of the capacity "
    "since the first log, in points; 95 % bands. A - stands where the logs do not show the capacity."
)
_WAYS = {SERIAL: "serial numbers", NAME: "the names of the files", FOLDER: "folders", ALONE: "themselves"}


def run(args: argparse.Namespace) -> Outcome:
    """Estimate all logs, or the rest of an interrupted run."""
    if args.where:
        raise InputError("--where picks rows of one file; a fleet's files hold one recording each")
    battery, notes = load_with_sensor(args.battery, args)
    name = chosen_name(args.filter.lower())
    make_estimator(name, battery)  # refused now, not in every process
    folder = Path(args.output)
    written = folder.resolve()  # of the logs only their folders: a link may lead to itself
    paths = [path for path in log_files(args.logs) if not Path(path).parent.resolve().is_relative_to(written)]
    if args.dask:  # workers have other working folders
        folder = folder.absolute()
        paths = [str(Path(path).absolute()) for path in paths]
    text = BATTERY_FILE.dump(battery) if notes else Path(args.battery).read_text(encoding="utf-8")
    estimates = str(folder / "estimates") if args.estimates else None
    job = fleet.Job(text, name, args.initial_soc, args.initial_soc_std, read_options(args), estimates)
    robots = fleet.robots_of(paths, args.by, job.reading.hints)
    here = partial(fleet.in_processes, processes=args.processes or os.cpu_count() or 1)
    executor = partial(fleet.on_dask, address=args.dask) if args.dask else here
    notes += _grouping_notes(robots, args.by)
    if robots.by != ALONE:
        of_none = {"": list(robots.unreadable)} if robots.unreadable else {}
        of_robots = fleet.RobotJob(job, robots.logs | of_none, str(folder / "batteries"))
        return _of_robots(args.battery, of_robots, folder, executor, notes)
    with progress() as report:
        finished = fleet.run_fleet(paths, job, folder, executor, _progress_of(report))
    figures = summary(args.battery, finished.rows, finished) | {"filter": name, "notes": notes}
    return Outcome(figures, describe(figures), notes, status=status(figures))


def _grouping_notes(robots: fleet.Robots, by: str | None) -> list[str]:
    """The way by which the robots were identified, and the logs for which it was another; by: as asked for."""
    if robots.by == ALONE:
        why = "" if by == ALONE else ": no column, serial number, name or folder gives a robot several logs; see --by"
        return [f"info: each log alone{why}"]
    notes = [f"info: robots identified by {_way(robots.by)}: {len(robots.logs)}"]
    for way, texts in robots.otherwise.items():
        level = "warning" if way in (ALONE, NAME, FOLDER) else "info"
        logs = ", ".join(_cut([Path(text).name for text in texts], "see the column `robot`"))
        notes.append(f"{level}: {counted(len(texts), 'log')} by {_way(way)}: {logs}")
    return notes


def _way(by: str) -> str:
    return _WAYS.get(by, f"the column {by!r}")


def _of_robots(battery: str, job: fleet.RobotJob, folder: Path, executor: Executor, notes: list[str]) -> Outcome:
    """Estimate the logs of each robot one after the other, and write the page of the fleet."""
    Path(str(job.batteries)).mkdir(parents=True, exist_ok=True)
    with progress() as report:
        finished = fleet.run_fleet(job.items, job, folder, executor, _progress_of(report, "robots"), batch=1)
    states = fleet.robot_states(finished.rows)
    logs = [log for row in finished.rows for log in row.get("logs", [row])]
    page = folder / PAGE
    figures = summary(battery, logs, finished) | {
        "filter": job.settings.filter,
        "robots": [state._asdict() for state in states],
        "report": str(page),
        "notes": notes,
    }
    write_page(make_page(figures, states, logs), page, notes)
    alarms = any(state.alarms for state in states)
    return Outcome(figures, describe(figures, states), notes, status=max(status(figures), int(alarms)))


def _progress_of(report: Report | None, what: str = "logs") -> Callable[[int, int], None] | None:
    """Progress callback (done, total) that counts the logs or robots; None where progress is not shown."""
    if report is None:
        return None
    return lambda done, total: report(f"{done:,} of {total:,} {what}", done / total)


def status(figures: dict[str, Any]) -> int:
    """Exit status: 2 if every log was refused, else 1 if the battery file does not fit one, as in `ohmward soc`."""
    if figures["failed"] == figures["logs"]:
        return 2
    return int(bool(figures["misfits"]))


def summary(battery: str, logs: list[dict[str, Any]], finished: fleet.Finished) -> dict[str, Any]:
    """The object of --json.

    battery: path of the battery file.
    logs: a row for each log.
    """
    good = [row for row in logs if not row["error"]]
    bad = [row for row in logs if row["error"]]
    fitting = [row for row in good if not row.get("misfit")]
    return {
        "command": "fleet",
        "battery": battery,
        "logs": len(logs),
        "failed": len(bad),
        "resumed": finished.resumed,
        "samples": sum(row["samples"] for row in good),
        "hours": sum(row["duration_s"] for row in good) / SECONDS_PER_HOUR,
        "soc_final_min": _most(min, fitting, "soc_final"),
        "soh_capacity_min": _most(min, fitting, "soh_capacity"),
        "resistance_ratio_max": _most(max, fitting, "resistance_ratio"),
        "summary": str(finished.summary),
        "errors": [{"path": row["path"], "error": row["error"]} for row in bad],
        "misfits": [{"path": row["path"], "misfit": row["misfit"]} for row in good if row.get("misfit")],
    }


def _most(function: Callable, rows: list[dict[str, Any]], name: str) -> float | None:
    """Smallest or largest value of a column among the rows that have one."""
    return function((row[name] for row in rows if row[name] is not None), default=None)


def describe(figures: dict[str, Any], states: Sequence[fleet.RobotRecord] = ()) -> str:
    """Text for people; states: of the robots, the worst first."""
    rows = {
        "logs": f"{figures['logs']:,}, {figures['resumed']:,} {'robots' if states else 'of them'} done before",
        "hours": f"{figures['hours']:,.1f} in {figures['samples']:,} samples",
        "least charge at the end": percent(figures["soc_final_min"], 1),
        "least capacity": f"{percent(figures['soh_capacity_min'], 1)} of the battery file's",
        "largest resistance": f"{percent(figures['resistance_ratio_max'], 1)} of the battery file's",
        "could not be used": f"{figures['failed']:,}",
        "battery file does not fit": f"{len(figures['misfits']):,}",
        "written": ", ".join(path for path in (figures.get("report"), figures["summary"]) if path),
    }
    alarms = [f"{state.robot}: {alarm}" for state in states for alarm in state.alarms]
    return paragraphs(
        fields(rows),
        table(ROBOTS, [robot_row(state) for state in states[:_MOST_RANKED]]) if states else "",
        bullets("Alarms", _cut(alarms, "see the page"), "warning"),
        bullets("Not used", _first(figures["errors"], "error")),
        "" if states else bullets("Not to be trusted", _first(figures["misfits"], "misfit")),
    )


def robot_row(state: fleet.RobotRecord) -> list[str]:
    """A robot in the table of `ROBOTS`."""
    change, std = state.soh_change, state.soh_change_std
    return [
        state.robot,
        f"{state.logs}" + (f" (+ {state.refused} refused)" if state.refused else ""),
        f"{state.hours:,.1f}",
        (state.last or "-")[:10],
        with_band(state.soc, state.soc_std),
        with_band(state.soh_capacity, state.soh_capacity_std),
        "-" if change is None or std is None else f"{100 * change:+z.1f} ± {100 * BAND_95 * std:.1f}",
        with_band(state.resistance_ratio, state.resistance_ratio_std),
        str(len(state.alarms)),
    ]


def make_page(figures: dict[str, Any], states: Sequence[fleet.RobotRecord], logs: Sequence[dict[str, Any]]) -> Page:
    """The fleet on one page: alarms by name, ranking, map and trend of its batteries, logs that were refused."""
    page = Page(f"{len(states)} robots", "Charge, capacity and resistance of each, the worst first")
    page = page.numbers({
        "Robots": str(len(states)),
        "With alarms": str(sum(bool(state.alarms) for state in states)),
        "Logs": f"{figures['logs']:,}",
        "Refused": f"{figures['failed']:,}",
        "Hours": f"{figures['hours']:,.0f}",
    })  # fmt: skip
    alarms = [[state.robot, "; ".join(state.alarms)] for state in states if state.alarms]
    for robot, text in alarms[:_MOST_LISTED]:
        page = page.callout("warning", f"{robot}: {text}")
    page = page.heading("Robots").table(ROBOTS, [robot_row(state) for state in states], _CAPTION)
    if alarms[_MOST_LISTED:]:
        page = page.table(["Robot", "Alarms"], alarms[_MOST_LISTED:], "The other robots with alarms")
    known = {s.robot: (s.soh_capacity, s.resistance_ratio) for s in states}
    points = {robot: (c, r) for robot, (c, r) in known.items() if c is not None and r is not None}
    if points:
        page = page.heading("Batteries").plot(battery_map(points, [s.robot for s in states if s.alarms]))
    names = [state.robot for state in states]
    for field, title in (("soh_capacity", "Capacity"), ("resistance_ratio", "Resistance")):
        if trends := _trends(logs, names, field):
            page = page.plot(trend_figure(f"{title} over time, of the first of the ranking", f"{title} [%]", trends))
    refused = [[log.get("robot") or "-", log["path"], log["error"]] for log in logs if log["error"]]
    if refused:
        page = page.heading("Logs that were refused").table(["Robot", "Log", "Why"], refused)
    return page


def _trends(
    logs: Sequence[dict[str, Any]], robots: Sequence[str], field: str
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times and values of a quantity over the logs of each robot that has several with a date."""
    found = {}
    for robot in robots:
        used = [log for log in logs if not log["error"] and log["robot"] == robot and log["begins"]]
        known = [log for log in used if log[field] is not None]
        if len(known) > 1:
            times = [datetime.fromisoformat(log["begins"]).timestamp() for log in known]
            found[robot] = np.array(times), np.array([log[field] for log in known])
    return found


def _first(rows: list[dict[str, Any]], column: str) -> list[str]:
    """The logs with something in a column, at most `_MOST_LISTED` of them."""
    return _cut([f"{row['path']}: {row[column]}" for row in rows], f"see the column `{column}`")


def _cut(lines: list[str], where: str) -> list[str]:
    """At most `_MOST_LISTED` lines, and where the others are."""
    more = len(lines) - _MOST_LISTED
    return lines[:_MOST_LISTED] + ([f"and {more} more, {where}"] if more > 0 else [])
