"""Batteries, tests on a bench and measured data that the tests of the identification share."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from needs import measured_file
from ohmward.battery import identification
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward.logs import Log, read_log
from ohmward_lab.simulate.voltage import simulate_voltage

RESISTANCE_GRID = np.linspace(0, 1, 21)
OCV_GRID = np.linspace(0, 1, 201)
NMC_OCV = OcvCurve(tuple(3.4 + 0.75 * OCV_GRID - 0.35 * np.exp(-15 * OCV_GRID) + 0.04 * np.sin(6 * OCV_GRID)))
LFP_OCV = OcvCurve(
    tuple(3.2 + 0.1 * OCV_GRID - 0.6 * np.exp(-25 * OCV_GRID) + 0.15 * np.exp(-60 * (1 - OCV_GRID))), (0.015,) * 201
)


def cell(
    ocv: OcvCurve = NMC_OCV, capacity_Ah: float = 2.0, tau_s: tuple[float, ...] = (20.0, 800.0), **other
) -> Thevenin:
    """A cell with constant resistances on the grid of the fit: r0 30 mohm, pairs 10 and 25 mohm."""

    def flat(ohm: float) -> tuple[float, ...]:
        return (ohm,) * RESISTANCE_GRID.size

    pairs = tuple(flat(ohm) for ohm in (0.010, 0.025, 0.008)[: len(tau_s)])
    return Thevenin(capacity_Ah, ocv, flat(0.030), flat(0.030), pairs, tau_s, **other)


def play(
    p: Thevenin,
    time_s: np.ndarray,
    current_A: np.ndarray,
    soc: float,
    *,
    std_V: float = 0.0,
    seed: int = 0,
    name: str = "log",
) -> Log:
    """What a logger would see of the cell from rest at `soc`; time_s, current_A: (T,)."""
    true_V = simulate_voltage(p, Log(name, time_s, current_A, np.zeros(time_s.size)), soc).voltage_V
    noise_V = np.random.default_rng(seed).normal(0.0, std_V, time_s.size) if std_V else 0.0
    return Log(name, time_s, current_A, true_V + noise_V)


def steps(phases: Sequence[tuple[float, float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Time (T,) and current (T,) of phases (duration [s], current [A], sampling interval [s]); steps take 0.1 s."""
    times, currents, start = [], [], 0.0
    for duration_s, current_A, dt_s in phases:
        inner = np.append(np.arange(0.1, duration_s, dt_s), duration_s)
        times.append(start + inner)
        currents.append(np.full(inner.size, current_A))
        start += duration_s
    return np.concatenate([[0.0], *times]), np.concatenate([[phases[0][1]], *currents])


def pulse_phases(capacity_Ah: float = 2.0, count: int = 10, rest_s: float = 3600.0) -> list[tuple[float, float, float]]:
    """From full downwards: a 1 C discharge pulse, a pause, a 0.75 C charge pulse, a step of SoC at C/2, a rest."""
    C = capacity_Ah
    share = 0.97 / count - 22.5 / 3600
    first = [(rest_s / 4, 0.0, 30.0)]
    pulses = [(30.0, -C, 1.0), (60.0, 0.0, 2.0), (10.0, 0.75 * C, 1.0), (60.0, 0.0, 2.0)]
    once = [*pulses, (share * 7200.0, -C / 2, 20.0), (rest_s, 0.0, 30.0)]
    return first + once * count


@cache
def pulse_log(p: Thevenin, *, std_V: float = 0.0, seed: int = 0, **how) -> Log:
    return play(p, *steps(pulse_phases(p.capacity_Ah, **how)), soc=1.0, std_V=std_V, seed=seed, name="pulses")


@cache
def low_rate_logs(p: Thevenin) -> tuple[Log, Log]:
    """A discharge from full and a charge from empty at C/30."""
    current_A, sweep_s = p.capacity_Ah / 30, 30 * 3600.0
    down = play(p, *steps([(600.0, 0.0, 60.0), (sweep_s, -current_A, 60.0)]), soc=1.0, name="down")
    up = play(p, *steps([(600.0, 0.0, 60.0), (sweep_s, current_A, 60.0)]), soc=0.0, name="up")
    return down, up


def measured(path: str, **how) -> Log:
    """A measured log; the test is skipped where it is not at hand."""
    return read_log(measured_file(path), **how)


def identify(*args: Any, **how: Any) -> Any:
    """As the package's; the tests know which of the optional parts of the battery are there."""
    return identification.identify(*args, **how)


def identify_in_detail(*args: Any, **how: Any) -> Any:
    """As the package's; the tests know which of the optional parts of the battery are there."""
    return identification.identify_in_detail(*args, **how)
