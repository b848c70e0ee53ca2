"""An RC battery, its simulation and its sensors, for the tests of the RC model and its filters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.soc.sample import SocSample
from ohmward.logs import Log
from ohmward_lab.published import rc, rc_circuit

#: A 12 V battery of 6 Ah with R_b = R_s, as in [T]; its open-circuit voltage is a straight line.
EVEN = rc.Circuit(17_000.0, 300.0, 0.03, 0.03, 0.02)
#: The same with three different resistances.
UNEVEN = rc.Circuit(17_000.0, 300.0, 0.05, 0.02, 0.015)
CAPACITY_AH = 6.0
FULL_V = 13.0


class Truth(NamedTuple):
    """What a simulation knows, and what its sensors show: (T,) each, states (T, 2)."""

    samples: SocSample
    states: np.ndarray
    soc: np.ndarray


def model_of(circuit: rc.Circuit) -> rc.RcModel:
    """The battery with this circuit, and with the straight line that its capacitances stand for."""
    span_V = 3600.0 * CAPACITY_AH / (circuit.c_bulk_F + circuit.c_surface_F)
    return rc.RcModel(*circuit, OcvCurve((FULL_V - span_V, FULL_V)), CAPACITY_AH)


def rates(p: rc.Circuit | rc.RcModel) -> tuple[np.ndarray, np.ndarray]:
    """A (2, 2) and B (2,) of dx/dt = A x + B i for x = [V_cb, V_cs]."""
    D = p.r_bulk_ohm + p.r_surface_ohm
    per_bulk, per_surface = 1 / (D * p.c_bulk_F), 1 / (D * p.c_surface_F)
    A = np.array([[-per_bulk, per_bulk], [per_surface, -per_surface]])
    return A, np.array([p.r_surface_ohm * per_bulk, p.r_bulk_ohm * per_surface])


def rates_with_voltage(p: rc.Circuit | rc.RcModel) -> tuple[np.ndarray, np.ndarray]:
    """A (3, 3) and B (3,) of dx/dt = A x + B i for x = [V_cb, V_cs, V] while di/dt = 0 ([P] 2.2, signs restored)."""
    R_b, R_s, R_t = p.r_bulk_ohm, p.r_surface_ohm, p.r_terminal_ohm
    D = R_b + R_s
    A33 = rc_circuit.disturbance_rate(p)
    surface = (R_b**2 / D + R_t + R_s * R_b / D) / (p.c_surface_F * D)
    B31 = surface - R_s * R_t / (p.c_bulk_F * R_b * D)
    A, B = rates(p)
    return np.block([[A, np.zeros((2, 1))], [np.array([[-A33, 0.0, A33]])]]), np.array([*B, B31])


def drive(rng: np.random.Generator, count: int, hold: int = 20) -> np.ndarray:
    """Current (T,) [A] that is new every `hold` samples; the first is zero."""
    current_A = np.repeat(rng.uniform(-8.0, 4.0, count // hold + 1), hold)[:count]
    current_A[0] = 0.0
    return current_A


def simulate(
    circuit: rc.Circuit,
    count: int = 2000,
    seed: int = 0,
    dt_s: float | np.ndarray = 1.0,
    voltage_std_V: float = 0.0,
    current_std_A: float = 0.0,
    offset_A: float = 0.0,
    soc: float = 1.0,
    warming: float = 0.0,
) -> Truth:
    """A battery of this circuit from rest; the current is linear between the samples, as every estimator assumes.

    warming: share of their value that the resistances lose, steadily, until the end.
    """
    rng = np.random.default_rng(seed)
    current_A, dt = drive(rng, count), np.broadcast_to(dt_s, count).copy()
    dt[0] = 0.0
    model = model_of(circuit)
    x, states, voltage_V = rc_circuit.at_rest(model, soc), [], []
    for k in range(count):
        p = scaled(circuit, 1 - warming * k / count)
        x = rc_circuit.next_state(x, 0.5 * (current_A[max(k - 1, 0)] + current_A[k]), p, dt[k])
        states.append(x)
        voltage_V.append(rc_circuit.voltage(x, current_A[k], p)[0])
    measured = SocSample(
        dt,
        current_A + offset_A + current_std_A * rng.standard_normal(count),
        np.array(voltage_V) + voltage_std_V * rng.standard_normal(count),
        np.full(count, np.nan),
    )
    mean_V = (np.array(states) @ circuit[:2]) / sum(circuit[:2])
    low, high = model.ocv.voltage_V
    return Truth(measured, np.array(states), (mean_V - low) / (high - low))


def scaled(circuit: rc.Circuit, share: float) -> rc.Circuit:
    """The circuit with its resistances multiplied by `share`."""
    return rc.Circuit(*circuit[:2], *(share * r for r in circuit[2:]))


def log_of(samples: SocSample) -> Log:
    """The samples as a log."""
    return Log("simulated", np.cumsum(samples.dt_s), samples.current_A, samples.voltage_V)


def lanes(runs: list[Truth]) -> SocSample:
    """The samples of several runs side by side, (T, B) each."""
    return SocSample(*(np.stack(columns, axis=1) for columns in zip(*(run.samples for run in runs), strict=True)))
