"""Past of the robot for its page: what memory holds, and before that what the store holds, thinned."""

from __future__ import annotations

import asyncio
import math
import sqlite3
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.errors import OhmwardError
from ohmward.onboard.page.dashboard import Dashboard
from ohmward.onboard.page.view import BATTERY, DRIVE, HISTORY, SLIP, history_row
from ohmward.onboard.part import LOG
from ohmward.onboard.store.store import Store

#: Rows further apart than so many usual distances have nothing between them: the robot was off.
_GAP_DISTANCES = 3.0


class Lookback(NamedTuple):
    """A time to look back on [s], and the time between two points that the store gives for it [s]."""

    length_s: float
    step_s: float


#: Some 400 points each, more than a picture on a phone has columns.
SPANS = {"hour": Lookback(3600.0, 10.0), "day": Lookback(86_400.0, 200.0), "week": Lookback(604_800.0, 1500.0)}

#: Points that memory gives between two that the store would.
FINER = 10.0

Rows = dict[str, list[float | None]]


class Past:
    """History of a dashboard; the store is read in a thread, once at a time, and no more often than its steps.

    Args:
        dashboard: what memory holds, and the folder of the store.
    """

    def __init__(self, dashboard: Dashboard):
        self._dashboard = dashboard
        self._reading = asyncio.Lock()
        self._read: dict[str, tuple[float, Rows]] = {}

    async def last(self, name: str) -> Rows:
        """Columns of `HISTORY` of the last "hour", "day" or "week"; None for what is not known."""
        span, state = SPANS[name], self._dashboard.state
        now_s = state.unix_s if state else time.time()
        recent = thinned(self._dashboard.history(now_s - span.length_s), span.step_s / FINER)
        stored = await self._stored(name, now_s) if self._dashboard.store else {}
        begin_s = (recent["unix_s"] or [now_s])[0] or now_s
        earlier = [k for k, unix_s in enumerate(stored.get("unix_s", ())) if unix_s is not None and unix_s < begin_s]
        return {column: [stored[column][k] for k in earlier] + recent[column] for column in HISTORY}

    async def _stored(self, name: str, now_s: float) -> Rows:
        """Rows of the store, as they were one step ago at most; what memory has since then is newer."""
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
    """Rows of a store in columns of `HISTORY`, one of nothing where the robot was off.

    Raises:
        OhmwardError: there is no store, or it cannot be read.
    """
    store = Store(folder, read_only=True)
    try:
        times_ns = int(1e9 * (until_s - span.length_s)), int(1e9 * until_s), int(1e9 * span.step_s)
        slip = [name for name in store.names("drive") if name.startswith(SLIP)]
        battery = store.thinned("battery", BATTERY, *times_ns)
        drive = store.thinned("drive", (*DRIVE, *slip), *times_ns)
    finally:
        store.close()
    rows = {step: {**values} for step, values in _by_step(battery, times_ns[2])}
    for step, values in _by_step(drive, times_ns[2]):
        rows[step] = {**values, **rows.get(step, {})}
    ordered = sorted((history_row(values["unix_ns"] / 1e9, values) for values in rows.values()), key=lambda row: row[0])
    return {name: _known(column) for name, column in zip(HISTORY, _with_gaps(ordered).T, strict=True)}


def _by_step(columns: dict[str, np.ndarray], step_ns: int) -> list[tuple[int, dict[str, float]]]:
    """Rows as dicts, each with the number of its step."""
    times = columns["unix_ns"]
    return [
        (int(unix_ns) // step_ns, {name: float(column[k]) for name, column in columns.items()})
        for k, unix_ns in enumerate(times)
    ]


def _with_gaps(rows: list[tuple[float, ...]]) -> np.ndarray:
    """Rows (T, columns) with one of nan between those that are far apart."""
    table = np.array(rows).reshape(-1, len(HISTORY))
    apart_s = np.diff(table[:, 0])
    if not len(apart_s):
        return table
    ends = np.flatnonzero(apart_s > _GAP_DISTANCES * np.median(apart_s))
    nothing = np.full((len(ends), len(HISTORY)), math.nan)
    nothing[:, 0] = (table[ends, 0] + table[ends + 1, 0]) / 2.0
    return np.insert(table, ends + 1, nothing, axis=0)


def thinned(rows: Rows, step_s: float) -> Rows:
    """Every n-th row, so that they are a step apart."""
    times = rows["unix_s"]
    if len(times) < 2 or times[0] is None or times[-1] is None:
        return rows
    every = max(round(step_s * (len(times) - 1) / max(times[-1] - times[0], 1e-3)), 1)
    return {name: column[::every] for name, column in rows.items()}


def after(since_unix_s: float, rows: Rows) -> Rows:
    """Rows after a time on the wall clock."""
    later = [k for k, unix_s in enumerate(rows["unix_s"]) if unix_s is not None and unix_s > since_unix_s]
    return {name: [column[k] for k in later] for name, column in rows.items()}


def _known(values: np.ndarray) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]
