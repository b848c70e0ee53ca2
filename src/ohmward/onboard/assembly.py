"""The process of a setup, put together: files read, estimators made, state of before taken up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from ohmward.errors import InputError
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.process import Process
from ohmward.onboard.quantities import QUANTITIES
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.onboard.setup import Setup
from ohmward.onboard.state_folder import StateFolder
from ohmward.traction.robot.file import load_robot
from ohmward.traction.robot.robot import Robot


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
    for fault in wiring_faults(setup, estimation.robot):
        if setup.strict:
            raise InputError(fault)
        process.tell(Diagnostic(f"wiring of {fault.partition(':')[0]}", Level.ERROR, fault))
    return process


def wiring_faults(setup: Setup, robot: Robot | None) -> Iterator[str]:
    """Sentences about signals in the setup that cannot be used, each with the fix."""
    first: dict[str, str] = {}
    for source in setup.source:
        for signal in getattr(source, "signals", ()):
            name, _, part = signal.partition(".")
            if signal in first:
                yield f"{signal}: {first[signal]} and {source.name} both send it; leave it out of one of them"
            first.setdefault(signal, source.name)
            if name == "wheel_counts" and setup.counts_per_turn is None:
                yield f"{signal}: counts need counts_per_turn = ... in the setup"
            places = [place.name for place in robot.places] if robot else []
            if robot and QUANTITIES[name].each in ("wheel", "motor") and not is_place(part, places):
                yield f"{signal}: the robot has no such {QUANTITIES[name].each}; it has {', '.join(places)}"


def is_place(part: str, places: Sequence[str]) -> bool:
    """True for the name of a wheel or its number from 0."""
    return part in places or (part.isdecimal() and int(part) < len(places))


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
