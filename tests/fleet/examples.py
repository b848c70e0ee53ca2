"""A small fleet: five logs, the last of them no log."""

from pathlib import Path

import numpy as np

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import BATTERY_FILE
from ohmward.fleet import Job, ReadOptions
from ohmward.logs import Log, write_log

SIGNED = ReadOptions(current_sign="charge")


def job() -> Job:
    return Job(BATTERY_FILE.dump(generic_battery("nmc", 2.0)), "coulomb", reading=SIGNED)


def write_fleet(folder: Path) -> list[str]:
    """Paths of the logs."""
    rng = np.random.default_rng(0)
    for k in range(4):
        current = -1.0 + rng.normal(0.0, 0.5, 200 + 50 * k)
        voltage = 3.9 + 0.05 * current - 0.0002 * np.arange(current.size)
        write_log(Log(f"robot{k}", np.arange(current.size) * 1.0, current, voltage), folder / f"robot{k}.csv")
    (folder / "robot4.csv").write_text("this is no log\n")
    return [str(folder / f"robot{k}.csv") for k in range(5)]
