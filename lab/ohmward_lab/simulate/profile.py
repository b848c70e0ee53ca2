"""Profile of a battery's load: current and ambient temperature over time, piecewise linear."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.errors import InputError

#: Time [s] in which a switched current changes.
EDGE_S = 0.05


class Profile(NamedTuple):
    """Current [A] (> 0 charges) and ambient temperature [degC] at the times [s], (K,) each; linear between."""

    time_s: np.ndarray
    current_A: np.ndarray
    ambient_degC: np.ndarray


def steps(phases: Sequence[tuple[float, float]], ambient_degC: float = ROOM_DEGC) -> Profile:
    """Constant currents one after the other, with edges of EDGE_S between them.

    phases: (duration_s, current_A) of each; longer than an edge.

    Raises:
        InputError: no phases, or one that is too short.
    """
    durations = np.array([duration for duration, _ in phases], dtype=float)
    if not durations.size or durations.min() <= EDGE_S:
        raise InputError(f"phases must be one or more, each longer than {EDGE_S} s, got {durations.tolist()}")
    current = np.repeat([current for _, current in phases], 2)
    stop = np.cumsum(durations)
    start = np.concatenate([[0.0], stop[:-1] + EDGE_S])
    time = np.column_stack([start, stop]).ravel()
    return Profile(time, current, np.full(time.size, ambient_degC))


def join(profiles: Sequence[Profile]) -> Profile:
    """One profile after the other, with an edge between them; each starts at its own time 0."""
    times: list[np.ndarray] = []
    for profile in profiles:
        start = times[-1][-1] + EDGE_S if times else 0.0
        times.append(start + profile.time_s)
    return Profile(
        np.concatenate(times),
        np.concatenate([p.current_A for p in profiles]),
        np.concatenate([p.ambient_degC for p in profiles]),
    )
