"""Apparent inertia of the wheels: what a change of their force accelerates tells whether they grip.

Wheels that grip carry the whole robot, wheels that slide turn themselves alone. With rims as fast as v_r under a force
F of the motors along x, d/dt v_r = (F - F_0)/M with

    grip    M_g = m + M_s        slide    M_s = J_w |G_x|^2 / r^2

On robots with wheels they differ by a factor of 10 to 50. Slopes and friction are nearly constant, so rims and force go
through a high pass, H = (T s/(1 + T s))^2 for the speed and H/s for the force, and U = I/M holds for what is left:

    evidence of grip    L = 1/2 ((U - I/M_s)^2 / sigma_s^2 - (U - I/M_g)^2 / sigma_g^2)

A drive that changes its force is evidence all the time; a steady one is none. Then a robot that the ground lets climb
with less force than its slope takes looks like one that grips on another slope, and nothing on board tells them apart:
the speed is not observable. Where the force is beyond what a usual slope and rolling resistance explain and no
evidence of grip is at hand, the band of the speed opens as fast as a slope of the usual size moves a robot that slides.
It opens too where wheels take the speed along faster than any force can have changed it. And a belief in wheels that
slide, with a friction that falls as their force does, starts again from grip where they show that they carry the robot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import std
from ohmward.filters.sanitize import every, some
from ohmward.trace import clip, exp, isfinite, logical_not, maximum, minimum, sin, sqrt, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.sanitize import CleanSample
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.body_sensors import BodyCorrection
from ohmward.traction.speed_observer.gross_slip import LEARNT, MEMORY_S, change_by_momentum
from ohmward.traction.speed_observer.model import UNKNOWN_M_S, Model
from ohmward.traction.speed_observer.slip_step import without_traction

#: Time constant [s] of the high pass: long against the 0.5 ms in which a wheel that grips settles and the 10 ms of a
#: sample, short against a slide, whose beginning shows in it for as long.
HIGH_PASS_S = 0.1

#: Time constant [s] with which evidence is forgotten, the most that one sample may say, and the mean over that time
#: from which on it counts.
EVIDENCE_S, MOST_EVIDENCE, ENOUGH = 0.15, 5.0, 3.0

#: Standard deviations of U [m/s]: of wheels that grip, by edges of slopes and by creep, and of wheels that slide, by
#: the noise of encoders and currents and by a friction that changes with the slip, a share of I/M_s.
GRIP_M_S, SLIDE_M_S, SLIDE_SHARE = 0.05, 0.03, 0.3

#: Usual slopes and resistances are within so many standard deviations.
USUAL = 1.0

#: Standard deviation of the acceleration of a robot that slides, in those that the slope gives, and the time [s] for
#: which it may have been sliding before the evidence of grip is forgotten.
OPENS, BEFORE_S = 1.1, 0.8

#: For so long [s] a sensor of the body that has shown the speed counts as showing it.
SEEN_S = 0.5

#: A belief in sliding wheels is wrong where they carry the robot with less than this share of the force that they have
#: given while sliding: a friction that falls would let them run away.
GRIP_SHARE = 0.7

#: Time constant [s] with which a jump of the speed is forgotten, and the least one [m/s] that no slope makes in it: it
#: takes 2 m/s^2, as on 0.2 rad. One of a speed that was uncertain is none.
JUMP_S, JUMP_M_S, JUMP_SIGMAS = 0.15, 0.3, 2.0

#: Standard deviation of the speed of wheels that are seen to slide, over the unexplained change until then.
LAGS = 2.0

#: Relative standard deviation of the mass with a load that nobody told: with 40 % more of it, wheels that slide change
#: the speed by 0.29 less than believed, two of these.
MASS_STD = 0.15

#: Wheels slide where their grip is below this; above, they show the speed of the body.
LEAST_GRIP = 0.2


class ApparentInertia(NamedTuple):
    """Test from sample to sample."""

    rim_m_s: Scalar  #: speed of the rims along x when the encoders last showed it
    rim_age_s: Scalar  #: time since then
    passed_m_s: np.ndarray  #: (2,) that after one and after two high passes; the last is U
    force_N: Scalar  #: of the motors, through a low pass
    impulse_Ns: Scalar  #: I
    evidence_s: Scalar  #: of grip, its sum over time, and fading
    unexplained_m_s: Scalar  #: change of the speed of late that neither force nor pitch explains, and fading
    jump_m_s: Scalar  #: the same of the last moments, by the wheels
    uncertain_m_s: Scalar  #: standard deviation of the speed, through a low pass
    pitch_rad: Scalar  #: last one measured
    no_pitch_s: Scalar  #: time since then
    unobserved_s: Scalar  #: time since a sensor of the body has shown the speed
    peak_N: Scalar  #: greatest force since the wheels have been sliding in the belief
    disturbed_m_s: Scalar  #: change of the speed by traction since then, while nothing else has shown the speed
    open_m_s: Scalar  #: standard deviation of the speed by a slide that cannot be told from grip


class InertiaTest(NamedTuple):
    """Outcome of a step."""

    test: ApparentInertia  #: after it
    belief: Belief  #: after it
    started: Scalar  #: the condition that the belief started again


def untested() -> ApparentInertia:
    """The test before the first sample."""
    return ApparentInertia(
        0.0, HIGH_PASS_S, np.zeros(2), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, SEEN_S, SEEN_S, 0.0, 0.0, 0.0
    )


def tells_grip(model: Model) -> bool:
    """True where the filter learns the ground from the forces of the wheels, and may take a slide for a slope."""
    return set(LEARNT) - {"log_friction"} <= set(model.layout.names) and model.states.friction != "known"


def advance_inertia(
    test: ApparentInertia,
    before: Belief,
    wheels: Belief,
    body: BodyCorrection,
    clean: CleanSample,
    model: Model,
) -> ApparentInertia:
    """The test after a step.

    before, wheels: beliefs before the step, and after the encoders of the driven wheels.
    body: after all measurements.
    """
    if not tells_grip(model):
        return test
    test = with_evidence(test, body.belief, clean, model)
    test = with_unexplained(test, before, wheels, body.belief, clean, model)
    unobserved_s = where(some([body.observable, clean.resting]), 0.0, test.unobserved_s + clean.dt_s)
    seen = some([unobserved_s < SEEN_S, grips(test)])
    rate_m_s2 = opening_m_s2(test, model)
    opened = maximum(test.open_m_s, BEFORE_S * rate_m_s2) + rate_m_s2 * clean.dt_s
    closing = exp(-clean.dt_s / MEMORY_S) * test.open_m_s
    suspicious = abs(test.unexplained_m_s) > usual_m_s(test, before, clean, model)
    open_m_s = where(seen, 0.0, where(suspicious, opened, closing))
    test = test._replace(unobserved_s=unobserved_s)
    open_m_s = maximum(open_m_s, where(has_jumped(test), abs(test.jump_m_s), 0.0))
    return test._replace(open_m_s=minimum(open_m_s, UNKNOWN_M_S))


def reconsidered(
    test: ApparentInertia, last: ApparentInertia, belief: Belief, clean: CleanSample, model: Model
) -> InertiaTest:
    """The belief where wheels begin to slide in it, and where they carry the robot although they slide in it.

    In the first case the speed has been the wheels' for as long as the filter took to see the slide, and is as
    uncertain as what neither force nor pitch explains. In the second it is the wheels' again.

    last: before the step.
    """
    if not tells_grip(model):
        return InertiaTest(test, belief, False)
    slides = every(grip < LEAST_GRIP for grip in model.grip(belief.mean, model.slip(belief.mean)))
    peak_N = where(slides, maximum(abs(test.force_N), last.peak_N), 0.0)
    begins = every([slides, last.peak_N <= 0.0, test.no_pitch_s < SEEN_S])
    lag_m_s = where(begins, LAGS * abs(test.unexplained_m_s), where(slides, last.open_m_s, 0.0))
    wrong = every([slides, grips(test), abs(test.force_N) < GRIP_SHARE * peak_N])
    omega = belief.mean[model.layout.wheel(0) : model.layout.robot_states]
    robot = model.scene.robot
    force_N = robot.rolling[: model.driven, 0] @ model.traction_N(belief.mean)
    disturbed_m_s = last.disturbed_m_s + clean.modelled_s * force_N / robot.inertia[0]
    alone = every([slides, logical_not(wrong), test.unobserved_s >= SEEN_S])
    test = test._replace(
        peak_N=where(wrong, 0.0, peak_N),
        disturbed_m_s=where(alone, disturbed_m_s, 0.0),
        open_m_s=where(wrong, 0.0, maximum(test.open_m_s, lag_m_s)),
    )
    return InertiaTest(test, choose(wrong, model.first_belief(omega), belief), wrong)


def by_mass_m_s(test: ApparentInertia) -> Scalar:
    """Standard deviation [m/s] of the speed by the mass, since nothing has shown the speed."""
    return MASS_STD * abs(test.disturbed_m_s)


def has_jumped(test: ApparentInertia) -> Scalar:
    """The condition that the wheels have taken the speed along as no force can have changed it."""
    jumped = abs(test.jump_m_s) > JUMP_M_S + JUMP_SIGMAS * test.uncertain_m_s
    return every([jumped, logical_not(grips(test)), test.unobserved_s >= SEEN_S])


def slope_std_rad(test: ApparentInertia, model: Model) -> Scalar:
    """Standard deviation [rad] of a usual slope: of what the pitch leaves of it where it is measured."""
    usual, measured = model.noise.grade_std_rad, model.noise.pitch_std_rad
    return usual if measured is None else where(test.no_pitch_s < SEEN_S, measured, usual)


def opening_m_s2(test: ApparentInertia, model: Model) -> Scalar:
    """Standard deviation [m/s^2] of the acceleration of a robot that slides.

    Without a pitch the slope tells it, with a pitch the force that is missing.
    """
    usual_m_s2 = OPENS * GRAVITY * model.noise.grade_std_rad
    if model.noise.pitch_std_rad is None:
        return usual_m_s2
    return where(test.no_pitch_s < SEEN_S, abs(test.unexplained_m_s) / MEMORY_S, usual_m_s2)


def grips(test: ApparentInertia) -> Scalar:
    """The condition that the wheels have shown of late that they carry the robot."""
    return test.evidence_s > ENOUGH * EVIDENCE_S


def with_evidence(test: ApparentInertia, belief: Belief, clean: CleanSample, model: Model) -> ApparentInertia:
    """The test with the evidence of this step."""
    robot, n = model.scene.robot, model.driven
    radius_m, along = robot.wheel.radius_m, robot.rolling[:n, 0]
    share = along / (along @ along)
    measured = every(clean.wheel_measured[:n])
    rim_age_s = where(measured, 0.0, test.rim_age_s + clean.dt_s)
    measured_m_s = radius_m * (share @ belief.mean[model.layout.wheel(0) : model.layout.robot_states])
    rim_m_s = where(measured, measured_m_s, test.rim_m_s)
    force_N = robot.motor.wheel_constant_Nm_per_A / radius_m * (along @ clean.current_A)
    sliding_kg = float(along**2 @ robot.inertia[robot.freedoms :]) / radius_m**2
    gripping_kg = float(robot.inertia[0]) + sliding_kg

    fades = exp(-clean.dt_s / HIGH_PASS_S)
    first = fades * (test.passed_m_s[0] + rim_m_s - test.rim_m_s)
    second = fades * (test.passed_m_s[1] + first - test.passed_m_s[0])
    low_N = fades * test.force_N + (1.0 - fades) * force_N
    impulse_Ns = fades * (test.impulse_Ns + clean.modelled_s * (force_N - low_N))
    U, slide_m_s, grip_m_s = second, impulse_Ns / sliding_kg, impulse_Ns / gripping_kg
    slide_variance = SLIDE_M_S**2 + (SLIDE_SHARE * slide_m_s) ** 2
    L = 0.5 * ((U - slide_m_s) ** 2 / slide_variance - (U - grip_m_s) ** 2 / GRIP_M_S**2)
    known = every([*clean.current_measured, rim_age_s < HIGH_PASS_S])
    evidence = where(known, clip(L, -MOST_EVIDENCE, MOST_EVIDENCE), 0.0)
    evidence_s = exp(-clean.dt_s / EVIDENCE_S) * test.evidence_s + clean.modelled_s * evidence
    return test._replace(
        rim_m_s=rim_m_s,
        rim_age_s=rim_age_s,
        passed_m_s=np.array([first, second]),
        force_N=low_N,
        impulse_Ns=impulse_Ns,
        evidence_s=evidence_s,
    )


def with_unexplained(
    test: ApparentInertia, before: Belief, wheels: Belief, after: Belief, clean: CleanSample, model: Model
) -> ApparentInertia:
    """The test with the change of the speed in this step that neither force nor pitch explains."""
    test = with_pitch(test, clean, model)
    slope_rad = where(test.no_pitch_s < SEEN_S, test.pitch_rad, 0.0)
    forced_m_s = change_by_momentum(before, after, clean, model)
    explained_m_s = forced_m_s - GRAVITY * sin(slope_rad) * clean.modelled_s
    change_m_s = after.mean[0] - before.mean[0] - explained_m_s
    by_wheels_m_s = wheels.mean[0] - before.mean[0] - explained_m_s
    known = every([*clean.current_measured, clean.unmodelled_s <= 0.0, clean.modelled_s > 0.0])
    soon = exp(-clean.dt_s / JUMP_S)
    return test._replace(
        unexplained_m_s=where(known, exp(-clean.dt_s / MEMORY_S) * test.unexplained_m_s + change_m_s, 0.0),
        jump_m_s=where(known, soon * test.jump_m_s + by_wheels_m_s, 0.0),
        uncertain_m_s=std(before.cov[0, 0]) + soon * (test.uncertain_m_s - std(before.cov[0, 0])),
    )


def with_pitch(test: ApparentInertia, clean: CleanSample, model: Model) -> ApparentInertia:
    """The test with the pitch of this step, or with the last one."""
    if model.noise.pitch_std_rad is None:
        return test
    measured = isfinite(clean.pitch_rad)
    return test._replace(
        pitch_rad=where(measured, clean.pitch_rad, test.pitch_rad),
        no_pitch_s=where(measured, 0.0, test.no_pitch_s + clean.dt_s),
    )


def usual_m_s(test: ApparentInertia, before: Belief, clean: CleanSample, model: Model) -> Scalar:
    """Unexplained change [m/s] of the speed up to which slope and rolling resistance are usual ones."""
    robot, parts = model.scene.robot, model.layout.split(before.mean)._replace(rolling_ratio=1.0)
    forces = without_traction(parts, model.input(before.mean, clean), model.scene, model.static_load_N)
    rolling_m_s2 = robot.rolling[:, 0] @ forces.rolling_N / robot.inertia[0]
    slope_m_s2 = GRAVITY * slope_std_rad(test, model)
    return USUAL * MEMORY_S * sqrt(slope_m_s2**2 + (model.noise.rolling_std * rolling_m_s2) ** 2)
