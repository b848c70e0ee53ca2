"""Replay of recorded logs, in real time or faster; the replays of one process keep step."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, cast, get_args

import numpy as np

from ohmward.checks import require_one_of, require_positive
from ohmward.logs.battery_columns import find_cells, numbered_rows
from ohmward.logs.drive_log import DriveLog, read_drive
from ohmward.logs.log import Log, read_log
from ohmward.onboard.message import Message, Put
from ohmward.onboard.part import EndedError, Source, sharing
from ohmward.signals.current_sign import CurrentSign
from ohmward.traction.robot.packaged import load_robot


@dataclass(frozen=True)
class ReplaySource:
    """Samples of a log, as they came."""

    live: ClassVar[bool] = False
    path: str  #: path of a battery log or, with `robot`, a drive log
    robot: str | None = None  #: path of a robot file or name of a packaged robot, for drive logs
    #: effect of a positive current in a battery log: "charge" or "discharge"; "auto" determines it from the data
    current_sign: str = "auto"
    rate: float = 1.0  #: seconds of the log per second, > 0; inf: as fast as possible
    name: str = "replay"  #: in diagnostics

    def __post_init__(self) -> None:
        require_one_of("current_sign", self.current_sign, get_args(CurrentSign))
        if self.rate != math.inf:
            require_positive("rate", self.rate)

    async def run(self, put: Put) -> None:
        """Put every sample at its time, with its receipt on the log's clock: a faster replay gives the same result."""
        await self.replay(put, ReplayClock([self.name]))

    async def replay(self, put: Put, clock: ReplayClock) -> None:
        """Put every sample at its time, in step with the other replays on the clock."""
        try:
            log = await asyncio.to_thread(self._read)
            samples = _of_drive(log) if isinstance(log, DriveLog) else _of_battery(log)
            first_s = float(log.time_s[0])
            first_s -= await clock.begin(self.name, log)
            for stamp_s, values in samples:
                wait_s = (stamp_s - first_s) / self.rate - (time.monotonic() - clock.began_s)
                await asyncio.sleep(max(wait_s, 0.0))
                await clock.turn(self.name, stamp_s - first_s)
                date_s = math.nan if log.start_unix_s is None else log.start_unix_s + stamp_s
                put(Message(stamp_s, clock.began_s + stamp_s - first_s, self.name, values, date_s=date_s))
        finally:
            clock.leave(self.name)
        raise EndedError(f"{self.path} was replayed to its end")

    def _read(self) -> Log | DriveLog:
        return (
            read_drive(self.path, load_robot(self.robot))
            if self.robot
            else read_log(self.path, current_sign=cast(CurrentSign, self.current_sign))
        )


class ReplayClock:
    """Common time of the replays of a process.

    They begin when all have read their logs. If the logs overlap by their dates they keep their offsets; otherwise all
    begin together.

    Args:
        names: of the replays.

    Attributes:
        began_s: monotonic time of the beginning, nan before.
    """

    def __init__(self, names: Iterable[str]):
        self.began_s = math.nan
        self._spans: dict[str, tuple[float, float] | None] = {}
        self._next_s = dict.fromkeys(names, -math.inf)
        self._all_read = asyncio.Event()

    async def begin(self, name: str, log: Log | DriveLog) -> float:
        """Wait until the others have read; return the time from the beginning to the first sample of the log [s]."""
        start_s = log.start_unix_s
        self._spans[name] = (
            None if start_s is None else (start_s + float(log.time_s[0]), start_s + float(log.time_s[-1]))
        )
        self._begin()
        await self._all_read.wait()
        spans = [span for span in self._spans.values() if span is not None]
        own, first_s = self._spans[name], min((first for first, _ in spans), default=0.0)
        overlap = len(spans) == len(self._spans) and max(f for f, _ in spans) <= min(last for _, last in spans)
        return own[0] - first_s if own and overlap else 0.0

    async def turn(self, name: str, time_s: float) -> None:
        """Wait until no other replay has an earlier sample."""
        self._next_s[name] = time_s
        while min(self._next_s.values()) < time_s:
            await asyncio.sleep(0.0)

    def leave(self, name: str) -> None:
        """Stop waiting for a replay that has ended or whose log cannot be read."""
        self._next_s.pop(name, None)
        self._begin()

    def _begin(self) -> None:
        if self._next_s.keys() <= self._spans.keys() and not self._all_read.is_set():
            self.began_s = time.monotonic()
            self._all_read.set()


def replays_in_step(sources: Sequence[Source]) -> list[Source]:
    """The sources of a process, with one clock for all its replays."""
    clock = ReplayClock([source.name for source in sources if isinstance(source, ReplaySource)])
    return [
        sharing(source, partial(source.replay, clock=clock)) if isinstance(source, ReplaySource) else source
        for source in sources
    ]


def _of_battery(log: Log) -> Iterator[tuple[float, dict[str, float]]]:
    """Time and values of every sample of a battery, with its cells if their voltages are among the columns."""
    cells: dict[str, np.ndarray] = {}
    for count in {len(row) for row in numbered_rows(log.extra)}:
        found, _ = find_cells(log.extra, log.voltage_V, count)
        if found:
            cells = {f"cell_voltage_V.{k}": column for k, column in enumerate(found.voltage_V.T)}
    return _rows(log.time_s, log.quantities("battery") | cells)


def _of_drive(log: DriveLog) -> Iterator[tuple[float, dict[str, float]]]:
    """Time and values of every sample of a drive."""
    columns = {f"wheel_speed_rad_s.{k}": column for k, column in enumerate(log.wheel_speed_rad_s.T)}
    columns |= {f"motor_current_A.{k}": column for k, column in enumerate(log.motor_current_A.T)}
    return _rows(log.time_s, columns | log.quantities("body"))


def _rows(time_s: np.ndarray, columns: dict[str, np.ndarray]) -> Iterator[tuple[float, dict[str, float]]]:
    """Time and values of every row that has values; unmeasured ones are left out, as by a sensor."""
    for stamp_s, *row in zip(time_s.tolist(), *(column.tolist() for column in columns.values()), strict=True):
        if values := {signal: v for signal, v in zip(columns, row, strict=True) if v == v}:
            yield stamp_s, values
