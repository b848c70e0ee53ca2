"""Many logs at once: in lanes, over processes or a cluster, resumable; see docs/fleet.md."""

from ohmward.fleet.dask import on_dask
from ohmward.fleet.job import Job, RobotJob
from ohmward.fleet.lanes import estimate_logs
from ohmward.fleet.robots import RobotRecord, Robots, robot_states, robots_of
from ohmward.fleet.run import Finished, in_processes, run_fleet
from ohmward.logs.log import ReadOptions

__all__ = [
    "Finished",
    "Job",
    "ReadOptions",
    "RobotJob",
    "RobotRecord",
    "Robots",
    "estimate_logs",
    "in_processes",
    "on_dask",
    "robot_states",
    "robots_of",
    "run_fleet",
]
