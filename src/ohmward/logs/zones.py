"""Local clocks: their time as UTC, and the hours in which they are put forward and back."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.dates import text_of
from ohmward.logs.hints import zone_of
from ohmward.runs import runs

#: Zones whose clocks are put forward and back at times of their own.
_CHANGING = (
    "Europe/London", "Europe/Berlin", "Europe/Athens", "America/New_York", "America/Chicago", "America/Denver",
    "America/Los_Angeles", "Australia/Sydney",
)  # fmt: skip
#: Offsets change at full quarters of an hour.
_QUARTER_S = 900.0
_HOUR_S = 3600.0
#: A change of clocks is looked for where the time goes by an hour this far from exactly [s].
_ABOUT_S = 120.0


def to_utc(local_s: np.ndarray, timezone: str) -> np.ndarray:
    """(T,) seconds since 1970 in UTC of local clocks (T,), nan stays.

    Of an hour that comes twice the rows after the one at which the time falls are the second.
    """
    zone = zone_of(timezone)
    known = np.isfinite(local_s)
    quarter, at = np.unique(np.floor(local_s[known] / _QUARTER_S), return_inverse=True)
    offsets = np.array([[_offset_s(zone, q * _QUARTER_S, fold) for fold in (0, 1)] for q in quarter]).reshape(-1, 2)
    early, late = offsets[at, 0], offsets[at, 1]
    twice = early > late
    utc_s = local_s[known] - early
    falls = np.concatenate([[0.0], np.diff(local_s[known])]) < 0
    second = np.zeros(twice.size, dtype=bool)
    for first, stop in runs(twice):
        fallen = np.flatnonzero(falls[first:stop])
        if fallen.size:
            second[first + fallen[0] : stop] = True
    utc_s[second] = local_s[known][second] - late[second]
    found = np.full(local_s.size, np.nan)
    found[known] = utc_s
    return found


def require_no_change(source: str, column: str, local_s: np.ndarray) -> None:
    """Refuse dates without a zone that go over the hour at which clocks are put forward or back.

    local_s: (T,) as they are written.

    Raises:
        InputError: the log has a gap of an hour, or goes back by one, where the clocks of some zone do.
    """
    known = local_s[np.isfinite(local_s)]
    for before, after in _hours(known):
        for name in _CHANGING:
            if _changes(ZoneInfo(name), before, after):
                what = "from which clocks are put forward" if after > before else "at which clocks are put back"
                raise InputError(
                    f"{source}: column {column!r} goes from {text_of(before)} to {text_of(after)}, {what} in the zone "
                    f"of {name}; say the zone with --timezone {name} (FileHints(timezone={name!r})), or "
                    "--timezone UTC where the clock is never changed"
                )


def _hours(local_s: np.ndarray) -> Iterator[tuple[float, float]]:
    """The neighbours between which about an hour is left out, or comes again."""
    steps = np.diff(local_s)
    if not steps.size:
        return
    usual = float(np.median(np.abs(steps)))
    for k in np.flatnonzero(np.abs(np.abs(steps - usual) - _HOUR_S) <= _ABOUT_S):
        yield float(local_s[k]), float(local_s[k + 1])


def _changes(zone: ZoneInfo, before_s: float, after_s: float) -> bool:
    """True where clocks of the zone leave out or repeat the hour between two readings."""
    if after_s > before_s:
        first = np.ceil(before_s / _QUARTER_S + 1e-9) * _QUARTER_S
        return _offset_s(zone, first, 0) < _offset_s(zone, first, 1)
    return _offset_s(zone, after_s, 0) > _offset_s(zone, after_s, 1)


def _offset_s(zone: ZoneInfo, local_s: float, fold: int) -> float:
    moment = datetime(1970, 1, 1, tzinfo=zone) + timedelta(seconds=float(local_s))
    offset = moment.replace(fold=fold).utcoffset()
    return offset.total_seconds() if offset else 0.0
