"""`ohmward export`: an estimator as a C99 library for a microcontroller, or as one file of Python."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from ohmward.atomic import replacing
from ohmward.battery.battery import Battery
from ohmward.battery.soc.registry import DEFAULT
from ohmward.battery.soc.score import soc_reference
from ohmward.cli.battery_inputs import given_start, load_with_sensor, log_files, read_battery_log, read_options
from ohmward.cli.options import DEFAULT_TERRAIN
from ohmward.cli.outcome import Outcome, check_output, progress
from ohmward.cli.wording import fields, paragraphs, table
from ohmward.embedded import blind
from ohmward.embedded.battery import WITH_LOOPS, battery_export, curve_error_of_pack_V
from ohmward.embedded.c_library import check_fits, library, size, write_library
from ohmward.embedded.export import SMALL, symbol_of
from ohmward.embedded.python_file import python_file
from ohmward.embedded.traction import robot_export
from ohmward.errors import InputError
from ohmward.logs.log import ReadOptions
from ohmward.toml_file import noun_of
from ohmward.traction import load_robot
from ohmward.traction.robot.packaged import PACKAGED

#: Module of a Python file unless another is named: blind benchmarks import `Model` from `Model.py`.
_MODULE = "Model"


def run(args: argparse.Namespace) -> Outcome:
    """Write the library, the file, or the archive for a blind benchmark."""
    # errors in all other files are reported by the reader of battery files
    is_robot = args.file.lower() in PACKAGED or noun_of(args.file) == "robot"
    notes: list[str] = []
    if args.terrain and not is_robot:
        raise InputError(f"--terrain is the ground under a robot, and {args.file} is a battery; leave it out")
    if (args.truth or args.truth_start is not None) and not args.score:
        raise InputError("--truth and --truth-start are of the logs that --score names; leave them out")
    if args.benchmark:
        only_c = (args.name, args.sample_time, args.curve_error, args.flash_kb, args.ram_kb)
        if any(only_c) or args.style != "lines" or is_robot:
            raise InputError(
                "--for mcmaster is one file of Python for a battery, a row a second, named Model: leave out --name, "
                "--sample-time, --style, --curve-error, --flash-kb and --ram-kb"
            )
        check_output("-o", args.output, (".zip",))
        if args.score and not args.truth:
            raise InputError(
                "--score needs the true state of charge: name its column with --truth, as `ohmward soc` does"
            )
        return _submission(args)
    if args.score:
        raise InputError("--score rehearses a blind benchmark; name it with --for mcmaster")
    python = args.language == "python"
    if python and (args.style != "lines" or args.flash_kb or args.ram_kb):
        raise InputError("--style, --flash-kb and --ram-kb are for C; leave them out with --language python")
    if python and is_robot:
        raise InputError(f"{args.file} is a robot; Python is written for batteries, leave out --language python")
    start = given_start(args)
    name, filter_name = args.name or (_MODULE if python else symbol_of(args.output)), args.filter
    filter_name = filter_name or (DEFAULT if python else SMALL)
    if is_robot:
        if any(given is not None for given in (args.sensor_offset, args.sensor_gain, args.voltage_gain)):
            raise InputError(
                "these sensors are those of a battery; leave out --sensor-offset, --sensor-gain and --voltage-gain"
            )
        if args.curve_error:
            raise InputError("a curve error is for the open-circuit voltage of a battery; leave out --curve-error")
        if args.style != "lines":
            raise InputError(f"{filter_name} of a robot has no loops, only {', '.join(WITH_LOOPS)} of a battery have")
        export = robot_export(load_robot(args.file), filter_name, name, args.terrain or DEFAULT_TERRAIN)
    else:
        battery, notes = load_with_sensor(args.file, args)
        export = battery_export(
            battery,
            filter_name,
            name,
            **start,
            sample_time_s=args.sample_time,
            style=args.style,
            curve_error_V=curve_error_of_pack_V(battery, args.curve_error),
        )
    figures = {
        "command": "export",
        "language": args.language,
        "title": export.title,
        "filter": filter_name,
        "name": name,
        "sample_time_s": args.sample_time,
        "output": args.output,
        "notes": notes,
    }
    if python:
        (path,) = write_library({f"{name}.py": python_file(export, args.sample_time, **start)}, Path(args.output))
        text = paragraphs(
            f"{path}: {export.title}",
            f"use it, with rows of current [A] (> 0 charges), voltage [V], temperature [degC]:\n"
            f"  from {name} import Model\n  soc, z = Model(X)",
        )
        return Outcome(figures | {"operations": len(export.step.nodes), "files": [path.name]}, text, notes)
    check_fits(export, *(1024 * k if k else None for k in (args.flash_kb, args.ram_kb)))
    paths = write_library(library(export), Path(args.output))
    needed = size(export)
    figures |= {
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
