"""Errata of the robot in [T] chapters 4 and 5: each form against mechanics and the sliding condition."""

from __future__ import annotations

import math

import numpy as np

from ohmward.traction import RLMA, RollingResistance
from ohmward.traction.friction.brush import Brush
from ohmward.traction.friction.law import Contact
from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.reproduce.row import Erratum, differs
from ohmward_lab.reproduce.thesis_cases import stop_on_ice

_YAW_RAD_S, _SPEED_M_S = 0.4, 0.3
_RANDOM_CASES = 2000


def _wheel_speed() -> bool:
    """(4.4): forward speed of a wheel's centre, v + (omega x r)_x, with half the track as lever."""
    left, right = RLMA.rolling[:2] @ np.array([_SPEED_M_S, _YAW_RAD_S])
    true = _SPEED_M_S - _YAW_RAD_S * 0.5 * _track_m()
    return differs(_SPEED_M_S - _YAW_RAD_S, float(left), true, 1e-9) and bool(right > left)


def _track_m() -> float:
    """Distance [m] of the front wheels."""
    y = [place.y_m for place in RLMA.places[:2]]
    return abs(y[0] - y[1])


def _yaw_signs() -> bool:
    """(4.17)-(4.20): yaw speeds up one wheel and slows down the other, so that their mean is v."""
    left, right = RLMA.rolling[:2] @ np.array([_SPEED_M_S, _YAW_RAD_S])
    return differs(float(left), float(0.5 * (left + right)), _SPEED_M_S, 1e-12)


def _loads() -> bool:
    """(4.9), (4.10): moments about the centre of gravity cancel: N_f L_f = N_r L_r; exchanged they do not."""
    L_f, L_r = 0.25, 0.40
    weight = RLMA.mass_kg * GRAVITY
    front, rear = weight * L_r / (L_f + L_r), weight * L_f / (L_f + L_r)
    return abs(front * L_f - rear * L_r) < 1e-9 * weight and abs(rear * L_f - front * L_r) > 0.1 * weight * L_f


def _rear_wheels() -> bool:
    """(4.12): rolling resistance acts on all wheels; the rear ones carry the share of the load that was left out."""
    law, weight = RollingResistance(), RLMA.mass_kg * GRAVITY
    per_wheel = [float(law.force_N(_SPEED_M_S, share * weight)) for share in RLMA.loads[:, 0]]
    whole = float(law.force_N(_SPEED_M_S, weight))
    return differs(sum(per_wheel[: RLMA.driven]), sum(per_wheel), whole, 1e-9)


def _rolling_energy() -> bool:
    """(4.14), (4.18)-(4.19): a force on the body and on the rim together feed (rim - v) F into a driving wheel."""
    travel, rim, force_N = 0.4, 0.5, 5.0
    printed_W = rim * force_N - travel * force_N  # in the wheel's equation with the force's own lever
    correct_W = -travel * force_N
    return printed_W > 0.4 and correct_W < 0


def _rolling_signs() -> bool:
    """(4.17)-(4.20): A_1 and A_3 with one sign, exponents negative: resistance against the motion, bounded, growing."""
    law = RollingResistance()
    speeds = np.array([0.01, 0.1, 0.5, 1.0])
    force = -np.array([float(law.force_N(v, 1.0)) for v in speeds])
    backwards = np.array([float(law.force_N(-v, 1.0)) for v in speeds])
    opposite = law.a1 * -np.expm1(-law.a2_s_per_m * speeds) - law.a3_s_per_m * speeds
    return bool((np.diff(force) > 0).all() and np.allclose(force, backwards) and opposite[-1] < 0)


def _brush_branches() -> bool:
    """(4.2): the brush force against the sum over 20,000 bristles, in all three ranges of creepage."""
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


def _input_gain() -> bool:
    """(5.26): d lambda/d omega is (1 - lambda)/omega, so that torque enters with (1 - lambda)/J_w, not 1/(r J_w)."""
    r, J, v, omega = 0.12, 0.02, 0.3, 3.0
    slip = 1 - v / (r * omega)
    step = 1e-6
    true = ((1 - v / (r * (omega + step))) - slip) / step * omega / J  # d lambda/dt per torque, times x_2 = omega
    return differs(1 / (r * J), (1 - slip) / J, true, 1e-4)


def _equivalent_control() -> bool:
    """(5.33)-(5.35): u = B^-1 (-f + d lambda_d/dt) keeps ds/dt = 0; +f, or B^-1 twice, do not."""
    f, B, rate = -3.0, 2.5, 0.4
    return all(abs(f + B * u - rate) > 0.1 for u in ((f + rate) / B, (-f + rate) / B**2)) and math.isclose(
        f + B * (-f + rate) / B, rate
    )


def _sliding_condition(with_size: bool) -> bool:
    """Truth of s ds/dt <= -eta |s| for all f and B within their bounds, with or without the size of u_hat in k."""
    rng = np.random.default_rng(0)
    f_hat, s, share, b = rng.uniform(-1.0, 1.0, (4, _RANDOM_CASES))
    F, eta, beta = 0.3, 0.2, 1.5
    f_hat, f, B = 3.0 * f_hat, 3.0 * f_hat + F * share, beta**b
    u_hat = -f_hat
    k = beta * (F + eta) + (beta - 1) * (np.abs(u_hat) if with_size else u_hat)
    ds = f + B * (u_hat - k * np.sign(s))
    return bool((s * ds <= -eta * np.abs(s) + 1e-12).all())


def _gain_size() -> bool:
    """(5.11), (5.19), (5.20): the gain needs the size of u_hat."""
    return _sliding_condition(with_size=True) and not _sliding_condition(with_size=False)


def _complete_division() -> bool:
    """(5.25): lambda = 1 - x_1/(r x_2): every term of the derivative is over r x_2."""
    r, v, omega, dv, domega, step = 0.12, 0.3, 3.0, -0.5, 2.0, 1e-7
    slip = 1 - v / (r * omega)
    true = ((1 - (v + dv * step) / (r * (omega + domega * step))) - slip) / step
    correct = (-dv + r * (1 - slip) * domega) / (r * omega)
    return differs(-dv + (1 - slip) * domega / omega, correct, true, 1e-4)


def _reaching() -> bool:
    """(5.43), (5.44): V = s^2/2 falls at least as eta |s|, for s of both signs; with s for |s| it grows below 0."""
    s, eta = np.array([-0.5, 0.5]), 0.2
    rate = s * -eta * np.sign(s)
    return bool(np.allclose(rate, -eta * np.abs(s)) and (-eta * s)[0] > 0)


def _layer() -> bool:
    """(5.47): inside the layer the law is s/theta: continuous at both edges and zero on the surface."""
    theta = 0.02
    inside = np.array([-theta, 0.0, theta]) / theta
    return bool(np.array_equal(inside, [-1.0, 0.0, 1.0]) and not np.array_equal(np.ones(3), [-1.0, 0.0, 1.0]))


def _cases() -> bool:
    """Cases I and II: at a slip of -0.18 a robot of 0.2 m/s has stopped long before 6 s and 1.5 m, on ice even."""
    stop = stop_on_ice()
    return stop.time_s < 2.0 and stop.way_m < 0.2


ERRATA = (
    Erratum(
        "[T]",
        "(4.2)",
        "two cases in one, the third branch missing, a length called lambda",
        "three branches",
        _brush_branches,
    ),
    Erratum(
        "[T]", "(4.4)", "the forward speed of a wheel lacks the track", "b/2 as lever of the yaw rate", _wheel_speed
    ),
    Erratum("[T]", "(4.9), (4.10)", "L_f and L_r exchanged", "front load with L_r, rear load with L_f", _loads),
    Erratum("[T]", "(4.12)", "the rear wheels are missing", "all wheels", _rear_wheels),
    Erratum(
        "[T]",
        "(4.14), (4.18), (4.19)",
        "rolling resistance in the wheel equation makes energy",
        "force on the body alone",
        _rolling_energy,
    ),
    Erratum(
        "[T]", "(4.17)-(4.20)", "yaw rate with the same sign for both wheels", "left minus, right plus", _yaw_signs
    ),
    Erratum(
        "[T]",
        "(4.17)-(4.20)",
        "A_1 and A_3 with opposite signs, minus signs lost in exponents",
        "one sign, exp(-A |v|)",
        _rolling_signs,
    ),
    Erratum(
        "[T]",
        "(5.11), (5.19), (5.20)",
        "u inside u_hat; a stray minus; u_hat without its size",
        "k with |u_hat|",
        _gain_size,
    ),
    Erratum("[T]", "(5.25)", "division by r x_2 incomplete", "every term", _complete_division),
    Erratum("[T]", "(5.26)", "b = 1/(r J_w)", "(1 - lambda)/J_w", _input_gain),
    Erratum("[T]", "(5.33)-(5.35)", "sign of f_hat; B_hat^-1 twice", "-f_hat, once", _equivalent_control),
    Erratum("[T]", "(5.43), (5.44)", "|s| and s^2", "d(s^2/2)/dt <= -eta |s|", _reaching),
    Erratum("[T]", "(5.47)", "the saturation is 1 inside the layer", "s/theta", _layer),
    Erratum(
        "[T]",
        "cases I, II",
        "-0.18, which brakes, for 6 s (I) and 1.5 m (II) at 0.1 and 0.2 m/s",
        "on ice, table 4.1, it stops in 1 s and 0.1 m",
        _cases,
    ),
)
