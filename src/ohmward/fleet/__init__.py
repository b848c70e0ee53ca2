"""Many logs at once: in lanes, over processes, resumable; see docs/fleet.md."""

from ohmward.fleet.job import Job, Reading
from ohmward.fleet.lanes import estimate_logs
from ohmward.fleet.local import Finished, run_fleet

__all__ = ["Finished", "Job", "Reading", "estimate_logs", "run_fleet"]
