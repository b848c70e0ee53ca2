"""An adaptive unscented filter on the seven-state RC model as one NumPy step: what the compiler has to take and the
yardstick of its speed.

State [V_cb, V_cs, V, 1/C_b, 1/C_s, 1/R_e, R_t], scaled to order one; y = V, Euler step of 1 s, sigma points reused
for h, noise of the measurement from a window of 100 innovations.
"""

from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import minimum

N = 7
WINDOW = 100
ALPHA, BETA = 0.85, 2.0
SCALE = np.array([1.0, 1.0, 1.0, 1e-4, 1e-2, 50.0, 1e-2])
Q_FLOOR = np.diag([1e-8, 1e-8, 1e-6, 1e-8, 1e-8, 1e-8, 1e-8])
R_FLOOR = 1e-6
SPREAD = ALPHA**2 * N  # N + chi
W0_MEAN = 1 - N / SPREAD
W0_COV = W0_MEAN + 1 - ALPHA**2 + BETA
W = 0.5 / SPREAD


class State(NamedTuple):
    mean: Any  # (7,)
    cov: Any  # (7, 7)
    squares: Any  # (100,) squared innovations, the newest first
    total: Any  # their sum
    count: Any  # how many there are


def initial() -> State:
    return State(np.array([12.5, 12.5, 12.5, 1.0, 1.0, 1.0, 1.0]), np.eye(N) * 1e-4, np.zeros(WINDOW), 0.0, 0.0)


def next_state(z, current_A, dt_s=1.0):
    """The RC model with R_b = R_s = R_e, V as a state; the parameters stay."""
    v_b, v_s, v, b, s, g, r_t = z * SCALE
    return np.array(
        [
            z[0] + dt_s * 0.5 * b * (g * (v_s - v_b) + current_A),
            z[1] + dt_s * 0.5 * s * (g * (v_b - v_s) + current_A),
            z[2] + dt_s * (0.5 * (s - b) * g * (v_b - v + r_t * current_A) + 0.5 * s * current_A),
            *z[3:],
        ]
    )


def step(state: State, sample):
    """One sample (current_A, voltage_V) -> the next state, and mean and innovation."""
    current_A, voltage_V = sample
    offsets = np.sqrt(SPREAD) * cholesky(state.cov).T
    points = np.vstack([state.mean, state.mean + offsets, state.mean - offsets])
    X = np.array([next_state(x, current_A) for x in points])
    x_hat = W0_MEAN * X[0] + W * sum(X[1:])
    dX = X - x_hat
    dY = dX[:, 2]
    e = voltage_V - x_hat[2]
    count = minimum(state.count + 1.0, float(WINDOW))
    total = state.total + e * e - state.squares[-1]
    noise = total / count
    S = weighted(dY, dY) + noise + R_FLOOR
    K = np.array([weighted(dX[:, i], dY) for i in range(N)]) / S
    G = (noise - S) * K  # K noise K' - K S K' = G K'
    P = symmetric(lambda i, j: weighted(dX[:, i], dX[:, j]) + G[i] * K[j] + Q_FLOOR[i, j])
    mean = x_hat + K * e
    return State(mean, P, np.append([e * e], state.squares[:-1]), total, count), (mean, e)


def weighted(a, b):
    return W0_COV * (a[0] * b[0]) + W * (a[1:] @ b[1:])


def symmetric(entry):
    lower = {(i, j): entry(i, j) for i in range(N) for j in range(i + 1)}
    return np.array([[lower[max(i, j), min(i, j)] for j in range(N)] for i in range(N)])


def cholesky(P):
    L = np.zeros_like(P)
    for j in range(len(P)):
        L[j, j] = np.sqrt(P[j, j] - L[j, :j] @ L[j, :j])
        for i in range(j + 1, len(P)):
            L[i, j] = (P[i, j] - L[i, :j] @ L[j, :j]) / L[j, j]
    return L


def log(count, lanes=None, seed=0):
    """A simulated log: currents and noisy voltages, (T,) or (T, lanes)."""
    rng = np.random.default_rng(seed)
    shape = (count,) if lanes is None else (count, lanes)
    return rng.normal(size=shape), 12.5 + 0.002 * rng.normal(size=shape)
