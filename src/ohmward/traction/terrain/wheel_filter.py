"""Motion of the rims and forces of the wheels, from encoders and motor currents: EKF, UKF, AEKF or AUKF.

    x = [w, F]       w: (freedoms,) motion of the driven wheels as if none slipped; F: (driven,) forces [N]
    w+ = w + noise,  F+ = F + noise                             random walks: nothing is assumed of ground or mass
    omega = G_d w / r,   I = current_for_torque(r F, omega)     encoders first, then currents

Slip is not a state: without a sensor of the speed nothing would correct it. It follows from F and from the floor. The
filter smooths F and w and gives their covariance.

With matching (AEKF, AUKF) the variance of each encoder and current is learnt from its residuals, [T] 3.50:

    R_k = mean of eps^2 + P_yy,   eps = y - h(x_k|k)

A sample more than three sigma away means that a wheel starts or hits something: a jump of the state, not sensor noise.
It is used but not learnt from, or the filter would become too slow where it has to follow.

A missing number gets a variance that leaves the belief unchanged; its quantity continues as a random walk.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_each_positive, require_one_of
from ohmward.filters import extended, kalman, unscented
from ohmward.filters.belief import Belief, Innovation, PackedBelief, pack, unpack
from ohmward.filters.linear_algebra import std
from ohmward.trace import linearize, maximum, minimum, where
from ohmward.traction.motion.sample import CleanSample
from ohmward.traction.robot.motor import current_for_torque
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.floor import static_loads

#: The filter of the currents, and whether R is matched, by name.
METHODS: dict[str, tuple[ModuleType, bool]] = {
    "ekf": (extended, False),
    "aekf": (extended, True),
    "ukf": (unscented, False),
    "aukf": (unscented, True),
}
#: Innovations of more sigmas than this are not learnt from.
_ORDINARY = 3.0
#: Matched standard deviations never fall below this share of the given ones.
_LEAST_STD_SHARE = 0.2
#: Variance of a missing number, over the given one.
_MISSING = 1e12
#: Standard deviation [m/s] of the rims if the first sample lacks an encoder.
_UNKNOWN_RIM_STD_M_S = 1.0


class WheelState(NamedTuple):
    """State of the filter from sample to sample."""

    belief: PackedBelief  #: mean (freedoms + driven,) and triangle of the covariance
    variance: np.ndarray  #: (2 driven,) of encoders and currents
    samples: Any  #: number of samples in these, including those that the given variances count for


class WheelBelief(NamedTuple):
    """rim, rim_std: (freedoms,) motion of the rims; force_N, force_std_N: (driven,) of the ground on the wheels."""

    rim: np.ndarray
    rim_std: np.ndarray
    force_N: np.ndarray
    force_std_N: np.ndarray


@dataclass(frozen=True)
class WheelFilter:
    """Settings; `init` and `step` are pure functions of them."""

    robot: Robot  #: its wheels and motors
    method: str = "ukf"  #: one of `METHODS`
    #: of one sample
    encoder_std_rad_s: float = 0.1
    current_std_A: float = 0.2
    #: of each motion of the rims, m/s over the root of a second; divided by the arm for rotations
    speed_walk: float = 0.03
    force_walk: float = 0.15  #: of each force, share of the mean load over the root of a second
    window: float = 1000.0  #: samples over which a matched variance is the mean; then it forgets exponentially
    given_samples: float = 100.0  #: number of samples that the given variances count for

    def __post_init__(self) -> None:
        require_one_of("method", self.method, METHODS)
        require_each_positive(
            "", self, "encoder_std_rad_s", "current_std_A", "speed_walk", "force_walk", "window", "given_samples"
        )

    @cached_property
    def walk(self) -> np.ndarray:
        """Random walk (n,) of each state, over the root of a second."""
        robot = self.robot
        arm_m = np.abs(robot.rolling).max(axis=0)
        force_N = self.force_walk * static_loads(robot)[: robot.driven].mean()
        return np.concatenate([self.speed_walk / arm_m, np.full(robot.driven, force_N)])

    @cached_property
    def given(self) -> np.ndarray:
        """Given variances (2 driven,) of encoders and currents."""
        n = self.robot.driven
        return np.array([self.encoder_std_rad_s**2] * n + [self.current_std_A**2] * n)

    def init(self, first: CleanSample) -> WheelState:
        """State with the rim speeds of the first sample, as far as it has encoders, and unknown forces."""
        robot, measured = self.robot, first.wheel_measured[: self.robot.driven]
        speed_m_s = first.wheel_speed_rad_s[: robot.driven] * robot.wheel.radius_m
        mean = np.concatenate([robot.motion_by_rims @ speed_m_s, np.zeros(robot.driven)])
        unknown = 1.0 if measured.all() else _UNKNOWN_RIM_STD_M_S / self.speed_walk
        initial_std = self.walk * np.repeat([unknown, 1.0], [robot.freedoms, robot.driven])
        return WheelState(pack(Belief(mean, np.diag(initial_std**2))), self.given, self.given_samples)

    def step(self, state: WheelState, clean: CleanSample) -> tuple[WheelState, WheelBelief]:
        """State and belief after a sample."""
        n, free = self.robot.driven, self.robot.freedoms
        before = unpack(state.belief)
        prior = Belief(before.mean, before.cov + np.diag(self.walk**2 * clean.dt_s))
        filtered, matching = METHODS[self.method]
        y = np.concatenate([clean.wheel_speed_rad_s[:n], clean.current_A])
        measured = np.concatenate([clean.wheel_measured[:n], clean.current_measured])
        R = where(measured, state.variance, _MISSING * self.given)
        known, encoders, _ = kalman.correct(prior, y[:n], self.turning, np.diag(R[:n]))
        after, currents, _ = filtered.correct(known, y[n:], self.current, np.diag(R[n:]))
        variance, samples = state.variance, minimum(state.samples + 1.0, self.window)
        if matching:
            ordinary = measured & np.array([*_ordinary(encoders), *_ordinary(currents)])
            variance = self.matched(variance, 1.0 / samples, ordinary, after, y)
        stds = np.array([std(v) for v in np.diag(after.cov)])
        belief = WheelBelief(after.mean[:free], stds[:free], after.mean[free:], stds[free:])
        return WheelState(pack(after), variance, samples), belief

    @cached_property
    def turning(self) -> np.ndarray:
        """Output matrix (driven, n) of the encoders."""
        robot = self.robot
        rows = robot.rolling[: robot.driven] / robot.wheel.radius_m
        return np.hstack([rows, np.zeros((robot.driven, robot.driven))])

    def current(self, x: np.ndarray) -> np.ndarray:
        """Output (driven,) [A] of the current sensors in state x."""
        robot, omega = self.robot, self.turning @ x
        torque_Nm = robot.wheel.radius_m * x[robot.freedoms :]
        return np.array([current_for_torque(robot.motor, torque_Nm[k], omega[k]) for k in range(robot.driven)])

    def matched(self, R: np.ndarray, share: Any, ordinary: np.ndarray, after: Belief, y: np.ndarray) -> np.ndarray:
        """Variances (2 driven,) with a share of one more sample y, where its innovation is `ordinary` (2 driven,)."""
        current, H = linearize(self.current, after.mean)
        rows = np.vstack([self.turning, H])
        residual = y - np.concatenate([self.turning @ after.mean, current])
        seen = [e * e + row @ after.cov @ row for e, row in zip(residual, rows, strict=True)]
        learnt = [r + where(usual, share * (s - r), 0.0) for r, usual, s in zip(R, ordinary, seen, strict=True)]
        return np.array([maximum(r, _LEAST_STD_SHARE**2 * g) for r, g in zip(learnt, self.given, strict=True)])


def _ordinary(innovation: Innovation) -> list[Any]:
    """True for each element of an innovation that lies within three of its sigmas."""
    variance = np.diag(innovation.cov)
    return [e * e <= _ORDINARY**2 * v for e, v in zip(innovation.value, variance, strict=True)]
