"""Items from a thread of a driver to the event loop: bounded, in order, errors too."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")

#: Of items that wait the newest so many are kept: 2 s of a full CAN bus at 1 Mbit/s.
_LONGEST = 20_000


class Handover(Generic[T]):
    """Made in the event loop; `put` and `fail` come from any thread, `take` from the loop.

    Attributes:
        lost: number of items that were left out because too many waited.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[T] = deque(maxlen=_LONGEST)
        self._something = asyncio.Event()
        self._error: Exception | None = None
        self.lost = 0

    def put(self, item: T) -> None:
        """Hand an item over."""
        self.lost += len(self._waiting) == _LONGEST
        self._waiting.append(item)
        self._wake()

    def fail(self, error: Exception) -> None:
        """Let `take` raise the error, the first one, once everything before it is taken."""
        self._error = self._error or error
        self._wake()

    async def take(self) -> list[T]:
        """All items that wait, at least one."""
        while not self._waiting:
            if self._error:
                raise self._error
            self._something.clear()
            if not self._waiting and not self._error:
                await self._something.wait()
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def _wake(self) -> None:
        if not self._something.is_set() and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._something.set)
