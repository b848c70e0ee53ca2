"""`ohmward run`: the process on the robot."""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys

from ohmward.checks import require_positive
from ohmward.cli.outcome import Outcome
from ohmward.cli.run.demonstration import demo_process
from ohmward.errors import InputError
from ohmward.onboard.assembly import assemble
from ohmward.onboard.process import Process
from ohmward.onboard.setup import SETUP_FILE


def run(args: argparse.Namespace) -> Outcome:
    """Run until the sources end or the user stops it."""
    if args.seconds is not None:
        require_positive("--seconds", args.seconds)
    if args.demo and args.setup:
        raise InputError(f"--demo needs no setup; leave {args.setup!r} out, or run it without --demo")
    if not args.demo and not args.setup:
        raise InputError("give a SETUP.toml (`ohmward run --example > robot.toml` writes one), or --demo")
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="ohmward: %(message)s")
    process = demo_process() if args.demo else assemble(SETUP_FILE.load(args.setup))
    process.estimation.compile()
    asyncio.run(_run(process, args.seconds))
    return Outcome({}, "")


async def _run(process: Process, seconds: float | None) -> None:
    process.stop_on_signals()
    if seconds is not None:
        asyncio.get_running_loop().call_later(seconds, process.stop)
    await process.run()
