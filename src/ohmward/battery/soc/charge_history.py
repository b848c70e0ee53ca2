"""Memory of a stateful estimator: when the battery was last certainly full, and from where charge is counted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np

from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.trace.snapshot import from_json, to_json

#: The battery has certainly been full where SoC stood this close to 1, with a 95 % band no wider than that.
FULL_WITHIN = 0.05
#: A plain number: operations on flags take longer than a step.
_DIVERGED = int(SocFlag.DIVERGED)


class CountingStart(NamedTuple):
    """Moment from which charge is counted: its time ago [s], SoC and standard deviation there."""

    since_s: float
    soc: float
    std: float


class ChargeHistory(NamedTuple):
    """Time since events that anchor SoC [s]; None where there was none."""

    since_full_s: float | None = None  #: since the battery was certainly full
    since_start_s: float | None = None  #: since the estimate began
    #: since the voltage contradicted the estimate for so long that SoC was declared unknown
    since_diverged_s: float | None = None
    anchor: CountingStart | None = None  #: the last of these


class ChargeMemory(NamedTuple):
    """Times of these events [s], nan where there was none, with SoC and its standard deviation at the last of them."""

    start_s: float = math.nan
    full_s: float = math.nan
    diverged_s: float = math.nan
    anchor_s: float = math.nan
    soc: float = math.nan
    std: float = math.nan

    @classmethod
    def of_json(cls, memory: Any) -> Self:
        """The memory in a snapshot.

        Raises:
            InputError: something other than a memory.
        """
        if not isinstance(memory, Mapping):
            raise InputError(f"snapshot memory must be that of snapshot(), got {memory!r:.80}; leave the key out")
        return cls(**{name: from_json(name, memory.get(name)) for name in cls._fields})

    def to_json(self) -> dict[str, float | None]:
        """The memory for a snapshot."""
        return {name: to_json(value) for name, value in self._asdict().items()}

    def after(self, time_s: float, estimate: SocEstimate) -> ChargeMemory:
        """The memory after an estimate."""
        soc, std = float(estimate.soc), float(estimate.soc_std)
        begins, diverged = math.isnan(self.start_s), bool(int(estimate.flags) & _DIVERGED)
        full = is_full(soc, std)
        if not (full or begins or diverged):
            return self
        here = self._replace(anchor_s=time_s, soc=soc, std=std, start_s=time_s if begins else self.start_s)
        if full:
            return here._replace(full_s=time_s)
        return here if begins else here._replace(diverged_s=time_s)

    def after_log(self, time_s: np.ndarray, estimates: SocEstimate) -> ChargeMemory:
        """The memory after estimates (T,) along a log."""
        full = is_full(estimates.soc, estimates.soc_std)
        diverged = (estimates.flags.astype(np.int32) & np.int32(SocFlag.DIVERGED)) > 0
        if not len(full):
            return self
        rows = {0}
        for happened in (full, diverged):
            rows.update(np.flatnonzero(happened)[-1:].tolist())
        memory = ChargeMemory() if time_s[0] < self.anchor_s else self  # times before the clock was set do not count
        for row in sorted(rows):
            here = {name: getattr(estimates, name)[row] for name in ("soc", "soc_std", "flags")}
            memory = memory.after(float(time_s[row]), estimates._replace(**here))
        return memory

    def history(self, now_s: float) -> ChargeHistory:
        """Times since the events."""
        full, start, diverged, anchor = (
            None if math.isnan(event_s) else max(now_s - event_s, 0.0)
            for event_s in (self.full_s, self.start_s, self.diverged_s, self.anchor_s)
        )
        return ChargeHistory(
            full, start, diverged, None if anchor is None else CountingStart(anchor, self.soc, self.std)
        )


def is_full(soc: Any, std: Any) -> Any:
    """True where the battery is certainly full."""
    return (soc >= 1.0 - FULL_WITHIN) & (std * BAND_95 <= FULL_WITHIN)
