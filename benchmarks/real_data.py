"""Common parts of the benchmarks on measured drives: columns, clocks that differ, alarms counted."""

from __future__ import annotations

import csv
from collections.abc import Iterator

import numpy as np

from figure import Figure, at_most, data_file
from ohmward.traction.speed_observer.estimate import SlipAlarm, SlipEstimate

#: False-alarm rates that are stated, and must not be exceeded.
STATED_RATES = (1e-1, 1e-2, 1e-3)


def columns(path: str) -> dict[str, np.ndarray]:
    """The columns of a Parquet or CSV file of the measured data, by name."""
    file = data_file(path)
    if file.suffix == ".csv":
        with file.open(newline="") as lines:
            rows = list(csv.DictReader(lines))
        return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    from pyarrow import parquet

    table = parquet.read_table(file)
    return {name: table[name].to_numpy() for name in table.column_names}


def held(time_s: np.ndarray, values: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """The latest value at or before each time; nan before the first."""
    last = np.searchsorted(time_s, at_s, side="right") - 1
    return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)


def once(time_s: np.ndarray, values: np.ndarray, at_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each value at the first of the times that is not before it, nan elsewhere; and how old it is then [s]."""
    row = np.searchsorted(at_s, time_s)
    there = row < len(at_s)
    arrived, age_s = np.full(len(at_s), np.nan), np.zeros(len(at_s))
    arrived[row[there]], age_s[row[there]] = values[there], at_s[row[there]] - time_s[there]
    return arrived, age_s


def alarm_share(estimates: SlipEstimate, test: SlipAlarm, radius_m: float) -> float:
    """Share of samples and wheels in which this test would raise the alarm."""
    rim_m_s = radius_m * estimates.wheel_speed_rad_s
    return float(np.mean(test.slips(estimates.slip_speed_m_s, estimates.slip_speed_std_m_s, rim_m_s)))


def false_alarms(data: str, method: str, estimates: SlipEstimate, radius_m: float) -> Iterator[Figure]:
    """Alarms where no wheel slips, against each stated rate."""
    for rate in STATED_RATES:
        share = alarm_share(estimates, SlipAlarm(false_alarm_rate=rate), radius_m)
        yield at_most(data, method, f"false alarms at a stated rate of {rate:g}", share, rate, ".2g")
