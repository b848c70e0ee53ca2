"""`ohmward run --demo`: a simulated robot with nothing attached."""

from __future__ import annotations

from ohmward.battery.chemistries import generic_battery
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.part import Sink
from ohmward.onboard.process import Process
from ohmward.onboard.sinks.page import PageSink
from ohmward.onboard.sinks.terminal import TerminalSink
from ohmward.onboard.sources.simulation import SimulationSource, demonstration

#: Of the simulated robot: what its label says.
CHEMISTRY, CAPACITY_AH, N_SERIES = "lfp", 12.0, 4


def demo_process() -> Process:
    """A simulated robot that goes round and round; the battery file is made of its label alone."""
    battery = generic_battery(CHEMISTRY, CAPACITY_AH, N_SERIES, "demonstration")
    return Process(Estimation(battery, demonstration().model), [SimulationSource()], demo_sinks())


def demo_sinks() -> list[Sink]:
    """A line on the terminal, and the live page."""
    return [TerminalSink(), PageSink(robot="demonstration")]
