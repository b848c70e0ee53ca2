"""Thevenin model along a log with its sensitivities to corrections of the file, derived by the compiler.

The step is that of `thevenin.next_state` and `thevenin.voltage`; q are the corrections theta and the RC voltages at the
start:

    x+ = f(x, theta)      S+ = df/dx S + df/dq        V = g(x+, theta)      dV/dq = dg/dx S+ + dg/dq

A `Kernel` scans it. The corrections are a constant state, so that one kernel serves every iteration of a fit. The
derivatives of the voltage are taken at constant SoC: its effect through the curve is left to the user of the curve, and
a resistance that depends on SoC says nothing about SoC, since its course along SoC is known far less than the curve.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.thevenin import (
    CircuitInput,
    Corrections,
    Thevenin,
    next_state,
    overpotentials,
    scaled_hysteresis,
    voltage,
)
from ohmward.trace import Expression, Kernel, linearize, trace, where


class CircuitSample(NamedTuple):
    """Sample of a log; scalars, or arrays along it."""

    dt_s: Any  #: since the sample before
    mean_current_A: Any  #: between the two, by the sensor; 0 at the first sample and after a gap
    current_A: Any  #: at the sample, by the sensor
    temperature_degC: Any
    counted: Any  #: 1.0, or 0.0 at the first sample and after a gap, where the current is not known
    moved: Any  #: change of SoC beyond what the current of this interval shows
    offset_A: Any  #: of the sensor at this time beyond the corrections [A]
    start_V: Any  #: (n,) change of the RC voltages at the first sample and after a gap, else 0
    start_h: Any  #: (3,) hysteresis there, see `CircuitState`


class CircuitState(NamedTuple):
    """State of the circuit along a log with its sensitivities."""

    circuit: Any  #: (n + 1,) SoC and RC voltages
    #: (3,) hysteresis from a start below the most likely one, from that, and from one above: a state that saturates is
    #: not linear in its start
    hysteresis: Any
    sensitivities: Any  #: those of (n + 1, Q) that are not always 0
    theta: Any  #: (P,) corrections


class CircuitAlong(NamedTuple):
    """Circuit at every sample (T, ...). The Q unknowns are the P corrections, then the n RC voltages at the start."""

    soc: Any  #: by the capacity of the file
    voltage_V: Any
    over_V2: Any  #: sum of the squares of the overpotentials [V^2]
    soc_columns: Any  #: (T, C) by the corrections that move SoC, see `SensitiveCircuit.moving`
    #: (T, Q) of the voltage at constant SoC; those by RC voltages refer to the start or to the last gap before
    voltage_columns: Any
    hysteresis_V: Any  #: difference of the voltages from the upper and the lower hysteresis at the start
    left: Any  #: (T, n) share of the RC voltages at the start, or at the last gap before, that is left at this sample


class SensitiveCircuit(NamedTuple):
    """Circuit with its sensitivities; equal circuits share a kernel."""

    model: Thevenin  #: its open-circuit curve is part of the voltage, not of the columns; `without_curve` has none
    sizes: Corrections  #: number of each of the corrections

    def corrections(self, theta: Any) -> Corrections:
        """The corrections of a vector (P,)."""
        ends = np.cumsum(self.sizes).tolist()
        return Corrections(*(theta[end - size : end] for end, size in zip(ends, self.sizes, strict=True)))

    @property
    def moving(self) -> np.ndarray:
        """(C,) places of the corrections that move SoC; all others never do."""
        _, pattern = _kernel(self)
        return np.flatnonzero(pattern[0, : sum(self.sizes)])

    def along(self, theta: np.ndarray, soc: float, samples: CircuitSample) -> CircuitAlong:
        """The circuit along a log with the corrections theta (P,), from this SoC."""
        kernel, pattern = _kernel(self)
        n = self.model.pairs
        none = np.zeros(np.count_nonzero(pattern))
        start = CircuitState(np.array([soc, *([0.0] * n)]), np.zeros(3), none, theta)
        found: CircuitAlong = kernel.scan(start, samples)[1]
        return found

    def step(self, pattern: np.ndarray, state: CircuitState, sample: CircuitSample) -> tuple[CircuitState, Any]:
        """One sample; pattern: (n + 1, Q) True where a sensitivity is not always 0."""
        p, n, P = self.model, self.model.pairs, sum(self.sizes)
        S = np.zeros(pattern.shape, dtype=object)
        S[pattern] = state.sensitivities
        x, F = self.next_circuit(state, sample)
        S = F[:, : n + 1] @ S
        S[:, :P] = S[:, :P] + F[:, n + 1 :]
        left = np.array([S[1 + j, P + j] for j in range(n)])
        for j, share in enumerate(left):
            S[1 + j, P + j] = where(sample.counted > 0.0, share, 1.0)
        h = self.next_hysteresis(state, sample)
        u = CircuitInput(sample.current_A - sample.offset_A, sample.temperature_degC)

        def terminal_V(z: np.ndarray) -> np.ndarray:
            k = self.corrections(z[n + 2 :])
            there = CircuitInput(u.current_A - k.offset_A, u.temperature_degC)
            hysteresis = scaled_hysteresis(z[n + 1], k.hysteresis_ratio, p)
            return voltage(np.array([x[0], *z[1 : n + 1], hysteresis]), there, p, k)

        V, G = linearize(terminal_V, np.array([*x, h[1], *state.theta]))
        columns = (G[:, : n + 1] @ S)[0]
        columns[:P] = columns[:P] + G[0, n + 2 :]
        k = self.corrections(state.theta)
        over_V = overpotentials(np.array([*x, h[1]]), u._replace(current_A=u.current_A - k.offset_A), p, k)
        after = CircuitState(x, h, S[pattern], state.theta)
        width_V = G[0, n + 1] * (h[2] - h[0])
        of_soc = S[0, :P][pattern[0, :P]]
        out = CircuitAlong(x[0], V[0], sum(v * v for v in over_V), of_soc, columns, width_V, left)
        return after, out

    def next_circuit(self, state: CircuitState, sample: CircuitSample) -> tuple[np.ndarray, np.ndarray]:
        """SoC and RC voltages (n + 1,) after the step, and their derivatives (n + 1, n + 1 + P) by state and theta."""
        n = self.model.pairs

        def after(z: np.ndarray) -> np.ndarray:
            k = self.corrections(z[n + 1 :])
            current_A = sample.mean_current_A - sample.counted * (sample.offset_A + k.offset_A)
            u = CircuitInput(current_A, sample.temperature_degC)
            at = state.circuit[0]
            soc, *v, _ = next_state(np.array([at, *z[1 : n + 1], 0.0]), u, self.model, sample.dt_s, k)
            start_V = np.asarray(sample.start_V).tolist()
            return np.array(
                [z[0] + (soc - at) + sample.moved, *(vj + more_V for vj, more_V in zip(v, start_V, strict=True))]
            )

        return linearize(after, np.array([*state.circuit, *state.theta]))

    def next_hysteresis(self, state: CircuitState, sample: CircuitSample) -> np.ndarray:
        """(3,) hysteresis after the step, by the current of the sensor: its offset is small beside what moves it."""
        u = CircuitInput(sample.mean_current_A, sample.temperature_degC)
        after = [next_state(np.array([*state.circuit, h]), u, self.model, sample.dt_s)[-1] for h in state.hysteresis]
        starts = np.asarray(sample.start_h).tolist()
        return np.array([where(sample.counted > 0.0, h, start) for h, start in zip(after, starts, strict=True)])


@lru_cache(maxsize=8)
def _kernel(circuit: SensitiveCircuit) -> tuple[Kernel, np.ndarray]:
    """The compiled step of a circuit, and the pattern of its sensitivities."""
    n, P = circuit.model.pairs, sum(circuit.sizes)
    sample = CircuitSample(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(n), np.zeros(3))
    bare = CircuitState(np.zeros(n + 1), np.zeros(3), np.zeros(0), np.zeros(P))
    jacobian = trace(lambda state, sample: circuit.next_circuit(state, sample)[1], bare, sample).outputs
    pattern = _pattern(
        np.array([isinstance(entry, Expression) or entry != 0.0 for entry in jacobian]).reshape(n + 1, n + 1 + P)
    )
    example = bare._replace(sensitivities=np.zeros(np.count_nonzero(pattern)))
    return Kernel(lambda state, sample: circuit.step(pattern, state, sample), example, sample), pattern


def _pattern(jacobian: np.ndarray) -> np.ndarray:
    """(n + 1, Q) True where a sensitivity is not always 0, by where the derivatives of the step are not."""
    states = len(jacobian)
    by_state, by_theta = jacobian[:, :states], jacobian[:, states:]
    pattern = np.hstack([by_theta, np.eye(states, dtype=bool)[:, 1:]])
    for _ in range(states):
        pattern = pattern | (by_state @ pattern)
    return pattern
