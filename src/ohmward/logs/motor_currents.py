"""The currents of motors, mended: one column for several motors, magnitudes without a sign, a rate of their own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from ohmward.logs.clean import find_gaps
from ohmward.logs.note import Note

#: A current that pulls backwards for this fraction of the samples must once be negative.
_BACKWARD_FRACTION = 0.05

#: Currents present in less than nine of ten rows with wheel speeds come at a rate of their own.
_OWN_RATE_FRACTION = 0.9

Mended = tuple[np.ndarray, list[Note]]


def mend_currents(
    time_s: np.ndarray,
    current_A: np.ndarray,
    speed_rad_s: np.ndarray,
    columns: Sequence[str],
    places: Sequence[str],
) -> Mended:
    """The currents of the driven motors as they must have been, and a note on each mending.

    time_s: (T,) [s]; current_A: (T, driven) [A]; speed_rad_s: (T, wheels) [rad/s], driven ones first.
    columns: name of the column of each motor, empty where there is none; places: names of the driven wheels.
    """
    current_A, shared = _share(current_A, columns)
    current_A, signed = _sign(current_A, speed_rad_s[:, : len(places)])
    current_A, bridged = _bridge(time_s, current_A, np.isfinite(speed_rad_s).any(axis=1), places)
    return current_A, [*shared, *signed, *bridged]


def _share(current_A: np.ndarray, columns: Sequence[str]) -> Mended:
    """Even shares of each current that is that of several motors."""
    shared = {name: count for name, count in Counter(columns).items() if name and count > 1}
    notes = [Note(f"{name!r} is the current of {count} wheels: shared evenly") for name, count in shared.items()]
    return current_A / np.array([shared.get(name, 1) for name in columns]), notes


def _sign(current_A: np.ndarray, speed_rad_s: np.ndarray) -> Mended:
    """Currents with the sign of their wheel where none is ever negative although wheels turn backwards."""
    backward = speed_rad_s < 0
    often = ((backward & (current_A > 0)).mean(axis=0) > _BACKWARD_FRACTION).any()
    if not often or (current_A < 0).any():
        return current_A, []
    text = (
        "motor currents are never negative although wheels turn backwards: taken as magnitudes with the sign of the "
        "wheel's speed, which is wrong while braking"
    )
    return np.where(backward, -current_A, current_A), [Note(text, "warning")]


def _bridge(time_s: np.ndarray, current_A: np.ndarray, wheels_measured: np.ndarray, places: Sequence[str]) -> Mended:
    """Straight lines between the samples of currents that come on rows of their own, but not over gaps."""
    known = np.isfinite(current_A)
    together = (known & wheels_measured[:, None]).sum(axis=0)
    apart = np.flatnonzero((known.sum(axis=0) > 1) & (together < _OWN_RATE_FRACTION * wheels_measured.sum()))
    if not apart.size:
        return current_A, []
    bridged = current_A.copy()
    for motor in apart:
        rows = known[:, motor]
        times = time_s[rows]
        line = np.interp(time_s, times, current_A[rows, motor], left=np.nan, right=np.nan)
        for gap in find_gaps(times):
            line[(time_s > times[gap]) & (time_s < times[gap + 1])] = np.nan
        bridged[:, motor] = line
    names = ", ".join(f"{places[int(motor)]} motor current".replace("_", " ") for motor in apart)
    return bridged, [Note(f"{names}: sampled on other rows than the wheels, straight lines in between")]
