"""Time on the robot: monotonic inside, wall clock beside it, and the clocks of sources brought to ours.

A wall clock may be stepped by hours while a robot drives, a microcontroller counts from its own start. Everything
inside is on the monotonic clock of this process.
"""

from __future__ import annotations

import math
import time

#: A stamp that leaps against its receipt by more than this is that of a clock that was set, or of a source that has
#: started again.
LEAP_S = 1.0

#: The smallest delay of so long counts. Crystals drift by 200 ppm at most: 6 ms in that time; a clock that was set by
#: less than `LEAP_S`, and a link that has become slower for good, are followed after it.
DELAY_WINDOW_S = 30.0

#: Dates of so many messages are remembered: those of the samples that still wait for others.
_DATES = 4096


class SystemClock:
    """The clocks of this machine."""

    def now_s(self) -> float:
        """Monotonic time [s], the same for all processes of one boot."""
        return time.monotonic()

    def unix_s(self) -> float:
        """Wall clock, seconds since 1970 (UTC)."""
        return time.time()


class SourceClock:
    """Time stamps of one source on our monotonic clock.

    A message cannot come before it was measured, and the one that was least delayed came at once, so that the offset
    between both clocks is the smallest difference of receipt and stamp of late. A stamp that leaps back or ahead of its
    receipt begins anew; one that is merely late, in a burst after a silence of the link, does not.

    Args:
        window_s: the smallest difference of so long counts; inf where both clocks are one, as in a simulation.

    Attributes:
        steps: number of times that the source's clock was set.
    """

    def __init__(self, window_s: float = DELAY_WINDOW_S) -> None:
        self.window_s, self.steps = window_s, 0
        self._least_s = self._least_before_s = math.inf
        self._window_s = self._stamp_s = math.nan

    def to_ours(self, stamp_s: float, received_s: float) -> float:
        """Time of the measurement on our clock [s], never after its receipt; that where the stamp is no number."""
        if not math.isfinite(stamp_s):
            return received_s
        offset_s = received_s - stamp_s
        known_s = min(self._least_s, self._least_before_s)
        if stamp_s < self._stamp_s - LEAP_S or offset_s < known_s - LEAP_S:
            self.steps += not math.isnan(self._stamp_s)
            self._least_s = self._least_before_s = math.inf
            self._window_s = received_s
        elif received_s - self._window_s > self.window_s / 2:
            self._least_before_s, self._least_s = self._least_s, math.inf
            self._window_s = received_s
        self._stamp_s = stamp_s
        self._least_s = min(self._least_s, offset_s)
        return stamp_s + min(self._least_s, self._least_before_s)


class MessageDates:
    """Dates of recent messages, by their times on our clock: those that their sources gave."""

    def __init__(self) -> None:
        self._dates: dict[float, float] = {}

    def put(self, time_s: float, date_s: float) -> None:
        """Remember that of a message; one without a date is none."""
        if not math.isfinite(date_s):
            return
        self._dates[time_s] = date_s
        if len(self._dates) > _DATES:
            del self._dates[next(iter(self._dates))]

    def at(self, time_s: float, otherwise_s: float) -> float:
        """Date of the message that was measured at this time; another one where there is none."""
        return self._dates.get(time_s, otherwise_s)
