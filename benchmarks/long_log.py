"""One log of up to ten million samples through `ohmward soc`, as a user would run it: wall time and peak memory.

    python benchmarks/long_log.py               every row
    python benchmarks/long_log.py 1000000       rows of logs of at most so many samples

Each command is a process of its own, started from a small one: the peak of a process counts the memory of the one that
forked it.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import save_battery
from ohmward.logs import Log, write_log
from ohmward_lab.simulate.voltage import simulate_voltage

SIZES = 100_000, 1_000_000, 10_000_000
CSV_SAMPLES = 1_000_000
BAR_S, BAR_GB = 15.0, 2.0
BATTERY = generic_battery("nmc", 12.0, 3)

#: Command -> wall time [s] and peak of the resident memory [kB], as JSON.
_LAUNCHER = """
import json, resource, subprocess, sys, time
began = time.perf_counter()
done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
seconds = time.perf_counter() - began
if done.returncode:
    sys.exit(done.stderr.decode())
print(json.dumps([seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss]))
"""


class Row(NamedTuple):
    """One line of the table: a value in seconds or GB, and what it should not exceed."""

    what: str
    how: str
    value: float
    unit: str
    bar: float | None = None


class Cost(NamedTuple):
    """Wall time [s] and peak of the resident memory [GB] of a process."""

    seconds: float
    peak_GB: float


class Case(NamedTuple):
    """Arguments of `ohmward soc`: the suffix of the log and the options, `OUT` being a folder."""

    how: str
    suffix: str
    options: tuple[str, ...]


CASES = (
    Case("from Parquet, --json", ".parquet", ("--json",)),
    Case("from Parquet, -o Parquet, --json", ".parquet", ("--json", "-o", "OUT/estimates.parquet")),
    Case("from Parquet, --report, --json", ".parquet", ("--json", "--report", "OUT/soc.html")),
    Case(
        "from Parquet, -o Parquet, --report, --json",
        ".parquet",
        ("--json", "-o", "OUT/estimates.parquet", "--report", "OUT/soc.html"),
    ),
)
CSV_CASES = (
    Case("from CSV, --json", ".csv", ("--json",)),
    Case("from CSV, -o CSV, --json", ".csv", ("--json", "-o", "OUT/estimates.csv")),
)


def rows(most: int = SIZES[-1]) -> Iterator[Row]:
    """Wall time and peak memory of every case, for logs of at most `most` samples."""
    for samples in (n for n in SIZES if n <= most):
        cases = CASES + (CSV_CASES if samples == CSV_SAMPLES else ())
        with tempfile.TemporaryDirectory() as folder:
            write_files(Path(folder), samples, {case.suffix for case in cases})
            for case in cases:
                cost = run_case(Path(folder), case)
                barred = samples == SIZES[-1]
                what = f"`ohmward soc`, {samples:,} samples"
                yield Row(what, case.how, cost.seconds, "s", BAR_S if barred else None)
                yield Row(what, case.how, cost.peak_GB, "GB", BAR_GB if barred else None)
            yield Row(
                f"`ohmward soc`, {samples:,} samples",
                "until a bar says what is done, on a terminal",
                first_sign_s(Path(folder)),
                "s",
            )


def write_files(folder: Path, samples: int, suffixes: set[str]) -> None:
    """battery.toml and log.*, written by another process, whose memory goes with it."""
    words = [sys.executable, __file__, "--write", str(folder), str(samples), *sorted(suffixes)]
    subprocess.run(words, check=True)


def run_case(folder: Path, case: Case) -> Cost:
    """The command as a user would type it; the smaller of two runs, the first of which may compile."""
    options = [word.replace("OUT", str(folder)) for word in case.options]
    words = ["soc", str(folder / f"log{case.suffix}"), "--battery", str(folder / "battery.toml"), *options]
    return min(cost_of([sys.executable, "-m", "ohmward", *words]) for _ in range(2))


def first_sign_s(folder: Path) -> float:
    """From the command to a bar on a terminal that says what is being done, the smaller of two."""
    words = [sys.executable, "-m", "ohmward", "soc", f"{folder}/log.parquet", "--battery", f"{folder}/battery.toml"]
    return min(_first_sign_s(words) for _ in range(2))


def _first_sign_s(words: list[str]) -> float:
    ours, theirs = os.openpty()
    began = time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=theirs, env=os.environ | {"TERM": "xterm"})
    os.close(theirs)  # lest reading never ends where the command does
    seen = b""
    with suppress(OSError):  # a short log is done before
        while not re.search(rb"reading|gsf", seen):
            seen += os.read(ours, 1000)
    seconds = time.perf_counter() - began
    process.terminate()
    process.wait()
    os.close(ours)
    return seconds


def cost_of(command: list[str]) -> Cost:
    """Time and memory of a command.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    launched = subprocess.run([sys.executable, "-S", "-c", _LAUNCHER, *command], check=True, stdout=subprocess.PIPE)
    seconds, peak_kB = json.loads(launched.stdout)
    return Cost(seconds, peak_kB * 1024 / 1e9)


def make_log(samples: int) -> Log:
    """Days of a robot at some 10 Hz: jitter, gaps, and values that are missing.

    Every load is given back in the next 20 s, so that the charge stays about where it was.
    """
    rng = np.random.default_rng(7)
    dt_s = 0.1 + 0.02 * rng.standard_normal(samples).clip(-3, 3)
    dt_s[rng.integers(1, samples, max(2, samples // 1_000_000))] = 90.0
    time_s = np.cumsum(dt_s)
    loads_A = 3.0 * rng.standard_normal(samples // 400 + 1)
    pieces_A = np.stack([loads_A, -loads_A], axis=1).ravel()
    current_A = np.repeat(pieces_A, 200)[:samples] * (np.sin(time_s / 700.0) > -0.7)
    whole = Log("log", time_s, current_A, np.full(samples, 11.0))
    voltage_V = simulate_voltage(BATTERY.thevenin, whole, 0.6).voltage_V
    current_A = current_A + 0.02 + 0.05 * rng.standard_normal(samples)
    voltage_V = voltage_V + 0.005 * rng.standard_normal(samples)
    temperature_degC = 25.0 + 5.0 * np.sin(time_s / 14_000.0)
    for values, share in ((current_A, 0.001), (voltage_V, 0.001), (temperature_degC, 0.9)):
        values[rng.random(samples) < share] = np.nan
    return Log("log", time_s, current_A, voltage_V, temperature_degC)


def _write(folder: Path, samples: int, suffixes: list[str]) -> None:
    save_battery(BATTERY, folder / "battery.toml")
    log = make_log(samples)
    for suffix in suffixes:
        write_log(log, folder / f"log{suffix}")


def _cells(row: Row) -> str:
    bar = "" if row.bar is None else f"{row.bar:g} {row.unit}"
    verdict = "" if row.bar is None else "met" if row.value <= row.bar else "**missed**"
    return f"| {row.what} | {row.how} | {row.value:.3g} {row.unit} | {bar} | {verdict} |"


def main(words: list[str]) -> None:
    if words[:1] == ["--write"]:
        _write(Path(words[1]), int(words[2]), words[3:])
        return
    for row in rows(*map(int, words)):
        print(_cells(row), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
