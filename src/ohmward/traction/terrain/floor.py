"""A floor as a robot has learnt it: creep of wheels under force, and drag.

F / N = mu (1 - e^(-C sigma / mu))         traction of a wheel at slip sigma, Burckhardt's law without its fall
sigma = -(mu / C) ln(1 - F / (mu N))       its inverse: the slip that a force needs; the wheel spins where F >= mu N
lambda = s / U = h sigma,    h = sqrt((a^2 + kappa^2 c^2) / w^2) (1 + k c / w) (U / U_0)^-p,    w^2 = a^2 + c^2

U is the travel speed of the rims as if no wheel slipped, s = r omega - v the slip speed of a wheel along its rolling
direction, in which it moves at a, and at c to its left. The factor h is 1 for fixed wheels at the speed U_0. Slip is
relative to the speed at which the contact is renewed, to which the motion along the axle, taken by rollers, contributes
the share kappa. Omni-wheels that lead, moving outward, slip more than those that trail, by k; and creep depends on
speed, by the power p. Rolling resists a wheel's motion with `rolling` of its load, and the rollers of an omni-wheel
resist the motion along its axle with `roller` of it.

The floors file holds the floors that one robot has learnt, as TOML that people read and edit.

Demand of floors on the driven wheels: the forces that keep a body moving against the drag under all its wheels.

    G_d' F = M dv/dt + sum over wheels of N_j [ rolling_j d(v_j) + roller_j d(v_j along the axle) ]

G_d are the rows of the driven wheels, v_j is the motion of wheel j over the ground, d the direction of a motion. With
as many driven wheels as the body has motions, F is unique; with more, it is the smallest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_each_not_negative, require_each_positive
from ohmward.errors import InputError
from ohmward.toml_file import TomlFile
from ohmward.trace import exp, log, maximum, minimum, sqrt, tanh
from ohmward.traction.friction.law import Burckhardt
from ohmward.traction.robot.robot import GRAVITY, Robot

#: Prior of a floor, rubber from carpet to concrete: medians, and sigmas of the logarithm. The stiffness of three floors
#: under an omni robot is 41, 3.1 and 1.4.
FRICTION, FRICTION_STD = 0.8, 0.5
STIFFNESS, STIFFNESS_STD = 8.0, 1.2
ROLLING, ROLLING_STD = 0.03, 1.0
#: Share of these sigmas from floor to floor of one robot; the rest is common to all its floors.
BETWEEN_SHARE = 0.8
#: Relative standard deviations of friction, stiffness and drag of a new floor that needs forces like those of a known
#: one. Two carpets under one robot need 0.21 and 0.25 of its weight; they differ by factors of 2.2 in stiffness and 1.7
#: in friction.
LIKE_FRICTION_STD, LIKE_STIFFNESS_STD, LIKE_DRAG_STD = 0.5, 1.0, 0.2
#: Sigma of ln kappa about 0, k about 0 and p about 0. Two floors under one omni robot have kappa 0.9 and 0.5, k -0.11
#: and -0.16, and p -0.11 and 0.07.
ACROSS_STD, SIDE_STD, SPEED_POWER_STD = 0.5, 0.2, 0.1
#: Speed [m/s] below which a wheel stands.
_STANDING_M_S = 1e-4
#: Nodes (q,) and weights (q,) of the quadrature over friction, and over stiffness.
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(11)
#: A floor of whose friction a force leaves less than this share unused is less probable the less it leaves: rough
#: floors and bouncing wheels never use all of it.
_SPARE_SHARE, _LEAST_WEIGHT = 0.2, 1e-6


@dataclass(frozen=True)
class Floor:
    """One floor. Standard deviations of positive quantities are relative."""

    name: str  #: in words
    friction: float  #: mu, traction over load of a spinning wheel, > 0
    stiffness: float  #: C, traction over load and slip at small slip, > 0
    #: share of the load, >= 0
    rolling: float
    roller: float = 0.0
    friction_std: float = FRICTION_STD  #: relative standard deviation of `friction`
    stiffness_std: float = STIFFNESS_STD  #: relative standard deviation of `stiffness`
    correlation: float = 0.0  #: between the errors of friction and stiffness, in (-1, 1)
    #: standard deviation of a wheel's slip from drive to drive that the law leaves unexplained, >= 0
    slip_std: float = 0.02
    drag_std: float = ROLLING_STD  #: relative standard deviation of `rolling` and `roller`, >= 0
    #: standard deviation of a wheel's force that these leave unexplained, share of the load, > 0
    force_std: float = 0.03
    drives: int = 0  #: number of recordings that it was learnt from; 0 for a new floor
    across: float = 1.0  #: kappa, share of the motion along a wheel's axle that renews its contact, in (0, 1]
    across_std: float = 0.0  #: its standard deviation
    side: float = 0.0  #: k, in (-1, 1), absolute
    side_std: float = 0.0  #: its standard deviation
    speed_power: float = 0.0  #: p, by which the stiffness grows with the speed, absolute
    speed_power_std: float = 0.0  #: its standard deviation
    #: lowest and highest speed of its drives; U_0 is their geometric mean. > 0.
    slowest_m_s: float = 0.1
    fastest_m_s: float = 0.1

    def __post_init__(self) -> None:
        positive = ("friction", "stiffness", "force_std", "slowest_m_s", "fastest_m_s")
        not_negative = ("friction_std", "stiffness_std", "slip_std", "rolling", "roller", "drag_std", "drives")
        require_each_positive("floor.", self, *positive)
        require_each_not_negative("floor.", self, *not_negative, "across_std", "side_std", "speed_power_std")
        if not 0 < self.across <= 1:
            raise InputError(f"floor.across must be > 0 and at most 1, got {self.across:g}")
        for name in ("side", "speed_power"):
            if not abs(getattr(self, name)) < 1:
                raise InputError(f"floor.{name} must be between -1 and 1, got {getattr(self, name):g}")
        if self.slowest_m_s > self.fastest_m_s:
            raise InputError(
                f"floor.slowest_m_s must not be above floor.fastest_m_s, got {self.slowest_m_s:g} and "
                f"{self.fastest_m_s:g}"
            )
        if not -1 < self.correlation < 1:
            raise InputError(f"floor.correlation must be between -1 and 1, got {self.correlation:g}")

    @property
    def middle_m_s(self) -> float:
        """U_0, the speed at which `stiffness` holds."""
        return math.sqrt(self.slowest_m_s * self.fastest_m_s)

    @property
    def law(self) -> Burckhardt:
        """The law of traction, for the models of `ohmward.traction`."""
        return Burckhardt(self.friction, self.stiffness / self.friction, 0.0)

    @property
    def drag(self) -> float:
        """Approximate force over weight that keeps a robot moving: half of its rollers turn."""
        return self.rolling + self.roller / 2

    @property
    def log_covariance(self) -> np.ndarray:
        """Covariance (2, 2) of ln mu and ln C."""
        a, b = self.friction_std, self.stiffness_std
        return np.array([[a * a, self.correlation * a * b], [self.correlation * a * b, b * b]])


class SlipBelief(NamedTuple):
    """The slip ratio of wheels."""

    mean: np.ndarray  #: (..., n)
    cov: np.ndarray  #: (..., n, n): wheels on one floor have correlated errors


class SlipScale(NamedTuple):
    """Slip of wheels over that of the law at their force, depending on their motion."""

    factor: Any = 1.0  #: h (..., n)
    #: its relative standard deviations, (..., n) each, from causes common to all wheels
    std: tuple[Any, ...] = ()


#: Wheels that roll straight ahead at the middle speed.
AS_LEARNT = SlipScale()


def slip_scale(floor: Floor, along: Any, across: Any, travel_m_s: Any) -> SlipScale:
    """Dependence of the slip on direction and speed; beyond the speeds of its drives it may continue or stay constant.

    along, across: (..., n) motion of each wheel in its rolling direction and to its left [m/s].
    travel_m_s: (..., 1) speed U of the rims.
    """
    speed = maximum(travel_m_s, _STANDING_M_S)
    within = minimum(maximum(speed, floor.slowest_m_s), floor.fastest_m_s)
    ways = floor.across, floor.side, floor.speed_power
    to_left = across / _size(along, across)
    counted = (floor.across * across) ** 2
    by_speed = (floor.speed_power_std * log(speed / floor.middle_m_s)) ** 2
    by_speed = by_speed + (floor.speed_power * log(speed / within)) ** 2
    return SlipScale(
        slip_factor(ways, along, across, log(within / floor.middle_m_s)),
        (
            floor.across_std * counted / (along**2 + counted + _STANDING_M_S**2),
            floor.side_std * to_left / (1.0 + floor.side * to_left),
            sqrt(by_speed),
        ),
    )


def slip_factor(ways: Sequence[Any], along: Any, across: Any, log_speed: Any) -> Any:
    """Factor h (..., n) of the slip; ways: kappa, k and p; log_speed: (..., 1) ln(U / U_0)."""
    kappa, k, p = ways
    size = _size(along, across)
    renewed = sqrt(along**2 + (kappa * across) ** 2 + _STANDING_M_S**2) / size
    return renewed * (1.0 + k * across / size) * exp(-p * log_speed)


def _size(along: Any, across: Any) -> Any:
    return sqrt(along**2 + across**2 + _STANDING_M_S**2)


def slip_at_force(force_share: Any, friction: Any, stiffness: Any) -> Any:
    """Slip ratio at which the ground gives this force over load; +-1, a spinning wheel, if it cannot."""
    size = np.minimum(np.abs(force_share) / friction, 1.0)
    with np.errstate(divide="ignore"):
        slip = -np.log1p(-size) * friction / stiffness
    return np.sign(force_share) * np.minimum(slip, 1.0)


def scaled(law: SlipBelief, scale: SlipScale, floor: Floor) -> SlipBelief:
    """Belief in lambda from that in sigma, with the slip that the floor leaves unexplained."""
    mean = law.mean * scale.factor
    cov = law.cov * _outer(scale.factor + 0.0 * law.mean)
    for std in scale.std:
        cov = cov + _outer(mean * std)
    return SlipBelief(minimum(maximum(mean, -1.0), 1.0), cov + floor.slip_std**2 * np.eye(mean.shape[-1]))


def _outer(v: Any) -> Any:
    return v[..., :, None] * v[..., None, :]


def slips_of_floors(floor: Floor, force_share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slip (Q, ...) at forces over load (...) on Q possible versions of this floor, and their probabilities (Q, ...).

    A force that the ground has given is evidence of its friction: floors that could hardly give it are less probable.
    """
    factor = np.linalg.cholesky(floor.log_covariance + 1e-12 * np.eye(2))
    grid = np.stack(np.meshgrid(_NODES, _NODES, indexing="ij"), axis=-1).reshape(-1, 2)
    columns = (-1, *(1,) * np.ndim(force_share))
    friction, stiffness = (
        values.reshape(columns) for values in np.exp(np.log([floor.friction, floor.stiffness]) + grid @ factor.T).T
    )
    weights = np.outer(_WEIGHTS, _WEIGHTS).reshape(columns)
    left = np.clip((1 - np.abs(force_share) / friction) / _SPARE_SHARE, _LEAST_WEIGHT, 1.0)
    probable = weights * left
    return slip_at_force(force_share, friction, stiffness), probable / probable.sum(axis=0)


def like(known: Floor) -> Floor:
    """New floor that needs forces like those of a known one, and may slip differently."""
    return replace(
        known,
        name=f"like {known.name}",
        friction_std=max(known.friction_std, LIKE_FRICTION_STD),
        stiffness_std=max(known.stiffness_std, LIKE_STIFFNESS_STD),
        correlation=0.0,
        drag_std=max(known.drag_std, LIKE_DRAG_STD),
        drives=0,
    )


def new_floor(known: Sequence[Floor] = ()) -> Floor:
    """New floor, predicted from the known ones as far as floors resemble each other.

    Precision-weighted mean of logarithms: each known floor with its own sigma and that from floor to floor, and the
    prior. Without a known floor it is the prior.
    """
    friction = _pooled([(f.friction, f.friction_std) for f in known], FRICTION, FRICTION_STD)
    stiffness = _pooled([(f.stiffness, f.stiffness_std) for f in known], STIFFNESS, STIFFNESS_STD)
    rolling = _pooled([(max(f.rolling, 1e-3), f.drag_std) for f in known], ROLLING, ROLLING_STD)
    roller = _pooled([(max(f.roller, 1e-3), f.drag_std) for f in known], ROLLING, ROLLING_STD)
    return Floor(
        "unseen",
        friction=friction[0],
        friction_std=friction[1],
        stiffness=stiffness[0],
        stiffness_std=stiffness[1],
        slip_std=max((f.slip_std for f in known), default=0.02),
        rolling=rolling[0],
        roller=roller[0],
        drag_std=max(rolling[1], roller[1]),
        force_std=max((f.force_std for f in known), default=0.03),
    )


def _pooled(known: Sequence[tuple[float, float]], median: float, std: float) -> tuple[float, float]:
    """Median and sigma of the logarithm of the next floor's value."""
    between, common = (BETWEEN_SHARE * std) ** 2, (1 - BETWEEN_SHARE**2) * std**2
    values = np.log([median, *(value for value, _ in known)])
    precision = np.array([1 / common, *(1 / (s * s + between) for _, s in known)])
    mean = precision @ values / precision.sum()
    return float(np.exp(mean)), float(np.sqrt(1 / precision.sum() + between))


_HEADER = """\
# Floors that a robot has learnt, one [[floor]] each. friction: traction over load of a wheel that spins; stiffness:
# traction over load and slip where the slip is small; rolling, roller: what a wheel takes along its motion, and an
# omni-wheel's rollers along its axle, over its load; across: share of the motion along an omni-wheel's axle that its
# slip relates to; side: by which share it slips more as it moves to its left; speed_power: of the speed, from
# slowest_m_s to fastest_m_s, with which the stiffness grows. Every *_std is relative, but those of side and
# speed_power; slip_std is a slip, force_std a share of the load.
"""


@dataclass(frozen=True)
class Floors:
    """Floors of a robot. robot: its name; floor: the floors, each with its own name."""

    robot: str
    floor: tuple[Floor, ...] = ()

    def __post_init__(self) -> None:
        names = [f.name for f in self.floor]
        if twice := {name for name in names if names.count(name) > 1}:
            raise InputError(f"floor.name must differ from floor to floor; {sorted(twice)[0]!r} comes twice")

    def with_floor(self, floor: Floor) -> Floors:
        """The floors with this one, which replaces one of the same name."""
        return Floors(self.robot, (*(f for f in self.floor if f.name != floor.name), floor))

    def named(self, names: Sequence[str]) -> Floors:
        """Only the floors of these names.

        Raises:
            InputError: no floor has such a name.
        """
        known = {f.name: f for f in self.floor}
        for name in names:
            if name not in known:
                raise InputError(f"no floor {name!r} has been learnt; the file has {', '.join(known) or 'none'}")
        return Floors(self.robot, tuple(known[name] for name in dict.fromkeys(names)))


_FILE = TomlFile(Floors, "ohmward-floors/1", _HEADER)


def save_floors(floors: Floors, path: str | PathLike[str]) -> None:
    """Write the floors file; it is either complete or absent.

    Raises:
        OhmwardError: the file cannot be written.
    """
    _FILE.save(floors, path)


def load_floors(path: str | PathLike[str]) -> Floors:
    """Load the floors from a file.

    Raises:
        InputError: the file cannot be read or describes impossible floors; names file, key, rule and fix.
    """
    return _FILE.load(path)


#: Speed [m/s] below which a direction fades.
FADING_M_S = 0.01
#: Share of a wheel's motion across it at which the drag of its rollers reaches tanh(1) of its full size: rubber creeps
#: before it turns a roller. Fitted to 396 drives of an omni robot on three floors.
ROLLER_CREEP = 0.3


def drag_columns(robot: Robot, motion: np.ndarray) -> np.ndarray:
    """Forces (..., driven, wheels, 2) [N] of the driven wheels for a rolling and a roller share of 1 under each wheel.

    motion: (..., freedoms) of the rims: the body's own is known only once the floor is. Drags learnt along the rims'
        motion differ more from floor to floor, and leave less unexplained, than those along the body's.
    """
    along, across = wheel_motion(robot, motion)
    size = sqrt(along**2 + across**2 + FADING_M_S**2)
    load = static_loads(robot)
    rolling = _on_body(robot, load * along / size, load * across / size)
    rollers = _on_body(robot, np.zeros(np.shape(along)), load * tanh(across / (ROLLER_CREEP * size)))
    by_wheel = np.stack([rolling, rollers], axis=-2) @ robot.motion_by_rims
    return np.moveaxis(by_wheel, -1, -3)


def wheel_motion(robot: Robot, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Motion (..., wheels) of each wheel in its rolling direction and across it; fixed wheels are assumed to roll."""
    along = motion @ robot.rolling.T
    across = motion @ robot.sideways.T if robot.chassis.rollers else np.zeros(np.shape(along))
    return along, across


def inertial_forces(robot: Robot, acceleration: np.ndarray) -> np.ndarray:
    """Forces (..., driven) [N] of the driven wheels that give the body this acceleration (..., freedoms)."""
    return (robot.inertia[: robot.freedoms] * acceleration) @ robot.motion_by_rims


def undetermined_force_std(robot: Robot, wheel_speed_rad_s: np.ndarray) -> np.ndarray:
    """Standard deviation (..., driven) [N] of the force that the dry friction of a standing motor may hold, either way.

    Friction has the size tau_c and opposes the rotation; at rest it may be anything in between, whatever the current.
    """
    motor = robot.motor
    free = 1.0 - abs(tanh(wheel_speed_rad_s / motor.friction_speed_rad_s))
    return motor.friction_Nm / robot.wheel.radius_m * free


def drag_share(robot: Robot, motion: np.ndarray, force_N: np.ndarray) -> Any:
    """Force (...,) of the wheels (..., driven) along the motion (..., freedoms), over the weight."""
    body = force_N @ robot.rolling[: robot.driven]
    along = (body[..., :-1] * motion[..., :-1]).sum(axis=-1) / maximum(travel_speed(motion), 1e-6)
    return along / static_loads(robot).sum()


def travel_speed(motion: np.ndarray) -> Any:
    """Speed (...,) [m/s] of a motion (..., freedoms), without its rotation."""
    return sqrt((motion[..., :-1] * motion[..., :-1]).sum(axis=-1))


def static_loads(robot: Robot) -> np.ndarray:
    """Load of each wheel (wheels,) [N] at rest."""
    return robot.mass_kg * GRAVITY * robot.loads[:, 0]


def mean_load(robot: Robot) -> float:
    """Mean load of the driven wheels [N] at rest."""
    return float(static_loads(robot)[: robot.driven].mean())


def _on_body(robot: Robot, along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Forces (..., wheels, freedoms) on the body of forces along and across each wheel."""
    return along[..., None] * robot.rolling + across[..., None] * robot.sideways
