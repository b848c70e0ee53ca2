"""`ohmward run --demo`: a simulated robot with nothing attached."""

from __future__ import annotations

import socket
from dataclasses import replace

from ohmward.battery.chemistries import generic_battery
from ohmward.onboard.control.operator_command import DriveLimits
from ohmward.onboard.control.outputs import SimulatedOutput
from ohmward.onboard.control.simulated_drives import connect_simulated_drives
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.part import LOG, Sink
from ohmward.onboard.process import Process
from ohmward.onboard.sinks.control import ControlSink
from ohmward.onboard.sinks.page import PageSink
from ohmward.onboard.sinks.terminal import TerminalSink
from ohmward.onboard.sources.simulation import SimulationSource
from ohmward_lab.onboard.simulated_robot import demonstration

#: Of the simulated robot: what its label says.
CHEMISTRY, CAPACITY_AH, N_SERIES = "lfp", 12.0, 4

#: A simulated robot harms nobody where a busy machine holds it up.
_PATIENT = DriveLimits(estimate_timeout_s=0.3, operator_timeout_s=0.3)


def demo_process(driven: bool = False) -> Process:
    """A simulated robot that goes round and round; the battery file is made of its label alone.

    driven: it stands and waits for an operator.
    """
    battery = generic_battery(CHEMISTRY, CAPACITY_AH, N_SERIES, "demonstration")
    sinks = demo_sinks()
    if driven:
        control = ControlSink(demonstration().robot, simulation=SimulatedOutput(), limits=_PATIENT)
        LOG.info("drive it in another terminal: ohmward drive")
        sinks.append(control)
    return Process(Estimation(battery, demonstration().model), *connect_simulated_drives([SimulationSource()], sinks))


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
