"""Time on the robot: monotonic clock, wall clock, and conversion of the sources' clocks to ours.

A wall clock may be stepped by hours while a robot drives, and a microcontroller counts from its own start. All internal
times are on the monotonic clock of this process.

A sender that waited for the connection first sends what it has queued, within milliseconds. When that was measured is
known once the burst is over, see `SourceClock`; until then the messages of that sender wait. Those of several senders
then leave together, in the order of their times (`Arrivals`), because samples are made of all of them.
"""

from __future__ import annotations

import ctypes
import math
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ohmward.onboard.message import Message

#: If a stamp leaps relative to its receipt by more than this, the source has restarted or its clock was set.
LEAP_S = 1.0

#: A stamp further from now is from another clock, such as one that starts with a board, and is no date [s].
DATED_S = 60.0

#: Window over which the smallest delay counts. Crystals drift by 200 ppm at most: 6 ms in that time; a link that has
#: become slower for good is followed after this time.
DELAY_WINDOW_S = 30.0

#: A new clock is known once the smallest delay has fallen by less than `_FALL_S` in this time: messages that were
#: queued before the connection, which come much faster than they were measured, are then through.
SETTLE_S, _FALL_S = 0.25, 0.1

#: A clock was set back by less than `LEAP_S` if after a stamp that went back at least this number of messages in a row,
#: over this time, are as late: jitter of 50 ms that lets messages overtake each other hardly ever does that.
_AS_LATE, _BACK_S = 5, 0.5

#: Clock modules of a Linux machine; a module shows the time of the wall clock that it has set within this time [s].
_CLOCK_MODULES, _CLOCK_AGREES_S = Path("/sys/class/rtc"), 60.0

#: Results of `adjtimex(2)` of a wall clock that no network has set, and room for its record.
_NOT_SYNCHRONIZED, _TIMEX_BYTES = (-1, 5), 512


class SystemClock:
    """The clocks of this machine."""

    def now_s(self) -> float:
        """Monotonic time [s], the same for all processes of one boot."""
        return time.monotonic()

    def suspended_s(self) -> float:
        """Time that this machine has been suspended [s], which `now_s` leaves out; 0 where the system counts none."""
        return time.clock_gettime(time.CLOCK_BOOTTIME) - time.monotonic() if hasattr(time, "CLOCK_BOOTTIME") else 0.0

    def unix_s(self) -> float:
        """Wall clock, seconds since 1970 (UTC)."""
        return time.time()

    def is_set(self) -> bool:
        """True if a clock module or the network has set the wall clock since this machine was switched on.

        One without either, as a Raspberry Pi in the field, goes on from the time at which it was shut down.
        """
        if not sys.platform.startswith("linux"):
            return True
        for module in _CLOCK_MODULES.glob("rtc*/since_epoch"):
            with suppress(OSError, ValueError):
                if abs(float(module.read_text(encoding="ascii")) - self.unix_s()) < _CLOCK_AGREES_S:
                    return True
        with suppress(OSError, AttributeError):
            return ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES)) not in _NOT_SYNCHRONIZED
        return False


class _LateMessages(NamedTuple):
    """Messages since a stamp went back."""

    began_s: float  #: receipt of the first
    above_s: float  #: halfway between its difference of receipt and stamp and that of the message before
    least_s: float = math.inf  #: smallest difference
    number: int = 0

    def after(self, offset_s: float) -> _LateMessages:
        """These and one more with this difference."""
        return self._replace(least_s=min(self.least_s, offset_s), number=self.number + 1)


class SourceClock:
    """Conversion of one source's time stamps to our monotonic clock.

    A message cannot arrive before it was measured, and the least delayed one is assumed to arrive at once, so that the
    offset between both clocks is the smallest recent difference of receipt and stamp. A stamp that leaps back or ahead
    of its receipt restarts the search; one that is merely late, in a burst after a silence of the link, does not. A
    stamp that goes back by less than `LEAP_S` may have been overtaken: the clock was set if those that follow are as
    late. The first messages may be such a burst, of a sender that waited for the connection: see `settle`.

    Args:
        window_s: time over which the smallest difference counts; inf if both clocks are one, as in a simulation.

    Attributes:
        steps: number of times that the source's clock was set.
        settled: True once the offset is known: no burst is arriving since the search began.
    """

    def __init__(self, window_s: float = DELAY_WINDOW_S) -> None:
        self.window_s, self.steps, self.settled = window_s, 0, math.isinf(window_s)
        self._least_s = self._least_before_s = math.inf
        self._window_s = self._stamp_s = math.nan
        self._began_s, self._fell_to_s, self._fell_s = math.nan, math.inf, math.nan
        self._offset_s = math.nan
        self._late: _LateMessages | None = None

    def observe(self, stamp_s: float, received_s: float) -> None:
        """Update the offset by the newest measurement, whose stamp is finite."""
        self.settle(received_s)
        offset_s = received_s - stamp_s
        first, goes_back = math.isnan(self._stamp_s), stamp_s < self._stamp_s - LEAP_S
        if first or goes_back or (self.settled and offset_s < self._least() - LEAP_S):
            self.steps += not first
            again_s = received_s - self._began_s  # two senders that take turns are no queue each time
            self.settled = self.settled and not (goes_back and again_s > self.window_s)
            self._began_s = received_s
            self._least_s = self._least_before_s = self._fell_to_s = math.inf
            self._window_s = received_s
            self._late = None
        elif (set_back := self._set_back(stamp_s, received_s)) is not None:
            self.steps += 1
            self._least_s, self._least_before_s = set_back.least_s, math.inf
            self._window_s = received_s
            self._late = None
        elif received_s - self._window_s > self.window_s / 2:
            self._least_before_s, self._least_s = self._least_s, math.inf
            self._window_s = received_s
        self._stamp_s, self._offset_s = stamp_s, offset_s
        self._least_s = min(self._least_s, offset_s)
        if offset_s < self._fell_to_s - _FALL_S:
            self._fell_to_s, self._fell_s = offset_s, received_s

    def time_s(self, stamp_s: float) -> float:
        """Time of an observed measurement on our clock [s]."""
        return stamp_s + self._least()

    def settle(self, now_s: float) -> bool:
        """True once the smallest delay no longer falls as in a burst: the offset may be used from then on."""
        self.settled = self.settled or now_s - self._fell_s >= SETTLE_S
        return self.settled

    def _set_back(self, stamp_s: float, received_s: float) -> _LateMessages | None:
        """The messages since a stamp went back, once enough of them are as late as the first; None otherwise."""
        offset_s = received_s - stamp_s
        if self._late is None and stamp_s < self._stamp_s and offset_s > self._offset_s:
            self._late = _LateMessages(received_s, 0.5 * (self._offset_s + offset_s))
        if self._late is None:
            return None
        late = self._late.after(offset_s)
        self._late = late if late.least_s > late.above_s else None
        is_set = late.number >= _AS_LATE and received_s - late.began_s >= _BACK_S
        return self._late if is_set else None

    def _least(self) -> float:
        return min(self._least_s, self._least_before_s)


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
