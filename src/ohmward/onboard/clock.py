"""Time on the robot: monotonic clock, wall clock, and conversion of the sources' clocks to ours.

A wall clock may be stepped by hours while a robot drives, and a microcontroller counts from its own start. All internal
times are on the monotonic clock of this process.
"""

from __future__ import annotations

import math
import time

#: If a stamp leaps relative to its receipt by more than this, the source has restarted or its clock was set.
LEAP_S = 1.0

#: Window over which the smallest delay counts. Crystals drift by 200 ppm at most: 6 ms in that time; a clock that was
#: set by less than `LEAP_S`, or a link that has become slower for good, is followed after this time.
DELAY_WINDOW_S = 30.0

#: Number of message dates remembered, enough for samples that still wait for others.
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
    """Conversion of one source's time stamps to our monotonic clock.

    A message cannot arrive before it was measured, and the least delayed one is assumed to arrive at once, so that the
    offset between both clocks is the smallest recent difference of receipt and stamp. A stamp that leaps back or ahead
    of its receipt restarts the search; one that is merely late, in a burst after a silence of the link, does not.

    Args:
        window_s: time over which the smallest difference counts; inf if both clocks are one, as in a simulation.

    Attributes:
        steps: number of times that the source's clock was set.
    """

    def __init__(self, window_s: float = DELAY_WINDOW_S) -> None:
        self.window_s, self.steps = window_s, 0
        self._least_s = self._least_before_s = math.inf
        self._window_s = self._stamp_s = math.nan

    def to_ours(self, stamp_s: float, received_s: float) -> float:
        """Time of the measurement on our clock [s], never after its receipt; the receipt if the stamp is not finite."""
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
    """Dates that sources gave to recent messages, by the messages' times on our clock."""

    def __init__(self) -> None:
        self._dates: dict[float, float] = {}

    def put(self, time_s: float, date_s: float) -> None:
        """Remember the date of a message, if it has one."""
        if not math.isfinite(date_s):
            return
        self._dates[time_s] = date_s
        if len(self._dates) > _DATES:
            del self._dates[next(iter(self._dates))]

    def at(self, time_s: float, otherwise_s: float) -> float:
        """Date of the message measured at this time; `otherwise_s` if there is none."""
        return self._dates.get(time_s, otherwise_s)
