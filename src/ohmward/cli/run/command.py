"""`ohmward run`: the process on the robot."""

from __future__ import annotations

import argparse
import asyncio

from ohmward.battery.file import load_battery
from ohmward.cli.outcome import Outcome
from ohmward.energy.consumption_file import load_consumption
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.process import Process
from ohmward.onboard.setup import SETUP_FILE, Setup
from ohmward.traction.robot.file import load_robot


def run(args: argparse.Namespace) -> Outcome:
    """Run until the sources end or the user stops it."""
    setup = SETUP_FILE.load(args.setup)
    process = Process(estimation_of(setup), setup.source, setup.sink)
    asyncio.run(process.run())
    return Outcome({}, "")


def estimation_of(setup: Setup) -> Estimation:
    """The estimators of a setup.

    Raises:
        InputError: a file that cannot be read.
    """
    return Estimation(
        load_battery(setup.battery) if setup.battery else None,
        load_robot(setup.robot) if setup.robot else None,
        load_consumption(setup.consumption) if setup.consumption else None,
        setup.delay_s,
        setup.counts_per_turn,
    )
