"""Ohmic resistance from the edges of the current, where the voltage jumps by R_0 di ([P] 2.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.record import Record
from ohmward.filters.consistency import BAND_95
from ohmward.logs.log import Note

#: Longest interval across an edge [s], where the log is no slower.
SLOWEST_EDGE_S = 2.0
#: Smallest edge: C/10.
_SMALLEST_RATE = 1 / 10
#: Fewest edges for a resistance with a standard error.
_FEWEST_EDGES = 3


class Edge(NamedTuple):
    """One jump of the current from one sample to the next."""

    log_name: str
    sample: int  #: the one after the jump
    dt_s: float  #: interval across it; soc there
    soc: float
    step_A: float  #: change of the current
    current_A: float  #: the larger of both in magnitude, whose sign is the direction
    resistance_ohm: float  #: dV / dI


class OhmicResistance(NamedTuple):
    """R_0 of one direction from all its edges: weighted mean [ohm], its standard error, the number of edges."""

    ohm: float
    std_ohm: float
    edges: int


def find_edges(record: Record, soc: np.ndarray, capacity_Ah: float) -> tuple[Edge, ...]:
    """Jumps of the current of more than C/10 within 2 s (or the log's own interval, if that is longer).

    In an interval of dt the RC pairs move as well: the resistance is R_0 and a part of r_1 of about dt/tau_1.
    soc: (T,) state of charge along the record.
    """
    time_s, current_A, voltage_V = record.log.time_s, record.current_A, record.log.voltage_V
    dt_s, step_A, step_V = np.diff(time_s), np.diff(current_A), np.diff(voltage_V)
    longest_s = max(SLOWEST_EDGE_S, 1.5 * float(np.median(dt_s)))
    sharp = (np.abs(step_A) > _SMALLEST_RATE * capacity_Ah) & (dt_s <= longest_s) & np.isfinite(step_V)
    larger_A = np.where(np.abs(current_A[1:]) > np.abs(current_A[:-1]), current_A[1:], current_A[:-1])
    rows = np.flatnonzero(sharp)
    columns = (rows + 1, dt_s[rows], soc[rows + 1], step_A[rows], larger_A[rows], step_V[rows] / step_A[rows])
    return tuple(Edge(record.log.name, *values) for values in zip(*(c.tolist() for c in columns), strict=True))


def ohmic_resistance(edges: Sequence[Edge], direction: int) -> OhmicResistance | None:
    """R_0 in discharge (direction -1) or charge (1): least squares of dV over dI, or None from fewer than 3 edges."""
    mine = [e for e in edges if np.sign(e.current_A) == direction]
    if len(mine) < _FEWEST_EDGES:
        return None
    step_A = np.array([e.step_A for e in mine])
    ohm = np.array([e.resistance_ohm for e in mine])
    weight = step_A**2 / np.sum(step_A**2)
    mean = float(weight @ ohm)
    return OhmicResistance(mean, float(np.sqrt(np.sum(weight**2 * (ohm - mean) ** 2))), len(mine))


def edge_notes(edges: Sequence[Edge]) -> tuple[Note, ...]:
    """Notes on R_0 of each direction from its edges, to compare with the fit."""
    found = {word: ohmic_resistance(edges, sign) for word, sign in (("discharge", -1), ("charge", 1))}
    return tuple(
        Note(f"{r.edges} edges show R_0 = {1e3 * r.ohm:.3g} ± {1e3 * BAND_95 * r.std_ohm:.2g} mohm in {word}")
        for word, r in found.items()
        if r
    )
