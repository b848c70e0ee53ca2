"""`ohmward demo`: a simulated robot day, worked through with the commands that a user would type."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.cli import wording
from ohmward.cli.outcome import Outcome
from ohmward.cli.parser import add_command, count
from ohmward.errors import InputError

#: A folder that holds this file was made by the demo and is safe to write into.
MARK = "made-by-ohmward-demo.txt"
CAPACITY_AH = 12.0
N_SERIES = {"lfp": 4, "lead-acid": 6}

_EXAMPLES = """\
  ohmward demo
  ohmward demo --out my-demo --seed 7
"""
_WELCOME = """\
A simulated robot and its battery, once lithium iron phosphate and once lead-acid: a pulse test on the bench, then a
working day, both recorded with low-cost sensors. The simulation knows the true state of charge; the commands below are
what you would type for your own logs, and can be pasted."""


class Step(NamedTuple):
    """A command line of the demo, without `ohmward`."""

    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"$ ohmward {shlex.join(self.words)}"


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "demo", "a simulated robot day, from pulse test to report", _EXAMPLES)
    parser.add_argument("--out", default="ohmward-demo", metavar="FOLDER", help="default: %(default)s")
    parser.add_argument("--seed", type=count, default=1, metavar="N", help="another seed, another day (default 1)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Make the logs, then do what a user would do with them."""
    folder = _prepare(Path(args.out))
    print(f"{_WELCOME}\n", flush=True)
    results = {chemistry: work_through(chemistry, folder, args.seed) for chemistry in N_SERIES}
    return Outcome({"command": "demo", "folder": str(folder), **results}, describe(results, folder))


def work_through(chemistry: str, folder: Path, seed: int) -> dict[str, Any]:
    """Simulate one battery and run every command on its files; returns the summaries of `soc` and `compare`."""
    from ohmward.simulate import make_robot_day, write_robot_day

    files = write_robot_day(make_robot_day(chemistry, seed), folder)
    summaries = {}
    for step in steps(chemistry, folder, files.pulse_test, files.mission):
        summaries[step.words[0]] = _play(step)
    return summaries


def steps(chemistry: str, folder: Path, pulse_test: Path, mission: Path) -> list[Step]:
    """What a user would type."""
    test, day, battery = str(pulse_test), str(mission), str(folder / f"{chemistry}.toml")

    def report(command: str) -> str:
        return str(folder / f"{chemistry}-{command}.html")

    identify = ("--capacity-ah", f"{CAPACITY_AH:g}", "--chemistry", chemistry, "--n-series", str(N_SERIES[chemistry]))
    truth = ("--battery", battery, "--truth", "soc_true")
    return [
        Step(("doctor", test, day, "--report", report("doctor"))),
        Step(("identify", test, *identify, "-o", battery, "--report", report("identify"))),
        Step(("soc", day, *truth, "--report", report("soc"))),
        Step(("compare", day, *truth, "--report", report("compare"))),
    ]


def describe(results: dict[str, dict[str, Any]], folder: Path) -> str:
    """The result table, and where to look."""
    rows = [
        [
            chemistry,
            wording.percent(soc["soc_final"], 1),
            wording.percent(soc["soc_rmse"]),
            wording.percent(soc["soc_max_error"]),
            wording.percent(soc["coverage_95"], 1),
        ]
        for chemistry, soc in ((name, summaries["soc"]) for name, summaries in results.items())
    ]
    header = ["simulated robot day", "SoC at the end", "RMSE", "largest error", "truth in 95 % band"]
    reports = sorted(str(path) for path in folder.glob("*.html"))
    return wording.paragraphs(wording.table(header, rows), wording.bullets("Reports, open them in a browser", reports))


def _play(step: Step) -> dict[str, Any]:
    """Print a command line, run it exactly as the shell would, print the beginning of what it says."""
    from ohmward.cli import main

    print(step, flush=True)
    outcome = main.run(main.build_parser().parse_args(step.words))
    beginning = "\n\n".join(outcome.text.split("\n\n")[:2])
    print(f"{beginning}\n", flush=True)
    return dict(outcome.summary)


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
