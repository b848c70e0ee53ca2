"""Drives of two minutes of simulated robots, many side by side: the truth that the observers are judged by.

Each run is another drive: straight on, curves, stops, reverse, hard and gentle starts, by a wheel-speed loop that knows
nothing of slip. Ground and robot follow the equations of the observers; what these do not know is the world's: the
ground, its patches and slopes, the wheels' true radius, the load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import Kernel
from ohmward.trace.structure import side_by_side
from ohmward.traction.control import Limits, WheelSpeedDrive
from ohmward.traction.friction.terrain import Terrain, terrain_named
from ohmward.traction.robot.chassis import SkidSteer
from ohmward.traction.robot.robot import GRAVITY, RLMA, Robot
from ohmward_lab.assess.draws import generator
from ohmward_lab.assess.traction.conditions import World
from ohmward_lab.simulate.closed_loop.scenario import ROBOTS as PACKAGED
from ohmward_lab.simulate.closed_loop.traction_plant import PlantInput, observed_step

DRIVEN_S = 120.0
SAMPLE_S = 0.0025
#: Steps whose outcome is held at once, before it is thinned: bounds the memory.
_STEPS_AT_ONCE = 12_000
#: Between two instants of the truth [s].
INTERVAL_S = 0.02

ROBOTS = {
    "rlma": PACKAGED["rlma"],
    "robotino": PACKAGED["robotino"],
    "skid-steer": replace(RLMA, name="skid-steer", chassis=SkidSteer(0.314, 0.314, 0.30)),
}
#: Fastest drive of each robot [m/s], and yaw rate [rad/s].
_FASTEST = {"rlma": (0.9, 0.6), "skid-steer": (0.9, 0.6), "robotino": (0.4, 0.5)}
#: Force of all motors at the rims, over the robot's weight.
_STRENGTH = 0.8
#: Bandwidth of the drives, and share of a spinning wheel's error that one step takes away: with all of it they ring.
_BANDWIDTH_RAD_S, _DEADBEAT = 20.0, 0.5
#: A patch lies there for as long [s], once in a period.
_PATCH_S, _PATCH_PERIOD_S = 3.0, 15.0
#: Time that a slope takes, up and down [s].
_SLOPE_PERIOD_S = 20.0


class Driving(NamedTuple):
    """State of a drive."""

    x: np.ndarray  #: (n,) of the robot
    angle_rad: np.ndarray  #: (wheels,) turned
    impulse_Nms: np.ndarray  #: (driven,) of the motors' torque
    drives: tuple  #: of each driven wheel


class Road(NamedTuple):
    """Inputs of a step of a drive."""

    reference_rad_s: np.ndarray  #: (driven,) speeds of the wheels that are asked for
    shares: np.ndarray  #: (wheels, grounds) of each ground under each wheel
    grade_rad: Any  #: along the robot
    dt_s: Any  #: of the step


class Drives(NamedTuple):
    """Truth of many drives, every `INTERVAL_S`: motion of the body (T, B), of the wheels (T, wheels or driven, B)."""

    speed_m_s: Any
    lateral_speed_m_s: Any
    yaw_rate_rad_s: Any
    slip_ratio: Any
    angle_rad: Any
    impulse_Nms: Any  #: (T, driven, B) of the motors' torque since the start
    specific_force_m_s2: Any
    grade_rad: Any


@lru_cache(maxsize=16)
def drives(name: str, world: World, runs: int, seed: int) -> Drives:
    """Drives of a robot in this world, one for each run."""
    robot = in_world(ROBOTS[name], world)
    grounds = [world.ground] if world.patch is None else [world.ground, world.patch]
    terrains = tuple(terrain_named(ground, robot.wheel.radius_m, robot.wheel.width_m) for ground in grounds)
    road = roads(name, robot, world, runs, seed)
    zero = np.zeros(robot.driven)
    drive = motor_drive(robot)
    start = Driving(
        np.zeros(len(robot.state_names)),
        np.zeros(len(robot.places)),
        zero,
        tuple(drive.init(0.0) for _ in range(robot.driven)),
    )
    example = Road(zero, np.zeros((len(robot.places), len(terrains))), 0.0, 0.0)
    kernel = Kernel(partial(drive_step, robot=robot, terrains=terrains), start, example)
    state, parts = side_by_side([start] * runs), []
    every = round(INTERVAL_S / SAMPLE_S)
    for first in range(0, len(road.grade_rad), _STEPS_AT_ONCE):
        here = slice(first, first + _STEPS_AT_ONCE)
        part = Road(road.reference_rad_s[here], road.shares[here], road.grade_rad[here], SAMPLE_S)
        state, found = kernel.scan_lanes(state, part)
        parts.append(Drives(*(values[every - 1 :: every] for values in found)))
    return Drives(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def in_world(robot: Robot, world: World) -> Robot:
    """The robot with another radius of its wheels and another mass than its file says."""
    loads = tuple(world.mass_ratio * load for load in robot.wheel_load_N)
    wheel = replace(robot.wheel, radius_m=world.radius_ratio * robot.wheel.radius_m)
    return replace(robot, mass_kg=world.mass_ratio * robot.mass_kg, wheel=wheel, wheel_load_N=loads)


def motor_drive(robot: Robot) -> WheelSpeedDrive:
    """Speed loop of each driven wheel: as quick as a wheel without grip allows, and damped."""
    torque_Nm = _STRENGTH * robot.mass_kg * GRAVITY * robot.wheel.radius_m / robot.driven
    body_kg_m2, wheel_kg_m2 = robot.mass_kg * robot.wheel.radius_m**2 / robot.driven, robot.inertia[-1]
    proportional = min(_BANDWIDTH_RAD_S * body_kg_m2, _DEADBEAT * wheel_kg_m2 / SAMPLE_S)
    return WheelSpeedDrive(Limits(torque_Nm, 50.0 * torque_Nm), proportional, proportional**2 / (3.0 * body_kg_m2))


def drive_step(state: Driving, road: Road, robot: Robot, terrains: Sequence[Terrain]) -> tuple[Driving, Drives]:
    """One step of a drive."""
    drive, moving = motor_drive(robot), robot.freedoms
    steps = [
        drive.step(before, reference, speed, road.dt_s)
        for before, reference, speed in zip(state.drives, road.reference_rad_s, state.x[moving:], strict=True)
    ]
    torque_Nm = np.array([torque for _, torque in steps])
    given = PlantInput(torque_Nm, road.grade_rad, 0.0, 0.0, road.shares, road.dt_s)
    result, _, view = observed_step(state.x, given, robot, terrains)
    x, mean = result.state, 0.5 * (state.x + result.state)
    free = robot.rolling[robot.driven :] @ mean[:moving] / robot.wheel.radius_m
    after = Driving(
        x,
        state.angle_rad + road.dt_s * np.concatenate([mean[moving:], free]),
        state.impulse_Nms + road.dt_s * torque_Nm,
        tuple(drive_state for drive_state, _ in steps),
    )
    left = x[1] if moving == 3 else 0.0 * x[0]
    ahead, grade = view.specific_force_m_s2[0], road.grade_rad + 0.0 * x[0]
    slip = view.slip_ratio[: robot.driven]
    return after, Drives(x[0], left, x[moving - 1], slip, after.angle_rad, after.impulse_Nms, ahead, grade)


def roads(name: str, robot: Robot, world: World, runs: int, seed: int) -> Road:
    """Inputs of all steps of all drives (T, ..., B)."""
    time_s = np.arange(0.0, DRIVEN_S, SAMPLE_S)
    rngs = [generator("drive", name, seed, run) for run in range(runs)]
    motion = np.stack([commanded(rng, robot, time_s, *_FASTEST[name]) for rng in rngs], axis=2)
    reference = np.einsum("wm,tmb->twb", robot.rolling[: robot.driven], motion) / robot.wheel.radius_m
    phases_s = np.array([rng.uniform(0.0, _PATCH_PERIOD_S) for rng in rngs])
    wave = 2 * np.pi * (time_s[:, None] + phases_s) / _SLOPE_PERIOD_S
    grade_rad = world.grade_rad * np.clip(2.0 * np.sin(wave), -1.0, 1.0)
    on_patch = np.mod(time_s[:, None] + phases_s, _PATCH_PERIOD_S) < _PATCH_S
    return Road(reference, _shares(robot, world, on_patch), grade_rad, SAMPLE_S)


def _shares(robot: Robot, world: World, on_patch: np.ndarray) -> np.ndarray:
    """Shares (T, wheels, grounds, B) of the grounds under the wheels; on_patch: (T, B)."""
    if world.patch is None:
        return np.ones((len(on_patch), len(robot.places), 1, on_patch.shape[1]))
    under = np.array([not world.one_side or place.y_m > 0.0 for place in robot.places])
    patch = (on_patch[:, None] & under[:, None]).astype(float)
    return np.stack([1.0 - patch, patch], axis=2)


def commanded(
    rng: np.random.Generator, robot: Robot, time_s: np.ndarray, speed_m_s: float, yaw_rate_rad_s: float
) -> np.ndarray:
    """Motion (T, freedoms) that is asked for: stretches of a few seconds, with ramps between them."""
    motion = np.zeros((time_s.size, robot.freedoms))
    ends_s = np.cumsum(rng.uniform(3.0, 9.0, 60))
    for begin_s, end_s in zip(np.append(1.0, ends_s + 1.0), ends_s + 1.0, strict=False):
        stands, turns, reverse = rng.random(3) < (0.12, 0.4, 0.15)
        forward = (0.0 if stands else rng.uniform(0.3, 1.0)) * (-1.0 if reverse else 1.0) * speed_m_s
        turn = rng.uniform(-1.0, 1.0) * yaw_rate_rad_s if turns and not stands else 0.0
        here = (time_s >= begin_s) & (time_s < end_s)
        motion[here, 0], motion[here, -1] = forward, turn
    steepest = rng.uniform(0.5, 2.0) * SAMPLE_S
    return np.stack([_ramp(motion[:, 0], steepest), *(_ramp(m, 2 * steepest) for m in motion.T[1:])], axis=1)


def _ramp(wanted: np.ndarray, steepest: float) -> np.ndarray:
    """The values (T,) with no step larger than the steepest."""
    reached, now = np.empty_like(wanted), 0.0
    for k, value in enumerate(wanted):
        now += min(max(value - now, -steepest), steepest)
        reached[k] = now
    return reached
