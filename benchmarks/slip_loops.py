"""The robot in MuJoCo under a slip controller: the loops that `slip_control.py` and the pictures measure.

Nothing is tuned to a floor: every controller has one set of numbers, and takes the friction for 0.5, give or take 0.5.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import Kernel
from ohmward.traction import RLMA, Terrain, scene
from ohmward.traction.control import Limits, Measurement, SlidingMode, SlipCommand, Uncertainty, driven_wheel
from ohmward.traction.friction.law import CoulombCreep
from ohmward.traction.friction.terrain import RollingResistance
from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.simulate.ground import Grade, Patch
from ohmward_lab.simulate.mujoco_plant import RlmaParameters, RlmaPlant
from ohmward_lab.simulate.robot_sensors import RobotTruth, stack
from ohmward_lab.traction.momentum_observer import (
    AngleSample,
    MomentumEstimate,
    MomentumNoise,
    MomentumObserver,
    count_std_rad,
)
from ohmward_lab.traction.wheel_speed_cascade import WheelSpeedCascade, WheelSpeedDrive

DT = 1e-3
REST_S = 1.0
EDGE_STD_COUNTS, CLOCK_S = 0.02, 1e-6
WHEEL = driven_wheel(RLMA)
LIMITS = Limits(torque_Nm=12.0)
UNSURE = Uncertainty(force_N=0.5 * WHEEL.load_N)
SLIDING = SlidingMode(UNSURE)
#: On an estimated speed: wider, so that the wheel does not follow the estimate's noise.
WIDER = SlidingMode(UNSURE, time_constant_s=0.01)
#: That of MuJoCo's robot: 0.01 of the load at any speed.
COASTED_DOWN = RollingResistance(a1=0.01, a3_s_per_m=0.0)
#: Drag ends the acceleration of a robot that holds a slip.
DRAG = RlmaParameters(drag_N_s2_per_m2=32.0)
AT_REST = Measurement(np.zeros(2), np.zeros(2))

Torque = Callable[[RobotTruth], Any]


def run(
    make: Callable[[], Torque],
    friction: float,
    until: Callable[[RobotTruth], bool],
    p: RlmaParameters,
    grade_rad: float = 0.0,
) -> RobotTruth:
    """Drive a new plant with a new controller until a condition holds; the truth at every step."""
    plant, torque = RlmaPlant(p, [Patch(friction=friction)], Grade(grade_rad=(grade_rad,))), make()
    truths = [plant.reset()]
    while not until(truths[-1]):
        truths.append(plant.step(torque(truths[-1]), DT))
    return stack(truths)


def lasting(duration_s: float) -> Callable[[RobotTruth], bool]:
    """The condition that so much time has passed."""
    return lambda truth: truth.time_s > duration_s - DT / 2


def with_controller(
    controller: Any, command: Callable[[float], Any], every: int = 1, late: int = 0, noise_rad_s: float = 0.0
) -> Callable[[], Torque]:
    """The controller with the true speed fed back; command: of time.

    every: milliseconds between its steps; late: by so many its torque comes late; noise_rad_s: of the encoders.
    """

    def make() -> Torque:
        state, rng, k = controller.init(AT_REST), np.random.default_rng(0), 0
        under_way = deque([np.zeros(2)] * late)
        given = np.zeros(2)

        def torque(truth: RobotTruth) -> Any:
            nonlocal state, given, k
            if k % every == 0:
                omega = truth.wheel_speed_rad_s[:2] + noise_rad_s * rng.standard_normal(2)
                m = Measurement(omega, truth.wheel_centre_speed_m_s[:2])
                state, given, _ = controller.step(state, command(truth.time_s), m, every * DT)
            k += 1
            under_way.append(given)
            return under_way.popleft()

        return torque

    return make


def cascade(slip_ratio: float) -> Callable[[], Torque]:
    """The cascade at 50 Hz over a wheel-speed drive at 1 kHz."""

    def make() -> Torque:
        outer, drive = WheelSpeedCascade(WHEEL), WheelSpeedDrive(LIMITS)
        state, motor, reference, k = outer.init(AT_REST), drive.init(np.zeros(2)), np.zeros(2), 0

        def torque(truth: RobotTruth) -> Any:
            nonlocal state, motor, reference, k
            if k % 20 == 0:
                m = Measurement(truth.wheel_speed_rad_s[:2], truth.wheel_centre_speed_m_s[:2])
                state, reference, _ = outer.step(state, SlipCommand(slip_ratio), m, 20 * DT)
            k += 1
            motor, given = drive.step(motor, reference, truth.wheel_speed_rad_s[:2], DT)
            return given

        return torque

    return make


class Sensors(NamedTuple):
    """Measurements at 1 kHz, besides the motor currents (0.1 A), and their errors.

    counts: per turn of the encoders.
    edges: the time of each edge is captured, to 1 us; edges lie where they should to 0.02 of a count.
    passive: encoders on the wheels that are not driven, too.
    imu: accelerometer (0.05 m/s^2, offset 0.05 m/s^2) and gyro (0.005 rad/s); without it the yaw rate counts as 0.
    speed: an external one at 10 Hz, 0.03 m/s.
    pitch_std_deg: of the constant error of the pitch.
    scale: what the accelerometer shows over what it should.
    mass: what the observer believes over the robot's.
    rolling: its rolling resistance: the published one, up to 5 times MuJoCo's, or MuJoCo's.
    """

    counts: int = 4096
    edges: bool = False
    passive: bool = False
    imu: bool = True
    speed: bool = False
    pitch_std_deg: float = 0.2
    scale: float = 1.0
    mass: float = 1.0
    rolling: RollingResistance = RollingResistance()


@cache
def observer(s: Sensors) -> tuple[MomentumObserver, Kernel]:
    """The observer that has these sensors, and its compiled step."""
    std = count_std_rad(s.counts)
    noise = MomentumNoise(
        std,
        edge_std_counts=EDGE_STD_COUNTS if s.edges else None,
        passive_std_rad=std if s.passive else None,
        accelerometer_std_m_s2=0.05 if s.imu else None,
        gyro_std_rad_s=0.005,
        speed_std_m_s=0.03 if s.speed else None,
        disturbance_walk=0.1 if s.imu else 0.03,
        disturbance_std_m_s2=math.hypot(GRAVITY * math.radians(s.pitch_std_deg), 0.05),
    )
    made = MomentumObserver(
        scene(
            replace(RLMA, mass_kg=s.mass * RLMA.mass_kg),
            Terrain("floor", CoulombCreep(0.5, 6.25), s.rolling, "assumed"),
        ),
        noise,
    )
    return made, Kernel(made.step, made.init(), made.no_sample())


class Board:
    """The sensors of one run: offsets are drawn once, noise for every sample."""

    def __init__(self, sensors: Sensors, seed: int) -> None:
        self.sensors, self.rng = sensors, np.random.default_rng(seed)
        self.resolution = 2 * math.pi / sensors.counts
        self.phase, self.before = self.rng.random(4), np.zeros(4)
        self.truth: RobotTruth | None = None
        self.pitch_rad = math.radians(sensors.pitch_std_deg) * self.rng.standard_normal()
        self.offset = 0.05 * self.rng.standard_normal()

    def counts(self, truth: RobotTruth) -> np.ndarray:
        """(4,) since the sample before."""
        now = np.floor(truth.wheel_angle_rad / self.resolution + self.phase)
        turned, self.before = now - self.before, now
        return turned if self.sensors.passive else np.where([True, True, False, False], turned, np.nan)

    def edge_age_s(self, truth: RobotTruth, turned: np.ndarray) -> np.ndarray:
        """(4,) since the last edge of this step, nan without one."""
        before, self.truth = self.truth or truth, truth
        if not self.sensors.edges:
            return np.full(4, math.nan)
        placed = self.before + (turned < 0) - self.phase + EDGE_STD_COUNTS * self.rng.standard_normal(4)
        ages = [age_s(before, truth, k, self.resolution * placed[k], way) for k, way in enumerate(np.sign(turned))]
        return CLOCK_S * np.round(np.array(ages) / CLOCK_S)

    def sample(self, truth: RobotTruth, torque: np.ndarray, blank: AngleSample) -> AngleSample:
        """Sample at this instant; torque: (2,) of the step that ends now."""
        noise, s = self.rng.standard_normal, self.sensors
        turned = self.counts(truth)
        shown = s.scale * (truth.specific_force_m_s2[0] + self.offset) + 0.05 * noise()
        fix = truth.speed_m_s + 0.03 * noise() if round(truth.time_s / DT) % 100 == 99 else math.nan
        return blank._replace(
            dt_s=DT,
            turned_rad=self.resolution * turned,
            edge_age_s=self.edge_age_s(truth, turned),
            current_A=torque / RLMA.motor.wheel_constant_Nm_per_A + 0.1 * noise(2),
            acceleration_m_s2=shown if s.imu else math.nan,
            pitch_rad=truth.grade_rad + self.pitch_rad,
            yaw_rate_rad_s=truth.yaw_rate_rad_s + 0.005 * noise() if s.imu else 0.0,
            speed_m_s=fix if s.speed else math.nan,
        )


def age_s(before: RobotTruth, now: RobotTruth, wheel: int, angle_rad: float, way: float) -> float:
    """Time since the wheel passed an angle in the last step, nan if it did not; its angle is a cubic over the step.

    way: > 0 forward, < 0 backward.
    """
    if not abs(way) > 0:
        return math.nan
    u = np.linspace(0.0, 1.0, 101)
    (a0, w0), (a1, w1) = ((t.wheel_angle_rad[wheel], DT * t.wheel_speed_rad_s[wheel]) for t in (before, now))
    angles = a0 + u * (w0 + u * (3 * (a1 - a0) - 2 * w0 - w1 + u * (w0 + w1 - 2 * (a1 - a0))))
    return DT * (1.0 - float(np.interp(way * angle_rad, way * angles, u)))


class Observed(NamedTuple):
    """Truth over time, and what the observer said (T,)."""

    truth: RobotTruth
    estimate: MomentumEstimate


def from_estimate(e: MomentumEstimate) -> Measurement:
    """Measurement for a controller by the observer."""
    return Measurement(e.wheel_speed_rad_s, e.travel_speed_m_s, 0.0, e.speed_std_m_s, e.force_N, e.acceleration_m_s2)


class Raw:
    """Speeds as they are without an observer: counts over the last 10 ms, the body's from the passive wheels."""

    def __init__(self, sensors: Sensors) -> None:
        self.resolution = 2 * math.pi / sensors.counts
        self.turned: deque[np.ndarray] = deque([np.zeros(4)] * 10, maxlen=10)

    def measurement(self, sample: AngleSample) -> Measurement:
        """Of this sample."""
        self.turned.append(sample.turned_rad)
        omega = np.sum(self.turned, axis=0) / (10 * DT)
        return Measurement(omega[:2], np.full(2, WHEEL.radius_m * omega[2:].mean()))


def observed_run(
    step: Callable[[float, Measurement], np.ndarray],
    plant: Any,
    duration_s: float,
    sensors: Sensors,
    seed: int,
    raw: bool = False,
    resting: RobotTruth | None = None,
) -> Observed:
    """A second at rest, then `step` for `duration_s`: (time, measurement) -> torque (2,). Time 0 is the start.

    plant: is reset.  resting: what the sensors feel at rest, where that differs from the plant's first truth.
    """
    watch, observe = observer(sensors)
    board, direct = Board(sensors, seed), Raw(sensors)
    truth, blank = plant.reset(), watch.no_sample()
    state, board.before = watch.init(), np.floor(board.phase)
    for _ in range(round(REST_S / DT)):
        state, e = observe(state, board.sample(resting or truth, np.zeros(2), blank))
    m = direct.measurement(blank._replace(turned_rad=np.zeros(4))) if raw else from_estimate(e)
    truths, estimates = [truth], [e]
    for _ in range(round(duration_s / DT)):
        torque = step(truth.time_s, m)
        truth = plant.step(torque, DT)
        sample = board.sample(truth, torque, blank)
        state, e = observe(state, sample)
        m = direct.measurement(sample) if raw else from_estimate(e)
        truths.append(truth)
        estimates.append(e)
    return Observed(stack(truths), stack(estimates))


class Stepper:
    """A controller with its state, as `observed_run` wants it; `switch` puts another one in its place."""

    def __init__(self, controller: Any, command: Callable[[float], Any]) -> None:
        self.controller, self.command, self.state = controller, command, None

    def __call__(self, time_s: float, m: Measurement) -> np.ndarray:
        if self.state is None:
            self.state = self.controller.init(m)
        self.state, torque, _ = self.controller.step(self.state, self.command(time_s), m, DT)
        return np.asarray(torque, dtype=float)


class Tracking(NamedTuple):
    """Tracking of a slip.

    settled_s: from when on it stays within 0.02 until the end; inf where it does not.
    rms: of its error after `steady_s`.
    change_Nm: largest change of the torque of one wheel from step to step, after the first.
    reversals: how often the torque turned back by more than 0.1 N m in the first half second.
    adhesion: most of the load that the ground gave in the first half second.
    """

    settled_s: float
    rms: float
    change_Nm: float
    reversals: int
    adhesion: float


def tracking(truth: RobotTruth, slip_ratio: float, steady_s: float) -> Tracking:
    """Of the front left wheel."""
    error = truth.slip_ratio[:, 0] - slip_ratio
    outside = np.flatnonzero(~(np.abs(error) <= 0.02))
    settled = truth.time_s[outside[-1] + 1] if outside[-1] + 1 < len(error) else math.inf
    torque, early = truth.torque_N_m[:, 0], truth.time_s < 0.5
    return Tracking(
        float(settled),
        float(np.sqrt(np.nanmean(error[truth.time_s > steady_s] ** 2))),
        float(np.abs(np.diff(torque[1:])).max()),
        reversals(torque[early], 0.1),
        float((truth.traction_N[early, 0] / truth.normal_N[early, 0]).max()),
    )


def reversals(torque_Nm: np.ndarray, size_Nm: float) -> int:
    """Number of times that the torque turns back by more than a size."""
    count, direction, turning = 0, 0.0, torque_Nm[0]
    for torque in torque_Nm:
        back = direction * (turning - torque) if direction else abs(torque - turning)
        if back > size_Nm:
            count, direction, turning = count + 1, float(np.sign(torque - turning)), torque
        elif direction * (torque - turning) > 0:
            turning = torque
    return max(count - 1, 0)
