"""Samples of a record for the fit, with all those at the edges of the current, and the model along them.

With the SoC known, the steps of `thevenin.next_state` are taken all at once: an RC pair is a recursion that is linear
in its voltage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.charge_count import begins_interval, find_gaps
from ohmward.battery.identification.ocv_from_logs import OcvBranch
from ohmward.battery.identification.record import Record
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import (
    CircuitInput,
    Thevenin,
    at_rest,
    next_hysteresis,
    next_state,
    pair_decays,
    voltage,
)
from ohmward.logs.log import SECONDS_PER_HOUR
from ohmward.optional import require
from ohmward.trace import Kernel

#: Intervals grow with the time since the last edge, by this share of it, between these [s].
FINEST_S = 1.0
COARSEST_S = 60.0
_GROWTH = 0.1
#: A record that starts with a rest of this length starts without overpotentials [s].
RELAXED_AFTER_S = 60.0
#: Most samples of varying current.
_MOST_VARYING = 6000
#: SoC at which a low-rate branch is fitted; its ends are steep and include the polarisation of a full or empty cell.
_BRANCH_SOC = np.linspace(0.02, 0.98, 97)


class FitSamples(NamedTuple):
    """Samples of one record, (N,) each; values of an interval are those of the one that ends at the sample."""

    time_s: np.ndarray
    dt_s: np.ndarray  #: length of the interval, 0 for the first
    current_A: np.ndarray  #: current at the sample
    mean_current_A: np.ndarray  #: its mean current
    soc: np.ndarray  #: state of charge there
    soc_before: np.ndarray  #: at the sample before
    temperature_degC: np.ndarray
    voltage_V: np.ndarray  #: measured, nan where it was not
    starts_at_rest: bool  #: True where the record starts with a long rest, its overpotentials gone

    @property
    def weight_s(self) -> np.ndarray:
        """Time that each sample stands for: beyond `COARSEST_S` it has an error of its own."""
        return np.minimum(self.dt_s, COARSEST_S)


def thin(record: Record, soc: np.ndarray) -> tuple[FitSamples, ...]:
    """The samples at the edges of the current, then at intervals of 10 % of the time since, from 1 s up to 60 s.

    A varying current is thinned evenly, to 1 s or to 6000 samples. The charge of the intervals left out is added up,
    so none is lost. At a gap in the recording, during which the current is unknown, one part ends and another starts.
    soc: (T,) state of charge along the record.
    """
    used = _used(record)
    gaps = np.flatnonzero(find_gaps(record.log.time_s))
    parts = np.split(used, np.searchsorted(used, gaps))
    return tuple(_part(record, soc, rows) for rows in parts if rows.size > 1)


def thin_branch(branch: OcvBranch, capacity_Ah: float, otherwise_degC: float = ROOM_DEGC) -> FitSamples:
    """The samples of a low-rate branch at every 1 % of SoC, without its ends, as a record of its own."""
    order = np.argsort(branch.soc, kind="stable")
    inside = (branch.soc[order[0]] <= _BRANCH_SOC) & (branch.soc[order[-1]] >= _BRANCH_SOC)
    soc = _BRANCH_SOC[inside]
    voltage_V = np.interp(soc, branch.soc[order], branch.voltage_V[order])
    if branch.direction == "discharge":
        soc, voltage_V = soc[::-1], voltage_V[::-1]
    time_s = np.abs(soc - soc[0]) * SECONDS_PER_HOUR * capacity_Ah / abs(branch.current_A)
    degC = otherwise_degC if branch.temperature_degC is None else branch.temperature_degC
    current_A = np.full(soc.size, branch.current_A)
    return FitSamples(
        time_s=time_s,
        dt_s=np.diff(time_s, prepend=time_s[0]),
        current_A=current_A,
        mean_current_A=current_A,
        soc=soc,
        soc_before=np.concatenate([soc[:1], soc[:-1]]),
        temperature_degC=np.full(soc.size, degC),
        voltage_V=voltage_V,
        starts_at_rest=False,
    )


def _part(record: Record, soc: np.ndarray, rows: np.ndarray) -> FitSamples:
    time_s = record.log.time_s[rows]
    dt_s = np.diff(time_s, prepend=time_s[0])
    total_Ah = record.charge.total_Ah[rows]
    phase = next(p for p in record.phases if p.last >= rows[0])
    rest_s = record.log.time_s[phase.last] - time_s[0]
    return FitSamples(
        time_s=time_s,
        dt_s=dt_s,
        current_A=record.current_A[rows],
        mean_current_A=SECONDS_PER_HOUR * np.diff(total_Ah, prepend=total_Ah[0]) / np.where(dt_s > 0, dt_s, 1.0),
        soc=soc[rows],
        soc_before=np.concatenate([soc[rows[:1]], soc[rows[:-1]]]),
        temperature_degC=record.log.temperature_along(ROOM_DEGC)[rows],
        voltage_V=record.log.voltage_V[rows],
        starts_at_rest=phase.kind == "rest" and (rest_s >= RELAXED_AFTER_S or rows[0] > 0),
    )


def _used(record: Record) -> np.ndarray:
    """(N,) indices of the samples to use, the first and the last among them."""
    time_s = record.log.time_s
    starts = np.array([p.first for p in record.phases])
    varying = np.concatenate([np.full(p.last - p.first + 1, p.kind == "varying") for p in record.phases])
    edges = starts[~varying[starts]]
    since_s = time_s - time_s[np.repeat(starts, np.diff(starts, append=time_s.size))]
    even_s = max(FINEST_S, float(np.diff(time_s)[varying[1:]].sum()) / _MOST_VARYING)
    number = np.where(varying, np.floor(time_s / even_s), _interval_number(since_s))
    used = begins_interval(number, find_gaps(time_s))
    used[edges] = True
    used[edges[edges > 0] - 1] = True
    return np.flatnonzero(used)


def _interval_number(since_s: np.ndarray) -> np.ndarray:
    """(T,) number of the growing interval in which a time since the last edge lies."""
    even_s, coarse_s = FINEST_S / _GROWTH, COARSEST_S / _GROWTH
    growing = np.log(np.clip(since_s, even_s, coarse_s) / even_s) / _GROWTH
    beyond = np.maximum(since_s - coarse_s, 0.0) / COARSEST_S
    return np.floor(np.where(since_s < even_s, since_s / FINEST_S, even_s / FINEST_S + growing + beyond))


def scan(decay: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """Recursion v_k = decay_k v_(k-1) + drive_k with v_0 = drive_0, for each column of drive (N,) or (N, K)."""
    solve_banded = require("scipy.linalg", "identification").solve_banded

    band = np.ones((2, decay.size))
    band[1, :-1] = -decay[1:]
    band[1, -1] = 0.0
    return solve_banded((1, 0), band, drive, check_finite=False)


def simulate(samples: FitSamples, p: Thevenin, start_V: Sequence[float] = (), hysteresis: float = 0.0) -> np.ndarray:
    """(N,) terminal voltage [V] along the samples; the SoC is that of the samples, not counted again.

    start_V: (n,) RC voltages at the first sample, () for rest; hysteresis: state h there.
    """
    x = at_rest(samples.soc, p)
    for j, step in enumerate(pair_steps(samples, p), start=1):
        driven_V = np.append(start_V[j - 1] if start_V else 0.0, step.drive_V[1:])
        x[j] = scan(step.decay, driven_V)
    x[-1] = hysteresis_along(samples, p, (hysteresis,))[:, 0]
    return voltage(x, CircuitInput(samples.current_A, samples.temperature_degC), p)[0]


class PairSteps(NamedTuple):
    """Steps of an RC pair along a record: v_k = decay_k v_(k-1) + drive_k."""

    decay: np.ndarray  #: (N,)
    drive_V: np.ndarray  #: (N,)


def pair_steps(samples: FitSamples, p: Thevenin) -> list[PairSteps]:
    """The steps of each RC pair."""
    u = CircuitInput(samples.mean_current_A, samples.temperature_degC)
    _, *drives_V, _ = next_state(at_rest(samples.soc_before, p), u, p, samples.dt_s)
    decays = pair_decays(u, p, samples.dt_s)
    return [PairSteps(decay, drive_V) for decay, drive_V in zip(decays, drives_V, strict=True)]


def hysteresis_along(samples: FitSamples, p: Thevenin, starts: Sequence[float]) -> np.ndarray:
    """(N, S) hysteresis state along the samples, from each of these starts."""
    moved = samples.dt_s * (p.hysteresis_rate / p.capacity_As)
    return hysteresis_by_charge(samples.mean_current_A, moved, starts, p.net_charge_hysteresis)


def hysteresis_by_charge(
    current_A: np.ndarray, moved: np.ndarray, starts: Sequence[float], net_charge: bool = False
) -> np.ndarray:
    """(N, S) hysteresis state from each of these starts; moved: (N,) change by 1 A, rate times time over capacity."""
    start = np.array(starts, dtype=float)
    return np.asarray(_hysteresis_kernel(net_charge, start.size).scan(start, (current_A, moved))[1])


@cache
def _hysteresis_kernel(net_charge: bool, starts: int) -> Kernel:
    """The step of the hysteresis, compiled once for all batteries: a capacity of 1 A s, a rate of 1."""
    zero = (0.0, 0.0)
    unit = Thevenin(1.0 / SECONDS_PER_HOUR, OcvCurve((0.0, 1.0)), zero, zero, (), ())
    unit = replace(unit, hysteresis_rate=1.0, net_charge_hysteresis=net_charge)

    def step(h: np.ndarray, sample: tuple[Any, Any]) -> tuple[np.ndarray, np.ndarray]:
        current_A, moved = sample
        after = np.array([next_hysteresis(each, current_A, moved, unit) for each in h])
        return after, after

    return Kernel(step, np.zeros(starts), (0.0, 0.0))
