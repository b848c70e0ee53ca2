"""Time on the robot: monotonic inside, wall clock beside it, and the clocks of sources brought to ours.

A wall clock may be stepped by hours while a robot drives, a microcontroller counts from its own start. Everything
inside is on the monotonic clock of this process.
"""

from __future__ import annotations

import math
import time

#: An offset that differs by more than this is that of a clock that was set or a source that has started again.
STEP_S = 1.0

#: Clocks of different crystals drift apart by less than this [s/s]; the smallest delay seen is forgotten as slowly.
DRIFT = 200e-6


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
    between both clocks is the smallest difference of receipt and stamp.
    """

    def __init__(self) -> None:
        self._offset_s = math.nan
        self._at_s = math.nan

    def to_ours(self, stamp_s: float, received_s: float) -> float:
        """Time of the measurement on our clock [s], never after its receipt; that where the stamp is no number."""
        if not math.isfinite(stamp_s):
            return received_s
        offset_s = received_s - stamp_s
        grown_s = self._offset_s + DRIFT * max(received_s - self._at_s, 0.0)
        stepped = not abs(offset_s - grown_s) < STEP_S
        self._offset_s = offset_s if stepped else min(offset_s, grown_s)
        self._at_s = received_s
        return stamp_s + self._offset_s
