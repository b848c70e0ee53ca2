"""A simulated day at twenty times real time: are memory, open handles and latency of the process flat?"""

from __future__ import annotations

import asyncio
import math
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward import generic_battery
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.message import Message, Put
from ohmward.onboard.part import EndedError
from ohmward.onboard.process import Process
from ohmward.onboard.sinks.json_lines import JsonLinesSink
from ohmward.onboard.state_folder import StateFolder
from ohmward.traction.robot.packaged import RLMA

RATE = 20.0
WHEELS_HZ, BATTERY_HZ = 50, 10
#: The robot drives for 40 minutes and charges for 20.
DRIVE_S, ROUND_S = 2400.0, 3600.0
#: Simulated time between two looks at the process.
LOOK_S = 120.0


class Look(NamedTuple):
    """The process at an instant: simulated time, resident memory, open handles, mean time that a message took."""

    time_s: float
    memory_MB: float
    handles: int
    message_s: float


@dataclass
class Day:
    """A source that drives and charges by turns, and looks at the process now and then."""

    hours: float
    looks: list[Look] = field(default_factory=list)
    name: str = "day"

    async def run(self, put: Put) -> None:
        began_s, took_s, messages, look_s = time.monotonic(), 0.0, 0, LOOK_S
        for k in range(round(self.hours * 3600.0 * WHEELS_HZ)):
            t = k / WHEELS_HZ
            if k % 50 == 0:
                await asyncio.sleep(max(began_s + t / RATE - time.monotonic(), 0.0))
            for values in measured(k, t):
                before_s = time.perf_counter()
                put(Message(t, began_s + t, self.name, values))
                took_s, messages = took_s + time.perf_counter() - before_s, messages + 1
            if t >= look_s:
                handles = sum(1 for _ in Path("/proc/self/fd").iterdir())
                self.looks.append(Look(t, resident_MB(), handles, took_s / messages))
                took_s, messages, look_s = 0.0, 0, look_s + LOOK_S
        raise EndedError("the day is over")


def measured(k: int, t: float) -> Iterator[dict[str, float]]:
    """Messages of the wheels, and with every fifth one of the battery."""
    drives = t % ROUND_S < DRIVE_S
    speed = 4.0 + 3.0 * math.sin(0.5 * t) if drives else 0.0
    wheels = {f"wheel_speed_rad_s.{j}": speed for j in range(4)}
    yield wheels | {f"motor_current_A.{j}": 0.5 + 0.1 * speed if drives else 0.0 for j in range(2)}
    if k % (WHEELS_HZ // BATTERY_HZ) == 0:
        current_A = -1.0 - 0.1 * speed if drives else 2.9
        yield {"battery_current_A": current_A, "battery_voltage_V": 13.2 + 0.03 * current_A}


def resident_MB(process: int | str = "self") -> float:
    """Memory of a process, by default of this one, that is resident."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def drive_a_day(hours: float) -> list[Look]:
    """Looks at the process along so many simulated hours, the first one after two minutes."""
    with tempfile.TemporaryDirectory() as folder:
        estimation = Estimation(generic_battery("lfp", 12.0, 4), RLMA)
        estimation.compile()
        state, day = StateFolder(Path(folder)), Day(hours)
        process = Process(estimation, [day], [JsonLinesSink(f"{folder}/states.jsonl", 10.0)])
        process.companions.append(("snapshots", state.writer(estimation, process.now_s)))
        asyncio.run(process.run())
        state.close()
    return day.looks


def growth(values: list[float]) -> float:
    """The last quarter over the second one, by their medians: the first one is the start."""
    quarter = max(len(values) // 4, 1)
    return float(np.median(values[-quarter:]) / np.median(values[quarter : 2 * quarter] or values[:quarter]))
