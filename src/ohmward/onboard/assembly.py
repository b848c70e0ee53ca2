"""The process of a setup, put together: files read, estimators made, state of before taken up."""

from __future__ import annotations

from pathlib import Path

from ohmward.onboard.estimation import Estimation
from ohmward.onboard.process import Process
from ohmward.onboard.setup import Setup
from ohmward.onboard.state_folder import StateFolder
from ohmward.traction.robot.file import load_robot


def assemble(setup: Setup) -> Process:
    """The process of a setup, ready to run.

    Raises:
        InputError: a file that cannot be read.
        OhmwardError: the folder of its state cannot be used.
    """
    folder = StateFolder(Path(setup.state), Path(setup.consumption) if setup.consumption else None, setup.learn)
    estimation = estimation_of(setup, folder)
    folder.begin(estimation)
    process = Process(estimation, setup.source, setup.sink, folder.clock, setup.strict)
    process.companions.append(("snapshots", folder.writer(estimation, process.now_s)))
    return process


def estimation_of(setup: Setup, folder: StateFolder) -> Estimation:
    """The estimators of a setup, without the state of before.

    Raises:
        InputError: a file that cannot be read.
    """
    table, days = folder.consumption()
    return Estimation(
        folder.battery(setup.battery) if setup.battery else None,
        load_robot(setup.robot) if setup.robot else None,
        table,
        setup.delay_s,
        setup.counts_per_turn,
        days,
    )
