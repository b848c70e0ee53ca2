"""`ohmward export`: an estimator as a C99 library for a microcontroller, or as one file of Python."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ohmward.atomic import replacing
from ohmward.battery.battery import Battery
from ohmward.battery.soc.registry import DEFAULT
from ohmward.battery.soc.score import soc_reference
from ohmward.cli.battery_inputs import given_start, load_with_sensor, log_files, read_battery_log, read_options
from ohmward.cli.options import DEFAULT_TERRAIN
from ohmward.cli.outcome import Outcome, check_output, progress
from ohmward.cli.wording import fields, paragraphs, table
from ohmward.embedded import blind
from ohmward.embedded.battery import battery_export, curve_error_of_pack_V
from ohmward.embedded.c_library import Export, check_fits, library, size, write_library
from ohmward.embedded.export import SMALL, symbol_of
from ohmward.embedded.python_file import python_file
from ohmward.embedded.traction import robot_export
from ohmward.errors import InputError
from ohmward.logs.log import ReadOptions
from ohmward.toml_file import noun_of
from ohmward.traction import load_robot
from ohmward.traction.robot.packaged import PACKAGED

#: Options of what a robot, a file of Python, and a blind benchmark do not have.
_OF_BATTERIES = (
    "--initial-soc", "--initial-soc-std", "--sample-time", "--style", "--curve-error",
    "--sensor-offset", "--sensor-gain", "--voltage-gain",
)  # fmt: skip
_OF_C = ("--style", "--flash-kb", "--ram-kb")
_PRESCRIBED = ("--name", "--sample-time", "--curve-error", *_OF_C)
_OF_SCORED_LOGS = ("--truth", "--truth-start")


def run(args: argparse.Namespace) -> Outcome:
    """Write the library, the file, or the archive for a blind benchmark."""
    # errors in all other files are reported by the reader of battery files
    is_robot = args.file.lower() in PACKAGED or noun_of(args.file) == "robot"
    _refuse_what_has_no_effect(args, is_robot)
    if args.benchmark:
        return _submission(args)
    if args.language == "python":
        return _python_file(args)
    return _c_library(args, is_robot)


def _refuse_what_has_no_effect(args: argparse.Namespace, is_robot: bool) -> None:
    python = args.language == "python"
    if args.terrain and not is_robot:
        raise InputError(f"--terrain is the ground under a robot, and {args.file} is a battery; leave it out")
    if is_robot and (python or args.benchmark):
        option = "--for" if args.benchmark else "--language python"
        raise InputError(f"{args.file} is a robot; Python is written for batteries, leave out {option}")
    if is_robot:
        _refuse(args, _OF_BATTERIES, f"{args.file} is a robot, not a battery")
    if args.benchmark:
        _refuse(args, _PRESCRIBED, "--for mcmaster is one file of Python for a battery, a row a second, named Model")
        check_output("-o", args.output, (".zip",))
    elif args.score:
        raise InputError("--score rehearses a blind benchmark; name it with --for mcmaster")
    elif python:
        _refuse(args, _OF_C, "--language python writes no C")
    if not args.score:
        _refuse(args, _OF_SCORED_LOGS, "no logs are scored without --score")
    elif not args.truth:
        raise InputError("--score needs the true state of charge: name its column with --truth, as `ohmward soc` does")


def _refuse(args: argparse.Namespace, options: Sequence[str], why: str) -> None:
    """Raise InputError if any of these options is given."""
    values = {option: getattr(args, option[2:].replace("-", "_")) for option in options}
    given = [option for option, value in values.items() if value not in (None, "lines")]
    if given:
        raise InputError(f"{why}; leave out {' and '.join(given)}")


def _python_file(args: argparse.Namespace) -> Outcome:
    """Write one file of Python for a battery."""
    name, filter_name = args.name or blind.MODULE, args.filter or DEFAULT
    export, notes = _of_battery(args, filter_name, name)
    source = python_file(export, args.sample_time, **given_start(args))
    (path,) = write_library({f"{name}.py": source}, Path(args.output))
    text = paragraphs(
        f"{path}: {export.title}",
        f"use it, with rows of current [A] (> 0 charges), voltage [V], temperature [degC]:\n"
        f"  from {name} import Model\n  soc, z = Model(X)",
    )
    figures = _figures(args, export, filter_name, notes) | {"operations": len(export.step.nodes), "files": [path.name]}
    return Outcome(figures, text, notes)


def _c_library(args: argparse.Namespace, is_robot: bool) -> Outcome:
    """Write a C99 library for a battery or a robot."""
    name, filter_name = args.name or symbol_of(args.output), args.filter or SMALL
    notes: list[str] = []
    if is_robot:
        export = robot_export(load_robot(args.file), filter_name, name, args.terrain or DEFAULT_TERRAIN)
    else:
        export, notes = _of_battery(args, filter_name, name)
    check_fits(export, *(1024 * k if k else None for k in (args.flash_kb, args.ram_kb)))
    paths = write_library(library(export), Path(args.output))
    needed = size(export)
    figures = _figures(args, export, filter_name, notes) | {
        "style": args.style,
        "curve_error_mV": args.curve_error,
        "operations": needed.operations,
        "flash_bytes_estimated": needed.flash,
        "state_bytes": needed.state,
        "vectors": len(export.samples),
        "files": [path.name for path in paths],
    }
    rows = {
        "operations": f"{needed.operations:,}",
        "flash": f"about {needed.flash / 1024:.1f} KB on a Cortex-M with -Os",
        "state": f"{needed.state} bytes",
        "files": ", ".join(path.name for path in paths),
    }
    text = paragraphs(
        f"{args.output}: {export.title}",
        fields(rows),
        f"compile and check it here:\n  make -C {shlex.quote(str(args.output))} test",
    )
    return Outcome(figures, text, notes)


def _of_battery(args: argparse.Namespace, filter_name: str, name: str) -> tuple[Export, list[str]]:
    """The estimator of the battery's charge, and notes about its file."""
    battery, notes = load_with_sensor(args.file, args)
    export = battery_export(
        battery,
        filter_name,
        name,
        **given_start(args),
        sample_time_s=args.sample_time,
        style=args.style,
        curve_error_V=curve_error_of_pack_V(battery, args.curve_error),
    )
    return export, notes


def _figures(args: argparse.Namespace, export: Export, filter_name: str, notes: list[str]) -> dict[str, Any]:
    """The figures of the command that C and Python share."""
    return {
        "command": "export",
        "language": args.language,
        "title": export.title,
        "filter": filter_name,
        "name": export.name,
        "sample_time_s": args.sample_time,
        "output": args.output,
        "notes": notes,
    }


def _submission(args: argparse.Namespace) -> Outcome:
    """Write the archive that a blind benchmark takes, and rehearse it where logs are given."""
    reading = read_options(args) if args.score else None
    battery, notes = load_with_sensor(args.file, args)
    filter_name, output = args.filter or SMALL, args.output
    export = battery_export(battery, filter_name, blind.MODULE, sample_time_s=blind.INTERVAL_S)
    text = python_file(export, blind.INTERVAL_S, **given_start(args))
    with replacing(Path(output)) as archive:
        archive.write_bytes(blind.submission(text))
    scores = list(_rehearsed(text, battery, reading, args)) if reading else []
    figures = {
        "command": "export",
        "benchmark": "mcmaster",
        "title": export.title,
        "filter": filter_name,
        "output": output,
        "operations": len(export.step.nodes),
        "rmse": {case: blind.case_rmse(scores, case) for case in blind.WEIGHTS} if scores else None,
        "rmse_weighted": blind.weighted_rmse(scores) if scores else None,
        "runs": [score._asdict() for score in scores],
        "notes": notes,
    }
    parts = (f"{output}: {export.title}", _score_table(scores) if scores else "")
    return Outcome(figures, paragraphs(*parts), notes)


def _rehearsed(
    text: str, battery: Battery, reading: ReadOptions, args: argparse.Namespace
) -> Iterator[blind.BlindScore]:
    """Scores of the module with this source text on every log."""
    model, words = blind.model_of(text), log_files(args.score)
    with progress() as report:
        for k, word in enumerate(words):
            if report:
                report(word, k / len(words))
            log = read_battery_log(word, reading, battery=battery)
            truth = soc_reference(log, args.truth, battery.capacity_Ah, args.truth_start)
            yield from blind.rehearse(model, blind.blind_run(log, truth.soc), battery.capacity_Ah)


def _score_table(scores: Sequence[blind.BlindScore]) -> str:
    """Cases with their weights and errors, the worst run of each, and the score."""
    rows = []
    for case, weight in blind.WEIGHTS.items():
        if own := [score for score in scores if score.case == case]:
            worst = max(own, key=lambda score: score.rmse)
            error = blind.case_rmse(scores, case)
            rows.append([case, f"{weight:.1f}", f"{len(own)}", f"{error:.2%}", f"{worst.rmse:.2%} ({worst.run})"])
    rows.append(["weighted", "", "", f"{blind.weighted_rmse(scores):.2%}", ""])
    return table(["rehearsal", "weight", "runs", "RMSE", "worst"], rows)
