"""Errata of the filters in [T] 3.3 and [P] 3: each form against what a Gaussian and a linear filter must give."""

from __future__ import annotations

import math

import numpy as np

from ohmward.battery.models import rc
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.soc.sample import SocSample
from ohmward.filters import Belief, adaptive, kalman
from ohmward.filters.unscented import DEFAULT, sigma_points, sigma_weights, textbook_step
from ohmward.trace import Kernel
from ohmward_lab.published.scheme_by_method import SchemeByMethod
from ohmward_lab.reproduce.row import Erratum, differs

#: States of the joint filter of [T].
_N = 7
_CHI = DEFAULT.alpha**2 * (_N + DEFAULT.kappa) - _N

_BELIEF = Belief(np.array([1.0, -2.0]), np.array([[0.5, 0.1], [0.1, 0.3]]))
_F = np.array([[1.0, 0.2], [-0.1, 0.9]])
_H = np.array([[1.0, 0.5]])
_Q, _R = np.diag([0.02, 0.03]), np.array([[0.1]])
_Y = np.array([0.4])


def _mean_weights() -> bool:
    """(3.38): the mean weights must sum to 1; with lambda (chi here) in the numerator to chi (N + 1) / (N + chi)."""
    printed = _CHI * (_N + 1) / (_N + _CHI)
    return differs(printed, float(sigma_weights(_N)[0].sum()), 1.0, 1e-12) and abs(printed + 3.07) < 0.005


def _one_scaling() -> bool:
    """(3.31)-(3.41), [P] (30)-(31): spread and weights must have the same scaling for the points to have the cov P."""
    X = sigma_points(_BELIEF)
    dX = X - _BELIEF.mean
    same = dX.T @ (sigma_weights(2)[0][:, None] * dX)
    other = dX.T @ (sigma_weights(2, DEFAULT._replace(alpha=1.0))[0][:, None] * dX)
    return bool(np.allclose(same, _BELIEF.cov) and not np.allclose(other, _BELIEF.cov, rtol=0.1))


def _point_zero() -> bool:
    """(3.35), (3.42), [P] (29): a sum without point 0, or that ends early, moves the mean of points about 1."""
    weights = sigma_weights(_N)[0]
    return differs(float(weights[1:].sum()), float(weights.sum()), 1.0, 1e-12)


def _central_weight() -> bool:
    """(3.31)-(3.41): var of x^2 is 2 sigma^4 for a normal x; with - beta the weights give a negative variance."""

    def variance(beta: float) -> float:
        belief = Belief(np.zeros(1), np.array([[1.0]]))
        w_mean, w_cov = sigma_weights(1, DEFAULT._replace(beta=beta))
        y = sigma_points(belief)[:, 0] ** 2
        return float(w_cov @ (y - w_mean @ y) ** 2)

    return differs(variance(-DEFAULT.beta), variance(DEFAULT.beta), 2.0, 1e-9)


def _propagated_points() -> bool:
    """(3.42): on a linear model the expected output is H F x; the points before propagation give H x."""
    _, innovation = textbook_step(_BELIEF, lambda x: _F @ x, lambda x: _H @ x, _Y, _Q, _R)
    true = float((_H @ _F @ _BELIEF.mean)[0])
    return differs(float((_H @ _BELIEF.mean)[0]), float(_Y[0] - innovation.value[0]), true, 1e-9)


def _window_mean() -> bool:
    """(3.49), (3.50): the moment of unit noise is 1, its sum over the window 100."""
    noise = np.random.default_rng(0).standard_normal((20_000, 1))
    mean = float(adaptive.windowed_moments(noise, 100)[99:, 0, 0].mean())
    return abs(mean - 1.0) < 0.02 and abs(100.0 * mean - 1.0) > 10.0


def _noise_in_covariances() -> bool:
    """[P] (33), (38), (39): on a linear model the unscented filter is the Kalman filter, Q and R included."""
    posterior, _ = textbook_step(_BELIEF, lambda x: _F @ x, lambda x: _H @ x, _Y, _Q, _R, redraw=True)
    true = kalman.update(kalman.predict(_BELIEF, _F, _Q), _Y, _H, _R)[0]
    without, _ = textbook_step(_BELIEF, lambda x: _F @ x, lambda x: _H @ x, _Y, 0 * _Q, _R, redraw=True)
    return bool(np.allclose(posterior.cov, true.cov) and not np.allclose(without.cov, true.cov, rtol=0.01))


def _roots() -> bool:
    """[P] (26), (27): points at plus and minus the root of (N + chi) P have the covariance P; without the root not."""
    w_mean, _ = sigma_weights(2)
    X = sigma_points(_BELIEF) - _BELIEF.mean
    spread = DEFAULT.alpha**2 * 2
    whole = np.vstack([np.zeros(2), spread * _BELIEF.cov, -spread * _BELIEF.cov])
    right = X.T @ (w_mean[:, None] * X)
    wrong = whole.T @ (w_mean[:, None] * whole)
    return bool(np.allclose(right, _BELIEF.cov) and not np.allclose(wrong, _BELIEF.cov, rtol=0.1))


def _gain() -> bool:
    """[P] (24): K = P H' (H P H' + R)^-1 minimises the variance; K changed by a factor L does not."""
    S = _H @ _BELIEF.cov @ _H.T + _R
    K = _BELIEF.cov @ _H.T @ np.linalg.inv(S)
    best = np.trace(kalman.joseph(_BELIEF.cov, K, _H, _R))
    return all(np.trace(kalman.joseph(_BELIEF.cov, L * K, _H, _R)) > best for L in (0.5, 0.9, 1.1, math.pi))


def _free_parameters() -> bool:
    """(3.51): with P0 = I sigma points have negative capacitances; UKF and AUKF end in no number, EKF and AEKF do not.

    On the circuit itself, without noise; within bounds, and corrected, none of the four does.
    """
    model = rc.RcModel(3000.0, 300.0, 0.08, 0.08, 0.06, OcvCurve((11.5, 13.5)), 3300.0 * 2.0 / 3600.0)
    current_A = np.tile(np.repeat([-3.0, -0.2, -1.5, 0.5], 10), 10)
    x, voltage_V = model.at_rest(0.6), []
    for now_A in current_A:
        x = rc.next_state(x, now_A, model, 1.0)
        voltage_V.append(rc.voltage(x, now_A, model)[0])
    nothing = np.full(current_A.size, math.nan)
    samples = SocSample(np.ones(current_A.size), current_A, np.array(voltage_V), nothing)
    first = SocSample(0.0, float(current_A[0]), float(voltage_V[0]), math.nan)

    def ends_in_no_number(method: str, corrected: bool) -> bool:
        scheme = SchemeByMethod(model, method, corrected)
        start = scheme.init(first, 0.6, 0.005)
        innovation_V = Kernel(scheme.step, start, first).scan(start, samples)[1].joint.innovation_V
        return not float(np.abs(innovation_V).max()) < 1e6

    printed = [ends_in_no_number(method, False) for method in ("ekf", "aekf", "ukf", "aukf")]
    corrected = [ends_in_no_number(method, True) for method in ("ekf", "aekf", "ukf", "aukf")]
    return printed == [False, False, True, True] and not any(corrected)


ERRATA = (
    Erratum("[T]", "(3.31)-(3.41)", "lambda and chi both stand for the scaling", "chi", _one_scaling),
    Erratum(
        "[T]",
        "(3.38)",
        "lambda in the numerator: the mean weights sum to -3.07",
        "weights that sum to 1",
        _mean_weights,
    ),
    Erratum("[T]", "(3.35), (3.42)", "the sums leave out point 0", "all 2 N + 1 points", _point_zero),
    Erratum("[T]", "(3.31)-(3.41)", "1 - alpha^2 - beta", "1 - alpha^2 + beta", _central_weight),
    Erratum(
        "[T]", "(3.42)", "output from the points before propagation", "from the propagated points", _propagated_points
    ),
    Erratum("[T]", "(3.49), (3.50)", "1/L is missing", "a mean over the window", _window_mean),
    Erratum(
        "[T]",
        "(3.6), (3.51)",
        "parameters of any sign: with these P0, Q0, R0 UKF and AUKF end in NaN or beyond 1e6 V, EKF and AEKF do not",
        "the circuit sees positive parameters",
        _free_parameters,
    ),
    Erratum("[P]", "(24)", "a stray L in the gain", "K = P H' (H P H' + R)^-1", _gain),
    Erratum("[P]", "(26), (27)", "roots lost", "the root of (N + lambda) P", _roots),
    Erratum("[P]", "(29)", "upper limit of the sum", "2 N", _point_zero),
    Erratum("[P]", "(30), (31), (34), (35)", "gamma where lambda belongs", "lambda, the scaling", _one_scaling),
    Erratum(
        "[P]", "(33), (38), (39)", "noise covariances or weights missing", "as in the textbook", _noise_in_covariances
    ),
)
