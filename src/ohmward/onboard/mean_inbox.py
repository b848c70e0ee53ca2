"""Inbox of a battery: current, voltages and temperature that come apart, each at its own rate, become samples.

A sample is complete when every signal that usually reports has done so, and holds the mean of each over the step. Means
over the same step fit each other: charge is counted whole, and the voltage drop is that of the mean current.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

#: A signal that has not reported for so long is not waited for.
USUAL_S = 10.0

#: No sample waits longer for a signal; so long does the first one wait for signals that have never reported.
LONGEST_S = 1.0


class MeanSample(NamedTuple):
    """Mean of each signal over a step, signals that have not reported left out; time_s: of the newest."""

    time_s: float
    values: dict[str, float]


class MeanInbox:
    """Messages in, samples out.

    Args:
        signals: that belong together; others are passed over.
    """

    def __init__(self, signals: Iterable[str]):
        self.signals = frozenset(signals)
        self._sums: dict[str, float] = {}
        self._counts: dict[str, int] = {}
        self._reported_s: dict[str, float] = {}
        self._began_s = self._newest_s = math.nan
        self._awaited = self.signals

    def put(self, time_s: float, values: Mapping[str, float]) -> MeanSample | None:
        """The sample that the message completes, if it does; nan is not measured."""
        for signal, value in values.items():
            if signal in self.signals and math.isfinite(value):
                self._add(time_s, signal, value)
        if not self._sums or not self._is_complete():
            return None
        return self._close()

    def flush(self) -> MeanSample | None:
        """The sample that is open, at the end."""
        return self._close() if self._sums else None

    def _add(self, time_s: float, signal: str, value: float) -> None:
        if not self._sums:
            self._began_s = time_s
        self._newest_s = time_s if not time_s < self._newest_s else self._newest_s
        self._sums[signal] = self._sums.get(signal, 0.0) + value
        self._counts[signal] = self._counts.get(signal, 0) + 1
        self._reported_s[signal] = self._newest_s

    def _is_complete(self) -> bool:
        return self._awaited <= self._sums.keys() or not self._newest_s - self._began_s < LONGEST_S

    def _close(self) -> MeanSample:
        sample = MeanSample(self._newest_s, {s: self._sums[s] / self._counts[s] for s in self._sums})
        self._sums.clear()
        self._counts.clear()
        for signal in [s for s, at_s in self._reported_s.items() if self._newest_s - at_s > USUAL_S]:
            del self._reported_s[signal]
        self._awaited = frozenset(self._reported_s)
        return sample
