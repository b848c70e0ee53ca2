"""All errors found in the texts we worked from, and their checks.

The RC model of [T] 3.2 to 3.4 and [P] 2.2 is compared with the circuit itself, the filters of [T] 3.3 and [P] 3 with
what a Gaussian and a linear filter must give, the robot of [T] 4 and 5 with mechanics and the sliding condition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.soc.sample import SocSample
from ohmward.filters import Belief, kalman
from ohmward.filters.unscented import DEFAULT
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.trace import Kernel
from ohmward.traction import RLMA, RollingResistance
from ohmward.traction.friction.law import Brush, Contact
from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.scheme_by_method import SchemeByMethod
from ohmward_lab.reproduce.row import Erratum, differs
from ohmward_lab.reproduce.thesis_cases import stop_on_ice
from ohmward_lab.reproduce.unscented_textbook import sigma_points, sigma_weights, textbook_step

#: Errata in the order of this file.
ERRATA: list[Erratum] = []


def _erratum(text: str, place: str, printed: str, correct: str) -> Callable[[Callable[[], bool]], Callable[[], bool]]:
    """Add the erratum whose check follows."""

    def add(check: Callable[[], bool]) -> Callable[[], bool]:
        ERRATA.append(Erratum(text, place, printed, correct, check))
        return check

    return add


#: A circuit with unequal branches, that of [P]; one with R_b = R_s, that of [T]; state, current [A] and short step [s].
_UNEQUAL = rc.Circuit(9000.0, 40.0, 0.09, 0.06, 0.05)
_EQUAL = rc.Circuit(9000.0, 40.0, 0.07, 0.07, 0.05)
_X = np.array([12.5, 12.3])
_CURRENT_A = -2.0
_SHORT_S = 1e-4
#: D [ohm] for which the frozen step of 3.4.2 loses the shares that the table of errata names, with steps of 1 s.
_FROZEN_D_OHM = 0.11


@_erratum("[T]", "(3.1)", "the resistor of the parallel branches enters as R_e", "R_e / 2")
def _branch_resistance() -> bool:
    """R_t and two branches R_e in parallel, by Kirchhoff's laws for a current of 1 A into dead capacitors."""
    p = _EQUAL
    node = np.array([[1 / p.r_bulk_ohm + 1 / p.r_surface_ohm]])
    true = p.r_terminal_ohm + float(np.linalg.solve(node, np.array([1.0]))[0])
    return differs(p.r_terminal_ohm + p.r_bulk_ohm, float(rc.instant_resistance(p)), true, 1e-12)


def _rate_V_per_s(p: rc.Circuit) -> float:
    """dV/dt [V/s] at constant current, from the circuit: central difference of the exact step."""
    ahead = rc_circuit.voltage(rc_circuit.next_state(_X, _CURRENT_A, p, _SHORT_S), _CURRENT_A, p)[0]
    return float((ahead - rc_circuit.voltage(_X, _CURRENT_A, p)[0]) / _SHORT_S)


def _t_rate(p: rc.Circuit, base_V: float, current_factor: float) -> float:
    """Right-hand side of (3.2) [V/s] with this voltage in place of V_cs or V_t, and this factor of the current."""
    g = 0.5 / p.r_bulk_ohm
    mixed = g * p.r_terminal_ohm * (1 / p.c_surface_F - 1 / p.c_bulk_F)
    return g * (1 / p.c_bulk_F - 1 / p.c_surface_F) * (base_V - _X[0]) + (current_factor + mixed) * _CURRENT_A


@_erratum("[T]", "(3.2), f_3 in (3.6)", "V_cs on the right-hand side", "the terminal voltage V_t")
def _terminal_voltage() -> bool:
    p, V = _EQUAL, float(rc_circuit.voltage(_X, _CURRENT_A, _EQUAL)[0])
    half = 0.5 / p.c_surface_F
    return differs(_t_rate(p, _X[1], half), _t_rate(p, V, half), _rate_V_per_s(p), 1e-4)


@_erratum("[T]", "(3.2), f_3 in (3.6)", "factor 1/(2 R_e C_s) of the current", "1/(2 C_s)")
def _current_factor() -> bool:
    p, V = _EQUAL, float(rc_circuit.voltage(_X, _CURRENT_A, _EQUAL)[0])
    printed = _t_rate(p, V, 0.5 / (p.r_bulk_ohm * p.c_surface_F))
    return differs(printed, _t_rate(p, V, 0.5 / p.c_surface_F), _rate_V_per_s(p), 1e-4)


@_erratum("[T]", "f_3 in (3.6)", "di/dt = 0 at every step", "V jumps by (R_t + R_e/2) di")
def _jump() -> bool:
    """A step of the current moves V at once, by (R_t + R_e/2) times it."""
    p = _EQUAL
    true = float((rc_circuit.voltage(_X, _CURRENT_A, p) - rc_circuit.voltage(_X, 0.0, p))[0])
    return differs(0.0, _CURRENT_A * (p.r_terminal_ohm + p.r_bulk_ohm / 2), true, 1e-12)


@_erratum("[T]", "3.2, (3.52)", "minus here, plus in 3.4.2 for the same charge", "one sign: i > 0 charges")
def _charge_sign() -> bool:
    """The charge of both capacitors rises by i dt, so that SoC rises by + i dt / Q."""
    p = _UNEQUAL
    after = rc_circuit.next_state(_X, _CURRENT_A, p, 10.0)
    true = float(p.c_bulk_F * (after[0] - _X[0]) + p.c_surface_F * (after[1] - _X[1]))
    return differs(-10.0 * _CURRENT_A, 10.0 * _CURRENT_A, true, 1e-9)


def _frozen_loss(c_surface_F: float) -> float:
    """Share of the charge that a first step of 1 s loses where each capacitor takes the other's voltage as constant."""
    p = rc.Circuit(9000.0, c_surface_F, 0.5 * _FROZEN_D_OHM, 0.5 * _FROZEN_D_OHM, 0.05)
    stored = 0.0
    for own_F, other_ohm in ((p.c_bulk_F, p.r_surface_ohm), (p.c_surface_F, p.r_bulk_ohm)):
        stored += own_F * other_ohm * -np.expm1(-1.0 / (_FROZEN_D_OHM * own_F))
    return 1.0 - float(stored)


@_erratum(
    "[T]",
    "3.4.2",
    "each capacitor steps with its partner frozen: loses up to 17 % of a step's charge",
    "the exact step of the pair",
)
def _frozen_partner() -> bool:
    """The frozen step loses charge, the exact step of the pair none."""
    p = rc.Circuit(9000.0, 10.0, 0.5 * _FROZEN_D_OHM, 0.5 * _FROZEN_D_OHM, 0.05)
    rest = np.array([12.0, 12.0])
    moved = rc_circuit.next_state(rest, 1.0, p, 1.0) - rest
    exact = abs(p.c_bulk_F * moved[0] + p.c_surface_F * moved[1] - 1.0) < 1e-9
    return bool(exact and 0.005 < _frozen_loss(300.0) < 0.015 and 0.15 < _frozen_loss(10.0) < 0.19)


def _p_rate(p: rc.Circuit, last_ohm: float, sign: float = 1.0) -> float:
    """A31 V_cb + A33 V + B31 i [V/s] of [P] 2.2, with this resistance in R_s R_t of B31, and this sign of A33."""
    V, D = float(rc_circuit.voltage(_X, _CURRENT_A, p)[0]), p.r_bulk_ohm + p.r_surface_ohm
    A33 = p.r_surface_ohm / (p.c_bulk_F * p.r_bulk_ohm * D) - sign / (p.c_surface_F * D)
    B31 = (
        p.r_bulk_ohm**2 / (p.c_surface_F * D**2)
        - p.r_surface_ohm * last_ohm / (p.c_bulk_F * p.r_bulk_ohm * D)
        + p.r_terminal_ohm / (p.c_surface_F * D)
        + p.r_surface_ohm * p.r_bulk_ohm / (p.c_surface_F * D**2)
    )
    return A33 * (V - _X[0]) + B31 * _CURRENT_A


@_erratum("[P]", "2.2, B31", "R_s R_s", "R_s R_t")
def _b31() -> bool:
    """dV/dt with a bulk about as small as the surface, so that the term matters."""
    p = _UNEQUAL._replace(c_bulk_F=60.0)
    return differs(_p_rate(p, p.r_surface_ohm), _p_rate(p, p.r_terminal_ohm), _rate_V_per_s(p), 1e-3)


@_erratum("[P]", "2.2, A31, A33", "minus signs lost", "A33 = R_s/(C_b R_b D) - 1/(C_s D), A31 = -A33")
def _a33() -> bool:
    p = _UNEQUAL
    return differs(_p_rate(p, p.r_terminal_ohm, -1.0), _p_rate(p, p.r_terminal_ohm), _rate_V_per_s(p), 1e-3)


@_erratum("[P]", "2.2 against 2.3", "RC and Thevenin model count current with opposite signs", "one: i > 0 charges")
def _one_sign() -> bool:
    """A charge raises the voltage of the RC model and of its Thevenin circuit alike, with one sign of the current."""
    after = rc_circuit.next_state(_X, 1.0, _UNEQUAL, 10.0) - rc_circuit.next_state(_X, 0.0, _UNEQUAL, 10.0)
    return bool((after > 0).all() and rc.instant_resistance(_UNEQUAL) > 0 and rc.slow_resistance(_UNEQUAL) > 0)


#: States of the joint filter of [T].
_N = 7
_CHI = DEFAULT.alpha**2 * (_N + DEFAULT.kappa) - _N

_BELIEF = Belief(np.array([1.0, -2.0]), np.array([[0.5, 0.1], [0.1, 0.3]]))
_F = np.array([[1.0, 0.2], [-0.1, 0.9]])
_H = np.array([[1.0, 0.5]])
_Q, _R = np.diag([0.02, 0.03]), np.array([[0.1]])
_Y = np.array([0.4])


@_erratum("[T]", "(3.31)-(3.41)", "lambda and chi both stand for the scaling", "chi")
def _one_scaling() -> bool:
    """Spread and weights must have the same scaling for the points to have the covariance P."""
    X = sigma_points(_BELIEF)
    dX = X - _BELIEF.mean
    same = dX.T @ (sigma_weights(2)[0][:, None] * dX)
    other = dX.T @ (sigma_weights(2, DEFAULT._replace(alpha=1.0))[0][:, None] * dX)
    return bool(np.allclose(same, _BELIEF.cov) and not np.allclose(other, _BELIEF.cov, rtol=0.1))


@_erratum("[T]", "(3.38)", "lambda in the numerator: the mean weights sum to -3.07", "weights that sum to 1")
def _mean_weights() -> bool:
    """The mean weights must sum to 1; with lambda (chi here) in the numerator to chi (N + 1) / (N + chi)."""
    printed = _CHI * (_N + 1) / (_N + _CHI)
    return differs(printed, float(sigma_weights(_N)[0].sum()), 1.0, 1e-12) and abs(printed + 3.07) < 0.005


@_erratum("[T]", "(3.35), (3.42)", "the sums leave out point 0", "all 2 N + 1 points")
def _point_zero() -> bool:
    """A sum without point 0, or that ends early, moves the mean of points about 1."""
    weights = sigma_weights(_N)[0]
    return differs(float(weights[1:].sum()), float(weights.sum()), 1.0, 1e-12)


@_erratum("[T]", "(3.31)-(3.41)", "1 - alpha^2 - beta", "1 - alpha^2 + beta")
def _central_weight() -> bool:
    """The variance of x^2 is 2 sigma^4 for a normal x; with - beta the weights give a negative variance."""

    def variance(beta: float) -> float:
        belief = Belief(np.zeros(1), np.array([[1.0]]))
        w_mean, w_cov = sigma_weights(1, DEFAULT._replace(beta=beta))
        y = sigma_points(belief)[:, 0] ** 2
        return float(w_cov @ (y - w_mean @ y) ** 2)

    return differs(variance(-DEFAULT.beta), variance(DEFAULT.beta), 2.0, 1e-9)


@_erratum("[T]", "(3.42)", "output from the points before propagation", "from the propagated points")
def _propagated_points() -> bool:
    """On a linear model the expected output is H F x; the points before propagation give H x."""
    _, innovation = textbook_step(_BELIEF, lambda x: _F @ x, lambda x: _H @ x, _Y, _Q, _R)
    true = float((_H @ _F @ _BELIEF.mean)[0])
    return differs(float((_H @ _BELIEF.mean)[0]), float(_Y[0] - innovation.value[0]), true, 1e-9)


@_erratum("[T]", "(3.49), (3.50)", "1/L is missing", "a mean over the window")
def _window_mean() -> bool:
    """The moment of unit noise is 1, its sum over the window 100."""
    noise = np.random.default_rng(0).standard_normal(20_000)
    mean = float(np.convolve(noise**2, np.full(100, 1 / 100), "valid").mean())
    return abs(mean - 1.0) < 0.02 and abs(100.0 * mean - 1.0) > 10.0


@_erratum(
    "[T]",
    "(3.6), (3.51)",
    "parameters of any sign: with these P0, Q0, R0 UKF and AUKF end in NaN or beyond 1e6 V, EKF and AEKF do not",
    "the circuit sees positive parameters",
)
def _free_parameters() -> bool:
    """With P0 = I sigma points have negative capacitances; UKF and AUKF end in nan or diverge, EKF and AEKF do not.

    The samples are those of the circuit itself, without noise; with bounds, and corrected, none of the four does.
    """
    model = rc.RcModel(3000.0, 300.0, 0.08, 0.08, 0.06, OcvCurve((11.5, 13.5)), 3300.0 * 2.0 / SECONDS_PER_HOUR)
    current_A = np.tile(np.repeat([-3.0, -0.2, -1.5, 0.5], 10), 10)
    x, voltage_V = rc_circuit.at_rest(model, 0.6), []
    for now_A in current_A:
        x = rc_circuit.next_state(x, now_A, model, 1.0)
        voltage_V.append(rc_circuit.voltage(x, now_A, model)[0])
    nothing = np.full(current_A.size, math.nan)
    samples = SocSample(np.ones(current_A.size), current_A, np.array(voltage_V), nothing)
    first = SocSample(0.0, float(current_A[0]), float(voltage_V[0]), math.nan)

    def ends_in_no_number(method: str, corrected: bool) -> bool:
        scheme = SchemeByMethod(model, method, corrected)
        start = scheme.init(first, 0.6, 0.005)
        innovation_V = Kernel(scheme.step, start, first).scan(start, samples)[1].innovation_V
        return not float(np.abs(innovation_V).max()) < 1e6

    printed = [ends_in_no_number(method, False) for method in ("ekf", "aekf", "ukf", "aukf")]
    corrected = [ends_in_no_number(method, True) for method in ("ekf", "aekf", "ukf", "aukf")]
    return printed == [False, False, True, True] and not any(corrected)


@_erratum("[P]", "(24)", "a stray L in the gain", "K = P H' (H P H' + R)^-1")
def _gain() -> bool:
    """K = P H' (H P H' + R)^-1 minimises the variance; K changed by a factor L does not."""
    S = _H @ _BELIEF.cov @ _H.T + _R
    K = _BELIEF.cov @ _H.T @ np.linalg.inv(S)
    best = np.trace(kalman.joseph(_BELIEF.cov, K, _H, _R))
    return all(np.trace(kalman.joseph(_BELIEF.cov, L * K, _H, _R)) > best for L in (0.5, 0.9, 1.1, math.pi))


@_erratum("[P]", "(26), (27)", "roots lost", "the root of (N + lambda) P")
def _roots() -> bool:
    """Points at plus and minus the root of (N + chi) P have the covariance P; without the root they do not."""
    w_mean, _ = sigma_weights(2)
    X = sigma_points(_BELIEF) - _BELIEF.mean
    spread = DEFAULT.alpha**2 * 2
    whole = np.vstack([np.zeros(2), spread * _BELIEF.cov, -spread * _BELIEF.cov])
    right = X.T @ (w_mean[:, None] * X)
    wrong = whole.T @ (w_mean[:, None] * whole)
    return bool(np.allclose(right, _BELIEF.cov) and not np.allclose(wrong, _BELIEF.cov, rtol=0.1))


_erratum("[P]", "(29)", "upper limit of the sum", "2 N")(_point_zero)


_erratum("[P]", "(30), (31), (34), (35)", "gamma where lambda belongs", "lambda, the scaling")(_one_scaling)


@_erratum("[P]", "(33), (38), (39)", "noise covariances or weights missing", "as in the textbook")
def _noise_in_covariances() -> bool:
    """On a linear model the unscented filter is the Kalman filter, Q and R included."""
    posterior, _ = textbook_step(_BELIEF, lambda x: _F @ x, lambda x: _H @ x, _Y, _Q, _R, redraw=True)
    true = kalman.update(kalman.predict(_BELIEF, _F, _Q), _Y, _H, _R)[0]
    without, _ = textbook_step(_BELIEF, lambda x: _F @ x, lambda x: _H @ x, _Y, 0 * _Q, _R, redraw=True)
    return bool(np.allclose(posterior.cov, true.cov) and not np.allclose(without.cov, true.cov, rtol=0.01))


_YAW_RAD_S, _SPEED_M_S = 0.4, 0.3
_RANDOM_CASES = 2000


@_erratum("[T]", "(4.2)", "two cases in one, the third branch missing, a length called lambda", "three branches")
def _brush_branches() -> bool:
    """The brush force against the sum over 20,000 bristles, in all three ranges of creepage."""
    law = Brush(0.8, 0.06, 4e5, lead_length_m=0.004)
    load_N, rim = 100.0, 1.0
    i_c, full = float(law.critical_creepage(load_N)), law.adhesion * load_N / (4e5 * 0.06 * 0.004)
    cells = (np.arange(20_000) + 0.5) / 20_000 * law.patch_length_m
    for i in (0.5 * i_c, 0.5 * (i_c + full), 1.5 * full):
        sticking = law.tread_stiffness_N_per_m2 * i * (law.lead_length_m + cells)
        true = np.minimum(sticking, law.adhesion * load_N / law.patch_length_m).mean() * law.patch_length_m
        found = float(law.force_N(Contact(i * rim, rim, rim - i * rim, load_N)))
        if abs(found - true) > 1e-3 * true:
            return False
    return True


@_erratum("[T]", "(4.4)", "the forward speed of a wheel lacks the track", "b/2 as lever of the yaw rate")
def _wheel_speed() -> bool:
    """Forward speed of a wheel's centre, v + (omega x r)_x, with half the track as lever."""
    left, right = RLMA.rolling[:2] @ np.array([_SPEED_M_S, _YAW_RAD_S])
    track_m = RLMA.places[0].y_m - RLMA.places[1].y_m
    true = _SPEED_M_S - _YAW_RAD_S * 0.5 * track_m
    return differs(_SPEED_M_S - _YAW_RAD_S, float(left), true, 1e-9) and bool(right > left)


@_erratum("[T]", "(4.9), (4.10)", "L_f and L_r exchanged", "front load with L_r, rear load with L_f")
def _loads() -> bool:
    """Moments about the centre of gravity cancel: N_f L_f = N_r L_r; exchanged they do not."""
    L_f, L_r = 0.25, 0.40
    weight = RLMA.mass_kg * GRAVITY
    front, rear = weight * L_r / (L_f + L_r), weight * L_f / (L_f + L_r)
    return abs(front * L_f - rear * L_r) < 1e-9 * weight and abs(rear * L_f - front * L_r) > 0.1 * weight * L_f


@_erratum("[T]", "(4.12)", "the rear wheels are missing", "all wheels")
def _rear_wheels() -> bool:
    """Rolling resistance acts on all wheels; the rear ones carry the share of the load that was left out."""
    law, weight = RollingResistance(), RLMA.mass_kg * GRAVITY
    per_wheel = [float(law.force_N(_SPEED_M_S, share * weight)) for share in RLMA.loads[:, 0]]
    whole = float(law.force_N(_SPEED_M_S, weight))
    return differs(sum(per_wheel[: RLMA.driven]), sum(per_wheel), whole, 1e-9)


@_erratum(
    "[T]", "(4.14), (4.18), (4.19)", "rolling resistance in the wheel equation makes energy", "force on the body alone"
)
def _rolling_energy() -> bool:
    """A force on the body and on the rim together feed (rim - v) F into a driving wheel."""
    travel, rim, force_N = 0.4, 0.5, 5.0
    printed_W = rim * force_N - travel * force_N  # in the wheel's equation with the force's own lever
    correct_W = -travel * force_N
    return printed_W > 0.4 and correct_W < 0


@_erratum("[T]", "(4.17)-(4.20)", "yaw rate with the same sign for both wheels", "left minus, right plus")
def _yaw_signs() -> bool:
    """Yaw speeds up one wheel and slows down the other, so that their mean is v."""
    left, right = RLMA.rolling[:2] @ np.array([_SPEED_M_S, _YAW_RAD_S])
    return differs(float(left), float(0.5 * (left + right)), _SPEED_M_S, 1e-12)


@_erratum(
    "[T]", "(4.17)-(4.20)", "A_1 and A_3 with opposite signs, minus signs lost in exponents", "one sign, exp(-A |v|)"
)
def _rolling_signs() -> bool:
    """A_1 and A_3 with one sign, exponents negative: resistance against the motion, bounded, growing."""
    law = RollingResistance()
    speeds = np.array([0.01, 0.1, 0.5, 1.0])
    force = -np.array([float(law.force_N(v, 1.0)) for v in speeds])
    backwards = np.array([float(law.force_N(-v, 1.0)) for v in speeds])
    opposite = law.a1 * -np.expm1(-law.a2_s_per_m * speeds) - law.a3_s_per_m * speeds
    return bool((np.diff(force) > 0).all() and np.allclose(force, backwards) and opposite[-1] < 0)


def _sliding_condition(with_size: bool) -> bool:
    """True where s ds/dt <= -eta |s| for all f and B within their bounds, with |u_hat| or with u_hat in k."""
    rng = np.random.default_rng(0)
    f_hat, s, share, b = rng.uniform(-1.0, 1.0, (4, _RANDOM_CASES))
    F, eta, beta = 0.3, 0.2, 1.5
    f_hat, f, B = 3.0 * f_hat, 3.0 * f_hat + F * share, beta**b
    u_hat = -f_hat
    k = beta * (F + eta) + (beta - 1) * (np.abs(u_hat) if with_size else u_hat)
    ds = f + B * (u_hat - k * np.sign(s))
    return bool((s * ds <= -eta * np.abs(s) + 1e-12).all())


@_erratum("[T]", "(5.11), (5.19), (5.20)", "u inside u_hat; a stray minus; u_hat without its size", "k with |u_hat|")
def _gain_size() -> bool:
    return _sliding_condition(with_size=True) and not _sliding_condition(with_size=False)


@_erratum("[T]", "(5.25)", "division by r x_2 incomplete", "every term")
def _complete_division() -> bool:
    """With lambda = 1 - x_1/(r x_2) every term of the derivative is over r x_2."""
    r, v, omega, dv, domega, step = 0.12, 0.3, 3.0, -0.5, 2.0, 1e-7
    slip = 1 - v / (r * omega)
    true = ((1 - (v + dv * step) / (r * (omega + domega * step))) - slip) / step
    correct = (-dv + r * (1 - slip) * domega) / (r * omega)
    return differs(-dv + (1 - slip) * domega / omega, correct, true, 1e-4)


@_erratum("[T]", "(5.26)", "b = 1/(r J_w)", "(1 - lambda)/J_w")
def _input_gain() -> bool:
    """The slope d lambda/d omega is (1 - lambda)/omega, so that torque enters with (1 - lambda)/J_w, not 1/(r J_w)."""
    r, J, v, omega = 0.12, 0.02, 0.3, 3.0
    slip = 1 - v / (r * omega)
    step = 1e-6
    true = ((1 - v / (r * (omega + step))) - slip) / step * omega / J  # d lambda/dt per torque, times x_2 = omega
    return differs(1 / (r * J), (1 - slip) / J, true, 1e-4)


@_erratum("[T]", "(5.33)-(5.35)", "sign of f_hat; B_hat^-1 twice", "-f_hat, once")
def _equivalent_control() -> bool:
    """The control u = B^-1 (-f + d lambda_d/dt) keeps ds/dt = 0; +f, or B^-1 twice, do not."""
    f, B, rate = -3.0, 2.5, 0.4
    return all(abs(f + B * u - rate) > 0.1 for u in ((f + rate) / B, (-f + rate) / B**2)) and math.isclose(
        f + B * (-f + rate) / B, rate
    )


@_erratum("[T]", "(5.43), (5.44)", "|s| and s^2", "d(s^2/2)/dt <= -eta |s|")
def _reaching() -> bool:
    """V = s^2/2 falls at least as eta |s|, for s of both signs; with s in place of |s| it grows for s < 0."""
    s, eta = np.array([-0.5, 0.5]), 0.2
    rate = s * -eta * np.sign(s)
    return bool(np.allclose(rate, -eta * np.abs(s)) and (-eta * s)[0] > 0)


@_erratum("[T]", "(5.47)", "the saturation is 1 inside the layer", "s/theta")
def _layer() -> bool:
    """Inside the layer the law is s/theta: continuous at both edges and zero on the surface."""
    theta = 0.02
    inside = np.array([-theta, 0.0, theta]) / theta
    return bool(np.array_equal(inside, [-1.0, 0.0, 1.0]) and not np.array_equal(np.ones(3), [-1.0, 0.0, 1.0]))


@_erratum(
    "[T]",
    "cases I, II",
    "-0.18, which brakes, for 6 s (I) and 1.5 m (II) at 0.1 and 0.2 m/s",
    "on ice, table 4.1, it stops in 1 s and 0.1 m",
)
def _cases() -> bool:
    """At a slip of -0.18 a robot at 0.2 m/s has stopped long before 6 s and 1.5 m, even on ice."""
    stop = stop_on_ice()
    return stop.time_s < 2.0 and stop.way_m < 0.2


def check(errata: Sequence[Erratum]) -> list[bool]:
    """Results of the checks, in the same order."""
    return [bool(erratum.check()) for erratum in errata]
