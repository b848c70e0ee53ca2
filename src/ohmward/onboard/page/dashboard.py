"""Dashboard of a robot: its newest state, its recent history and its path, all bounded, and its past in the store."""

from __future__ import annotations

import asyncio
import math
import sqlite3
import time
from collections import deque
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import OhmwardError
from ohmward.onboard.evidence import usable
from ohmward.onboard.feed import MissionForecaster
from ohmward.onboard.page.view import BATTERY, DRIVE, HISTORY, SLIP, history_row, view
from ohmward.onboard.part import LOG
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.store.rows import columns_of
from ohmward.onboard.store.store import Store
from ohmward.quantities import DAY_S, SECONDS_PER_HOUR

#: Time between two rows of the history, and number of rows: an hour and a half.
ROW_S, ROWS = 1.0, 5400

#: Distance between two points of the path, and number of points; a longer path loses every other one.
POINT_M, POINTS = 0.05, 2000


class Dashboard:
    """States in, views for readers out; readers never hold up the writer.

    Args:
        name: of the robot.
        store: folder of its store, None if there is none.
        mission: forecast of a mission that would begin now, see `Feed.mission`.

    Attributes:
        state: the newest one, None before the first.
        version: number of states so far.
        path: x, y [m] of the robot's path.
        ended: True once no more states come.
    """

    def __init__(self, name: str, store: Path | None = None, mission: MissionForecaster | None = None):
        self.name, self.store, self.mission = name, store, mission
        self.state: RobotState | None = None
        self.version = 0
        self.path: list[tuple[float, float]] = []
        self.ended = False
        self._sample: dict[str, float] = {}
        self._rows: deque[tuple[float, ...]] = deque(maxlen=ROWS)
        self._row_s = -math.inf
        self._point_m = POINT_M
        self._news = asyncio.Event()

    def take(self, states: Sequence[RobotState]) -> None:
        """Take states in, in order."""
        for state in states:
            self._sample |= state.sample
            self._remember(state)
        self.state = self._whole(states[-1])
        self.version += len(states)
        self._wake()

    def end(self) -> None:
        """Release waiting readers."""
        self.ended = True
        self._wake()

    async def newer_than(self, version: int, timeout_s: float) -> int:
        """Version of the newest state, once it is newer than `version` or the timeout is over."""
        if self.version <= version and not self.ended:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), timeout_s)
        return self.version

    def view(self) -> dict[str, Any]:
        """The newest state as the page shows it."""
        return {"name": self.name, "stored": self.store is not None, **(view(self.state) if self.state else {})}

    def history(self, since_unix_s: float = -math.inf) -> Rows:
        """Columns of the rows after a time on the wall clock, None for unknown values."""
        return _in_columns([row for row in self._rows if row[0] > since_unix_s])

    def _whole(self, state: RobotState) -> RobotState:
        """The state with the last value of every sensor, not only of those in its sample; nan for useless ones."""
        return state._replace(sample=usable(self._sample, state))

    def _remember(self, state: RobotState) -> None:
        if not 0.0 <= state.time_s - self._row_s < ROW_S:
            self._row_s = state.time_s
            while self._rows and self._rows[-1][0] > state.unix_s:  # the wall clock was set back
                self._rows.pop()
            self._rows.append(history_row(state.unix_s, columns_of(self._whole(state))))
        if state.pose is not None:
            point = float(state.pose.x_m), float(state.pose.y_m)
            if not self.path or math.dist(point, self.path[-1]) >= self._point_m:
                self.path.append(point)
            if len(self.path) > POINTS:
                self.path, self._point_m = self.path[::2], 2.0 * self._point_m

    def _wake(self) -> None:
        """Wake all readers that wait now; later ones wait for the next call."""
        news, self._news = self._news, asyncio.Event()
        news.set()


#: Rows further apart than this many times the median distance enclose a gap: the robot was off.
_GAP_DISTANCES = 3.0


class Lookback(NamedTuple):
    """A time to look back on [s], and the time between two points that the store gives for it [s]."""

    length_s: float
    step_s: float


#: Some 400 points each, more than a picture on a phone has columns.
SPANS = {"hour": Lookback(SECONDS_PER_HOUR, 10.0), "day": Lookback(DAY_S, 200.0), "week": Lookback(7 * DAY_S, 1500.0)}

#: Number of points from memory for each point from the store.
FINER = 10.0

Rows = dict[str, list[float | None]]


class Past:
    """History of a dashboard; the store is read in a thread, by one reader at a time, and at most once per step.

    Args:
        dashboard: with the rows in memory, and the folder of the store.
    """

    def __init__(self, dashboard: Dashboard):
        self._dashboard = dashboard
        self._reading = asyncio.Lock()
        self._read: dict[str, tuple[float, Rows]] = {}

    async def last(self, name: str) -> Rows:
        """Columns of `HISTORY` of the last "hour", "day" or "week"; None for unknown values."""
        span, state = SPANS[name], self._dashboard.state
        now_s = state.unix_s if state else time.time()
        recent = thinned(self._dashboard.history(now_s - span.length_s), span.step_s / FINER)
        stored = await self._stored(name, now_s) if self._dashboard.store else {}
        begin_s = (recent["unix_s"] or [now_s])[0] or now_s
        earlier = [k for k, unix_s in enumerate(stored.get("unix_s", ())) if unix_s is not None and unix_s < begin_s]
        return {column: [stored[column][k] for k in earlier] + recent[column] for column in HISTORY}

    async def _stored(self, name: str, now_s: float) -> Rows:
        """Rows of the store, read at most one step ago; newer rows are in memory."""
        span = SPANS[name]
        async with self._reading:
            made_s, rows = self._read.get(name, (-math.inf, {}))
            if not 0.0 <= now_s - made_s < span.step_s and self._dashboard.store:
                try:
                    rows = await asyncio.to_thread(stored_rows, self._dashboard.store, now_s, span)
                except (OhmwardError, sqlite3.Error) as error:
                    LOG.warning("the page shows no history of the store: %s", error)
                self._read[name] = now_s, rows
        return rows


def stored_rows(folder: Path, until_s: float, span: Lookback) -> Rows:
    """Rows of a store in columns of `HISTORY`, with an empty one where the robot was off.

    Raises:
        OhmwardError: there is no store, or it cannot be read.
    """
    with closing(Store(folder, read_only=True)) as store:
        times_ns = int(1e9 * (until_s - span.length_s)), int(1e9 * until_s), int(1e9 * span.step_s)
        slip = [name for name in store.names("drive") if name.startswith(SLIP)]
        battery = store.thinned("battery", BATTERY, *times_ns)
        drive = store.thinned("drive", (*DRIVE, *slip), *times_ns)
    rows = {step: {**values} for step, values in _by_step(battery, times_ns[2])}
    for step, values in _by_step(drive, times_ns[2]):
        rows[step] = {**values, **rows.get(step, {})}
    ordered = sorted((history_row(values["unix_ns"] / 1e9, values) for values in rows.values()), key=lambda row: row[0])
    return _in_columns(_with_gaps(ordered).tolist())


def _in_columns(rows: Sequence[Sequence[float]]) -> Rows:
    """Rows of `HISTORY` as columns by name, None for unknown values."""
    return {name: [row[k] if math.isfinite(row[k]) else None for row in rows] for k, name in enumerate(HISTORY)}


def _by_step(columns: dict[str, np.ndarray], step_ns: int) -> list[tuple[int, dict[str, float]]]:
    """Rows as dicts, each with the number of its step."""
    times = columns["unix_ns"]
    return [
        (int(unix_ns) // step_ns, {name: float(column[k]) for name, column in columns.items()})
        for k, unix_ns in enumerate(times)
    ]


def _with_gaps(rows: list[tuple[float, ...]]) -> np.ndarray:
    """Rows (T, columns), with a row of nan between those that are far apart."""
    table = np.array(rows).reshape(-1, len(HISTORY))
    apart_s = np.diff(table[:, 0])
    if not len(apart_s):
        return table
    ends = np.flatnonzero(apart_s > _GAP_DISTANCES * np.median(apart_s))
    nothing = np.full((len(ends), len(HISTORY)), math.nan)
    nothing[:, 0] = (table[ends, 0] + table[ends + 1, 0]) / 2.0
    return np.insert(table, ends + 1, nothing, axis=0)


def thinned(rows: Rows, step_s: float) -> Rows:
    """Every n-th row, so that the rows are a step apart."""
    times = rows["unix_s"]
    if len(times) < 2 or times[0] is None or times[-1] is None:
        return rows
    every = max(round(step_s * (len(times) - 1) / max(times[-1] - times[0], 1e-3)), 1)
    return {name: column[::every] for name, column in rows.items()}


def after(since_unix_s: float, rows: Rows) -> Rows:
    """Rows after a time on the wall clock."""
    later = [k for k, unix_s in enumerate(rows["unix_s"]) if unix_s is not None and unix_s > since_unix_s]
    return {name: [column[k] for k in later] for name, column in rows.items()}
