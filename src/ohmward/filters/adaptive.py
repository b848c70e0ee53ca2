"""Noise covariances learnt online: covariance matching (AEKF, AUKF), [T] 3.49-3.50 with the missing 1/L restored.

    C_k = mean of e e'                               e_k = y_k - y_k|k-1, innovation
    Q_k = K_k C_k K_k' + Q_floor
    R_k = mean of eps eps' + P_yy(x_k|k) + R_floor   eps_k = y_k - h(x_k|k), residual

Its limits:

- The rank of Q_k is at most the number of elements of y: without the floor the covariance of weakly observable states
  collapses, and the filter becomes overconfident. The floors are part of the model: the variance of the random walk of
  each state in one step, and that of the sensor's resolution alone.
- Matching both at once finds the size of the noise, not the ratio of Q to R: with S = C_k in the formulas, every gain K
  reproduces itself. NIS comes out right, but the gain stays where the first samples left it. Where one of the two is
  known, match the other alone (`match_Q`, `match_R`): then it is identified.

[T] averages over a ring buffer of the last L = 100 samples. Here the mean is recursive: over all samples while there
are fewer than L, then with exponential forgetting 1/L. The newest sample weighs 1/L in both (the mean scatters like
that of a ring of 2 L - 1), but a ring would put m (m + 1) L numbers into every state that is stored, exported to a
controller or kept per robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters import extended, unscented
from ohmward.filters.belief import Belief, Correction, Function, Innovation, require_shape
from ohmward.filters.gate import choose, passes
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import linearize, minimum


class NoiseEstimate(NamedTuple):
    """Second moments that the noise is matched to, in units of y squared."""

    innovation: np.ndarray  #: (m, m), mean of e e'
    residual: np.ndarray  #: (m, m), mean of eps eps'
    samples: float  #: number of samples in the means, at most the window


class AdaptiveState(NamedTuple):
    """Everything that an adaptive filter carries from step to step."""

    belief: Belief  #: of the state
    Q: np.ndarray  #: (n, n), process noise for the next step
    R: np.ndarray  #: (m, m), measurement noise for the next step
    noise: NoiseEstimate  #: moments that they are matched to


@dataclass(frozen=True, eq=False)
class Matching:
    """Settings of the covariance matching."""

    #: (n, n), random walk of each state over one step; unit of the state squared. All of Q without `match_Q`.
    Q_floor: np.ndarray
    R_floor: np.ndarray  #: (m, m), unit of the output squared. All of R without `match_R`.
    window: float = 100.0  #: effective number of samples in the means, >= 1; [T] takes 100
    #: largest NIS of a measurement that is used; infinity skips only missing ones; None uses every one, and then a
    #: single NaN destroys the state
    gate: float | None = None
    #: which covariance is matched
    match_Q: bool = True
    match_R: bool = True

    def __post_init__(self) -> None:
        if not self.window >= 1:
            raise InputError(f"window must be at least 1 sample but is {self.window}; [T] takes 100")
        if self.gate is not None and not self.gate > 0:
            raise InputError(f"gate must be > 0 but is {self.gate}; None trusts every measurement")


def init(belief: Belief, Q: np.ndarray, R: np.ndarray) -> AdaptiveState:
    """State before the first sample, with the noise Q (n, n), R (m, m) of the first step."""
    n, m = len(belief.mean), len(R)
    require_shape("Q", Q, (n, n))
    require_shape("R", R, (m, m))
    return AdaptiveState(belief, Q, R, NoiseEstimate(np.zeros((m, m)), np.zeros((m, m)), 0.0))


def extended_step(
    state: AdaptiveState, f: Function, h: Function, y: np.ndarray, matching: Matching
) -> tuple[AdaptiveState, Innovation]:
    """Adaptive extended Kalman filter (AEKF): predict through f, correct with y = h(x) + v, match Q and R.

    Args:
        state: before the step.
        f: next state (n,) of a state (n,).
        h: output (m,) of a state (n,).
        y: (m,) measured output.
        matching: floors, window and gate.

    Raises:
        InputError: shapes do not fit each other.
    """
    prior = extended.predict(state.belief, f, state.Q)
    correction = extended.correct(prior, y, h, state.R)
    y_hat, H = linearize(h, correction.belief.mean)
    P_yy = H @ correction.belief.cov @ H.T
    return _matched(state, prior, correction, y - y_hat, P_yy, matching)


def unscented_step(
    state: AdaptiveState, f: Function, h: Function, y: np.ndarray, matching: Matching
) -> tuple[AdaptiveState, Innovation]:
    """Adaptive unscented Kalman filter (AUKF) with redrawn sigma points; arguments as for `extended_step`."""
    prior = unscented.predict(state.belief, f, state.Q)
    correction = unscented.correct(prior, y, h, state.R)
    P_yy = unscented.output_covariance(correction.belief, h)
    return _matched(state, prior, correction, y - h(correction.belief.mean), P_yy, matching)


def unscented_step_reusing_points(
    state: AdaptiveState, f: Function, h: Function, y: np.ndarray, matching: Matching
) -> tuple[AdaptiveState, Innovation]:
    """The AUKF of [T]: the propagated sigma points are used for h too; arguments as for `extended_step`."""
    prior, correction = unscented.correct_reusing_points(state.belief, f, h, y, state.Q, state.R)
    P_yy = unscented.output_covariance(correction.belief, h)
    return _matched(state, prior, correction, y - h(correction.belief.mean), P_yy, matching)


def remember(noise: NoiseEstimate, innovation: np.ndarray, residual: np.ndarray, window: float) -> NoiseEstimate:
    """The moments with one more sample: the mean of all up to `window` of them, then exponential forgetting 1/window.

    Args:
        noise: so far.
        innovation: (m,), y_k - y_k|k-1.
        residual: (m,), y_k - h(x_k|k).
        window: L, effective number of samples, >= 1.
    """
    samples = minimum(noise.samples + 1.0, window)
    share = 1.0 / samples
    return NoiseEstimate(
        mirror_lower(noise.innovation + share * (np.outer(innovation, innovation) - noise.innovation)),
        mirror_lower(noise.residual + share * (np.outer(residual, residual) - noise.residual)),
        samples,
    )


def match(noise: NoiseEstimate, K: np.ndarray, P_yy: np.ndarray, matching: Matching) -> tuple[np.ndarray, np.ndarray]:
    """Q (n, n) and R (m, m) for the next step, from the gain K (n, m) and the covariance P_yy (m, m) of h(x_k|k)."""
    n, m = K.shape
    require_shape("matching.Q_floor", matching.Q_floor, (n, n))
    require_shape("matching.R_floor", matching.R_floor, (m, m))
    Q, R = matching.Q_floor, matching.R_floor
    if matching.match_Q:
        Q = K @ noise.innovation @ K.T + Q
    if matching.match_R:
        R = noise.residual + P_yy + R
    return mirror_lower(Q), mirror_lower(R)


def _matched(
    state: AdaptiveState,
    prior: Belief,
    correction: Correction,
    residual: np.ndarray,
    P_yy: np.ndarray,
    matching: Matching,
) -> tuple[AdaptiveState, Innovation]:
    """State after a correction with the noise matched; where the gate rejects it, after the prediction alone."""
    posterior, innovation, K = correction
    noise = remember(state.noise, innovation.value, residual, matching.window)
    Q, R = match(noise, K, P_yy, matching)
    after = AdaptiveState(posterior, Q, R, noise)
    if matching.gate is not None:
        after = choose(passes(innovation, matching.gate), after, state._replace(belief=prior))
    return after, innovation
