"""Feed of a sink: states of the robot in order, bounded, at no more than the sink's own rate."""

from __future__ import annotations

import asyncio
import math
from collections import deque

from ohmward.onboard.robot_state import RobotState

#: A sink that is away for longer than so many states loses the oldest ones; the feed counts them.
LONGEST_FEED = 10_000


class Feed:
    """States for one sink, which waits for them: `async for state in feed`.

    Args:
        interval_s: least time between two states, >= 0; 0 gives every one.
        longest: number of states that wait at most.

    Attributes:
        lost: number of states that were left out because too many waited.
        ended: no more states come.
        trouble: what keeps the sink from delivering while it goes on, "" where nothing does.
    """

    def __init__(self, interval_s: float = 0.0, longest: int = LONGEST_FEED):
        self.interval_s, self.lost = interval_s, 0
        self._waiting: deque[RobotState] = deque(maxlen=longest)
        self._something = asyncio.Event()
        self._last_s = -math.inf
        self._measured: dict[str, float] = {}
        self.ended, self.trouble = False, ""

    def put(self, state: RobotState) -> None:
        """Add a state, unless the last one is too recent; what was measured then goes with the next one."""
        if self.interval_s:
            self._measured |= state.sample
            if 0.0 <= state.time_s - self._last_s < self.interval_s:
                return
            state, self._measured = state._replace(sample=self._measured), {}
        self._last_s = state.time_s
        self.lost += len(self._waiting) == self._waiting.maxlen
        self._waiting.append(state)
        self._something.set()

    def put_back(self, states: list[RobotState]) -> None:
        """Return states that could not be delivered to the head, as far as there is room."""
        room = (self._waiting.maxlen or 0) - len(self._waiting)
        self.lost += max(len(states) - room, 0)
        self._waiting.extendleft(reversed(states[len(states) - min(room, len(states)) :]))
        if self._waiting:
            self._something.set()

    def end(self) -> None:
        """No more states come; the sink gets those that wait, and its loop ends."""
        self.ended = True
        self._something.set()

    def __aiter__(self) -> Feed:
        return self

    async def __anext__(self) -> RobotState:
        while not self._waiting:
            if self.ended:
                raise StopAsyncIteration
            self._something.clear()
            await self._something.wait()
        return self._waiting.popleft()

    async def batch(self, most: int = 10_000) -> list[RobotState]:
        """All states that wait, at least one and `most` at most; none once the feed has ended."""
        try:
            states = [await anext(self)]
        except StopAsyncIteration:
            return []
        while self._waiting and len(states) < most:
            states.append(self._waiting.popleft())
        return states
