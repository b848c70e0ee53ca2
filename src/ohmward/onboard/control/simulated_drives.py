"""Drives of the simulated robot in the same process, to try slip control with nothing attached."""

from __future__ import annotations

import math
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ohmward.errors import InputError
from ohmward.onboard.control.loop import Send
from ohmward.onboard.control.outputs import SimulatedOutput
from ohmward.onboard.part import Sink, Source, sharing
from ohmward.onboard.sinks.control import ControlSink
from ohmward.onboard.sources.simulation import SimulationSource

#: Time without a new command after which a drive stops by itself [s].
COMMAND_TIMEOUT_S = 0.05


class SimulatedDrives:
    """Drives that hold the last torques while they are enabled and new commands keep coming."""

    def __init__(self) -> None:
        self._last: tuple[float, Mapping[str, float]] = -math.inf, {}

    def take(self, numbers: Mapping[str, float]) -> None:
        """Take a command; from any thread."""
        self._last = time.monotonic(), dict(numbers)

    def torque_Nm(self, wheels: Sequence[str]) -> np.ndarray:
        """Torque (driven,) of each wheel now; 0 unless enabled."""
        taken_s, numbers = self._last
        if time.monotonic() - taken_s > COMMAND_TIMEOUT_S or not numbers.get("enable"):
            return np.zeros(len(wheels))
        return np.array([numbers[f"torque_Nm.{wheel}"] for wheel in wheels])


@dataclass(frozen=True)
class ConnectedOutput(SimulatedOutput):
    """The connection to the drives of a simulated robot."""

    drives: SimulatedDrives = field(default_factory=SimulatedDrives)  #: drives that take the commands

    @asynccontextmanager
    async def opened(self, names: list[str]) -> AsyncIterator[Send]:
        """The function that sends; names: names of the available numbers."""
        yield self.drives.take


def connect_simulated_drives(
    sources: Sequence[Source], sinks: Sequence[Sink]
) -> tuple[tuple[Source, ...], tuple[Sink, ...]]:
    """Sources and sinks of a setup, with each simulated robot driven by the control sink that names it.

    Raises:
        InputError: there is no such simulated robot, it runs at another rate than real time, or two controls name it.
    """
    driven: dict[str, Source] = {}
    connected: list[Sink] = []
    for sink in sinks:
        if isinstance(sink, ControlSink) and sink.simulation:
            name = sink.simulation.source
            if name in driven:
                raise InputError(f"sink {sink.name}: {name!r} is driven by another sink already; leave one of them out")
            simulation, drives = _simulation(sources, sink.name, name), SimulatedDrives()
            driven[name] = sharing(simulation, partial(simulation.drive, torque_Nm=drives.torque_Nm))
            sink = replace(sink, simulation=ConnectedOutput(name, drives))
        connected.append(sink)
    return tuple(driven.get(source.name, source) for source in sources), tuple(connected)


def _simulation(sources: Sequence[Source], sink: str, name: str) -> SimulationSource:
    """The source of that name, which must be a simulated robot in real time."""
    there = {source.name: source for source in sources if isinstance(source, SimulationSource)}
    if name not in there:
        known = f"there are: {', '.join(there)}" if there else 'add a [[source]] of kind = "simulation"'
        raise InputError(f"sink {sink}: simulation.source = {name!r} is no simulated robot; {known}")
    if there[name].rate != 1.0:
        raise InputError(f"sink {sink}: {name!r} has rate = {there[name].rate:g}; an operator drives at rate = 1.0")
    return there[name]
