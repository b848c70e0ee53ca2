"""Linear regression with a prior, and a covariance that stands when the rows of one drive err together.

    beta = H^-1 (A' y / sigma^2 + P0^-1 beta0),   H = A' A / sigma^2 + P0^-1
    cov  = H^-1 (sum over groups g g' + P0^-1) H^-1,   g = A_g' e_g / sigma^2     (sandwich; White 1980)

sigma is that of the residuals e. Groups are drives where there are ten of them, else rows: a sandwich of few groups
is too small.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.floor import FRICTION_STD, Floor

#: Largest standard deviation over the value with which drives tell a number of the robot file: that is the rule for all
#: of them.
MOST_STD = {
    "wheel.radius_m": 0.1,
    "chassis.track_m": 0.2,
    "chassis.effective_track_m": 0.2,
    "motor.torque_constant_Nm_per_A": 0.1,
    "motor.friction_Nm": 0.5,
    "motor.damping_Nms_per_rad": 0.5,
}
#: A radius found beyond this factor of the robot file's is none: wheels slip all the time, or a unit is another.
MOST_RADIUS_RATIO = 2.0
#: Largest friction of a floor, and relative standard deviation of it: more than before any drive.
MOST_FRICTION, MOST_FRICTION_STD = 2.5, 1.1 * FRICTION_STD


class Parameter(NamedTuple):
    """A number of the robot file."""

    name: str  #: its path in the robot, with its unit: "motor.friction_Nm"
    value: float  #: as calibrated, or the robot's own where it was not
    std: float  #: standard deviation of that
    reason: str = ""  #: cause why it could not be identified; empty where it was

    @property
    def identified(self) -> bool:
        """True where the drives tell it."""
        return not self.reason


def is_identified(name: str, value: float, std: float) -> bool:
    """True where drives tell the number `name` of the robot file: positive, and as certain as `MOST_STD` asks."""
    return value > 0 and std <= MOST_STD[name] * value


def unidentified_floor(floor: Floor) -> str:
    """Reason why a floor is not one that the drives tell; empty where it is."""
    if floor.friction <= MOST_FRICTION and floor.friction_std <= MOST_FRICTION_STD:
        return ""
    return (
        f"friction {floor.friction:.3g} with a standard deviation of {100 * floor.friction_std:.0f} % (at most "
        f"{MOST_FRICTION:g} and {100 * MOST_FRICTION_STD:.0f} %): calibrate the robot first (--what radius,motor), "
        "weigh its wheels (--wheel-load), or add drives in which the wheels slip more; no floor was learnt"
    )


def with_parameters(robot: Robot, parameters: Iterable[Parameter]) -> Robot:
    """The robot with those numbers that were identified."""
    for p in parameters:
        if p.identified:
            part, _, name = p.name.partition(".")
            changed: Any = replace(getattr(robot, part), **{name: p.value})
            robot = replace(robot, **{part: changed})
    return robot


FEWEST_DRIVES = 10


class Regression(NamedTuple):
    """beta: (p,); cov: (p, p); residual: (K,) measured minus fitted; std: of the residuals."""

    beta: np.ndarray
    cov: np.ndarray
    residual: np.ndarray
    std: float


def regress(A: np.ndarray, y: np.ndarray, drive: np.ndarray, prior: np.ndarray, prior_std: np.ndarray) -> Regression:
    """Fit y = A beta.

    Args:
        A: (K, p).
        y: (K,).
        drive: (K,) number of the recording of each row.
        prior: (p,) mean.
        prior_std: (p,) standard deviation; infinity for no prior.
    """
    P0_inv = np.diag(1 / prior_std**2)
    beta = np.linalg.lstsq(A, y, rcond=None)[0]
    for _ in range(20):
        std = max(float(np.sqrt(np.mean((y - A @ beta) ** 2))), 1e-12)
        H = A.T @ A / std**2 + P0_inv
        beta = np.linalg.solve(H, A.T @ y / std**2 + P0_inv @ prior)
    residual = y - A @ beta
    H_inv = np.linalg.inv(H)
    g = scores(A, residual, drive) / std**2
    return Regression(beta, H_inv @ (g.T @ g + P0_inv) @ H_inv, residual, std)


def scores(A: np.ndarray, residual: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """A_g' e_g of every group, (groups, p), with the correction for the degrees of freedom that the fit took."""
    numbers, group = np.unique(drive, return_inverse=True)
    if numbers.size < FEWEST_DRIVES:
        group = np.arange(residual.size)
    count = int(group.max()) + 1
    total = np.zeros((count, A.shape[1]))
    np.add.at(total, group, A * residual[:, None])
    return total * np.sqrt(count / max(count - A.shape[1], 1))
