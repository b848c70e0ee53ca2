"""Profile of a battery's load: current and ambient temperature over time, piecewise linear."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.errors import InputError
from ohmward.quantities import SECONDS_PER_HOUR


def pulse_profile(capacity_Ah: float, ambient_degC: float = ROOM_DEGC) -> Profile:
    """From full to empty in steps of 10 %, of 5 % at both ends, with pulses before each; [P] 2.2 and 2.3, HPPC manuals.

    A discharge pulse of 1 C and a charge pulse of 0.75 C, 10 s each, 60 s apart; then C/3 for the step and an hour of
    rest. No charge pulse at full, where the battery would not take it.
    """
    Q = capacity_Ah
    full = [(600.0, 0.0), (10.0, -Q), (60.0, 0.0)]
    pulses = [(10.0, -Q), (60.0, 0.0), (10.0, 0.75 * Q), (60.0, 0.0)]
    small = [(0.05 * 3.0 * SECONDS_PER_HOUR, -Q / 3.0), (SECONDS_PER_HOUR, 0.0)]
    large = [(0.10 * 3.0 * SECONDS_PER_HOUR, -Q / 3.0), (SECONDS_PER_HOUR, 0.0)]
    phases = full + small
    for discharge in (small, *8 * (large,), small, small):
        phases += pulses + discharge
    return steps(phases, ambient_degC)


def low_rate_profile(capacity_Ah: float, ambient_degC: float = ROOM_DEGC) -> Profile:
    """Full to empty and back at C/20, with an hour of rest before, between and after."""
    sweep_s, current_A = 20 * SECONDS_PER_HOUR, capacity_Ah / 20
    rest = (SECONDS_PER_HOUR, 0.0)
    return steps([rest, (1.05 * sweep_s, -current_A), rest, (1.1 * sweep_s, current_A), rest], ambient_degC)


def bench_times(profile: Profile) -> np.ndarray:
    """Sample times [s] of a bench logger: every second; every ten seconds once the current was off for a minute."""
    times = np.arange(0.0, profile.time_s[-1], 1.0)
    edges = profile.time_s[1:][np.diff(profile.current_A) != 0.0]
    since_edge = times - np.concatenate([[0.0], edges])[np.searchsorted(edges, times, side="right")]
    resting = np.interp(times, profile.time_s, profile.current_A) == 0.0
    settling = since_edge < 60.0 + EDGE_S
    tenth = np.arange(times.size) % 10 == 0
    return times[~resting | settling | tenth]


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


def constant(duration_s: float, current_A: float) -> Profile:
    """A constant current at 0 degC."""
    return Profile(np.array([0.0, duration_s]), np.full(2, current_A), np.zeros(2))


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
