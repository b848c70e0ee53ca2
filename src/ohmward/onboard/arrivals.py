"""Arrivals: messages of all sources with the times of their measurements on our clock.

A sender that waited for the connection first sends what it has queued, within milliseconds. When that was measured is
known once the burst is over, see `SourceClock`; until then the messages of that sender wait. Those of several senders
then leave together, in the order of their times, because samples are made of all of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ohmward.onboard.clock import DELAY_WINDOW_S, SourceClock
from ohmward.onboard.message import Message

#: Most messages that wait, and the longest that one waits; a burst beyond them has the times of its receipt.
MOST_QUEUED, LONGEST_QUEUED_S = 10_000, 2.0

#: Most clocks; further publishers of a source share one, so that one that invents names does not fill the memory.
MOST_CLOCKS = 1000


class Arrival(NamedTuple):
    """A message and the time of its measurement on our clock."""

    message: Message
    time_s: float
    clock_was_set: bool  #: True if the clock of its sender was set before it


class Arrivals:
    """Messages in, arrivals out; each publisher of a source has a clock of its own.

    Args:
        own: names of the sources whose clock is ours, as in a simulation; their messages never wait.
    """

    def __init__(self, own: frozenset[str] = frozenset()) -> None:
        self._own = own
        self._clocks: dict[tuple[str, str], SourceClock] = {}
        self._waiting: list[tuple[SourceClock, Message, bool]] = []
        self._held: set[SourceClock] = set()  #: clocks of the messages that wait

    def put(self, message: Message) -> list[Arrival]:
        """The message, and those that have waited, unless it has to wait itself."""
        if not math.isfinite(message.stamp_s):
            return [*self.due(message.received_s), Arrival(message, message.received_s, False)]
        clock = self._clock(message.source, message.publisher)
        steps = clock.steps
        clock.observe(message.stamp_s, message.received_s)
        was_set = clock.steps > steps
        if clock.settled and clock not in self._held:
            time_s = clock.time_s(message.stamp_s)
            return [*self.due(message.received_s), Arrival(message, time_s, was_set)]
        self._held.add(clock)
        self._waiting.append((clock, message, was_set))
        return self.due(message.received_s)

    def _clock(self, source: str, publisher: str) -> SourceClock:
        if (found := self._clocks.get((source, publisher))) is not None:
            return found
        if publisher and len(self._clocks) >= MOST_CLOCKS:
            return self._clock(source, "")
        window_s = math.inf if source in self._own else DELAY_WINDOW_S
        found = self._clocks[source, publisher] = SourceClock(window_s)
        return found

    def due(self, now_s: float) -> list[Arrival]:
        """Messages that have waited long enough, in the order of their times."""
        if not self._waiting:
            return []
        is_over = all(clock.settle(now_s) for clock in self._held)
        too_long = now_s - self._waiting[0][1].received_s > LONGEST_QUEUED_S or len(self._waiting) >= MOST_QUEUED
        return self.flush() if is_over or too_long else []

    def flush(self) -> list[Arrival]:
        """All messages that wait, in the order of their times."""
        found = []
        for clock, message, was_set in self._waiting:
            clock.settled = True
            found.append(Arrival(message, clock.time_s(message.stamp_s), was_set))
        self._waiting = []
        self._held.clear()
        return sorted(found, key=lambda arrival: arrival.time_s)
