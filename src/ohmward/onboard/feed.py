"""Feed of a sink: states of the robot in order, bounded, at no more than the sink's own rate on average."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable, Sequence

from ohmward.energy.leg import Leg
from ohmward.energy.range import MissionForecast
from ohmward.onboard.clock import LEAP_S
from ohmward.onboard.robot_state import RobotState

#: Way, energy of tasks, reserve -> forecast.
MissionForecaster = Callable[[float | Sequence[Leg], float, float | None], MissionForecast]

#: Most states that wait; a sink that is away for longer loses the oldest ones, which the feed counts.
LONGEST_FEED = 10_000


class Rate:
    """Rate limit that passes everything up to the rate: due times do not depend on the time of the last item.

    Of the items around a due time the nearest passes, so that samples at exactly this rate all pass; an item with an
    earlier time than its predecessors is late, not due again.

    Args:
        interval_s: least time between two on average, >= 0; 0 passes all.
    """

    def __init__(self, interval_s: float):
        self.interval_s = interval_s
        self._due_s = self._newest_s = -math.inf

    def passes(self, time_s: float) -> bool:
        """True if an item is due; restarts if the clock was set back."""
        if self.interval_s == 0.0:
            return True
        if time_s < self._newest_s - max(LEAP_S, self.interval_s):
            self._due_s = self._newest_s = -math.inf
        spacing_s = max(time_s - self._newest_s, 0.0)
        self._newest_s = max(self._newest_s, time_s)
        if self._newest_s < self._due_s - 0.5 * min(spacing_s, self.interval_s):
            return False
        missed = self._newest_s > self._due_s + self.interval_s
        self._due_s = (self._newest_s if missed else self._due_s) + self.interval_s
        return True


class Feed:
    """States for one sink, which waits for them: `while states := await feed.batch()`.

    Args:
        interval_s: least time between two states, on average, >= 0; 0 gives every one.

    Attributes:
        lost: number of states dropped because too many were waiting.
        ended: True once no more states come.
        trouble: reason why the running sink cannot deliver, "" if it can.
        mission: forecast of a mission for a sink that is asked, see `Estimation.mission`; None where nobody makes one.
    """

    def __init__(self, interval_s: float = 0.0):
        self.lost = 0
        self._rate = Rate(interval_s)
        self._waiting: deque[RobotState] = deque(maxlen=LONGEST_FEED)
        self._something = asyncio.Event()
        self._measured: dict[str, float] = {}
        self.ended, self.trouble = False, ""
        self.mission: MissionForecaster | None = None

    @property
    def waiting(self) -> int:
        """Number of states that wait for the sink."""
        return len(self._waiting)

    def put(self, state: RobotState) -> None:
        """Add a state if one is due; otherwise its measured values go with the next one."""
        if self._rate.interval_s:
            self._measured |= state.sample
            if not self._rate.passes(state.time_s):
                return
            state, self._measured = state._replace(sample=self._measured), {}
        self.lost += len(self._waiting) == LONGEST_FEED
        self._waiting.append(state)
        self._something.set()

    def put_back(self, states: list[RobotState]) -> None:
        """Return undelivered states to the head of the queue, as far as there is room."""
        room = LONGEST_FEED - len(self._waiting)
        self.lost += max(len(states) - room, 0)
        self._waiting.extendleft(reversed(states[len(states) - min(room, len(states)) :]))
        if self._waiting:
            self._something.set()

    def end(self) -> None:
        """End the feed: the sink gets the waiting states, then its loop ends."""
        self.ended = True
        self._something.set()

    async def batch(self, most: int = LONGEST_FEED) -> list[RobotState]:
        """All waiting states, at least one and at most `most`; empty once the feed has ended."""
        while not (self._waiting or self.ended):
            self._something.clear()
            await self._something.wait()
        return [self._waiting.popleft() for _ in range(min(most, len(self._waiting)))]
