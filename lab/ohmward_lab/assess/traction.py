"""Study of observers of speed and slip on simulated drives of two minutes: conditions, truth, methods, figures.

The conditions are a base case, and variations that break one of its assumptions. Each run is another drive: straight
on, curves, stops, reverse, hard and gentle starts, by a wheel-speed loop that ignores slip. Robot and ground follow the
equations of the observers, which do not know the true ground, its patches and slopes, the wheels' true radius, and the
load. Each method is made for the robot of the file and the ground that it is given.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import Kernel, where
from ohmward.trace.kernel import repeatable_lowering
from ohmward.trace.structure import pick_lanes, side_by_side
from ohmward.traction.control import Limits
from ohmward.traction.friction.terrain import DEFAULT_TERRAIN, Terrain, terrain_named
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.robot.chassis import SkidSteer
from ohmward.traction.robot.packaged import RLMA
from ohmward.traction.robot.robot import GRAVITY, Robot, motion_from_wheels
from ohmward.traction.score import DriveScore, DriveTruth, score_drive
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.estimator import considered_step
from ohmward.traction.speed_observer.make_observer import default_observer
from ohmward_lab.assess.draws import generator, signs
from ohmward_lab.assess.recommendation import Improvement, Processor, Situation, as_in_the_base_case
from ohmward_lab.simulate.closed_loop.observing import unknown_ground
from ohmward_lab.simulate.closed_loop.scenario import ROBOTS as PACKAGED
from ohmward_lab.simulate.closed_loop.sensing import ExternalSpeed
from ohmward_lab.simulate.closed_loop.traction_plant import PlantInput, observed_step
from ohmward_lab.simulate.robot_sensors import ACCELEROMETER, GYRO, PITCH
from ohmward_lab.traction.wheel_speed_cascade import WheelSpeedDrive


class World(NamedTuple):
    """Ground, and deviations of the robot from its file."""

    ground: str = DEFAULT_TERRAIN  #: name of the terrain
    patch: str | None = None  #: name of a terrain that replaces it for a while, periodically; None for none
    one_side: bool = False  #: the patch lies under the wheels of the left side alone
    grade_rad: float = 0.0  #: of the slopes, up and down
    #: of wheels and robot, relative to the file
    radius_ratio: float = 1.0
    mass_ratio: float = 1.0


class DriveCondition(NamedTuple):
    """One condition."""

    #: in words
    factor: str
    level: str
    world: World = World()  #: ground and robot
    assumed: str = DEFAULT_TERRAIN  #: name of the ground that the observer assumes
    interval_s: float = 0.02  #: between samples
    all_encoders: bool = False  #: True with encoders on free wheels too
    counts_per_turn: int = 4096  #: of each encoder
    glitches: float = 0.0  #: share of an encoder's speeds that are wrong by 20 rad/s
    has_currents: bool = True  #: the motor currents are measured
    #: errors of these sensors; their signs alternate from run to run
    current_gain: float = 0.03
    gyro_offset_rad_s: float = 0.002
    current_noise_A: float = 0.1  #: standard deviation
    #: True with a MEMS gyro, and with an attitude filter
    has_gyro: bool = True
    has_pitch: bool = False
    speed_interval_s: float = 0.0  #: between external speeds, as of GNSS; 0 for none
    speed_delay_s: float = 0.0  #: delay of the external speeds, which report their age
    missing: float = 0.0  #: share of the wheel speeds and of the motor currents that are lost

    @property
    def name(self) -> str:
        """Name in tables and files."""
        return f"{self.factor}: {self.level}"


#: The base case: the ground and the robot of the files, everyday sensors at 50 Hz, encoders on the driven wheels.
BASE_DRIVE = DriveCondition("base", "everyday sensors")

_ICE = World(patch="ice")

DRIVE_CONDITIONS: tuple[DriveCondition, ...] = (
    BASE_DRIVE,
    *(DriveCondition("ground", f"{name}, told asphalt", World(name)) for name in ("gravel", "wet asphalt", "ice")),
    DriveCondition("ground", "sand, told asphalt", World("LETE sand")),
    *(DriveCondition("ground told", name, World(name), assumed=name) for name in ("gravel", "wet asphalt", "ice")),
    DriveCondition("ground told", "sand", World("LETE sand"), assumed="LETE sand"),
    DriveCondition("patches of ice", "under all wheels", _ICE),
    DriveCondition("patches of ice", "under the left wheels", _ICE._replace(one_side=True)),
    DriveCondition("ice and more sensors", "encoders on free wheels", _ICE, all_encoders=True),
    *(
        DriveCondition("ice and more sensors", text, _ICE, speed_interval_s=every_s, speed_delay_s=late_s)
        for text, every_s, late_s in (
            ("speed from outside at 10 Hz", 0.1, 0.0),
            ("the same 0.2 s late", 0.1, 0.2),
            ("speed from outside at 1 Hz", 1.0, 0.0),
        )
    ),
    *(DriveCondition("slope", f"{percent} %", World(grade_rad=percent / 100)) for percent in (5, 15)),
    *(DriveCondition("wheel radius", f"{100 * (1 - r):.0f} % less", World(radius_ratio=r)) for r in (0.98, 0.95)),
    *(DriveCondition("mass", f"{100 * (r - 1):.0f} % more", World(mass_ratio=r)) for r in (1.2, 1.5)),
    *(DriveCondition("motor current", f"gain {gain:.0%} off", current_gain=gain) for gain in (0.1, 0.3)),
    DriveCondition("motor current", "noise of 1 A", current_noise_A=1.0),
    DriveCondition("motor current", "not measured", has_currents=False),
    DriveCondition("IMU", "gyro 0.05 rad/s off", gyro_offset_rad_s=0.05),
    DriveCondition("IMU", "none", has_gyro=False),
    DriveCondition("IMU", "with pitch, slope 15 %", World(grade_rad=0.15), has_pitch=True),
    DriveCondition("encoders", "64 counts a turn", counts_per_turn=64),
    DriveCondition("encoders", "1 % glitches", glitches=0.01),
    DriveCondition("interval", "0.1 s", interval_s=0.1),
    *(DriveCondition("lost samples", f"{share:.0%}", missing=share) for share in (0.05, 0.3)),
)

#: Pairs of conditions that differ only in the ground that the observer assumes: the true one, and another.
GROUND_PAIRS = tuple(
    (right.name, wrong.name)
    for right in DRIVE_CONDITIONS
    for wrong in DRIVE_CONDITIONS
    if wrong.assumed != right.assumed == right.world.ground
    and wrong == right._replace(factor=wrong.factor, level=wrong.level, assumed=wrong.assumed)
)


_FOR_ICE = (
    Improvement("encoders on free wheels", ("ice and more sensors: encoders on free wheels",)),
    Improvement("a speed from outside at 10 Hz", ("ice and more sensors: speed from outside at 10 Hz",)),
)
DRIVE_SITUATIONS = (
    Situation("ground and robot as in their files", ("base",)),
    Situation("another ground than told", ("ground",), (Improvement("the ground told right", ("ground told",)),)),
    Situation("another ground than asphalt, told", ("ground told",)),
    Situation("patches of ice", ("patches of ice",), _FOR_ICE),
    Situation("patches of ice, more sensors", ("ice and more sensors",), _FOR_ICE),
    Situation("slopes", ("slope",), (Improvement("an attitude filter", ("IMU: with pitch, slope 15 %",)),)),
    Situation("worn wheels, a load", ("wheel radius", "mass"), as_in_the_base_case("calibration")),
    Situation("motor currents wrong, noisy or none", ("motor current",), as_in_the_base_case("better current sensors")),
    Situation("gyro off or none, or an attitude filter", ("IMU",), as_in_the_base_case("level ground and a gyro")),
    Situation("coarse encoders, glitches", ("encoders",), as_in_the_base_case("better encoders")),
    Situation("samples seldom or lost", ("interval", "lost samples"), as_in_the_base_case("50 samples a second")),
)


DRIVEN_S = 120.0
SAMPLE_S = 0.0025
#: Steps that are held in memory at once, before thinning.
_STEPS_AT_ONCE = 12_000
#: Time between two instants of the truth [s].
TRUTH_INTERVAL_S = 0.02

ROBOTS = {
    "rlma": PACKAGED["rlma"],
    "robotino": PACKAGED["robotino"],
    "skid-steer": replace(RLMA, name="skid-steer", chassis=SkidSteer(0.314, 0.314, 0.30)),
}
#: Highest speed [m/s] and yaw rate [rad/s] of each robot.
_FASTEST = {"rlma": (0.9, 0.6), "skid-steer": (0.9, 0.6), "robotino": (0.4, 0.5)}
#: Force of all motors at the rims, over the robot's weight.
_STRENGTH = 0.8
#: Bandwidth of the drives, and share of a spinning wheel's error that one step removes: at 1 they ring.
_BANDWIDTH_RAD_S, _DEADBEAT = 20.0, 0.5
#: Duration of a patch, and its period [s].
_PATCH_S, _PATCH_PERIOD_S = 3.0, 15.0
#: Period of the slopes, up and down [s].
_SLOPE_PERIOD_S = 20.0


class Driving(NamedTuple):
    """State of a drive."""

    x: np.ndarray  #: (n,) state of the robot
    angle_rad: np.ndarray  #: (wheels,) angles turned
    impulse_Nms: np.ndarray  #: (driven,) integrals of the motors' torques
    drives: tuple  #: states of the drives of the driven wheels


class Road(NamedTuple):
    """Inputs of a step of a drive."""

    reference_rad_s: np.ndarray  #: (driven,) commanded speeds of the wheels
    shares: np.ndarray  #: (wheels, grounds) of each ground under each wheel
    grade_rad: Any  #: along the robot
    dt_s: Any  #: of the step


class Drives(NamedTuple):
    """Truth of many drives, every `TRUTH_INTERVAL_S`: of the body (T, B), of the wheels (T, wheels or driven, B)."""

    speed_m_s: Any
    lateral_speed_m_s: Any
    yaw_rate_rad_s: Any
    slip_ratio: Any
    angle_rad: Any
    impulse_Nms: Any  #: (T, driven, B) integrals of the motors' torques since the start
    specific_force_m_s2: Any
    grade_rad: Any


@lru_cache(maxsize=16)
def drives(name: str, world: World, runs: int, seed: int) -> Drives:
    """Drives of a robot in this world, one for each run."""
    robot = in_world(ROBOTS[name], world)
    grounds = [world.ground] if world.patch is None else [world.ground, world.patch]
    terrains = tuple(terrain_named(ground, robot.wheel) for ground in grounds)
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
    every = round(TRUTH_INTERVAL_S / SAMPLE_S)
    for first in range(0, len(road.grade_rad), _STEPS_AT_ONCE):
        here = slice(first, first + _STEPS_AT_ONCE)
        part = Road(road.reference_rad_s[here], road.shares[here], road.grade_rad[here], SAMPLE_S)
        state, found = kernel.scan_lanes(state, part)
        parts.append(Drives(*(values[every - 1 :: every] for values in found)))
    return Drives(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def in_world(robot: Robot, world: World) -> Robot:
    """The robot with the wheel radius and mass of this world in place of its file's."""
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
    """Commanded motion (T, freedoms): segments of a few seconds, with ramps between them."""
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
    """The values (T,) with steps limited to `steepest`."""
    reached, now = np.empty_like(wanted), 0.0
    for k, value in enumerate(wanted):
        now += min(max(value - now, -steepest), steepest)
        reached[k] = now
    return reached


#: Size of a glitch of an encoder [rad/s].
_GLITCH_RAD_S = 20.0


@lru_cache(maxsize=2)
def measured(name: str, condition: DriveCondition, runs: int, seed: int) -> tuple[RobotSample, Drives]:
    """Samples (T, ..., B) as the sensors of this condition give them, and the truth at their times."""
    robot = ROBOTS[name]
    every = round(condition.interval_s / TRUTH_INTERVAL_S)
    truth = Drives(*(values[::every] for values in drives(name, condition.world, runs, seed)))
    rng = generator("sensors", name, condition.name, seed)
    sign = signs(runs)
    times = truth.speed_m_s.shape
    gyro = truth.yaw_rate_rad_s + sign * condition.gyro_offset_rad_s + GYRO.noise_std * rng.standard_normal(times)
    ahead = (
        truth.specific_force_m_s2 + sign * ACCELEROMETER.offset + ACCELEROMETER.noise_std * rng.standard_normal(times)
    )
    pitch = truth.grade_rad + sign * PITCH.offset + PITCH.noise_std * rng.standard_normal(times)
    speed = _outside_speed(condition, truth.speed_m_s, rng)
    known = np.isfinite(speed)
    dt_s = np.full(times[0], condition.interval_s)
    dt_s[0] = 0.0
    sample = RobotSample(
        dt_s=dt_s,
        wheel_speed_rad_s=_wheel_speeds(condition, robot, truth.angle_rad, rng),
        current_A=_currents(condition, robot, truth.impulse_Nms, rng),
        yaw_rate_rad_s=gyro if condition.has_gyro else np.full(times, np.nan),
        acceleration_m_s2=ahead if condition.has_pitch else np.full(times, np.nan),
        pitch_rad=pitch if condition.has_pitch else np.full(times, np.nan),
        speed_m_s=speed,
        speed_std_m_s=np.where(known, ExternalSpeed.std_m_s, np.nan),
        speed_age_s=np.where(known, condition.speed_delay_s, 0.0),
    )
    return sample, truth


def _wheel_speeds(
    condition: DriveCondition, robot: Robot, angle_rad: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Wheel speeds (T, wheels, B) from the counts between two samples; the first is that of a robot at rest."""
    step_rad = 2 * np.pi / condition.counts_per_turn
    start = rng.random(angle_rad.shape[1:])
    counts = np.floor(angle_rad / step_rad + start)
    speed = np.diff(counts, axis=0, prepend=counts[:1]) * step_rad / condition.interval_s
    signs_of_glitches = rng.choice([-1.0, 1.0], speed.shape)
    speed = speed + np.where(rng.random(speed.shape) < condition.glitches, _GLITCH_RAD_S * signs_of_glitches, 0.0)
    speed[rng.random(speed.shape) < condition.missing] = np.nan
    if not condition.all_encoders:
        speed[:, robot.driven :] = np.nan
    return speed


def _currents(condition: DriveCondition, robot: Robot, impulse_Nms: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Motor currents (T, driven, B), means between two samples."""
    if not condition.has_currents:
        return np.full_like(impulse_Nms, np.nan)
    torque_Nm = np.diff(impulse_Nms, axis=0, prepend=impulse_Nms[:1]) / condition.interval_s
    gain = 1.0 + signs(impulse_Nms.shape[-1]) * condition.current_gain
    noise_A = condition.current_noise_A * rng.standard_normal(torque_Nm.shape)
    current_A = gain * torque_Nm / robot.motor.wheel_constant_Nm_per_A + noise_A
    return np.where(rng.random(current_A.shape) < condition.missing, np.nan, current_A)


def _outside_speed(condition: DriveCondition, speed_m_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """External speeds (T, B), nan where none arrives."""
    found = np.full_like(speed_m_s, np.nan)
    if condition.speed_interval_s:
        late = round(condition.speed_delay_s / condition.interval_s)
        at = np.arange(late, len(speed_m_s), round(condition.speed_interval_s / condition.interval_s))
        noise = ExternalSpeed.std_m_s * rng.standard_normal((at.size, speed_m_s.shape[1]))
        found[at] = speed_m_s[at - late] + noise
    return found


#: Functions that give the state before the first sample, and the state and estimate after a sample.
InitAndStep = tuple[Callable[[RobotSample], Any], Callable[[Any, RobotSample], tuple[Any, SlipEstimate]]]


class SlipMethod(NamedTuple):
    """A method by its name, in words, and the function that makes it for a robot and the name of a ground."""

    name: str
    title: str
    make: Callable[[Robot, str], InitAndStep]


def wheels_alone(robot: Robot, ground: str) -> InitAndStep:
    """Method that assumes wheels rolling without slip; a missing speed is replaced by the last one.

    The state is the speeds (driven,) of the wheels [rad/s], the estimate the motion of the body that fits them best.
    """
    n = robot.driven

    def step(state: np.ndarray, sample: RobotSample) -> tuple[np.ndarray, SlipEstimate]:
        pairs = zip(sample.wheel_speed_rad_s[:n], state, strict=True)
        speeds = np.array([where(new == new, new, old) for new, old in pairs])
        motion = motion_from_wheels(robot, speeds)
        return speeds, unknown_ground(n)._replace(
            speed_m_s=motion[0],
            yaw_rate_rad_s=motion[-1],
            wheel_speed_rad_s=speeds,
            slip_speed_m_s=np.zeros(n),
            slip_ratio=np.zeros(n),
        )

    return lambda sample: np.zeros(n), step


def _of_filter(name: str, title: str) -> SlipMethod:
    """A speed observer whose bands include the uncertainty of the wheel radius."""

    def make(robot: Robot, ground: str) -> InitAndStep:
        observer = default_observer(robot, ground, name)
        return observer.init, partial(considered_step, observer)

    return SlipMethod(name, title, make)


#: The method without a filter.
PLAIN = "wheels"

SLIP_METHODS: tuple[SlipMethod, ...] = (
    SlipMethod(PLAIN, "the wheels are believed to roll without slip", wheels_alone),
    _of_filter("ekf", "extended Kalman filter"),
    _of_filter("aekf", "extended, the encoders' noise is matched"),
    _of_filter("ukf", "unscented Kalman filter, the default"),
    _of_filter("aukf", "unscented, the encoders' noise is matched"),
)

#: The extended filters for a robot with two driven wheels take 60 KB of code, the unscented ones 150 KB and more.
OBSERVER_PROCESSORS = (
    Processor("2 KB of flash", 350.0),
    Processor("64 KB of flash", 8000.0),
    Processor("512 KB of flash, or a computer", math.inf),
)


class SlipFigures(NamedTuple):
    """Figures of one observer of one robot under one condition."""

    robot: str
    condition: str
    method: str
    #: error of the speed [m/s], over all drives; nan if one drive has none
    rmse: float
    largest: float
    #: share of the samples with the true speed, and slip speed of each driven wheel, in the 95 % band; nan without a
    #: band
    speed_covered: float
    slip_covered: float
    slip_rmse: float  #: of the slip ratio
    way: float  #: relative error of the distance driven, mean of the drives
    #: share of alarms among the samples with clearly more than the allowed slip, and among those with no more
    detected: float
    false_alarms: float
    operations: int  #: in a step
    ns: float  #: time per sample with many drives side by side; depends on the machine and is not reproducible

    @property
    def subject(self) -> str:
        """The robot."""
        return self.robot

    @property
    def covered(self) -> float:
        """Smaller one of the two coverages."""
        return min(self.speed_covered, self.slip_covered)


def slip_cell(name: str, condition: DriveCondition, method: SlipMethod, runs: int, seed: int) -> SlipFigures:
    """Run the method along every drive of this condition."""
    samples, truth = measured(name, condition, runs, seed)
    kernel, init = _compiled(name, condition.assumed, method.name)
    firsts = [RobotSample(0.0, *(values[0, ..., run] for values in samples[1:])) for run in range(runs)]
    states = side_by_side([init(first) for first in firsts])
    began = time.perf_counter()
    _, found = kernel.scan_lanes(states, samples)
    ns = 1e9 * (time.perf_counter() - began) / truth.speed_m_s.size
    true = DriveTruth(truth.speed_m_s, truth.yaw_rate_rad_s, truth.lateral_speed_m_s, truth.slip_ratio)
    scores = [score_drive(ROBOTS[name], pick_lanes(found, run), pick_lanes(true, run)) for run in range(runs)]
    has_band = bool(np.isfinite(found.speed_std_m_s).any())
    way, true_way = (np.abs(speed_m_s).sum(axis=0) for speed_m_s in (found.speed_m_s, truth.speed_m_s))
    return SlipFigures(
        name,
        condition.name,
        method.name,
        **figures(scores, has_band),
        way=float(np.mean(np.abs(way / true_way - 1.0))),
        operations=len(kernel.program.nodes),
        ns=ns,
    )


@lru_cache(maxsize=2 * len(SLIP_METHODS))
def _compiled(name: str, ground: str, method: str) -> tuple[Kernel, Any]:
    """Compiled step, in machine code where possible since it serves many conditions; and the function `init`."""
    robot = ROBOTS[name]
    init, step = next(m for m in SLIP_METHODS if m.name == method).make(robot, ground)
    example = RobotSample(0.0, np.zeros(len(robot.places)), np.zeros(robot.driven))
    return Kernel(step, init(example), example, lowering=repeatable_lowering()), init


def figures(scores: Sequence[DriveScore], has_band: bool) -> dict[str, float]:
    """The figures of all drives, which are equally long; has_band: the observer reports standard deviations."""
    by_name = {name: np.array([getattr(score, name) for score in scores]) for name in DriveScore._fields}
    return {
        "rmse": _rms(by_name["speed_rmse_m_s"]),
        "largest": float(by_name["speed_max_error_m_s"].max()),
        "speed_covered": _mean(by_name["speed_coverage_95"]) if has_band else math.nan,
        "slip_covered": _mean(by_name["coverage_95"]) if has_band else math.nan,
        "slip_rmse": _rms(by_name["slip_rmse"]),
        "detected": _mean(by_name["detection_rate"]),
        "false_alarms": _mean(by_name["false_alarm_rate"]),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _mean(values: np.ndarray) -> float:
    """Mean of the finite values: a drive on which no wheel slips has no detection rate."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan
