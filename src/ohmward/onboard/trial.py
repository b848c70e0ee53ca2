"""Trial of a setup before its estimates are trusted: every signal seen, units plausible, signs agree.

Its sources are run and its sinks opened, but nothing is estimated or sent.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

from ohmward.battery.file import load_battery
from ohmward.onboard.assembly import sinks_of
from ohmward.onboard.control.simulated_drives import connect_simulated_drives
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Message
from ohmward.onboard.part import Sink, is_live, keep_running
from ohmward.onboard.robot_setup import Setup
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.onboard.wiring_check import Recorder, SignalRecord, check_wiring
from ohmward.traction.robot.packaged import load_robot

#: Longest wait for the first message of a simulated robot, which is compiled first.
COMPILED_S = 60.0


class Trial(NamedTuple):
    """Result of a trial."""

    signals: Mapping[str, SignalRecord]  #: as they came
    findings: list[Diagnostic]  #: about parts and signals, errors first

    @property
    def passed(self) -> bool:
        """True if nothing is wrong; what could not be checked counts as right."""
        return all(finding.level < Level.ERROR for finding in self.findings)


def try_setup(setup: Setup, seconds: float) -> Trial:
    """Listen for `seconds`, and check the received signals.

    Raises:
        InputError: a file cannot be read.
    """
    battery = load_battery(Path(setup.battery)) if setup.battery else None
    robot = load_robot(setup.robot) if setup.robot else None
    recorder = Recorder()
    found_live = asyncio.run(_listen(setup, recorder, seconds))
    promised = {source.name: tuple(getattr(source, "signals", ())) for source in setup.source}
    found = recorder.signals()
    checked = check_wiring(found, promised, battery, robot, setup.counts_per_turn is not None)
    return Trial(found, sorted([*found_live.values(), *checked], key=lambda finding: -finding.level))


async def _open(sink: Sink) -> None:
    """Open what a sink sends to, until cancelled; it gets no state.

    One that sends or writes even without a state (commands, its status, rows that waited, an empty file) has a method
    `try_out`, which opens the destination without leaving anything, and returns or holds it open.
    """
    if try_out := getattr(sink, "try_out", None):
        await try_out()
        await asyncio.Event().wait()
    await sink.run(Feed())


async def _listen(setup: Setup, recorder: Recorder, seconds: float) -> dict[str, Diagnostic]:
    """Run sources and sinks for `seconds`, or until every source has ended; return the worst condition of each."""
    found_live: dict[str, Diagnostic] = {}

    def report(diagnostic: Diagnostic) -> None:
        worst = found_live.get(diagnostic.name)
        if worst is None or diagnostic.level >= worst.level:
            found_live[diagnostic.name] = diagnostic

    begun = asyncio.Event()

    def put(message: Message) -> None:
        begun.set()
        recorder.put(message.source, message.received_s, message.values, message.publisher)

    simulated, driving = connect_simulated_drives(setup.source, sinks_of(setup))
    sinks = [asyncio.create_task(keep_running(f"sink {sink.name}", partial(_open, sink), report)) for sink in driving]
    sources = [
        asyncio.create_task(keep_running(f"source {source.name}", partial(source.run, put), report))
        for source in simulated
    ]
    if not all(map(is_live, simulated)):
        first = asyncio.create_task(begun.wait())
        await asyncio.wait([first, *sources], timeout=COMPILED_S, return_when=asyncio.FIRST_COMPLETED)
        first.cancel()
    if sources:
        await asyncio.wait(sources, timeout=seconds)
    for task in (*sources, *sinks):
        task.cancel()
    await asyncio.gather(*sources, *sinks, return_exceptions=True)
    return found_live
