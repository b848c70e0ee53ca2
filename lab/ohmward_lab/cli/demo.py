"""`ohmward demo`: a simulated robot and its day, worked through with the commands that a user would type."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ohmward.cli.main import parse, run_of
from ohmward.cli.outcome import Outcome, carry_out, write_page
from ohmward.cli.wording import bullets, fields, paragraphs, table
from ohmward.errors import InputError
from ohmward.figures.numbers import percent, quantity
from ohmward.filters.consistency import BAND_95
from ohmward.report import Page
from ohmward.traction import save_robot
from ohmward_lab.simulate import RobotDay, make_robot_day, write_robot_day
from ohmward_lab.simulate.closed_loop import save_scenario
from ohmward_lab.simulate.robot_drive import WAY_HOME, robot_drive

#: A folder that holds this file was made by the demo and is safe to write into.
MARK = "made-by-ohmward-demo.txt"
CAPACITY_AH = 12.0
N_SERIES = {"lfp": 4, "lead-acid": 6}
#: Chemistry of the battery on the drive home.
DRIVEN = "lfp"

_WELCOME = """\
A simulated robot. First its battery, once lithium iron phosphate and once lead-acid: a pulse test on the bench and a
working day, recorded with low-cost sensors. Then the drive home: dry floor, wet tiles, a ramp. The simulation knows the
truth; the commands below are what you would type for your own logs, and can be pasted."""


def run(args: argparse.Namespace) -> Outcome:
    """Make the logs, then do what a user would do with them."""
    folder = _prepare(Path(args.out))
    print(f"{_WELCOME}\n", flush=True)
    days = {chemistry: make_robot_day(chemistry, args.seed) for chemistry in N_SERIES}
    worked = {}
    for chemistry, day in days.items():
        files = write_robot_day(day, folder)
        worked[chemistry] = _play(steps(chemistry, folder, str(files.pulse_test), str(files.mission)))
    home = drive_home(folder, days[DRIVEN], worked[DRIVEN]["soc"].summary, args.seed)
    of_days = {
        chemistry: {name: dict(outcome.summary) for name, outcome in outcomes.items()}
        for chemistry, outcomes in worked.items()
    }
    results = of_days | {name: dict(outcome.summary) for name, outcome in home.items()}
    write_page(make_page(worked[DRIVEN] | home, drive_figures(results)), folder / "report.html", ())
    return Outcome({"command": "demo", "folder": str(folder), **results}, describe(results, folder))


def steps(chemistry: str, folder: Path, test: str, day: str) -> list[tuple[str, ...]]:
    """Command lines of a user with this battery; test, day: its logs."""
    battery = str(folder / f"{chemistry}.toml")

    def report(command: str) -> str:
        return str(folder / f"{chemistry}-{command}.html")

    identify = ("--capacity-ah", f"{CAPACITY_AH:g}", "--chemistry", chemistry, "--n-series", str(N_SERIES[chemistry]))
    truth = ("--battery", battery, "--truth", "soc_true")
    return [
        ("doctor", test, day, "--report", report("doctor")),
        ("identify", test, *identify, "-o", battery, "--report", report("identify")),
        ("soc", day, *truth, "--report", report("soc")),
        ("compare", day, *truth, "--report", report("compare")),
    ]


def drive_home(folder: Path, day: RobotDay, evening: Mapping[str, Any], seed: int) -> dict[str, Outcome]:
    """Simulate the drive from the charge left at the end of the day, and run every command on its log.

    evening: the summary of `soc` at the end of the day.
    """
    left = float(day.mission.extra["soc_true"][-1])
    drive = robot_drive(DRIVEN, left, seed, "mujoco" if find_spec("mujoco") else "own")
    save_scenario(drive, folder / "drive.toml")
    save_robot(drive.model, folder / "robot.toml")
    (folder / "home.toml").write_text(WAY_HOME, encoding="utf-8")
    return _play(drive_steps(folder, evening["soc_final"], evening["soc_std_final"]))


def drive_steps(folder: Path, soc: float, soc_std: float) -> list[tuple[str, ...]]:
    """Command lines of a user with this drive.

    soc, soc_std: estimate and its standard deviation at the start of the drive.
    """

    def path(name: str) -> str:
        return str(folder / name)

    log = path("drive.csv")
    robot = ("--robot", path("robot.toml"))
    battery = ("--battery", path(f"{DRIVEN}.toml"))
    start = ("--current-sign", "charge", "--initial-soc", f"{soc:.3f}", "--initial-soc-std", f"{soc_std:.3f}")
    ahead = ("--terrain", "floor", "--plan", path("home.toml"), "-o", path("consumption.toml"))
    return [
        ("simulate", path("drive.toml"), "-o", log, "--report", path("drive-simulate.html")),
        ("slip", log, *robot, "--truth", "speed_true_m_s", "--report", path("drive-slip.html")),
        ("mission", log, *robot, *battery, *start, *ahead, "--report", path("drive-mission.html")),
    ]


def describe(results: Mapping[str, Any], folder: Path) -> str:
    """The figures of battery and drive, and where to look."""
    header = ["simulated robot day", "SoC at the end", "RMSE", "largest error", "truth in 95 % band"]
    columns = {"soc_final": 1, "soc_rmse": 2, "soc_max_error": 2, "coverage_95": 1}
    rows = [
        [chemistry, *(percent(results[chemistry]["soc"][key], digits) for key, digits in columns.items())]
        for chemistry in N_SERIES
    ]
    reports = sorted(str(path) for path in folder.glob("*-*.html"))
    return paragraphs(
        table(header, rows),
        f"the drive home\n{fields(drive_figures(results))}",
        f"The whole story on one page, open it in a browser:\n  {folder / 'report.html'}",
        bullets("A page for each command", reports),
    )


def drive_figures(results: Mapping[str, Any]) -> dict[str, str]:
    """Figures that the commands found, by name."""
    evening = results[DRIVEN]["soc"]
    slip = results["slip"]
    mission = results["mission"]
    p10, p50, p90 = (metres / 1e3 for metres in mission["range_m"])
    return {
        "charge in the evening": f"{100 * evening['soc_final']:.0f} ± {100 * BAND_95 * evening['soc_std_final']:.0f} %",
        "speed error": quantity(slip["speed_rmse_m_s"], "mm/s RMS", 1e3),
        "slip error": quantity(slip["slip_rmse"], "points RMS of the slip ratio", 100.0),
        "range left": f"{p50:.1f} km, {p10:.1f} to {p90:.1f} (P10-P90)",
        "gets home": f"{percent(mission['probability'], 0)} sure, with the reserve left",
    }


def _play(steps: Sequence[tuple[str, ...]]) -> dict[str, Outcome]:
    """Print each command line, run it as the shell would, print the start of its text; return outcomes by command."""
    outcomes = {}
    for words in steps:
        print(f"$ ohmward {shlex.join(words)}", flush=True)
        outcome = outcomes[words[0]] = carry_out(run_of(words[0]), parse(words))
        beginning = "\n\n".join(outcome.text.split("\n\n")[:2])
        print(f"{beginning}\n", flush=True)
    return outcomes


def _prepare(folder: Path) -> Path:
    """A folder for the demo: a new or empty one, or one from an earlier demo, whose files are overwritten.

    Raises:
        InputError: the folder holds something else, or cannot be made.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: this is a file; name a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()) and not (folder / MARK).is_file():
            raise InputError(f"--out {folder}: the folder is not empty and not from a demo; name another one")
        (folder / MARK).write_text("`ohmward demo` made these files and may make them anew.\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"--out {folder}: cannot be made ({error.strerror}); name another folder") from error
    return folder


_SUBTITLE = "Everything here is simulated: a robot with a 12 V battery, its day, and its drive home"

#: Steps of the demo in the order of the story: the title of each, and how many sections of its own report are shown.
CHAPTERS = {
    "identify": ("The battery, from its pulse test", 1),
    "soc": ("Charge over the day", 0),
    "simulate": ("The drive home as it was", 0),
    "slip": ("Speed and slip as the robot knows them", 0),
    "mission": ("Where the energy went, and whether it gets home", 3),
}


def make_page(outcomes: Mapping[str, Outcome], figures: Mapping[str, str]) -> Page:
    """Page with a chapter for each step; outcomes: by name of the step.  figures: shown at the top."""
    page = Page("A robot, from its battery test to the way home", _SUBTITLE)
    page = page.numbers({label.capitalize(): value for label, value in figures.items()})
    for name, (title, sections) in CHAPTERS.items():
        if make := outcomes[name].page:
            page = with_chapter(page, title, make(), sections)
    return page


def with_chapter(page: Page, title: str, other: Page, sections: int = 0) -> Page:
    """The page with the beginning of another one: blocks before its first heading, then its first sections."""
    page = page.heading(title)
    titles = iter(other.headings[:sections])
    blocks = []
    for block in other.body:
        if not block.startswith("<h2"):
            blocks.append(block)
        elif section := next(titles, None):
            blocks.append(f"<h3>{escape(section)}</h3>")
        else:
            break
    return replace(page, body=(*page.body, *blocks))
