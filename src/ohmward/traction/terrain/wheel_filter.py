"""Motion of the rims and forces of the wheels, from encoders and motor currents: EKF, UKF, AEKF or AUKF.

    x = [w, F]       w: (freedoms,) motion that the driven wheels make, as if none slipped; F: (driven,) forces [N]
    w+ = w + noise,  F+ = F + noise                             both wander: nothing is assumed of ground or mass
    omega = G_d w / r,   I = current_for_torque(r F, omega)     encoders first, then currents

Slip is no state: without a sensor of the speed nothing would correct it. It follows from F and from the floor. The
filter makes F and w smooth and says how sure they are.

With matching (AEKF, AUKF) the variance of each encoder and current is learnt from its residuals, [T] 3.50:

    R_k = mean of eps^2 + P_yy,   eps = y - h(x_k|k)

A sample that surprises by more than three sigma is a wheel that starts or meets something: a jump of the state, not
noise of the sensor. It is used and not learnt from, else the filter would go deaf where it has to follow.

A number that is missing has a variance that leaves the belief as it was; what it would have shown wanders on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_positive
from ohmward.errors import InputError
from ohmward.filters import extended, kalman, unscented
from ohmward.filters.belief import Belief, Innovation, PackedBelief, pack, unpack
from ohmward.trace import isfinite, linearize, maximum, minimum, sqrt, where
from ohmward.traction.robot.motor import current_for_torque
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.demand import static_loads

#: The filter of the currents, and whether R is matched, by name.
METHODS: dict[str, tuple[ModuleType, bool]] = {
    "ekf": (extended, False),
    "aekf": (extended, True),
    "ukf": (unscented, False),
    "aukf": (unscented, True),
}
#: A surprise of more sigmas than this is not learnt from.
_SURPRISE = 3.0
#: Matched standard deviations never fall below this share of the given ones.
_LEAST_SHARE = 0.2
#: Variance of a number that is missing, over the given one.
_MISSING = 1e12
#: Of rims that a first sample without all encoders leaves open [m/s].
_UNKNOWN_M_S = 1.0


class WheelSample(NamedTuple):
    """dt_s: since the sample before; wheel_speed_rad_s, current_A: (driven,), nan where nothing new was measured."""

    dt_s: Any
    wheel_speed_rad_s: np.ndarray
    current_A: np.ndarray


class WheelState(NamedTuple):
    """What the filter carries from sample to sample.

    belief: mean (freedoms + driven,) and triangle of the covariance.
    variance: (2 driven,) of encoders and currents.
    samples: how many are in these, those that the given ones count for included.
    """

    belief: PackedBelief
    variance: np.ndarray
    samples: Any


class WheelBelief(NamedTuple):
    """rim, rim_std: (freedoms,) motion of the rims; force_N, force_std_N: (driven,) of the ground on the wheels."""

    rim: np.ndarray
    rim_std: np.ndarray
    force_N: np.ndarray
    force_std_N: np.ndarray


@dataclass(frozen=True)
class WheelFilter:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        robot: its wheels and motors.
        method: one of `METHODS`.
        encoder_std_rad_s, current_std_A: of one sample.
        speed_walk: of each motion of the rims, m/s over the root of a second; rotations take it over the arm.
        force_walk: of each force, share of the mean load over the root of a second.
        window: samples over which a matched variance is the mean; then it forgets exponentially.
        given_samples: for so many of them the given variances count.
    """

    robot: Robot
    method: str = "ukf"
    encoder_std_rad_s: float = 0.1
    current_std_A: float = 0.2
    speed_walk: float = 0.03
    force_walk: float = 0.15
    window: float = 1000.0
    given_samples: float = 100.0

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}")
        for name in ("encoder_std_rad_s", "current_std_A", "speed_walk", "force_walk", "window", "given_samples"):
            require_positive(name, getattr(self, name))

    @cached_property
    def walk(self) -> np.ndarray:
        """Random walk of each state (n,), over the root of a second."""
        robot = self.robot
        arm_m = np.abs(robot.rolling).max(axis=0)
        force_N = self.force_walk * static_loads(robot)[: robot.driven].mean()
        return np.concatenate([self.speed_walk / arm_m, np.full(robot.driven, force_N)])

    @cached_property
    def given(self) -> np.ndarray:
        """Variance (2 driven,) of encoders and currents as given."""
        n = self.robot.driven
        return np.array([self.encoder_std_rad_s**2] * n + [self.current_std_A**2] * n)

    def init(self, first: WheelSample) -> WheelState:
        """Rims that turn as the first sample says, as far as it says it, forces unknown."""
        robot, measured = self.robot, np.isfinite(first.wheel_speed_rad_s)
        speed_m_s = np.where(measured, first.wheel_speed_rad_s, 0.0) * robot.wheel.radius_m
        mean = np.concatenate([np.linalg.pinv(robot.rolling[: robot.driven]) @ speed_m_s, np.zeros(robot.driven)])
        unknown = 1.0 if measured.all() else _UNKNOWN_M_S / self.speed_walk
        std = self.walk * np.repeat([unknown, 1.0], [robot.freedoms, robot.driven])
        return WheelState(pack(Belief(mean, np.diag(std**2))), self.given, self.given_samples)

    def step(self, state: WheelState, sample: WheelSample) -> tuple[WheelState, WheelBelief]:
        """The state after a sample, and what is known then."""
        n, free = self.robot.driven, self.robot.freedoms
        before = unpack(state.belief)
        prior = Belief(before.mean, before.cov + np.diag(self.walk**2 * sample.dt_s))
        filtered, matching = METHODS[self.method]
        y = np.concatenate([sample.wheel_speed_rad_s, sample.current_A])
        there = isfinite(y)
        y, R = where(there, y, 0.0), where(there, state.variance, _MISSING * self.given)
        known, encoders, _ = kalman.correct(prior, y[:n], self.turning, np.diag(R[:n]))
        after, currents, _ = filtered.correct(known, y[n:], self.current, np.diag(R[n:]))
        variance, samples = state.variance, minimum(state.samples + 1.0, self.window)
        if matching:
            ordinary = there & np.array([*_ordinary(encoders), *_ordinary(currents)])
            variance = self.matched(variance, 1.0 / samples, ordinary, after, y)
        std = np.array([sqrt(maximum(v, 0.0)) for v in np.diag(after.cov)])
        belief = WheelBelief(after.mean[:free], std[:free], after.mean[free:], std[free:])
        return WheelState(pack(after), variance, samples), belief

    @cached_property
    def turning(self) -> np.ndarray:
        """Speeds (driven, n) of the wheels for each state."""
        robot = self.robot
        rows = robot.rolling[: robot.driven] / robot.wheel.radius_m
        return np.hstack([rows, np.zeros((robot.driven, robot.driven))])

    def current(self, x: np.ndarray) -> np.ndarray:
        """Currents (driven,) [A] in state x."""
        robot, omega = self.robot, self.turning @ x
        torque_Nm = robot.wheel.radius_m * x[robot.freedoms :]
        return np.array([current_for_torque(robot.motor, torque_Nm[k], omega[k]) for k in range(robot.driven)])

    def matched(self, R: np.ndarray, share: Any, ordinary: np.ndarray, after: Belief, y: np.ndarray) -> np.ndarray:
        """Variances (2 driven,) with a share of one more sample y in their mean, where it is `ordinary` (2 driven,)."""
        current, H = linearize(self.current, after.mean)
        rows = np.vstack([self.turning, H])
        residual = y - np.concatenate([self.turning @ after.mean, current])
        seen = [e * e + row @ after.cov @ row for e, row in zip(residual, rows, strict=True)]
        learnt = [r + where(usual, share * (s - r), 0.0) for r, usual, s in zip(R, ordinary, seen, strict=True)]
        return np.array([maximum(r, _LEAST_SHARE**2 * g) for r, g in zip(learnt, self.given, strict=True)])


def _ordinary(innovation: Innovation) -> list[Any]:
    """Whether each element of an innovation lies within three of its sigmas."""
    variance = np.diag(innovation.cov)
    return [e * e <= _SURPRISE**2 * v for e, v in zip(innovation.value, variance, strict=True)]
