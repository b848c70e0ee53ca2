"""The adaptive unscented filter of [T] section 3.3: the RC battery model with its parameters as states, seven in all.

x = [V_cb, V_cs, V, 1/C_b, 1/C_s, 1/R_e, R_t] divided by SCALE, so that every element is of order one; y = V. An example
of a filter on a model with parameter states, and the yardstick for the size and the speed of the compiled step.
"""

from __future__ import annotations

import numpy as np

from ohmward.filters import Belief, adaptive
from ohmward.filters.adaptive import Matching
from ohmward_lab.published.scheme_by_method import pack, unpack

SCALE = np.array([1, 1, 1, 1e-4, 1e-2, 50, 1e-2])
TRUE_PARAMETERS = np.array([1.2, 0.8, 1.1, 0.9])
NOISE_STD_V = 2e-3
MATCHING = Matching(Q_floor=np.diag([1e-10, 1e-10, 1e-8, 1e-8, 1e-8, 1e-8, 1e-8]), R_floor=np.array([[1e-7]]))
START = adaptive.init(
    Belief(np.array([12.8, 12.8, 12.8, 1.0, 1.0, 1.0, 1.0]), np.diag([1e-2, 1e-2, 1e-4, 0.04, 0.04, 0.04, 0.04])),
    MATCHING.Q_floor,
    np.array([[4e-6]]),
)


def next_state(z, current_A, dt_s=1.0):
    """Euler step of the RC model with R_b = R_s = R_e and constant current > 0 charging; z: (7,) scaled state.

    V_cs is eliminated from dV/dt, which leaves it a stable equation.
    """
    bulk_V, surface_V, terminal_V, per_bulk, per_surface, per_R_e, R_t = (
        z[i] * SCALE[i] if SCALE[i] != 1 else z[i] for i in range(7)
    )
    flow_A = per_R_e * (surface_V - bulk_V)
    bulk_rate = 0.5 * per_bulk * (flow_A + current_A)
    surface_rate = 0.5 * per_surface * (current_A - flow_A)
    relaxation = (per_surface - per_bulk) * per_R_e * (bulk_V - terminal_V + R_t * current_A)
    terminal_rate = 0.5 * (relaxation + per_surface * current_A)
    return np.array(
        [
            bulk_V + dt_s * bulk_rate,
            surface_V + dt_s * surface_rate,
            terminal_V + dt_s * terminal_rate,
            z[3],
            z[4],
            z[5],
            z[6],
        ]
    )


def terminal_voltage(z):
    """Terminal voltage [V], (1,)."""
    return z[2:3]


def step(state, sample, filter_step=adaptive.unscented_step_reusing_points, matching=MATCHING):
    """One sample (current_A, voltage_V) through the adaptive filter."""
    current_A, voltage_V = sample
    y = np.array([voltage_V])
    return filter_step(state, lambda z: next_state(z, current_A), terminal_voltage, y, matching)


PACKED = pack(START)


def packed_step(packed, sample, filter_step=adaptive.unscented_step_reusing_points):
    """The same as a kernel takes it: the state after a sample; its mean, and the innovation [V]."""
    state, innovation = step(unpack(packed), sample, filter_step)
    return pack(state), (state.belief.mean, innovation.value[0])


def simulated_log(length, seed=1):
    """Current [A] in random steps of 20 s and noisy voltage [V] of the model itself, (length,) each."""
    rng = np.random.default_rng(seed)
    current_A = np.repeat(rng.uniform(-6, 2, size=length // 20 + 1), 20)[:length]
    z = np.array([12.9, 12.9, 12.9, *TRUE_PARAMETERS])
    voltage_V = np.empty(length)
    for k, i in enumerate(current_A):
        z = next_state(z, i)
        voltage_V[k] = z[2]
    return current_A, voltage_V + NOISE_STD_V * rng.normal(size=length)
