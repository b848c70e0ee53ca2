"""Evidence of whether the wheels show the speed of the body, and the one decision based on it.

evidence                                          effect on the belief (`judge`)

an outside speed near zero, rims that turn        the robot is held (`motion/outside_speed.py`): its speed is zero
a force that changes the speed of the rims as     the wheels grip: their speed is the body's, and a belief in a slide
  the whole robot's mass allows                     starts again from grip, unless a sensor of the body shows the speed
ground and grade unusual for grip, wheels that    gross slip: it starts again from wheels that slide, as long as the
  turn in the direction of their drive              slope has not been learnt
a change of the speed that neither force nor      not distinct from grip on a slope: the band widens as fast as
  pitch explains, and no evidence of grip           a usual slope moves a robot that slides
rims that changed the speed faster than any       a jump: the band widens to it
  force can
not a number, faster than its recent wheels, or   impossible for this robot (`is_lost`): it starts again from this
  against every encoder for long                    sample

Apparent inertia. Gripping wheels carry the whole robot, sliding wheels turn only themselves. With rims at the speed v_r
under a force F of the motors along x, d/dt v_r = (F - F_0)/M with

    grip    M_g = m + M_s        slide    M_s = J_w |G_x|^2 / r^2

On robots with wheels they differ by a factor of 10 to 50. Slopes and friction are nearly constant, so rims and force go
through a high pass, H = (T s/(1 + T s))^2 for the speed and H/s for the force, and U = I/M holds for the remainder:

    evidence of grip    L = 1/2 (min((U - I/M_s)^2 / sigma_s^2, g) - min((U - I/M_g)^2 / sigma_g^2, g))

A drive that changes its force is evidence all the time; a steady one is none.

Gross slip. From wheels that turn faster than their forces explain, a filter that assumes grip can only learn a slope, a
little in every step and with growing confidence. So both are compared by their squared Mahalanobis distance from the
usual values (-2 log of their likelihood), if only the driven wheels show the speed, and until the slope has been
learnt:

    grip    d^2 = sum ((x_i - x_i0) / sigma_i0)^2      over the states of ground and grade as learnt
    slide   d^2 = (ln a / sigma_a0)^2                  friction ratio a at which these wheels slide with their force

Reach. A robot on wheels is as fast as its wheels have recently turned, or faster by what a slope adds while they slide:

    |v| <= SHARE p + s + REST,   p+ = max(r |omega|, |v| where a sensor of the body shows it, e^(-dt/T) p)

with s the speed that sliding can have added since the speed was last observed.
"""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import std
from ohmward.filters.sanitize import every, some, within
from ohmward.quantities import FASTEST_M_S
from ohmward.trace import Scalar, exp, isfinite, log, logical_not, maximum, minimum, sin, sqrt, where
from ohmward.traction.motion.outside_speed import IS_HELD, Held, SpeedErrors
from ohmward.traction.motion.sample import CleanSample
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.body_sensors import BodyCorrection
from ohmward.traction.speed_observer.model import UNKNOWN_M_S, UNKNOWN_M_S2, Model
from ohmward.traction.speed_observer.slip_step import step_without_traction, traction

#: Time constant [s] with which an unexplained change of the speed is forgotten.
MEMORY_S = 1.0

#: Squared distance from which grip is unusual, and by which slide may be farther off than grip.
UNUSUAL, GRIP_MARGIN = 5.0, 2.0

#: A slope counts as learnt once its standard deviation is below this share of its first one.
LEARNT_SHARE = 0.5

#: States of ground and grade; the evidence needs all of them.
LEARNT = ("log_friction", "log_stiffness", "grade_rad", "rolling_excess")

#: Slip [m/s] at which any ground gives its full traction; relative sigma of a sliding wheel's friction; least friction
#: ratio.
SLIDING_M_S, SLIDING_FRICTION_STD, LEAST_RATIO = 1.0, 0.1, 1e-3

#: Prevents a division by zero on a ground that gives no force [N^2].
_TINY_N2 = 1e-12


def is_ambiguous(model: Model) -> bool:
    """True if grip and slide look alike: all that they differ in is learnt, and no other sensor distinguishes them."""
    others = model.noise.pitch_std_rad, model.noise.speed_std_m_s, model.noise.passive_std_rad_s
    return observes_grip(model) and all(std is None for std in others)


def change_by_momentum(before: Belief, after: Belief, clean: CleanSample, model: Model) -> Scalar:
    """Change [m/s] of the speed by the motors' impulse that the wheels do not keep, whatever the ground.

    F dt = J_w (omega* - omega+) / r with the end omega* of a step on level ground without traction.
    """
    robot, layout = model.scene.robot, model.layout
    parts = layout.split(before.mean)._replace(rolling_ratio=1.0)
    level = model.input(before.mean, clean)._replace(grade_rad=0.0)
    v, omega = step_without_traction(parts, level, model.scene, clean.modelled_s, model.static_load_N)
    end = after.mean[layout.wheel(0) : layout.robot_states]
    impulse_Ns = robot.inertia[robot.freedoms :] * (omega - end) / robot.wheel.radius_m
    return v[0] - before.mean[0] + robot.rolling[: model.driven, 0] @ impulse_Ns / robot.inertia[0]


def with_gross_slip(judged: Judgement, clean: CleanSample, model: Model, gate: float) -> Judgement:
    """Restart the belief from sliding wheels if that is the better hypothesis, and a possible one.

    gate: squared distance from which a friction is rejected.
    """
    if not is_ambiguous(model):
        return judged
    evidence, belief, _ = judged
    unexplained_m_s = evidence.unexplained_m_s
    log_friction = log_friction_of_sliding(belief, unexplained_m_s, model)
    grip = squared_mahalanobis(belief, model)
    slide = (log_friction / model.noise.friction_std) ** 2
    likelier = (grip > UNUSUAL) & (grip + GRIP_MARGIN > slide) & (slide < gate)
    driven = is_driven(belief, unexplained_m_s, clean, model)
    gross_slip = every([likelier, slope_unlearnt(belief, model), driven])
    restarted = sliding(belief, log_friction, unexplained_m_s, model)
    evidence = evidence._replace(unexplained_m_s=where(gross_slip, 0.0, unexplained_m_s))
    return Judgement(evidence, choose(gross_slip, restarted, belief), gross_slip)


def squared_mahalanobis(belief: Belief, model: Model) -> Scalar:
    """Squared distance of ground and grade from their usual values, in standard deviations before the first sample."""
    return sum((belief.mean[model.layout.index(name)] / model.initial_std(name)) ** 2 for name in LEARNT)


def slope_unlearnt(belief: Belief, model: Model) -> Scalar:
    """True where the slope is still about as unknown as at first."""
    i = model.layout.index("grade_rad")
    return belief.cov[i, i] > (LEARNT_SHARE * model.noise.grade_std_rad) ** 2


def is_driven(belief: Belief, unexplained_m_s: Scalar, clean: CleanSample, model: Model) -> Scalar:
    """True where traction and motor currents act in the direction of the unexplained change."""
    along = model.scene.robot.rolling[: model.driven, 0]
    by_ground = along @ model.traction_N(belief.mean) * unexplained_m_s > 0.0
    by_motors = along @ clean.current_A * unexplained_m_s > 0.0
    return every([by_ground, by_motors])


def log_friction_of_sliding(belief: Belief, unexplained_m_s: Scalar, model: Model) -> Scalar:
    """State `log_friction` at which the ground gives no more than the traction that the wheels have."""
    parts, force_N = model.layout.split(belief.mean), model.traction_N(belief.mean)
    away = where(unexplained_m_s > 0.0, SLIDING_M_S, -SLIDING_M_S)
    slip = model.slip(belief.mean) + model.scene.robot.rolling[: model.driven, 0] * away
    most_N = traction(slip, parts, model.static_load_N, model.scene)
    ratios = force_N * most_N / maximum(most_N * most_N, _TINY_N2)
    return belief.mean[model.layout.index("log_friction")] + log(maximum(reduce(maximum, ratios), LEAST_RATIO))


def sliding(belief: Belief, log_friction: Scalar, unexplained_m_s: Scalar, model: Model) -> Belief:
    """Belief in wheels that slide under a body as fast as its forces imply; ground and grade as unknown as at first."""
    layout, own = model.layout, model.layout.robot_states
    first = model.first_belief(belief.mean[layout.wheel(0) : own])
    mean = np.array([*belief.mean[:own], *first.mean[own:]])
    variances = np.array([*np.diag(belief.cov)[:own], *np.diag(first.cov)[own:]])
    friction = layout.index("log_friction")
    mean[0] = mean[0] - unexplained_m_s
    mean[friction] = log_friction
    variances[0] = variances[0] + (0.5 * unexplained_m_s) ** 2
    variances[friction] = SLIDING_FRICTION_STD**2
    return Belief(mean, np.diag(variances))


#: Time constant [s] of the high pass: long against the 0.5 ms in which a wheel that grips settles and the 10 ms of a
#: sample, short against a slide, whose beginning shows in it for as long.
HIGH_PASS_S = 0.1

#: Time constant [s] with which evidence is forgotten, largest NIS of either case in one sample, and mean evidence over
#: that time from which it counts. A sample that excludes both, as at the beginning of a slide, is no evidence.
EVIDENCE_MEMORY_S, MOST_NIS, ENOUGH = 0.15, 10.0, 3.0

#: Standard deviations of U [m/s]: of wheels that grip, by edges of slopes and by creep, and of wheels that slide, by
#: the noise of encoders and currents and by a friction that changes with the slip, a share of I/M_s.
GRIP_M_S, SLIDE_M_S, SLIDE_SHARE = 0.05, 0.03, 0.3

#: Standard deviations within which slopes and resistances are usual.
USUAL = 1.0

#: Standard deviation of the acceleration of a sliding robot, over that by the slope, and the time [s] for which it may
#: have been sliding before the evidence of grip is forgotten.
OPENS, SLID_BEFORE_S = 1.1, 0.8

#: Time [s] for which a measurement of the speed, or of the pitch, counts; then the speed is unobserved.
SEEN_S = 0.5

#: A belief in sliding wheels is wrong if they carry the robot with less than this share of their force while sliding:
#: with a falling friction they would run away.
GRIP_SHARE = 0.7

#: Time constant [s] with which a jump of the speed is forgotten, and the smallest one [m/s] that no slope causes in it:
#: it takes 2 m/s^2, as on 0.2 rad. The last one is added to it, in standard deviations of the speed before.
JUMP_MEMORY_S, JUMP_M_S, JUMP_SIGMAS = 0.15, 0.3, 2.0

#: Standard deviation of the speed of wheels that are seen to slide, over the unexplained change until then.
LAGS = 2.0

#: Relative standard deviation of the mass with an unknown load: with 40 % more mass, sliding wheels change the speed by
#: 0.29 less than estimated, two of these.
MASS_STD = 0.15

#: Wheels slide where their grip is below this; above, they show the speed of the body.
LEAST_GRIP = 0.2


class SpeedEvidence(NamedTuple):
    """Evidence from sample to sample."""

    rim_m_s: Scalar = 0.0  #: speed of the rims along x when the encoders last showed it
    rim_age_s: Scalar = HIGH_PASS_S  #: time since the encoders last showed it
    passed_m_s: np.ndarray = np.zeros(2)  #: that after one and after two high passes; the last is U
    force_N: Scalar = 0.0  #: of the motors, through a low pass
    impulse_Ns: Scalar = 0.0  #: I
    evidence_s: Scalar = 0.0  #: of grip, its fading sum over time
    unexplained_m_s: Scalar = 0.0  #: fading sum of the changes of speed that neither force nor pitch explains
    jump_m_s: Scalar = 0.0  #: the same over the last moments, by the wheels
    uncertain_m_s: Scalar = 0.0  #: standard deviation of the speed, through a low pass
    pitch_rad: Scalar = 0.0  #: last one measured
    no_pitch_s: Scalar = SEEN_S  #: time since the last pitch
    body_unobserved_s: Scalar = SEEN_S  #: time since a sensor of the body has shown the speed
    peak_N: Scalar = 0.0  #: greatest force since the wheels have been sliding in the belief
    disturbed_m_s: Scalar = 0.0  #: change of the speed by traction since then, while nothing else has shown the speed
    open_m_s: Scalar = 0.0  #: standard deviation of the speed by a slide that cannot be distinguished from grip
    wheels_m_s: Scalar = 0.0  #: greatest speed that wheels or sensors of the body have recently shown
    sliding_m_s: Scalar = 0.0  #: speed that sliding can have added since the speed was last observed
    outside: SpeedErrors = SpeedErrors()  #: rims, and errors of outside speeds
    held: Held = Held()  #: that the robot is held while its wheels turn


class Judgement(NamedTuple):
    """Outcome of a step."""

    evidence: SpeedEvidence  #: after it
    belief: Belief  #: after it
    ground_changed: Scalar  #: the condition that the belief started again from slide or from grip


def observes_grip(model: Model) -> bool:
    """True where the filter learns the ground from the forces of the wheels, and may mistake a slide for a slope."""
    return set(LEARNT) <= set(model.layout.names)


def judge(
    last: SpeedEvidence,
    before: Belief,
    wheels: Belief,
    body: BodyCorrection,
    clean: CleanSample,
    model: Model,
    gate: float,
) -> Judgement:
    """Evidence and belief after a step: whether the wheels show the speed, see the table above.

    last: before the step, but with `held` after it.
    before, wheels: beliefs before the step, and after the encoders of the driven wheels.
    body: after all measurements.
    gate: squared distance from which a friction is rejected.
    """
    if not observes_grip(model):
        return Judgement(last, body.belief, False)
    evidence = gathered(last, before, wheels, body, clean, model)
    slides = with_gross_slip(Judgement(evidence, body.belief, False), clean, model, gate)
    grips_again = with_grip(slides.evidence, last, slides.belief, clean, model)
    held = last.held.probability > IS_HELD
    evidence = grips_again.evidence
    evidence = evidence._replace(open_m_s=where(held, 0.0, evidence.open_m_s))
    ground_changed = some([slides.ground_changed, grips_again.ground_changed])
    return Judgement(evidence, grips_again.belief, ground_changed)


def gathered(
    evidence: SpeedEvidence, before: Belief, wheels: Belief, body: BodyCorrection, clean: CleanSample, model: Model
) -> SpeedEvidence:
    """The evidence after a step."""
    evidence = with_evidence(evidence, body.belief, clean, model)
    evidence = with_unexplained(evidence, before, wheels, body.belief, clean, model)
    unobserved_s = where(some([body.observable, clean.resting]), 0.0, evidence.body_unobserved_s + clean.dt_s)
    seen = some([unobserved_s < SEEN_S, grips(evidence)])
    rate_m_s2 = opening_m_s2(evidence, model)
    opened = maximum(evidence.open_m_s, SLID_BEFORE_S * rate_m_s2) + rate_m_s2 * clean.dt_s
    closing = exp(-clean.dt_s / MEMORY_S) * evidence.open_m_s
    suspicious = abs(evidence.unexplained_m_s) > usual_m_s(evidence, before, clean, model)
    open_m_s = where(seen, 0.0, where(suspicious, opened, closing))
    evidence = evidence._replace(body_unobserved_s=unobserved_s)
    open_m_s = maximum(open_m_s, where(has_jumped(evidence), abs(evidence.jump_m_s), 0.0))
    return evidence._replace(open_m_s=minimum(open_m_s, UNKNOWN_M_S))


def with_grip(
    evidence: SpeedEvidence, last: SpeedEvidence, belief: Belief, clean: CleanSample, model: Model
) -> Judgement:
    """The belief when its wheels begin to slide, and when they carry the robot although they slide in it.

    In the first case the speed has followed the wheels until the filter detected the slide, and is as uncertain as the
    change that neither force nor pitch explains; earlier evidence of grip no longer counts. In the second it follows
    the wheels again.

    last: before the step.
    """
    slides = every(grip < LEAST_GRIP for grip in model.grip(belief.mean, model.slip(belief.mean)))
    begins = slides & (last.peak_N <= 0.0)
    evidence = evidence._replace(evidence_s=where(begins, minimum(evidence.evidence_s, 0.0), evidence.evidence_s))
    peak_N = where(slides, maximum(abs(evidence.force_N), last.peak_N), 0.0)
    opens = begins & (evidence.no_pitch_s < SEEN_S)
    lag_m_s = where(opens, LAGS * abs(evidence.unexplained_m_s), where(slides, last.open_m_s, 0.0))
    unobserved = evidence.body_unobserved_s >= SEEN_S
    wrong = every([slides, grips(evidence), unobserved, abs(evidence.force_N) < GRIP_SHARE * peak_N])
    omega = belief.mean[model.layout.wheel(0) : model.layout.robot_states]
    robot = model.scene.robot
    force_N = robot.rolling[: model.driven, 0] @ model.traction_N(belief.mean)
    disturbed_m_s = last.disturbed_m_s + clean.modelled_s * force_N / robot.inertia[0]
    alone = every([slides, logical_not(wrong), unobserved])
    evidence = evidence._replace(
        peak_N=where(wrong, 0.0, peak_N),
        disturbed_m_s=where(alone, disturbed_m_s, 0.0),
        open_m_s=where(wrong, 0.0, maximum(evidence.open_m_s, lag_m_s)),
    )
    return Judgement(evidence, choose(wrong, model.first_belief(omega), belief), wrong)


def by_mass_m_s(evidence: SpeedEvidence) -> Scalar:
    """Standard deviation [m/s] of the speed by the mass, since the speed was last observed."""
    return MASS_STD * abs(evidence.disturbed_m_s)


def has_jumped(evidence: SpeedEvidence) -> Scalar:
    """The condition that the wheels have changed the estimated speed faster than any force can."""
    jumped = abs(evidence.jump_m_s) > JUMP_M_S + JUMP_SIGMAS * evidence.uncertain_m_s
    return every([jumped, logical_not(grips(evidence)), evidence.body_unobserved_s >= SEEN_S])


def slope_std_rad(evidence: SpeedEvidence, model: Model) -> Scalar:
    """Standard deviation [rad] of a usual slope: that of the pitch where it is measured."""
    usual, measured = model.noise.grade_std_rad, model.noise.pitch_std_rad
    return usual if measured is None else where(evidence.no_pitch_s < SEEN_S, measured, usual)


def opening_m_s2(evidence: SpeedEvidence, model: Model) -> Scalar:
    """Standard deviation [m/s^2] of the acceleration of a robot that slides.

    Without a pitch it follows from the slope, with a pitch from the force that is missing.
    """
    usual_m_s2 = OPENS * GRAVITY * model.noise.grade_std_rad
    if model.noise.pitch_std_rad is None:
        return usual_m_s2
    return where(evidence.no_pitch_s < SEEN_S, abs(evidence.unexplained_m_s) / MEMORY_S, usual_m_s2)


def grips(evidence: SpeedEvidence) -> Scalar:
    """The condition that the wheels have recently shown that they carry the robot."""
    return evidence.evidence_s > ENOUGH * EVIDENCE_MEMORY_S


def with_evidence(evidence: SpeedEvidence, belief: Belief, clean: CleanSample, model: Model) -> SpeedEvidence:
    """The evidence with the evidence of this step."""
    robot, n = model.scene.robot, model.driven
    radius_m, along = robot.wheel.radius_m, robot.rolling[:n, 0]
    share = along / (along @ along)
    measured = every(clean.wheel_measured[:n])
    rim_age_s = where(measured, 0.0, evidence.rim_age_s + clean.dt_s)
    measured_m_s = radius_m * (share @ belief.mean[model.layout.wheel(0) : model.layout.robot_states])
    rim_m_s = where(measured, measured_m_s, evidence.rim_m_s)
    force_N = robot.motor.wheel_constant_Nm_per_A / radius_m * (along @ clean.current_A)
    sliding_kg = float(along**2 @ robot.inertia[robot.freedoms :]) / radius_m**2
    gripping_kg = float(robot.inertia[0]) + sliding_kg

    fades = exp(-clean.dt_s / HIGH_PASS_S)
    first = fades * (evidence.passed_m_s[0] + rim_m_s - evidence.rim_m_s)
    second = fades * (evidence.passed_m_s[1] + first - evidence.passed_m_s[0])
    low_N = fades * evidence.force_N + (1.0 - fades) * force_N
    impulse_Ns = fades * (evidence.impulse_Ns + clean.modelled_s * (force_N - low_N))
    U, slide_m_s, grip_m_s = second, impulse_Ns / sliding_kg, impulse_Ns / gripping_kg
    slide_variance = SLIDE_M_S**2 + (SLIDE_SHARE * slide_m_s) ** 2
    slide = minimum((U - slide_m_s) ** 2 / slide_variance, MOST_NIS)
    grip = minimum((U - grip_m_s) ** 2 / GRIP_M_S**2, MOST_NIS)
    known = every([*clean.current_measured, rim_age_s < HIGH_PASS_S])
    counted = where(known, 0.5 * (slide - grip), 0.0)
    evidence_s = exp(-clean.dt_s / EVIDENCE_MEMORY_S) * evidence.evidence_s + clean.modelled_s * counted
    return evidence._replace(
        rim_m_s=rim_m_s,
        rim_age_s=rim_age_s,
        passed_m_s=np.array([first, second]),
        force_N=low_N,
        impulse_Ns=impulse_Ns,
        evidence_s=evidence_s,
    )


def with_unexplained(
    evidence: SpeedEvidence, before: Belief, wheels: Belief, after: Belief, clean: CleanSample, model: Model
) -> SpeedEvidence:
    """The evidence with the change of the speed in this step that neither force nor pitch explains."""
    evidence = with_pitch(evidence, clean, model)
    slope_rad = where(evidence.no_pitch_s < SEEN_S, evidence.pitch_rad, 0.0)
    forced_m_s = change_by_momentum(before, after, clean, model)
    explained_m_s = forced_m_s - GRAVITY * sin(slope_rad) * clean.modelled_s
    change_m_s = after.mean[0] - before.mean[0] - explained_m_s
    by_wheels_m_s = wheels.mean[0] - before.mean[0] - explained_m_s
    known = every([*clean.current_measured, clean.unmodelled_s <= 0.0, clean.modelled_s > 0.0])
    soon = exp(-clean.dt_s / JUMP_MEMORY_S)
    return evidence._replace(
        unexplained_m_s=where(known, exp(-clean.dt_s / MEMORY_S) * evidence.unexplained_m_s + change_m_s, 0.0),
        jump_m_s=where(known, soon * evidence.jump_m_s + by_wheels_m_s, 0.0),
        uncertain_m_s=std(before.cov[0, 0]) + soon * (evidence.uncertain_m_s - std(before.cov[0, 0])),
    )


def with_pitch(evidence: SpeedEvidence, clean: CleanSample, model: Model) -> SpeedEvidence:
    """The evidence with the pitch of this step, or with the last one."""
    if model.noise.pitch_std_rad is None:
        return evidence
    measured = isfinite(clean.pitch_rad)
    return evidence._replace(
        pitch_rad=where(measured, clean.pitch_rad, evidence.pitch_rad),
        no_pitch_s=where(measured, 0.0, evidence.no_pitch_s + clean.dt_s),
    )


def usual_m_s(evidence: SpeedEvidence, before: Belief, clean: CleanSample, model: Model) -> Scalar:
    """Unexplained change [m/s] of the speed up to which slope and rolling resistance are usual ones."""
    rolling_m_s2 = model.usual_rolling_N(before.mean, clean) / model.scene.robot.inertia[0]
    slope_m_s2 = GRAVITY * slope_std_rad(evidence, model)
    return USUAL * MEMORY_S * sqrt(slope_m_s2**2 + (model.noise.rolling_std * rolling_m_s2) ** 2)


#: Time constant [s] with which the greatest speed of the wheels is forgotten: sliding lasts for less.
FASTEST_MEMORY_S = 10.0

#: A body on omni wheels is faster than their rims by 2/sqrt(3), a tyre larger than its data sheet by some percent; a
#: robot that rolls back on its own has no more than REST_M_S before its wheels show it.
SHARE, REST_M_S = 1.25, 0.25

#: Acceleration [m/s^2] that sliding down a slope of 0.2 rad gives.
SLIDING_M_S2 = 2.0

#: Speed [m/s] and standard deviation that no belief reaches: twice the fastest robot, as an estimate may be further off
#: than a sensor.
LOST_M_S = 2.0 * FASTEST_M_S

#: Yaw rate and wheel speed [rad/s] that no belief reaches; nor does the standard deviation of a wheel speed.
LOST_YAW_RAD_S, LOST_WHEEL_RAD_S = 50.0, 1e3

#: Standard deviation of the speed after a restart, as a share of the rims' speed: wheels may be spinning then.
RESTART_SHARE = 0.5


def with_reach(
    evidence: SpeedEvidence,
    belief: Belief,
    body_observable: Scalar,
    unobserved_s: Scalar,
    clean: CleanSample,
    model: Model,
) -> SpeedEvidence:
    """The evidence with the speeds that the body can have reached after a step.

    body_observable: the condition that a sensor of the body shows its speed in this step.
    unobserved_s: time since the speed was last observed, before the step.
    """
    parts, robot = model.layout.split(belief.mean), model.scene.robot
    rims = robot.wheel.radius_m * parts.radius_ratio * abs(parts.omega)
    body = where(body_observable, abs(belief.mean[0]), 0.0)
    gap = minimum(UNKNOWN_M_S2 * clean.unmodelled_s, UNKNOWN_M_S)
    slid = evidence.sliding_m_s + SLIDING_M_S2 * clean.dt_s
    return evidence._replace(
        wheels_m_s=maximum(reduce(maximum, [*rims, body]), exp(-clean.dt_s / FASTEST_MEMORY_S) * evidence.wheels_m_s),
        sliding_m_s=minimum(gap + where(unobserved_s > 0.0, slid, 0.0), UNKNOWN_M_S),
    )


def fastest_m_s(evidence: SpeedEvidence) -> Scalar:
    """Greatest speed [m/s] that the body can have."""
    return SHARE * evidence.wheels_m_s + evidence.sliding_m_s + REST_M_S


def is_lost(
    belief: Belief, evidence: SpeedEvidence, rejected_s: np.ndarray, locked_out_s: float, model: Model
) -> Scalar:
    """True if the belief is impossible for this robot.

    rejected_s: (driven,) time for which each encoder has been outside its gate.
    locked_out_s: if all have been for longer, the belief is wrong.
    """
    x, P = belief
    layout = model.layout
    yaw, own = layout.index("yaw_rate_rad_s"), layout.robot_states
    fastest = minimum(fastest_m_s(evidence), LOST_M_S)
    sane = [
        isfinite(sum(x) + sum(P[i, j] for i in range(len(x)) for j in range(i + 1))),
        *[abs(x[i]) <= fastest for i in range(model.scene.robot.freedoms - 1)],
        P[0, 0] <= LOST_M_S**2,
        within(x[yaw], LOST_YAW_RAD_S),
        *[within(x[i], LOST_WHEEL_RAD_S) & (P[i, i] <= LOST_WHEEL_RAD_S**2) for i in range(layout.wheel(0), own)],
        some(time <= locked_out_s for time in rejected_s),
    ]
    return logical_not(every(sane))


def restarted(before: Belief, clean: CleanSample, model: Model) -> Belief:
    """New belief from this sample: the body moves as its wheels show, or quite differently.

    before: belief before the step, for wheels that are not measured.
    """
    layout, n = model.layout, model.driven
    usable = [where(within(value, LOST_WHEEL_RAD_S), value, 0.0) for value in before.mean[layout.wheel(0) :][:n]]
    omega = where(clean.wheel_measured[:n], clean.wheel_speed_rad_s[:n], np.array(usable))
    rim_m_s = reduce(maximum, model.scene.robot.wheel.radius_m * abs(omega))
    mean, cov = model.first_belief(omega)
    speed, *others = np.diag(cov)
    return Belief(mean, np.diag(np.array([speed + (RESTART_SHARE * rim_m_s) ** 2, *others])))
