"""Time of 10,000 logs of 36,000 samples from Parquet to a row each: `python benchmarks/fleet_speed.py`."""

from __future__ import annotations

import os
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import BATTERY_FILE
from ohmward.fleet import Job, in_processes, run_fleet
from ohmward.logs import Log, write_log
from ohmward_lab.simulate.voltage import simulate_voltage

LOGS, STEPS, FLEET = 2048, 36_000, 10_000
BAR_S = 120.0
PROCESSES = os.cpu_count() or 1


def write_logs(folder: Path, logs: int = LOGS) -> list[str]:
    """Ten hours at 1 Hz each; eight different ones, many times."""
    model, rng = generic_battery("nmc", 2.0).thevenin, np.random.default_rng(0)
    different = []
    for k in range(8):
        current = np.repeat(rng.normal(-0.1, 0.5, STEPS // 20), 20) + 0.01 * rng.standard_normal(STEPS)
        truth = Log(f"robot {k}", np.arange(STEPS, dtype=float), current, np.full(STEPS, 3.7))
        voltage = simulate_voltage(model, truth, 0.9).voltage_V + 0.002 * rng.standard_normal(STEPS)
        different.append(Log(truth.name, truth.time_s, current, voltage))
    paths = [folder / f"robot{k:04d}.parquet" for k in range(logs)]
    for k, path in enumerate(paths):
        if k < len(different):
            write_log(different[k], path)
        else:
            os.link(paths[k % len(different)], path)  # the same content under another name
    return list(map(str, paths))


def seconds_for_each(logs: int = LOGS) -> float:
    """Wall time that a log takes when so many run one after the other on all processors [s]."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths, job = write_logs(folder, logs), Job(BATTERY_FILE.dump(generic_battery("nmc", 2.0)))
        began = time.perf_counter()
        run_fleet(paths, job, folder / "out", partial(in_processes, processes=PROCESSES))
        return (time.perf_counter() - began) / logs


def main() -> None:
    seconds = seconds_for_each()
    print(
        f"{PROCESSES} at once: {1e3 * seconds:.1f} ms a log; {FLEET:,} take {FLEET * seconds:.0f} s, bar {BAR_S:.0f} s"
    )


if __name__ == "__main__":
    main()
