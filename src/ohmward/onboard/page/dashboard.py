"""Dashboard of a robot: the newest state of the robot, its recent history and its path, all bounded."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ohmward.onboard.page.view import HISTORY, history_row, view
from ohmward.onboard.robot_state import Level, RobotState
from ohmward.onboard.store.rows import columns_of

#: Time between two rows of the history, and number of rows: an hour and a half.
ROW_S, ROWS = 1.0, 5400

#: Distance between two points of the path, and number of points; a longer path loses every other one.
POINT_M, POINTS = 0.05, 2000


class Dashboard:
    """States in, what readers ask for out; readers never hold up whoever writes.

    Args:
        name: of the robot.
        store: folder of its store, None where there is none.

    Attributes:
        state: the newest one, None before the first.
        version: number of states so far.
        path: x, y [m] of the way.
        ended: no more states come.
    """

    def __init__(self, name: str, store: Path | None = None):
        self.name, self.store = name, store
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
        """Let readers that wait go."""
        self.ended = True
        self._wake()

    async def newer_than(self, version: int, timeout_s: float) -> int:
        """Version of the newest state, once it is newer than `version` or the time is over."""
        if self.version <= version and not self.ended:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), timeout_s)
        return self.version

    def view(self) -> dict[str, Any]:
        """The newest state as the page shows it."""
        return {"name": self.name, "stored": self.store is not None, **(view(self.state) if self.state else {})}

    def history(self, since_unix_s: float = -math.inf) -> dict[str, list[float | None]]:
        """Columns of the rows after a time on the wall clock, None where nothing was known."""
        rows = [row for row in self._rows if row[0] > since_unix_s]
        return {name: [row[k] if math.isfinite(row[k]) else None for row in rows] for k, name in enumerate(HISTORY)}

    def _whole(self, state: RobotState) -> RobotState:
        """The state with the last value of every sensor, not only of those that made it; nan of one that is silent."""
        silent = [diagnostic.name for diagnostic in state.diagnostics if diagnostic.level == Level.STALE]
        return state._replace(sample=self._sample | {name: math.nan for name in silent if name in self._sample})

    def _remember(self, state: RobotState) -> None:
        if not 0.0 <= state.time_s - self._row_s < ROW_S:
            self._row_s = state.time_s
            self._rows.append(history_row(state.unix_s, columns_of(self._whole(state))))
        if state.pose is not None:
            point = float(state.pose.x_m), float(state.pose.y_m)
            if not self.path or math.dist(point, self.path[-1]) >= self._point_m:
                self.path.append(point)
            if len(self.path) > POINTS:
                self.path, self._point_m = self.path[::2], 2.0 * self._point_m

    def _wake(self) -> None:
        """Wake everybody who waits now; who comes later waits for the next one."""
        news, self._news = self._news, asyncio.Event()
        news.set()
