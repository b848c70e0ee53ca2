"""Estimate of the speed observer: slip, forces, time for which the speed has not been observable, and alarms.

Alarms for a wheel that slips and for a robot that is stuck: tests of an estimate against its own sigma.

A wheel slips where |s| - s_allowed > z sigma_s. If the sigma is correct, a wheel whose slip is just the allowed one
raises the alarm in a share 1 - Phi(z) of the samples, one that slips less in fewer: that is the false-alarm rate.
Samples of one wheel are correlated, so alarms come in bursts: the rate is a share of time, not a count of events.

The robot is immobilised if its wheels turn and its speed plus z sigma_v is below a share of theirs, for a while. While
the speed of the body is unobserved, sigma_v grows and the test gives no alarm: it never guesses.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_each_not_negative, require_positive
from ohmward.errors import InputError
from ohmward.filters.belief import Belief
from ohmward.filters.flags import SampleFlag
from ohmward.filters.linear_algebra import TINY, std
from ohmward.trace import Scalar, linearize, maximum, minimum, sqrt, where
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.motion.outside_speed import STUCK_SHARE, TURNS_M_S
from ohmward.traction.motion.sample import CleanSample
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.model import Model


class SlipEstimate(NamedTuple):
    """Estimate after a sample. A quantity that is not a state has its assumed value, and std 0.

    >>> estimator = ow.SlipEstimator("turtlebot4")
    >>> estimate = estimator.update(0.0, wheel_speed_rad_s=[5.0, 5.0], yaw_rate_rad_s=0.0)
    >>> estimate.slip_speed_m_s.shape
    (2,)

    speed_m_s: of the body, forward.
    speed_std_m_s: standard deviation of that speed.
    yaw_rate_rad_s: > 0 to the left.
    yaw_rate_std_rad_s: standard deviation of the yaw rate.
    wheel_speed_rad_s: (driven,) speed of each wheel.
    slip_speed_m_s: (driven,) r omega - v of the wheel's centre.
    slip_speed_std_m_s: (driven,) standard deviation of the slip speed.
    slip_ratio: (driven,) nan below a floor of speed.
    traction_N: (driven,) force of the ground.
    friction_ratio: (driven,) largest traction over the terrain's.
    friction_std: (driven,) relative standard deviation of that ratio.
    grade_rad: > 0 uphill.
    grade_std_rad: standard deviation of the grade.
    radius_ratio: effective radius over the robot's.
    radius_std: standard deviation of that ratio.
    grip: (driven,) slope of traction over slip, one sigma of slip beyond the estimate, over the slope without slip:
        1 grips, 0 spins. The wheels measure the speed of the body only as far as they grip.
    unobserved_s: time since the speed of the body was last observed: no wheel gripped, no passive wheel turned, no
        external speed came. The speed is then dead reckoning from the forces, and `speed_std_m_s` grows.
    slipping: (driven,) 1 where the slip is beyond the allowed one, else 0.
    immobilised: 1 where the wheels turn and the robot does not, else 0.
    flags: sum of `SlipFlag` values; 0 is a sample without incident.
    """

    speed_m_s: Any
    speed_std_m_s: Any
    yaw_rate_rad_s: Any
    yaw_rate_std_rad_s: Any
    wheel_speed_rad_s: np.ndarray
    slip_speed_m_s: np.ndarray
    slip_speed_std_m_s: np.ndarray
    slip_ratio: np.ndarray
    traction_N: np.ndarray
    friction_ratio: np.ndarray
    friction_std: np.ndarray
    grade_rad: Any
    grade_std_rad: Any
    radius_ratio: Any
    radius_std: Any
    grip: np.ndarray
    unobserved_s: Any
    slipping: np.ndarray
    immobilised: Any
    flags: Any


class SlipFlag(SampleFlag):
    """Events at a sample. None of them stops the observer.

    >>> ow.SlipEstimator("turtlebot4").update(0.0, wheel_speed_rad_s=[None, None]).flags
    SlipFlag.NO_CURRENT|NO_ENCODER
    """

    BAD_TIME = 1  # dt_s is not a number, negative or longer than an hour: taken as 0
    GAP = 2  # a step longer than the last current holds: the speed is uncertain in the rest of it
    NO_CURRENT = 4  # of at least one motor, or an impossible one: the last one fades, its torque is unknown
    NO_ENCODER = 8  # of at least one driven wheel when one was due: not a number, or an impossible one
    GROUND_CHANGED = 16  # a wheel moved as the model excludes: its ground is unknown, its speed is the encoder's
    ENCODER_REJECTED = 32  # a wheel has contradicted the model for so long that its encoder is no longer used
    GYRO_REJECTED = 64  # yaw rate outside its gate, or stuck
    SPEED_REJECTED = 128  # outside speed outside its gate
    SPEED_RESET = 256  # outside speeds have contradicted the estimate for too long: it was widened to accept this one
    STANDSTILL = 512  # wheels and motors at rest: speed is zero
    SPEED_UNOBSERVED = 1024  # the speed has not been observed for a while: dead reckoning
    NOT_POSITIVE_DEFINITE = 2048  # the covariance had to be repaired
    RESTARTED = 4096  # the state had become impossible for this robot: a new one was started from this sample
    ENCODER_SPIKE = 8192  # an encoder jumped further than a wheel can: not used


@dataclass(frozen=True)
class SlipAlarm:
    """Settings of both tests."""

    #: share of the samples in which a wheel at the allowed slip raises the alarm, in (0, 0.5)
    false_alarm_rate: float = 1e-3
    allowed_m_s: float = 0.03  #: slip speed that is always allowed, >= 0
    allowed_ratio: float = 0.05  #: further slip that is allowed, over the speed of the wheel's rim, >= 0
    stuck_rim_m_s: float = TURNS_M_S  #: rim speed from which the wheels count as turning, > 0
    stuck_ratio: float = STUCK_SHARE  #: share of the rim speed below which the robot counts as stuck, in (0, 1)
    stuck_s: float = 1.0  #: time for which it must be, >= 0

    def __post_init__(self) -> None:
        if not 0 < self.false_alarm_rate < 0.5:
            raise InputError(f"slip_alarm.false_alarm_rate must be > 0 and < 0.5, got {self.false_alarm_rate:g}")
        if not 0 < self.stuck_ratio < 1:
            raise InputError(f"slip_alarm.stuck_ratio must be > 0 and < 1, got {self.stuck_ratio:g}")
        require_each_not_negative("slip_alarm.", self, "allowed_m_s", "allowed_ratio", "stuck_s")
        require_positive("slip_alarm.stuck_rim_m_s", self.stuck_rim_m_s)

    @property
    def z(self) -> float:
        """Sigmas to the alarm; two-sided tests of a slip near 0 have no more false alarms than twice the rate."""
        return NormalDist().inv_cdf(1 - self.false_alarm_rate)

    def slips(self, slip_m_s: Any, slip_std_m_s: Any, rim_m_s: Any) -> Any:
        """True where a wheel slips."""
        return abs(slip_m_s) - self.allowed_m_s - self.allowed_ratio * abs(rim_m_s) > self.z * slip_std_m_s

    def stands(self, speed_m_s: Any, speed_std_m_s: Any, rim_m_s: Any) -> Any:
        """True where the body stands while this wheel turns."""
        turns = abs(rim_m_s) > self.stuck_rim_m_s
        return turns & (abs(speed_m_s) + self.z * speed_std_m_s < self.stuck_ratio * abs(rim_m_s))


class DrivenWheels(NamedTuple):
    """The driven wheels, each (driven,), and the body."""

    speed_std_m_s: Scalar  #: of the body
    #: speed of the wheel's centre along its rolling direction
    travel_m_s: np.ndarray
    travel_std_m_s: np.ndarray
    #: slip speed
    slip_m_s: np.ndarray
    slip_std_m_s: np.ndarray
    rim_m_s: np.ndarray  #: slip plus travel
    grip: np.ndarray  #: at one sigma of slip beyond the estimate, in [0, 1]


def driven_wheels(belief: Belief, open_m_s: Scalar, model: Model) -> DrivenWheels:
    """Travel, slip and grip of the driven wheels.

    open_m_s: standard deviation of the speed in addition to the belief's.
    """
    x, P = belief
    G, freedoms = model.scene.robot.rolling[: model.driven], model.scene.robot.freedoms
    slip, H = linearize(model.slip, x)
    slip_std = np.array([std(row @ P @ row + (g * open_m_s) ** 2) for row, g in zip(H, G[:, 0], strict=True)])
    forward = np.array([s >= 0 for s in slip])
    travel = G @ x[:freedoms]
    return DrivenWheels(
        speed_std_m_s=std(P[0, 0] + open_m_s**2),
        travel_m_s=travel,
        travel_std_m_s=np.array([std(row @ P[:freedoms, :freedoms] @ row + (row[0] * open_m_s) ** 2) for row in G]),
        slip_m_s=slip,
        slip_std_m_s=slip_std,
        rim_m_s=slip + travel,
        grip=model.grip(x, where(forward, slip + slip_std, slip - slip_std)),
    )


def with_unknown_mass(wheels: DrivenWheels, by_mass_m_s: Scalar, model: Model) -> DrivenWheels:
    """The wheels with this standard deviation added to the speed; their grip stays."""
    along_m_s = model.scene.robot.rolling[: model.driven, 0] * by_mass_m_s
    return wheels._replace(
        speed_std_m_s=sqrt(wheels.speed_std_m_s**2 + by_mass_m_s**2),
        travel_std_m_s=sqrt(wheels.travel_std_m_s**2 + along_m_s**2),
        slip_std_m_s=sqrt(wheels.slip_std_m_s**2 + along_m_s**2),
    )


def conclude(
    belief: Belief,
    wheels: DrivenWheels,
    unobserved_s: Scalar,
    stuck: Scalar,
    clean: CleanSample,
    model: Model,
    alarm: SlipAlarm,
) -> SlipEstimate:
    """The estimate after a sample, still without flags.

    stuck: the condition that the robot stands while its wheels turn.
    """
    x, P = belief
    parts, yaw = model.layout.split(x), model.layout.index("yaw_rate_rad_s")
    slips = zip(wheels.slip_m_s, wheels.slip_std_m_s, wheels.rim_m_s, strict=True)
    rims = zip(wheels.rim_m_s, wheels.travel_m_s, strict=True)
    return SlipEstimate(
        speed_m_s=x[0],
        speed_std_m_s=wheels.speed_std_m_s,
        yaw_rate_rad_s=x[yaw],
        yaw_rate_std_rad_s=std(P[yaw, yaw]),
        wheel_speed_rad_s=parts.omega,
        slip_speed_m_s=wheels.slip_m_s,
        slip_speed_std_m_s=wheels.slip_std_m_s,
        slip_ratio=np.array([slip_ratio(rim, travel) for rim, travel in rims]),
        traction_N=model.traction_N(x),
        friction_ratio=parts.friction,
        friction_std=np.array([model.std_of("log_friction", P)] * model.driven),
        grade_rad=model.input(x, clean).grade_rad,
        grade_std_rad=grade_std(belief, clean, model),
        radius_ratio=parts.radius_ratio,
        radius_std=model.std_of("radius_ratio", P),
        grip=wheels.grip,
        unobserved_s=unobserved_s,
        slipping=np.array([where(alarm.slips(slip, slip_std, rim), 1.0, 0.0) for slip, slip_std, rim in slips]),
        immobilised=where(stuck, 1.0, 0.0),
        flags=0.0,
    )


def grade_std(belief: Belief, clean: CleanSample, model: Model) -> Scalar:
    """Standard deviation [rad] of the grade, including unusual rolling resistance that may really be grade.

    In a steady drive a long slope and a changed resistance look alike, and the prior expects short slopes: the force of
    a long one is attributed to the resistance. So the unusual part of that, over the weight, counts as far as the two
    cannot be distinguished, by their correlation.
    """
    (x, P), names = belief, model.layout.names
    if not {"grade_rad", "rolling_excess"} <= set(names):
        return model.std_of("grade_rad", P)
    i, j = model.layout.index("grade_rad"), model.layout.index("rolling_excess")
    alike = P[i, j] * P[i, j] / maximum(P[j, j], TINY)  # the squared correlation times the variance of the grade
    share = minimum(alike / maximum(P[i, i], TINY), 1.0)
    weight_N = GRAVITY * model.scene.robot.inertia[0]
    may_be_rad = x[j] * (abs(model.usual_rolling_N(x, clean)) / weight_N)
    return std(P[i, i] + share * may_be_rad * may_be_rad)
