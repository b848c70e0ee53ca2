"""The process on the robot under load, as a user runs it: latency, losses, processor and memory.

Another process sends samples of wheels and motors at 1 kHz and of the battery at 100 Hz over a socket, as JSON lines
with its own time stamps. `on_board.py` makes rows of what this measures.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import resource
import socket
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward import generic_battery, save_battery
from ohmward.onboard.assembly import assemble
from ohmward.onboard.feed import Feed
from ohmward.onboard.process import Process
from ohmward.onboard.robot_setup import SETUP_FILE
from on_board_day import resident_MB

WHEELS_HZ, BATTERY_HZ = 1000, 100
#: Of the start that is not counted: the first samples of a stream.
SETTLE_S = 2.0
#: The sender holds the connection so long after its last sample.
END_S = 4.0


class Load(NamedTuple):
    """Measurements of the process under load.

    sent, estimated: samples of wheels and motors, and estimates of the drive.
    p50_s, p99_s: from a sample's own time stamp to its estimate at a sink.
    cpu: share of one core.
    memory_MB: (M,) resident, along the run.
    """

    sent: int
    estimated: int
    p50_s: float
    p99_s: float
    cpu: float
    memory_MB: np.ndarray


class Histogram:
    """Latencies in steps of 10 us up to a second, after the first `SETTLE_S`; a list of them would grow."""

    def __init__(self):
        self.number, self.counts = 0, np.zeros(100_001, dtype=int)

    def add(self, latency_s: float) -> None:
        self.number += 1
        if self.number > SETTLE_S * WHEELS_HZ:
            self.counts[min(max(round(1e5 * latency_s), 0), 100_000)] += 1

    def quantile(self, share: float) -> float:
        """Latency [s] that so many share."""
        return float(np.searchsorted(np.cumsum(self.counts), share * self.counts.sum())) * 1e-5


class ObservedSource:
    """A source and the offset that the process finds between the sender's clock and its own, which are the same."""

    def __init__(self, source):
        self.source, self.name, self.offset_s = source, source.name, math.inf

    async def run(self, put):
        def observe(message):
            self.offset_s = min(self.offset_s, message.received_s - message.stamp_s)
            put(message)

        await self.source.run(observe)


@dataclass
class Meter:
    """A sink that measures the age of every estimate of the drive."""

    source: ObservedSource
    name: str = "meter"
    interval_s: float = 0.0

    async def run(self, feed):
        self.latencies, self.memory_MB, self.cpu_s, last_s = Histogram(), [], [], math.nan
        while states := await feed.batch(1):
            (state,) = states
            if state.drive_time_s == last_s or math.isnan(state.drive_time_s):
                continue
            last_s = state.drive_time_s
            self.latencies.add(time.monotonic() - (last_s - self.source.offset_s))
            if self.latencies.number % WHEELS_HZ == 0:
                self.memory_MB.append(resident_MB())
                used = resource.getrusage(resource.RUSAGE_SELF)
                self.cpu_s.append((time.monotonic(), used.ru_utime + used.ru_stime))


def send(path: str, seconds: float) -> None:
    """Send samples in time over a socket to whoever connects first."""
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path)
        server.listen(1)
        connection, _ = server.accept()
        began_s = time.monotonic()
        for k in range(round(seconds * WHEELS_HZ)):
            time.sleep(max(began_s + k / WHEELS_HZ - time.monotonic(), 0.0))
            connection.sendall(messages(k, time.monotonic()))
        time.sleep(END_S)


def messages(k: int, now_s: float) -> bytes:
    """The k-th sample of wheels and motors, and with every tenth one of the battery."""
    speed = 4.0 + 3.0 * math.sin(0.5 * k / WHEELS_HZ)
    drive = {"time_s": now_s, "wheel_speed_rad_s": [speed] * 4, "motor_current_A": [0.5 + 0.1 * speed] * 2}
    battery = {"time_s": now_s, "battery_current_A": -2.0 - 0.1 * speed, "battery_voltage_V": 13.1 - 0.003 * speed}
    both = [drive] if k % (WHEELS_HZ // BATTERY_HZ) else [drive, battery]
    return b"".join(json.dumps(message).encode() + b"\n" for message in both)


SETUP = """
format = "ohmward-setup/1"
battery = "{folder}/battery.toml"
robot = "rlma"
state = "{folder}/state"
[[source]]
kind = "json-lines"
address = "{folder}/socket"
[[sink]]
kind = "json-lines"
path = "{folder}/states.jsonl"
interval_s = 0.1
"""


async def run_until_quiet(process: Process) -> None:
    """Run until no sample has come for a while."""
    running = asyncio.create_task(process.run())
    while not time.monotonic() - process.estimation.state.drive_time_s > 0.5 * END_S:
        await asyncio.sleep(0.1)
    process.stop()
    await running


def start(folder: str) -> Process:
    """The process, with its steps in machine code."""
    process = assemble(SETUP_FILE.load(f"{folder}/robot.toml"))
    process.estimation.compile()
    return process


def estimate(folder: str) -> dict[str, object]:
    """Run the process until the sender ends; the figures of its meter."""
    process = start(folder)
    process.sources = [ObservedSource(source) for source in process.sources]
    meter = Meter(process.sources[0])
    process.sinks.append((meter, Feed(meter.interval_s)))

    asyncio.run(run_until_quiet(process))
    (from_s, from_cpu), (to_s, to_cpu) = meter.cpu_s[int(SETTLE_S)], meter.cpu_s[-1]
    return {
        "cpu": (to_cpu - from_cpu) / (to_s - from_s),
        "memory_MB": meter.memory_MB,
        "estimated": meter.latencies.number,
        "p50_s": meter.latencies.quantile(0.5),
        "p99_s": meter.latencies.quantile(0.99),
    }


def measure(seconds: float) -> Load:
    """Run the processes: a first start that compiles, the sender, the estimators."""
    with tempfile.TemporaryDirectory() as folder:
        save_battery(generic_battery("lfp", 12.0, 4), f"{folder}/battery.toml")
        Path(f"{folder}/robot.toml").write_text(SETUP.format(folder=folder))
        script = [sys.executable, __file__]
        subprocess.run([*script, "--first-start", folder], check=True)  # measured is a later one
        with subprocess.Popen([*script, "--send", folder, "--seconds", str(seconds)]) as sender:
            try:
                while not Path(f"{folder}/socket").exists():
                    time.sleep(0.05)
                run = subprocess.run([*script, "--estimate", folder], stdout=subprocess.PIPE, check=True)
            finally:
                sender.terminate()
        found = json.loads(run.stdout)
    return Load(sent=round(seconds * WHEELS_HZ), **found | {"memory_MB": np.array(found["memory_MB"])})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--send", metavar="FOLDER", help=argparse.SUPPRESS)
    parser.add_argument("--first-start", metavar="FOLDER", help=argparse.SUPPRESS)
    parser.add_argument("--estimate", metavar="FOLDER", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.send:
        send(f"{args.send}/socket", args.seconds)
    elif args.first_start:
        start(args.first_start)
        for thread in threading.enumerate():  # those that compile behind the first steps
            if thread is not threading.main_thread():
                thread.join()
    elif args.estimate:
        print(json.dumps(estimate(args.estimate)))
    else:
        print(measure(args.seconds))


if __name__ == "__main__":
    main()
