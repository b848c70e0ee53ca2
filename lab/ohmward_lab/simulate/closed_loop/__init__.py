"""Observer, controller, robot and battery in closed loop on terrains; see docs/simulate.md."""

from ohmward_lab.simulate.closed_loop.control import Command, Control
from ohmward_lab.simulate.closed_loop.loop import run
from ohmward_lab.simulate.closed_loop.observing import Observing
from ohmward_lab.simulate.closed_loop.run import ClosedLoopRun, columns, drive_log
from ohmward_lab.simulate.closed_loop.scenario import Scenario, find_scenario, packaged, parse_scenario, save_scenario
from ohmward_lab.simulate.closed_loop.sensing import ExternalSpeed, Sensing
from ohmward_lab.simulate.closed_loop.supply import Pack
from ohmward_lab.simulate.ground import Grade, Patch

__all__ = [
    "ClosedLoopRun",
    "Command",
    "Control",
    "ExternalSpeed",
    "Grade",
    "Observing",
    "Pack",
    "Patch",
    "Scenario",
    "Sensing",
    "columns",
    "drive_log",
    "find_scenario",
    "packaged",
    "parse_scenario",
    "run",
    "save_scenario",
]
