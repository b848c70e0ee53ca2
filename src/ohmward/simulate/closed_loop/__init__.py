"""Observer, controller, robot and battery in closed loop on terrains; see docs/simulate.md."""

from ohmward.simulate.closed_loop.control import Command, Control
from ohmward.simulate.closed_loop.ground import Grade, Patch
from ohmward.simulate.closed_loop.loop import run
from ohmward.simulate.closed_loop.observing import Observing
from ohmward.simulate.closed_loop.run import ClosedLoopRun, columns, drive_log
from ohmward.simulate.closed_loop.scenario import Scenario
from ohmward.simulate.closed_loop.scenario_file import find_scenario, packaged, parse_scenario, save_scenario
from ohmward.simulate.closed_loop.sensing import ExternalSpeed, Sensing
from ohmward.simulate.closed_loop.supply import Pack

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
