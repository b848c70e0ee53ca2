"""Many logs at once: in lanes, over processes or a cluster, resumable; see docs/fleet.md."""

from ohmward.fleet.dask import on_dask
from ohmward.fleet.job import Job, ReadOptions
from ohmward.fleet.lanes import estimate_logs
from ohmward.fleet.local import in_processes
from ohmward.fleet.run import Finished, run_fleet

__all__ = ["Finished", "Job", "ReadOptions", "estimate_logs", "in_processes", "on_dask", "run_fleet"]
