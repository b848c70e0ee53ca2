"""`ohmward run --demo`: a simulated robot with nothing attached."""

from __future__ import annotations

import socket
from dataclasses import replace

from ohmward.battery.chemistries import generic_battery
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.part import LOG, Sink
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
    """A line on the terminal, and the live page; on another port where something else has its own."""
    usual = PageSink(robot="demonstration")
    if _is_free(usual.host, usual.port):
        return [TerminalSink(), usual]
    LOG.info("port %d is taken: the page takes another one", usual.port)
    return [TerminalSink(), replace(usual, port=0)]


def _is_free(host: str, port: int) -> bool:
    try:
        socket.create_server((host, port)).close()
    except OSError:
        return False
    return True
