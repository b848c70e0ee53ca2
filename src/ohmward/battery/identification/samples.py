"""What the fit needs of a record: every sample where something happens, fewer where nothing does."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.charge import find_gaps
from ohmward.battery.identification.record import Record
from ohmward.logs.log import SECONDS_PER_HOUR

FINEST_S = 1.0
COARSEST_S = 60.0
LONG_REST_S = 60.0
_GROWTH = 0.1
# Within a phase of varying current everything is an edge: thin evenly instead.
_EDGE_KINDS = ("rest", "constant")


class Samples(NamedTuple):
    """Samples of one record, (N,) each; what belongs to an interval belongs to the one that ends at the sample.

    dt_s: length of the interval, 0 for the first; moved_Ah: its charge; mean_current_A: its mean current.
    current_A: current at the sample; soc: state of charge there; soc_before: at the sample before.
    voltage_V: measured, nan where it was not.
    starts_at_rest: whether the record starts with a long rest, its overpotentials gone.
    sample: index of each in the log.
    """

    name: str
    time_s: np.ndarray
    dt_s: np.ndarray
    current_A: np.ndarray
    mean_current_A: np.ndarray
    soc: np.ndarray
    soc_before: np.ndarray
    temperature_degC: np.ndarray
    voltage_V: np.ndarray
    starts_at_rest: bool
    sample: np.ndarray


def thin(
    record: Record, soc: np.ndarray, otherwise_degC: float = 25.0, finest_s: float = FINEST_S
) -> tuple[Samples, ...]:
    """The samples at the edges of the current, then ever fewer: every 10 % of the time since, from 1 s up to 60 s.

    The charge of the intervals left out is added up, so nothing of the current is lost. At a gap in the recording,
    during which the course of the current is not known, one part ends and another starts.
    soc: (T,) state of charge along the record.
    """
    kept = _kept(record, finest_s)
    gaps = np.flatnonzero(find_gaps(record.log.time_s))
    parts = np.split(kept, np.searchsorted(kept, gaps))
    return tuple(_part(record, soc, rows, otherwise_degC) for rows in parts if rows.size > 1)


def _part(record: Record, soc: np.ndarray, rows: np.ndarray, otherwise_degC: float) -> Samples:
    time_s = record.log.time_s[rows]
    dt_s = np.diff(time_s, prepend=time_s[0])
    total_Ah = record.charge.total_Ah[rows]
    phase = next(p for p in record.phases if p.last >= rows[0])
    rest_s = record.log.time_s[phase.last] - time_s[0]
    return Samples(
        name=record.log.name,
        time_s=time_s,
        dt_s=dt_s,
        current_A=record.current_A[rows],
        mean_current_A=SECONDS_PER_HOUR * np.diff(total_Ah, prepend=total_Ah[0]) / np.where(dt_s > 0, dt_s, 1.0),
        soc=soc[rows],
        soc_before=np.concatenate([soc[rows[:1]], soc[rows[:-1]]]),
        temperature_degC=record.temperature_degC(otherwise_degC)[rows],
        voltage_V=record.log.voltage_V[rows],
        starts_at_rest=phase.kind == "rest" and (rest_s >= LONG_REST_S or rows[0] > 0),
        sample=rows,
    )


def _kept(record: Record, finest_s: float) -> np.ndarray:
    """(N,) indices of the samples to keep, the first and the last among them."""
    time_s = record.log.time_s
    edges = np.array([p.first for p in record.phases if p.kind in _EDGE_KINDS], dtype=int)
    varying = [p.first for p in record.phases if p.kind == "varying"]
    starts = np.unique(np.concatenate([[0], edges, np.array(varying, dtype=int)]))
    since_s = time_s - time_s[starts[np.searchsorted(starts, np.arange(time_s.size), side="right") - 1]]
    number = _numbered(since_s, finest_s)
    in_varying = np.zeros(time_s.size, dtype=bool)
    for phase in record.phases:
        in_varying[phase.first : phase.last + 1] = phase.kind == "varying"
    number[in_varying] = np.floor(time_s[in_varying] / finest_s)
    new = np.concatenate([[True], number[1:] != number[:-1]])
    new[edges] = True
    gaps = find_gaps(time_s)
    new |= gaps
    new[:-1] |= gaps[1:]
    new[edges[edges > 0] - 1] = True
    new[-1] = True
    return np.flatnonzero(new)


def _numbered(since_s: np.ndarray, finest_s: float) -> np.ndarray:
    """(T,) number of the interval of growing length in which a time since the last edge lies."""
    even_s, coarse_s = finest_s / _GROWTH, COARSEST_S / _GROWTH
    growing = even_s + np.log(np.maximum(np.minimum(since_s, coarse_s), even_s) / even_s) / _GROWTH
    beyond = np.maximum(since_s - coarse_s, 0.0) / COARSEST_S
    return np.floor(np.where(since_s < even_s, since_s / finest_s, even_s / finest_s - even_s + growing + beyond))
