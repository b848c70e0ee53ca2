"""`ohmward run`: the process on the robot."""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import sys
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from ohmward.checks import require_positive
from ohmward.cli.outcome import Outcome
from ohmward.cli.wording import bullets, paragraphs
from ohmward.errors import InputError, OhmwardError
from ohmward.lab import lab
from ohmward.onboard.assembly import assemble
from ohmward.onboard.notify import notifying, service_manager
from ohmward.onboard.part import LOG
from ohmward.onboard.process import Process
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.robot_state import Level
from ohmward.onboard.trial import Trial, try_setup

#: Exit status after an error that is in the log.
REFUSED = 2

#: Time for which `--check` listens by default [s].
CHECK_S = 10.0

#: Time between two looks whether the setup was edited [s].
EDITED_S = 5.0


def run(args: argparse.Namespace) -> Outcome:
    """Run until the sources end or the user stops it; or check a setup, or print an example."""
    _check_arguments(args)
    if args.example:
        return Outcome({}, files("ohmward.cli").joinpath("example.toml").read_text(encoding="utf-8").rstrip())
    if args.check:
        return _check(args.setup, args.seconds or CHECK_S)
    begin_log(args.log_format)
    try:
        if args.demo:
            process = lab("onboard.demonstration").demo_process(args.drive)
        else:
            process = assemble(SETUP_FILE.load(args.setup))
            if (setup := Path(args.setup)).is_file():  # no pipe
                process.companions.append(("setup", partial(watch_setup, setup)))
        process.estimation.compile()
        asyncio.run(_run(process, args.seconds))
    except OhmwardError as error:
        if args.log_format == "text":
            raise
        LOG.error("%s", error)
        return Outcome({}, "", status=REFUSED)
    return Outcome({}, "")


def _check(setup: str, seconds: float) -> Outcome:
    """Findings about a setup, printed instead of the log."""
    logging.disable(logging.ERROR)
    try:
        trial = try_setup(SETUP_FILE.load(setup), seconds)
    finally:
        logging.disable(logging.NOTSET)
    return Outcome(summary(trial), describe(trial, setup), status=0 if trial.passed else 1)


def _check_arguments(args: argparse.Namespace) -> None:
    """Raise InputError for arguments that do not go together."""
    if args.seconds is not None:
        require_positive("--seconds", args.seconds)
    alone = "--demo" if args.demo else "--example" if args.example else ""
    if alone and args.setup:
        raise InputError(f"{alone} needs no setup; leave {args.setup!r} out, or run it without {alone}")
    if not alone and not args.setup:
        raise InputError("give a SETUP.toml (`ohmward run --example > robot.toml` writes one), or --demo")
    if args.drive and not args.demo:
        raise InputError('--drive goes with --demo; a robot of your own has a [[sink]] of kind = "control"')
    if args.json and not args.check:
        raise InputError('--json goes with --check; estimates as JSON come from a [[sink]] of kind = "json-lines"')


async def _run(process: Process, seconds: float | None) -> None:
    process.stop_on_signals()
    if manager := service_manager():
        process.companions.append(notifying(process, manager))
    if seconds is not None:
        asyncio.get_running_loop().call_later(seconds, process.stop)
    await process.run()


async def watch_setup(setup: Path) -> None:
    """Log each change of the file, which is read at the start alone."""
    read = setup.read_bytes()
    while True:
        await asyncio.sleep(EDITED_S)
        with suppress(OSError):  # an editor may replace it in two steps
            if (now := setup.read_bytes()) != read:
                read = now
                LOG.warning("%s has changed; it is read at the start: restart ohmward to use it", setup)


_TITLES = {Level.ERROR: "Wrong, with the fix", Level.WARN: "Not known yet", Level.OK: "In order"}


def summary(trial: Trial) -> dict[str, Any]:
    """The object of --json."""
    return {
        "command": "run --check",
        "passed": trial.passed,
        "findings": [{"subject": f.name, "level": f.level.name, "text": f.message} for f in trial.findings],
        "signals": {
            signal: {"sources": r.sources, "rate_hz": r.rate_hz, "median": r.median, "largest": r.largest}
            for signal, r in trial.signals.items()
        },
    }


def describe(trial: Trial, setup: str) -> str:
    """The findings by severity, and the verdict."""
    parts = []
    for level, title in _TITLES.items():
        parts.append(bullets(title, [f"{f.name}: {f.message}" for f in trial.findings if f.level == level]))
    wrong = sum(f.level == Level.ERROR for f in trial.findings)
    things = "thing is" if wrong == 1 else "things are"
    verdict = f"{setup}: {wrong} {things} wrong" if wrong else f"{setup}: nothing is wrong; ohmward run {setup}"
    return paragraphs(*parts, verdict)


class JsonFormatter(logging.Formatter):
    """Records as JSON objects: time (ISO 8601, UTC), level, logger, message and, of an unexpected error, traceback."""

    def format(self, record: logging.LogRecord) -> str:
        """One line."""
        found = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            found["traceback"] = self.formatException(record.exc_info)
        return json.dumps(found, ensure_ascii=False)


def begin_log(log_format: str) -> None:
    """Send the log, and warnings with it, to standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonFormatter() if log_format == "json" else logging.Formatter("ohmward: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    if log_format == "json":
        logging.captureWarnings(True)
