"""Drives of an omni robot on floors, from the equations of `floors`, wheel by wheel."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from kernels import kernel_of
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import ROBOTINO, Robot
from ohmward.traction.calibration import CalibrationDrive
from ohmward.traction.motion.sample import RobotSample, first_of, sanitize
from ohmward.traction.robot.motor import current_for_torque
from ohmward.traction.terrain.floor import Floor
from ohmward.traction.terrain.slip_on_floors import GAP_S, SlipOnFloors, slip_on_floors
from ohmward.traction.terrain.wheel_filter import WheelFilter

DT_S = 0.03
OMNI = replace(
    ROBOTINO,
    mass_kg=11.3,
    wheel_load_N=(30.0, 50.8, 30.0),
    wheel=replace(ROBOTINO.wheel, radius_m=0.036),
    motor=replace(ROBOTINO.motor, friction_Nm=0.15),
)
SMOOTH = Floor("smooth", 0.7, 30.0, 0.01, 0.04, 0.1, 0.1, 0.0, 0.005, 0.1, 0.02, 40)
SOFT = Floor("soft", 1.4, 3.0, 0.1, 0.22, 0.1, 0.03, -0.5, 0.01, 0.08, 0.04, 40)


@cache
def on_floors(floors: tuple[Floor, ...], method: str = "ukf", told: bool = False) -> SlipOnFloors:
    """The estimator of slip of the robot OMNI, compiled once for all tests."""
    return slip_on_floors(OMNI, floors, method, told)


def steady(robot: Robot, floors: list[Floor], rim: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Motion (3,) of the body and forces (3,) on the wheels, floor by wheel, while the rims move so."""
    G, load = robot.rolling, np.array(robot.wheel_load_N)
    along, across = G @ rim, robot.sideways @ rim
    factor = np.array([direction_and_speed(*of, np.hypot(*rim[:2])) for of in zip(floors, along, across, strict=True)])
    push = np.zeros(3)
    for k, place in enumerate(robot.places):
        along, across = G[k] @ rim, robot.sideways[k] @ rim
        size = np.hypot(np.hypot(along, across), 0.01)
        roll = floors[k].rolling * load[k] / size
        roller = floors[k].roller * load[k] * np.tanh(across / (0.3 * size))
        c, s = np.cos(place.heading_rad), np.sin(place.heading_rad)
        force = roll * along * np.array([c, s]) + (roll * across + roller) * np.array([-s, c])
        push += [*force, place.x_m * force[1] - place.y_m * force[0]]
    F = np.linalg.solve(G.T, push)
    slip = [
        -np.sign(f) * np.log(1 - min(abs(f) / (m * n), 0.999)) * m / c
        for f, n, m, c in zip(F, load, [x.friction for x in floors], [x.stiffness for x in floors], strict=True)
    ]
    lost = np.linalg.solve(G, factor * np.clip(slip, -1, 1)) * np.hypot(rim[0], rim[1])
    return rim - lost, F


def direction_and_speed(floor: Floor, along: float, across: float, speed: float) -> float:
    """Slip of a wheel over that of one that rolls straight ahead at the middle speed."""
    size, middle = max(np.hypot(along, across), 1e-9), np.sqrt(floor.slowest_m_s * floor.fastest_m_s)
    turned = np.hypot(along, floor.across * across) / size * (1 + floor.side * across / size)
    return turned * (np.clip(speed, floor.slowest_m_s, floor.fastest_m_s) / middle) ** -floor.speed_power


def omni_drive(
    floors: list[Floor],
    direction_deg: float,
    speed_m_s: float = 0.15,
    seconds: float = 8.0,
    rng: np.random.Generator | None = None,
    robot: Robot = OMNI,
    later: list[Floor] | None = None,
) -> CalibrationDrive:
    """A steady drive; the floors under the wheels are `later` from half of it on."""
    a = np.radians(direction_deg)
    rim = np.array([speed_m_s * np.cos(a), speed_m_s * np.sin(a), 0.0])
    time_s = np.arange(0.0, seconds, DT_S)
    second = (time_s >= seconds / 2)[:, None]
    states = [steady(robot, f, rim) for f in (floors, later or floors)]
    motion, force = (np.where(second, states[1][i], states[0][i]) for i in (0, 1))
    omega = np.tile(robot.rolling @ rim / robot.wheel.radius_m, (time_s.size, 1))
    current = current_for_torque_rows(robot, robot.wheel.radius_m * force, omega)
    if rng is not None:
        omega = omega + rng.normal(0.0, 0.1, omega.shape)
        current = current + rng.normal(0.0, 0.15, current.shape)
        motion = motion + rng.normal(0.0, 0.002, motion.shape)
    return CalibrationDrive(DriveLog("synthetic", time_s, omega, current), motion)


def current_for_torque_rows(robot: Robot, torque: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Currents (T, 3) for torques (T, 3)."""
    return np.array(
        [
            [float(current_for_torque(robot.motor, t, w)) for t, w in zip(*row, strict=True)]
            for row in zip(torque, omega, strict=True)
        ]
    )


class OnRawSamples(NamedTuple):
    """A filter of the wheels that takes samples as they come."""

    wheels: WheelFilter

    def step(self, state, sample):
        return self.wheels.step(state, sanitize(sample, GAP_S))


def along(wheels: WheelFilter, samples: RobotSample):
    """State at the end, and beliefs (T, ...)."""
    first = first_of(samples)
    state = wheels.init(sanitize(first, GAP_S))
    return kernel_of(OnRawSamples(wheels), state, first).scan(state, samples)
