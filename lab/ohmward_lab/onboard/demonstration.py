"""`ohmward run --demo`: a simulated robot without hardware."""

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

#: Label of the simulated robot's battery.
CHEMISTRY, CAPACITY_AH, N_SERIES = "lfp", 12.0, 4

#: Long timeouts: a simulated robot harms nobody when a busy machine delays it.
_PATIENT = DriveLimits(estimate_timeout_s=0.3, operator_timeout_s=0.3)


def demo_process(driven: bool = False) -> Process:
    """A simulated robot that drives rounds; the battery file is made from its label alone.

    driven: True for a robot that stands and waits for an operator.
    """
    battery = generic_battery(CHEMISTRY, CAPACITY_AH, N_SERIES, "demonstration")
    sinks = demo_sinks()
    if driven:
        control = ControlSink(demonstration().robot, simulation=SimulatedOutput(), limits=_PATIENT)
        LOG.info("drive it in another terminal: ohmward drive")
        sinks.append(control)
    estimation = Estimation(battery, demonstration().model)
    return Process(estimation, *connect_simulated_drives([SimulationSource()], sinks))


def demo_sinks() -> list[Sink]:
    """A line on the terminal, and the live page; on another port where the usual one is taken."""
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
