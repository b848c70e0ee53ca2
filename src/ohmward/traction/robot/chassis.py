"""Chassis: positions and rolling directions of the wheels; one matrix serves speeds and forces.

A wheel at (x, y) that rolls in the direction (c, s) moves at c v_x + s v_y + (x s - y c) yaw_rate: one row of the
rolling matrix G. Travel speeds are G times the body's motion, and the wheels' forces act on the body through the
transpose of G, so no power is lost or created between wheel and body.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from ohmward.checks import require_each_positive, require_finite, require_one_of, require_positive
from ohmward.errors import InputError

#: The motion of a body in the plane: forward and leftward speed [m/s], yaw rate [rad/s].
PLANAR = ("v_m_s", "v_left_m_s", "yaw_rate_rad_s")


class Place(NamedTuple):
    """One wheel: x forward and y left of the centre of gravity, its rolling direction, and True if driven."""

    name: str
    x_m: float
    y_m: float
    heading_rad: float = 0.0
    driven: bool = True


class Chassis(ABC):
    """A layout of wheels."""

    freedoms: ClassVar[tuple[str, ...]] = (PLANAR[0], PLANAR[2])  #: motions that the body can make
    #: True if the wheels resist sideways motion, by the same friction law as along their rolling direction
    scrubs: ClassVar[bool] = False
    rollers: ClassVar[bool] = False  #: True if rollers on the wheels let them move sideways

    @property
    @abstractmethod
    def places(self) -> tuple[Place, ...]:
        """The wheels, the driven ones first."""


@dataclass(frozen=True)
class Rectangle(Chassis):
    """Four wheels at the corners of a rectangle."""

    #: distances of front and rear axle from the centre of gravity, > 0
    front_m: float
    rear_m: float
    track_m: float  #: distance between left and right wheels, > 0

    def __post_init__(self) -> None:
        require_each_positive("chassis.", self, "front_m", "rear_m", "track_m")

    @property
    def wheelbase_m(self) -> float:
        """Distance between the axles."""
        return self.front_m + self.rear_m

    @property
    def places(self) -> tuple[Place, ...]:
        """Front left, front right, rear left, rear right."""
        half = self.track_m / 2
        return (
            Place("front_left", self.front_m, half),
            Place("front_right", self.front_m, -half),
            Place("rear_left", -self.rear_m, half),
            Place("rear_right", -self.rear_m, -half),
        )


@dataclass(frozen=True)
class Differential(Rectangle):
    """Four wheels, the front pair or all of them driven, as in [T]: no sideways motion, no resistance to turning."""

    driven: str = "front"  #: "front" or "all"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.driven not in ("front", "all"):
            raise InputError(f'chassis.driven must be "front" or "all", got {self.driven!r}')

    @property
    def places(self) -> tuple[Place, ...]:
        """Front left, front right, rear left, rear right."""
        return tuple(p._replace(driven=p.x_m > 0.0 or self.driven == "all") for p in super().places)


@dataclass(frozen=True)
class SkidSteer(Rectangle):
    """Four fixed, driven wheels: to turn, the robot drags them sideways."""

    #: speed difference between the two sides over the yaw rate: the distance between the instantaneous centres of
    #: rotation of left and right wheels (Mandow et al. 2007), > 0. `ohmward calibrate` finds it; divided by `track_m`
    #: it is ROS's `wheel_separation_multiplier`. If absent, `track_m`; the odometry then begins with 1.5 times that
    effective_track_m: float | None = None

    freedoms = PLANAR
    scrubs = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.effective_track_m is not None:
            require_positive("chassis.effective_track_m", self.effective_track_m)

    @property
    def turning_track_m(self) -> float:
        """The effective track, or the track where none is known."""
        return self.effective_track_m or self.track_m


@dataclass(frozen=True)
class TwoWheeled(Chassis):
    """Two driven wheels and casters, which swivel: they carry and roll, and neither steer nor count."""

    axle_m: float  #: position of the driven wheels ahead of the centre of gravity; < 0 behind it
    track_m: float  #: distance between left and right wheel, > 0
    #: position of each caster ahead of the centre of gravity, on the centre line; two side by side count as one
    casters_m: tuple[float, ...]

    def __post_init__(self) -> None:
        require_positive("chassis.track_m", self.track_m)
        require_finite("chassis.axle_m, chassis.casters_m", (self.axle_m, *self.casters_m))
        stands = any(caster_m != self.axle_m for caster_m in self.casters_m)
        if not stands or np.any(load_matrix(self.places)[:, 0] <= 0):
            raise InputError(
                "chassis.casters_m must have a caster on the other side of the centre of gravity than chassis.axle_m, "
                f"or the robot tips over; got {list(self.casters_m)} and {self.axle_m:g}"
            )

    @property
    def places(self) -> tuple[Place, ...]:
        """Left, right, then the casters."""
        half = self.track_m / 2
        driven = Place("left", self.axle_m, half), Place("right", self.axle_m, -half)
        casters = enumerate(self.casters_m, start=1)
        return (*driven, *(Place(f"caster_{k}", x_m, 0.0, driven=False) for k, x_m in casters))


@dataclass(frozen=True)
class Steered(Chassis):
    """A car or a tricycle with the speed of one wheel or axle and a steering angle, but no encoders at its rear wheels.

    The rear wheels, which do not steer, roll about the point where their axis meets that of the steered one: a wheel
    steered by d, or the middle of two (Ackermann's geometry), moves at v / cos(d) where the middle of the rear axle
    moves at v, which turns at v tan(d) / wheelbase. So the two measured values give the speeds of both rear wheels, and
    with these the robot is one with two driven wheels. Its motor currents are not used.
    """

    rear_m: float  #: distance of the rear axle behind the centre of gravity, > 0
    wheelbase_m: float  #: distance between the rear axle and the steered one, > rear_m
    track_m: float  #: distance between the rear wheels, > 0
    #: where the speed is measured: "rear", of the rear axle, as by the motor of a car; "front", of the steered wheel
    measured: str = "rear"
    steering_zero_rad: float = 0.0  #: measured steering angle with which the robot drives straight ahead

    def __post_init__(self) -> None:
        require_each_positive("chassis.", self, "rear_m", "wheelbase_m", "track_m")
        require_finite("chassis.steering_zero_rad", self.steering_zero_rad)
        require_one_of("chassis.measured", self.measured, ("front", "rear"))
        if self.rear_m >= self.wheelbase_m:
            raise InputError(
                f"chassis.rear_m must be below chassis.wheelbase_m = {self.wheelbase_m:g}, got {self.rear_m:g}: the "
                "centre of gravity is between the axles"
            )

    @property
    def places(self) -> tuple[Place, ...]:
        """Rear left, rear right, and the steered one in front."""
        half = self.track_m / 2
        rear = Place("rear_left", -self.rear_m, half), Place("rear_right", -self.rear_m, -half)
        return (*rear, Place("front", self.wheelbase_m - self.rear_m, 0.0, driven=False))

    @property
    def steepest_rad(self) -> float:
        """Largest steering angle: across on forklifts, whose driven wheel steers; the rear axle shows no turn there."""
        return math.pi if self.measured == "front" else 1.4

    def wheel_speeds(self, measured: np.ndarray, steering_rad: np.ndarray) -> np.ndarray:
        """Speeds (..., 3) of the wheels, nan where a value is missing; the front one has none of its own.

        measured: (..., 3) the measured speed in the place of the rear left wheel; where the rear right one has a speed
            too, both are their own.
        steering_rad: (...) as measured, > 0 to the left.
        """
        measured, steering_rad = np.asarray(measured), np.asarray(steering_rad) - self.steering_zero_rad
        speed, own = measured[..., 0], np.isfinite(measured[..., 1])
        steering_rad = np.where(np.abs(steering_rad) <= self.steepest_rad, steering_rad, np.nan)
        along = speed * np.cos(steering_rad) if self.measured == "front" else speed
        across = speed * np.sin(steering_rad) if self.measured == "front" else speed * np.tan(steering_rad)
        apart = self.track_m / (2 * self.wheelbase_m) * across
        found = np.stack([along - apart, along + apart, np.full(np.shape(apart), np.nan)], axis=-1)
        return np.where(own[..., None], measured, found)


@dataclass(frozen=True)
class Omni(Chassis):
    """Omni-wheels on a circle around the centre of gravity, each rolling along the circle and free sideways."""

    arm_m: float  #: radius of the circle of the wheels, > 0
    #: directions of the wheels from the centre, counter-clockwise from forward; at least three, not all on one line
    bearings_deg: tuple[float, ...] = (60.0, 180.0, 300.0)

    freedoms = PLANAR
    rollers = True

    def __post_init__(self) -> None:
        require_positive("chassis.arm_m", self.arm_m)
        if np.linalg.matrix_rank(rolling_matrix(self)) < 3:
            raise InputError(
                "chassis.bearings_deg must hold three or more bearings that let the robot move in every direction; "
                f"got {list(self.bearings_deg)}"
            )

    @property
    def places(self) -> tuple[Place, ...]:
        """The wheels, in the order of the bearings."""
        return tuple(self._place(k, math.radians(bearing)) for k, bearing in enumerate(self.bearings_deg, start=1))

    def _place(self, number: int, bearing: float) -> Place:
        x, y = self.arm_m * math.cos(bearing), self.arm_m * math.sin(bearing)
        return Place(f"wheel_{number}", x, y, bearing + math.pi / 2)


@dataclass(frozen=True)
class Mecanum(Rectangle):
    """Four driven wheels with rollers at 45 degrees, which form an X as seen from above.

    Such a wheel pushes along the axis of the roller that it stands on and moves freely across it: it acts as an
    omni-wheel that rolls at 45 degrees to the robot, with a radius smaller by the factor sqrt(2). `wheel.radius_m` is
    that smaller radius.
    """

    freedoms = PLANAR
    rollers = True

    @property
    def places(self) -> tuple[Place, ...]:
        """Front left, front right, rear left, rear right."""
        return tuple(
            place._replace(heading_rad=-math.copysign(math.pi / 4, place.x_m * place.y_m)) for place in super().places
        )


def currents_show_force(chassis: Chassis) -> bool:
    """True where the motor currents show the force that drives the robot: not of one that scrubs or steers."""
    return not (chassis.scrubs or isinstance(chassis, Steered))


def rolling_matrix(chassis: Chassis, turned_rad: float = 0.0) -> np.ndarray:
    """G (wheels, freedoms): travel speed of each wheel along its rolling direction, for each motion of the body.

    turned_rad: of another direction, counted from the rolling one to the left.
    """
    rows = []
    for p in chassis.places:
        c, s = math.cos(p.heading_rad + turned_rad), math.sin(p.heading_rad + turned_rad)
        rows.append((c, s, p.x_m * s - p.y_m * c))
    return np.array(rows).reshape(-1, 3)[:, [PLANAR.index(name) for name in chassis.freedoms]]


def load_matrix(places: Sequence[Place]) -> np.ndarray:
    """(wheels, 3): normal loads from the force on the ground and its first moments in x and y.

    The loads vary linearly with the position, like those of a stiff body on equal springs: for a rectangle and for
    three wheels this is the only solution without twist. Mirrored wheels get the same numbers to the last bit.
    """
    moments = np.array([[1.0, p.x_m, p.y_m] for p in places])
    return np.linalg.solve(moments.T @ moments, moments.T).T
