"""Databases that go away in real time while the robot drives: estimates go on, every row comes once.

OHMWARD_OUTAGE_S says for how long; `benchmarks/on_board.py outage` takes five minutes.
"""

import asyncio
import json
import math
import os
import time
import urllib.parse
import urllib.request
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np

from ohmward.battery.chemistries import generic_battery
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Message, Put
from ohmward.onboard.part import Sink
from ohmward.onboard.process import Process
from ohmward.onboard.robot_state import Level
from ohmward.onboard.sinks.server import InfluxSink, PostgresqlSink
from ohmward.onboard.sinks.store import StoreSink
from ohmward.onboard.store.rows import KINDS
from ohmward.onboard.store.store import Store
from ohmward.traction.robot.packaged import load_robot
from onboard.servers import free_port, influxdb, postgresql

RATE_HZ = 10.0

#: With the longest pause between two tries rows come within this after the server.
RECOVERY_S = 40.0

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


@dataclass(frozen=True)
class Drive:
    """A source that drives ahead in real time."""

    name: str = "drive"

    async def run(self, put: Put) -> None:
        while True:
            await asyncio.sleep(1.0 / RATE_HZ)
            now_s = time.monotonic()
            battery = {"battery_current_A": -3.0, "battery_voltage_V": 13.2}
            wheels = {f"wheel_speed_rad_s.{wheel}": 5.0 for wheel in WHEELS}
            put(Message(now_s, now_s, self.name, battery | wheels | {"yaw_rate_rad_s": 0.1}))


@dataclass(frozen=True)
class Meter:
    """A sink that notes when estimates of the drive came, and what the conditions of the deliveries were."""

    estimates_s: list[float] = field(default_factory=list)
    conditions: dict[str, list[tuple[float, Level, str]]] = field(default_factory=dict)
    name: str = "meter"
    interval_s: float = 0.0

    async def run(self, feed: Feed) -> None:
        while states := await feed.batch(1):
            (state,) = states
            if not math.isnan(state.drive_time_s) and state.drive_time_s not in self.estimates_s[-1:]:
                self.estimates_s.append(state.drive_time_s)
            for name, level, message, _ in state.diagnostics:
                if name.startswith("delivery"):
                    self.conditions.setdefault(name, []).append((time.monotonic(), level, message))


def test_databases_that_are_away_get_every_row_once(tmp_path):
    away_s = float(os.environ.get("OHMWARD_OUTAGE_S", "3"))
    influx_port, postgresql_port = free_port(), free_port()
    meter = Meter()
    sinks: list[Sink] = [
        InfluxSink(
            f"http://127.0.0.1:{influx_port}/write?db=robots", spool=str(tmp_path / "influx.spool"), interval_s=0.0
        ),
        PostgresqlSink(
            f"host=127.0.0.1 port={postgresql_port} dbname=postgres user=rover",
            spool=str(tmp_path / "postgresql.spool"),
            interval_s=0.0,
        ),
        StoreSink(str(tmp_path / "store")),
        meter,
    ]
    process = Process(Estimation(generic_battery("lfp", 12.0, 4), load_robot("rlma")), [Drive()], sinks)

    def servers() -> ExitStack:
        stack = ExitStack()
        stack.enter_context(influxdb(tmp_path, influx_port))
        stack.enter_context(postgresql(tmp_path, postgresql_port))
        return stack

    async def run() -> tuple[float, float, int, ExitStack]:
        running = await asyncio.to_thread(servers)
        task = asyncio.create_task(process.run())
        await until(lambda: len(meter.estimates_s) > 1.5 * RATE_HZ)
        await asyncio.to_thread(running.close)  # both are killed
        gone_s = time.monotonic()
        ticks = await asyncio.to_thread(ticks_in, away_s)
        back_s = time.monotonic()
        running = await asyncio.to_thread(servers)
        await until(lambda: all(last(meter, sink)[1] == Level.OK for sink in ("influxdb", "postgresql")), RECOVERY_S)
        process.stop()
        await task
        return gone_s, back_s, ticks, running

    gone_s, back_s, ticks, running = asyncio.run(run())
    with running:
        stored = Store(tmp_path / "store", read_only=True)
        expected = {kind: stored.read(kind, [])["unix_ns"].tolist() for kind in KINDS}
        for times in (in_influx(influx_port), in_postgresql(postgresql_port)):
            assert {kind: sorted(found) for kind, found in times.items()} == expected
    assert len(expected["drive"]) == len(meter.estimates_s)
    estimates_s = np.array(meter.estimates_s)
    during = estimates_s[(estimates_s > gone_s) & (estimates_s < back_s)]
    assert len(during) > 0.7 * ticks
    for name in ("influxdb", "postgresql"):
        said = [message for when_s, level, message in meter.conditions[f"delivery to {name}"] if level == Level.ERROR]
        assert "rows wait on the disk" in said[0] and "is the server running" in said[0]


def last(meter: Meter, sink: str) -> tuple[float, Level, str]:
    return meter.conditions[f"delivery to {sink}"][-1]


def ticks_in(span_s: float) -> int:
    """Ticks at the rate of the drive that a thread of this process comes to beside everything on this machine."""
    end_s, ticks = time.monotonic() + span_s, 0
    while time.monotonic() < end_s:
        time.sleep(1.0 / RATE_HZ)
        ticks += 1
    return ticks


async def until(condition: Callable[[], bool], within_s: float = 120.0) -> None:
    end_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end_s
        await asyncio.sleep(0.05)


def in_influx(port: int) -> dict[str, list[int]]:
    """Times of the rows, each once as the server keeps it."""
    times = {}
    for kind, column in (("battery", "soc"), ("drive", "estimated_speed_m_s")):
        words = {"db": "robots", "epoch": "ns", "q": f"SELECT {column} FROM {kind}"}
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/query?{urllib.parse.urlencode(words)}", timeout=60) as a:
            times[kind] = [row[0] for row in json.load(a)["results"][0]["series"][0]["values"]]
    return times


def in_postgresql(port: int) -> dict[str, list[int]]:
    """Times of the rows."""
    import psycopg

    with psycopg.connect(f"host=127.0.0.1 port={port} dbname=postgres user=rover") as connection:
        return {
            kind: [row[0] for row in connection.execute(f"SELECT unix_ns FROM ohmward_{kind}".encode())]
            for kind in KINDS
        }
