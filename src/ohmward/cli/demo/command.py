"""`ohmward demo`: a simulated robot and its day, worked through with the commands that a user would type."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ohmward.cli import wording
from ohmward.cli.outcome import Outcome, write_page
from ohmward.cli.parser import add_command, count
from ohmward.errors import InputError

if TYPE_CHECKING:
    from ohmward.simulate import RobotDay

#: A folder that holds this file was made by the demo and is safe to write into.
MARK = "made-by-ohmward-demo.txt"
CAPACITY_AH = 12.0
N_SERIES = {"lfp": 4, "lead-acid": 6}
#: The battery that drives home.
DRIVEN = "lfp"

_EXAMPLES = """\
  ohmward demo
  ohmward demo --out my-demo --seed 7
"""
_WELCOME = """\
A simulated robot. First its battery, once lithium iron phosphate and once lead-acid: a pulse test on the bench and a
working day, recorded with low-cost sensors. Then the drive home: dry floor, wet tiles, a ramp. The simulation knows the
truth; the commands below are what you would type for your own logs, and can be pasted."""


class DemoStep(NamedTuple):
    """A command line of the demo, without `ohmward`, and what to call it."""

    name: str
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"$ ohmward {shlex.join(self.words)}"


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "demo", "a simulated robot, from pulse test to the way home", _EXAMPLES)
    parser.add_argument("--out", default="ohmward-demo", metavar="FOLDER", help="default: %(default)s")
    parser.add_argument("--seed", type=count, default=1, metavar="N", help="another seed, another day (default 1)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Make the logs, then do what a user would do with them."""
    from ohmward.cli.demo.report import make_page
    from ohmward.simulate import make_robot_day

    folder = _prepare(Path(args.out))
    print(f"{_WELCOME}\n", flush=True)
    days = {chemistry: make_robot_day(chemistry, args.seed) for chemistry in N_SERIES}
    worked = {chemistry: work_through(chemistry, day, folder) for chemistry, day in days.items()}
    home = drive_home(folder, days[DRIVEN], worked[DRIVEN]["soc"].summary, args.seed)
    results = {chemistry: _summaries(outcomes) for chemistry, outcomes in worked.items()} | _summaries(home)
    page = make_page(worked[DRIVEN] | home, drive_figures(results))
    write_page(page, str(folder / "report.html"))
    return Outcome({"command": "demo", "folder": str(folder), **results}, describe(results, folder))


def work_through(chemistry: str, day: RobotDay, folder: Path) -> dict[str, Outcome]:
    """Write the logs of one battery and run every command on them; outcomes by the name of the step."""
    from ohmward.simulate import write_robot_day

    files = write_robot_day(day, folder)
    return _play(steps(chemistry, folder, files.pulse_test, files.mission))


def steps(chemistry: str, folder: Path, pulse_test: Path, mission: Path) -> list[DemoStep]:
    """What a user would type for the battery."""
    test, day, battery = str(pulse_test), str(mission), str(folder / f"{chemistry}.toml")

    def report(command: str) -> str:
        return str(folder / f"{chemistry}-{command}.html")

    identify = ("--capacity-ah", f"{CAPACITY_AH:g}", "--chemistry", chemistry, "--n-series", str(N_SERIES[chemistry]))
    truth = ("--battery", battery, "--truth", "soc_true")
    return [
        DemoStep("doctor", ("doctor", test, day, "--report", report("doctor"))),
        DemoStep("identify", ("identify", test, *identify, "-o", battery, "--report", report("identify"))),
        DemoStep("soc", ("soc", day, *truth, "--report", report("soc"))),
        DemoStep("compare", ("compare", day, *truth, "--report", report("compare"))),
    ]


def drive_home(folder: Path, day: RobotDay, evening: Mapping[str, Any], seed: int) -> dict[str, Outcome]:
    """Simulate the drive with what the day has left in the battery, and run every command on its log.

    evening: the summary of `soc` at the end of the day.
    """
    from ohmward.simulate.closed_loop import save_scenario
    from ohmward.simulate.robot_drive import WAY_HOME, robot_drive
    from ohmward.traction import save_robot

    left = float(day.mission.extra["soc_true"][-1])
    drive = robot_drive(DRIVEN, left, seed, "mujoco" if find_spec("mujoco") else "own")
    save_scenario(drive, folder / "drive.toml")
    save_robot(drive.model, folder / "robot.toml")
    (folder / "home.toml").write_text(WAY_HOME, encoding="utf-8")
    return _play(drive_steps(folder, evening["soc_final"], evening["soc_std_final"]))


def drive_steps(folder: Path, soc: float, soc_std: float) -> list[DemoStep]:
    """What a user would type for the drive; soc, soc_std: of the battery when it begins."""

    def path(name: str) -> str:
        return str(folder / name)

    log, robot, battery = path("drive.csv"), ("--robot", path("robot.toml")), ("--battery", path(f"{DRIVEN}.toml"))
    start = ("--current-sign", "charge", "--initial-soc", f"{soc:.3f}", "--initial-soc-std", f"{soc_std:.3f}")
    ahead = ("--terrain", "floor", "--plan", path("home.toml"), "-o", path("consumption.toml"))
    return [
        DemoStep("simulate", ("simulate", path("drive.toml"), "-o", log, "--report", path("drive-simulate.html"))),
        DemoStep("slip", ("slip", log, *robot, "--truth", "speed_true_m_s", "--report", path("drive-slip.html"))),
        DemoStep("mission", ("mission", log, *robot, *battery, *start, *ahead, "--report", path("drive-mission.html"))),
    ]


def describe(results: Mapping[str, Any], folder: Path) -> str:
    """The figures of battery and drive, and where to look."""
    header = ["simulated robot day", "SoC at the end", "RMSE", "largest error", "truth in 95 % band"]
    reports = sorted(str(path) for path in folder.glob("*-*.html"))
    return wording.paragraphs(
        wording.table(header, [_battery_row(chemistry, results[chemistry]["soc"]) for chemistry in N_SERIES]),
        f"the drive home\n{wording.fields(drive_figures(results))}",
        f"The whole story on one page, open it in a browser:\n  {folder / 'report.html'}",
        wording.bullets("A page for each command", reports),
    )


def drive_figures(results: Mapping[str, Any]) -> dict[str, str]:
    """What the commands found, by name."""
    evening, slip, mission = results[DRIVEN]["soc"], results["slip"], results["mission"]
    p10, p50, p90 = (metres / 1e3 for metres in mission["range_m"].values())
    return {
        "charge in the evening": f"{100 * evening['soc_final']:.0f} ± {196 * evening['soc_std_final']:.0f} %",
        "speed error": wording.quantity(slip["speed_rmse_m_s"], "mm/s RMS", 1e3),
        "wheel slip found": wording.percent(slip["detection_rate"], 1),
        "range left": f"{p50:.1f} km, {p10:.1f} to {p90:.1f} (P10-P90)",
        "gets home": f"{wording.percent(mission['probability'], 0)} sure, with the reserve left",
    }


def _battery_row(chemistry: str, soc: Mapping[str, Any]) -> list[str]:
    figures = [(soc["soc_final"], 1), (soc["soc_rmse"], 2), (soc["soc_max_error"], 2), (soc["coverage_95"], 1)]
    return [chemistry, *(wording.percent(value, digits) for value, digits in figures)]


def _summaries(outcomes: Mapping[str, Outcome]) -> dict[str, dict[str, Any]]:
    return {name: dict(outcome.summary) for name, outcome in outcomes.items()}


def _play(steps: Sequence[DemoStep]) -> dict[str, Outcome]:
    """Print each command line, run it exactly as the shell would, print the beginning of what it says."""
    from ohmward.cli import main

    outcomes = {}
    for step in steps:
        print(step, flush=True)
        outcomes[step.name] = main.run(main.build_parser().parse_args(step.words))
        beginning = "\n\n".join(outcomes[step.name].text.split("\n\n")[:2])
        print(f"{beginning}\n", flush=True)
    return outcomes


def _prepare(folder: Path) -> Path:
    """A folder for the demo: a new or empty one, or one from an earlier demo, whose files are made anew.

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
