"""The process on the robot under load, as a user runs it: latency, losses, processor and memory.

Another process sends samples of wheels and motors at 1 kHz and of the battery at 100 Hz over a socket, as JSON lines
with its own time stamps. `python benchmarks/on_board.py --seconds 60` prints; `make soak` takes ten minutes and writes
the page.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import resource
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward import generic_battery, save_battery
from ohmward.onboard.assembly import assemble
from ohmward.onboard.process import Process
from ohmward.onboard.setup import SETUP_FILE
from ohmward.traction.robot.robot import RLMA

WHEELS_HZ, BATTERY_HZ = 1000, 100
#: Of the start that is not counted: the first samples of a stream.
SETTLE_S = 2.0
#: The sender holds the connection so long after its last sample.
END_S = 4.0


class Load(NamedTuple):
    """Measurements of the process under load.

    sent, estimated: samples of wheels and motors, and estimates of the drive.
    latency_s: (K,) from a sample's own time stamp to its estimate at a sink.
    cpu: share of one core.
    memory_MB: (M,) resident, along the run.
    """

    sent: int
    estimated: int
    latency_s: np.ndarray
    cpu: float
    memory_MB: np.ndarray


@dataclass
class Meter:
    """A sink that measures the age of every estimate of the drive."""

    clock_of: object
    name: str = "meter"
    interval_s: float = 0.0

    async def run(self, feed):
        self.latency_s, self.memory_MB, self.cpu_s, last_s = [], [], [], math.nan
        async for state in feed:
            if state.drive_time_s == last_s or math.isnan(state.drive_time_s):
                continue
            last_s = state.drive_time_s
            self.latency_s.append(time.monotonic() - (last_s - self.clock_of.offset_s))
            if len(self.latency_s) % WHEELS_HZ == 0:
                self.memory_MB.append(resident_MB())
                used = resource.getrusage(resource.RUSAGE_SELF)
                self.cpu_s.append((time.monotonic(), used.ru_utime + used.ru_stime))


def resident_MB() -> float:
    """Memory of this process that is in use."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


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


class Clock:
    """The offset that the process has found between the sender's clock and its own, which are the same."""

    def __init__(self, process):
        self.process = process

    @property
    def offset_s(self) -> float:
        clock = self.process._clocks["json-lines"]
        return min(clock._least_s, clock._least_before_s)


async def run_until_quiet(process: Process) -> None:
    """Run until no sample has come for a while."""
    running = asyncio.create_task(process.run())
    while not time.monotonic() - process.estimation.state.drive_time_s > 0.5 * END_S:
        await asyncio.sleep(0.1)
    process.stop()
    await running


def estimate(folder: str) -> dict[str, object]:
    """Run the process until the sender ends; the figures of its meter."""
    process = assemble(SETUP_FILE.load(f"{folder}/robot.toml"))
    process.estimation.compile()
    meter = Meter(Clock(process))
    process.add_sink(meter)

    asyncio.run(run_until_quiet(process))
    np.save(f"{folder}/latency.npy", np.array(meter.latency_s))
    (from_s, from_cpu), (to_s, to_cpu) = meter.cpu_s[int(SETTLE_S)], meter.cpu_s[-1]
    return {"cpu": (to_cpu - from_cpu) / (to_s - from_s), "memory_MB": meter.memory_MB}


def measure(seconds: float) -> Load:
    """Run both processes."""
    with tempfile.TemporaryDirectory() as folder:
        save_battery(generic_battery("lfp", 12.0, 4), f"{folder}/battery.toml")
        Path(f"{folder}/robot.toml").write_text(SETUP.format(folder=folder))
        words = [sys.executable, __file__, "--estimate", folder]
        sender = subprocess.Popen([sys.executable, __file__, "--send", folder, "--seconds", str(seconds)])
        while not Path(f"{folder}/socket").exists():
            time.sleep(0.05)
        found = json.loads(subprocess.run(words, stdout=subprocess.PIPE, check=True).stdout)
        sender.wait()
        latency_s = np.load(f"{folder}/latency.npy")
    sent = round(seconds * WHEELS_HZ)
    counted = latency_s[round(SETTLE_S * WHEELS_HZ) :]
    return Load(sent, len(latency_s), counted, found["cpu"], np.array(found["memory_MB"]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--send", metavar="FOLDER", help=argparse.SUPPRESS)
    parser.add_argument("--estimate", metavar="FOLDER", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.send:
        send(f"{args.send}/socket", args.seconds)
    elif args.estimate:
        print(json.dumps(estimate(args.estimate)))
    else:
        load = measure(args.seconds)
        print(load.sent, load.estimated, np.quantile(load.latency_s, [0.5, 0.9, 0.99, 0.999, 1.0]), load.cpu)
        print(load.memory_MB[[0, 2, -1]], RLMA.name)


if __name__ == "__main__":
    main()
