"""The Thevenin model along a whole record, at a known state of charge.

The steps are `thevenin.next_state`, all of a record at once: with the SoC known, an RC pair is a recursion that is
linear in its voltage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, next_hysteresis, next_state, pair_decays, voltage
from ohmward.logs.log import SECONDS_PER_HOUR
from ohmward.optional import require
from ohmward.trace import Kernel


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
    starts = start_V or (0.0,) * p.pairs
    pairs = [scan(s.decay, np.append(v0, s.drive_V[1:])) for s, v0 in zip(pair_steps(samples, p), starts, strict=True)]
    h = hysteresis_along(samples, p, (hysteresis,))[:, 0]
    return voltage(np.array([samples.soc, *pairs, h]), CircuitInput(samples.current_A, samples.temperature_degC), p)[0]


class PairSteps(NamedTuple):
    """Steps of an RC pair along a record: v_k = decay_k v_(k-1) + drive_k."""

    decay: np.ndarray  #: (N,)
    drive_V: np.ndarray  #: (N,)


def pair_steps(samples: FitSamples, p: Thevenin) -> list[PairSteps]:
    """The steps of each RC pair."""
    u = CircuitInput(samples.mean_current_A, samples.temperature_degC)
    nothing = np.zeros(samples.soc.size)
    _, *drives_V, _ = next_state(np.array([samples.soc_before, *([nothing] * (p.pairs + 1))]), u, p, samples.dt_s)
    decays = pair_decays(u, p, samples.dt_s)
    return [PairSteps(decay, drive_V) for decay, drive_V in zip(decays, drives_V, strict=True)]


def hysteresis_along(samples: FitSamples, p: Thevenin, starts: Sequence[float]) -> np.ndarray:
    """(N, S) hysteresis state from each of these at the first sample."""
    moved = samples.dt_s * (p.hysteresis_rate / p.capacity_As)
    start = np.array(starts, dtype=float)
    return np.asarray(
        _hysteresis_kernel(p.net_charge_hysteresis, start.size).scan(start, (samples.mean_current_A, moved))[1]
    )


@cache
def _hysteresis_kernel(net_charge: bool, starts: int) -> Kernel:
    """The step of the hysteresis, compiled once for all batteries: a capacity of 1 A s, a rate of 1."""
    unit = Thevenin(1.0 / SECONDS_PER_HOUR, OcvCurve((0.0, 1.0)), (0.0, 0.0), (0.0, 0.0), (), (), hysteresis_rate=1.0)
    unit = replace(unit, net_charge_hysteresis=net_charge)

    def step(h: np.ndarray, sample: tuple[Any, Any]) -> tuple[np.ndarray, np.ndarray]:
        current_A, moved = sample
        after = np.array([next_hysteresis(each, current_A, moved, unit) for each in h])
        return after, after

    return Kernel(step, np.zeros(starts), (0.0, 0.0))
