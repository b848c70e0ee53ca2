"""What the channels of a drive may need before they mean what a DriveLog says; each mending leaves a note.

Each takes the time (T,) [s], the channels (T,) by name in SI units and the columns that they are from, and returns the
channels that it changes with its notes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ohmward.logs.clean import find_gaps
from ohmward.logs.columns import Column
from ohmward.logs.drive_columns import MOTOR_CURRENT, WHEEL_SPEED, kind_of
from ohmward.logs.log import Note

Channels = Mapping[str, np.ndarray]
Columns = Mapping[str, Column]
Mended = tuple[dict[str, np.ndarray], list[Note]]

#: A current that pulls backwards for this share of the time that a wheel turns so must once be negative.
_BACKWARD_SHARE = 0.05

#: Currents that lack in more than one of ten rows with wheel speeds come at a rate of their own.
_TOGETHER_SHARE = 0.9


def yaw_rate_from_heading(time_s: np.ndarray, channels: Channels, columns: Columns) -> Mended:
    """Where there is a heading and no gyro, the yaw rate since the heading before, the short way round."""
    if "yaw_rate" in channels or "heading" not in channels:
        return {}, []
    known = np.flatnonzero(np.isfinite(channels["heading"]))
    rate = np.full(time_s.size, np.nan)
    turned = np.mod(np.diff(channels["heading"][known]) + math.pi, 2 * math.pi) - math.pi
    rate[known[1:]] = turned / np.diff(time_s[known])
    return {"yaw_rate": rate}, [Note("no gyro: the yaw rate is the change of the heading")]


def shared_currents(time_s: np.ndarray, channels: Channels, columns: Columns) -> Mended:
    """Where one column is the current of several wheels, each has its even share."""
    by_column: dict[str, list[str]] = {}
    for quantity in channels:
        if kind_of(quantity) == MOTOR_CURRENT:
            by_column.setdefault(columns[quantity].name, []).append(quantity)
    shared = {name: group for name, group in by_column.items() if len(group) > 1}
    notes = [Note(f"{name!r} is the current of {len(group)} wheels: shared evenly") for name, group in shared.items()]
    return {quantity: channels[quantity] / len(group) for group in shared.values() for quantity in group}, notes


def signed_currents(time_s: np.ndarray, channels: Channels, columns: Columns) -> Mended:
    """Magnitudes of currents, never negative although their wheels turn backwards, with the sign of the wheel."""
    pairs = {
        quantity: channels.get(quantity.replace(MOTOR_CURRENT, WHEEL_SPEED), np.full(values.shape, np.nan))
        for quantity, values in channels.items()
        if kind_of(quantity) == MOTOR_CURRENT
    }
    if any((channels[quantity] < 0).any() for quantity in pairs):
        return {}, []
    backward = {q: (speed < 0) & (channels[q] > 0) for q, speed in pairs.items()}
    if not any(rows.mean() > _BACKWARD_SHARE for rows in backward.values()):
        return {}, []
    signed = {q: np.where(speed < 0, -channels[q], channels[q]) for q, speed in pairs.items()}
    text = (
        "motor currents are never negative although wheels turn backwards: taken as magnitudes with the sign of the "
        "wheel's speed, which is wrong while braking"
    )
    return signed, [Note(text, "warning")]


def bridged_currents(time_s: np.ndarray, channels: Channels, columns: Columns) -> Mended:
    """Currents that come on rows of their own, as straight lines between their samples, but not over gaps."""
    speeds = [np.isfinite(values) for quantity, values in channels.items() if kind_of(quantity) == WHEEL_SPEED]
    rows = np.any(speeds, axis=0) if speeds else np.zeros(time_s.size, dtype=bool)
    known = {q: np.isfinite(values) for q, values in channels.items() if kind_of(q) == MOTOR_CURRENT}
    apart = [q for q, k in known.items() if k.sum() > 1 and (k & rows).sum() < _TOGETHER_SHARE * rows.sum()]
    if not apart:
        return {}, []
    names = ", ".join(quantity.replace("_", " ") for quantity in apart)
    note = Note(f"{names}: sampled on other rows than the wheels, straight lines in between")
    return {q: _bridged(time_s, channels[q], known[q]) for q in apart}, [note]


def _bridged(time_s: np.ndarray, values: np.ndarray, known: np.ndarray) -> np.ndarray:
    line = np.interp(time_s, time_s[known], values[known], left=np.nan, right=np.nan)
    times = time_s[known]
    for gap in find_gaps(times):
        line[(time_s > times[gap]) & (time_s < times[gap + 1])] = np.nan
    return line


#: In this order.
MENDINGS = (yaw_rate_from_heading, shared_currents, signed_currents, bridged_currents)
