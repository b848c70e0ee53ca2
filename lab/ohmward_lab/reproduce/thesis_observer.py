"""Observer of [T], figures 4.7 to 4.16: UKF and AUKF of four states, a drive forward, and one forward and backward.

The robot is our own plant at 1 kHz, its sensors are ours: encoders of 4096 counts read every 10 ms, currents with 0.1 A
of noise. The filters know robot and ground, as in [T], and start with the right noise, or with one that is wrong by a
factor of 100.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from ohmward.filters import Belief, adaptive
from ohmward.report import TIME, Figure, Series
from ohmward.trace import Kernel
from ohmward.traction import RLMA, RobotInput, RollingResistance, Terrain, scene
from ohmward.traction.friction.law import WardIagnemma
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.encoders import wheel_speeds
from ohmward.traction.speed_observer.slip_step import SlipStep, slip_step
from ohmward.traction.speed_observer.states import KNOWN_GROUND, StateLayout
from ohmward_lab.published.scheme_by_method import PackedAdaptiveState, pack, unpack
from ohmward_lab.reproduce.row import Result, ResultRow
from ohmward_lab.simulate.closed_loop.sensing import quantisation_std_rad_s
from ohmward_lab.simulate.implicit_step import next_state

WET = scene(RLMA, Terrain("wet tiles", WardIagnemma(0.4, 8.0), RollingResistance(), "assumed"))
LAYOUT = StateLayout(RLMA, KNOWN_GROUND)
CONSTANT, RADIUS = RLMA.motor.torque_constant_Nm_per_A, RLMA.wheel.radius_m
PLANT_S, DT_S, COUNTS, CURRENT_STD_A, DURATION_S, RUNS = 1e-3, 1e-2, 4096, 0.1, 12.0, 10
R = quantisation_std_rad_s(COUNTS, DT_S) ** 2 * np.eye(2)
#: Floor of a matched covariance as a share of the right one: next to nothing, as [T] has no floor.
FLOOR = 1e-6


class CurrentDrive(NamedTuple):
    """Currents of the motors over time."""

    title: str  #: in words
    #: commanded speed [m/s] over time (T,), from which the current is computed
    speed: Callable[[np.ndarray], np.ndarray]
    steer_A: Callable[[np.ndarray], np.ndarray]  #: current of the right motor less that of the left, over time (T,)


DRIVES = {
    "forward": CurrentDrive("Forward", lambda t: 0.3 - 0.2 * np.cos(1.5 * t), lambda t: 0.4 * np.sin(0.8 * t)),
    "backward": CurrentDrive("Forward and backward", lambda t: 0.4 * np.sin(0.9 * t), lambda t: 0.4 * np.sin(0.8 * t)),
}


class RecordedDrive(NamedTuple):
    """A drive, true and as measured: time_s (T,), truth (T, 4), speeds and currents (T, 2)."""

    time_s: np.ndarray
    truth: np.ndarray
    speed_rad_s: np.ndarray
    current_A: np.ndarray


class MatchingFilter(NamedTuple):
    """A filter of the table: its name, and which noise it matches."""

    name: str
    match_Q: bool = False
    match_R: bool = False


class WrongNoise(NamedTuple):
    """Factors by which the initial noise of a filter is wrong."""

    name: str
    Q: float = 1.0
    R: float = 1.0


STARTS = (
    WrongNoise("right"),
    WrongNoise("R / 100", R=0.01),
    WrongNoise("R x 100", R=100.0),
    WrongNoise("Q / 100", Q=0.01),
    WrongNoise("Q x 100", Q=100.0),
)
UKF = MatchingFilter("UKF")
AUKF = MatchingFilter("AUKF, R matched", match_R=True)
AUKF_T = MatchingFilter("AUKF of [T], Q and R matched", match_Q=True, match_R=True)


def record(drive: CurrentDrive, rng: np.random.Generator) -> RecordedDrive:
    """The drive, from its first speed on."""
    every = round(DT_S / PLANT_S)
    time_s = PLANT_S * np.arange(round(DURATION_S / PLANT_S))
    current_A = currents(drive, time_s)
    speed = float(drive.speed(np.zeros(1))[0])
    x = np.array([speed, 0.0, speed / RADIUS, speed / RADIUS])
    _, truth = Kernel(plant, x, np.zeros(2)).scan(x, current_A)
    angle = PLANT_S * np.cumsum(truth[:, 2:], axis=0) + rng.uniform(0.0, 1.0, 2)
    sampled = slice(every - 1, None, every)
    counts = np.floor(angle * COUNTS / (2 * np.pi)).astype(int)[sampled]
    measured_A = current_A.reshape(-1, every, 2).mean(axis=1)
    measured_A = measured_A + CURRENT_STD_A * rng.standard_normal(measured_A.shape)
    speeds = wheel_speeds(counts, time_s[sampled], COUNTS)
    return RecordedDrive(time_s[sampled][1:], truth[sampled][1:], speeds[1:], measured_A[1:])


def plant(x: np.ndarray, current_A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Step of the plant: the state (4,) after a millisecond, as state and as output."""
    x = next_state(x, RobotInput(current_A), WET, PLANT_S)
    return x, x


def currents(drive: CurrentDrive, time_s: np.ndarray) -> np.ndarray:
    """Currents (T, 2) of the motors: those of a robot without slip, and the steering."""
    speed = drive.speed(time_s)
    mass_kg = RLMA.inertia[0] + 2 * RLMA.inertia[2] / RADIUS**2
    push_N = mass_kg * np.gradient(speed, time_s) - WET.terrains[0].rolling.force_N(speed, RLMA.mass_kg * GRAVITY)
    return (push_N * RADIUS / (2 * CONSTANT))[:, None] + drive.steer_A(time_s)[:, None] * np.array([-0.5, 0.5])


def observer(kind: MatchingFilter, wrong: WrongNoise) -> Kernel:
    """The filter, compiled; its samples are the wheels' speeds and the currents, each (2,)."""

    def one(packed: PackedAdaptiveState, sample: tuple) -> tuple:
        state, (y, current_A) = unpack(packed), sample
        step = slip_step(LAYOUT.split(state.belief.mean), RobotInput(current_A), WET, DT_S)
        Q = process_noise(step.torque_response) * (FLOOR if kind.match_Q else wrong.Q)
        floors = Q, R * (FLOOR if kind.match_R else wrong.R)
        matching = adaptive.Matching(*floors, match_Q=kind.match_Q, match_R=kind.match_R)
        state, _ = adaptive.unscented_step(state, lambda x: follow(x, current_A, step), lambda x: x[2:], y, matching)
        return pack(state), (state.belief.mean, np.diag(state.belief.cov))

    return Kernel(one, start(np.zeros(4), wrong), (np.zeros(2), np.zeros(2)))


def start(x: np.ndarray, wrong: WrongNoise) -> PackedAdaptiveState:
    """State before the first sample of a drive that starts at x (4,)."""
    first = Belief(x, np.diag([0.02, 0.05, 0.1, 0.1]) ** 2)
    return pack(adaptive.init(first, wrong.Q * np.diag([1e-6, 1e-6, 1e-5, 1e-5]), wrong.R * R))


def estimate(filter_: Kernel, drive: RecordedDrive, wrong: WrongNoise) -> tuple[np.ndarray, np.ndarray]:
    """Mean (T, 4) and variance (T, 4) of the state along a drive, from its first state."""
    return filter_.scan(start(drive.truth[0], wrong), (drive.speed_rad_s, drive.current_A))[1]


def follow(x: np.ndarray, current_A: np.ndarray, mean: SlipStep) -> np.ndarray:
    """State (4,) after a step, with the slip at the mean as the initial guess."""
    step = slip_step(LAYOUT.split(x), RobotInput(current_A), WET, DT_S, mean.slip_m_s)
    return np.array([*step.motion, *step.omega])


def process_noise(torque_response: np.ndarray) -> np.ndarray:
    """Q (4, 4): unknown current through the model, and a little noise on every state."""
    B = CURRENT_STD_A * CONSTANT * torque_response
    return B @ B.T + DT_S * np.diag([0.003, 0.03, 0.03, 0.03]) ** 2


class ObserverErrors(NamedTuple):
    """RMS errors of a filter over its drives, and the mean NEES of the speed."""

    speed_mm_s: float
    wheel_rad_s: float
    slip_mm_s: float
    yaw_mrad_s: float
    nees: float


def errors(drives: list[RecordedDrive], kind: MatchingFilter, wrong: WrongNoise) -> ObserverErrors:
    """Errors of a filter over several drives."""
    filter_ = observer(kind, wrong)
    found = [estimate(filter_, d, wrong) for d in drives]
    mean, variance = (np.concatenate(parts) for parts in zip(*found, strict=True))
    truth = np.concatenate([d.truth for d in drives])
    e, slip = mean - truth, slip_speed(mean) - slip_speed(truth)
    nees = e[:, 0] ** 2 / variance[:, 0]
    return ObserverErrors(1e3 * rms(e[:, 0]), rms(e[:, 2:]), 1e3 * rms(slip), 1e3 * rms(e[:, 1]), float(nees.mean()))


def slip_speed(x: np.ndarray) -> np.ndarray:
    """Slip speeds (T, 2) [m/s] of states (T, 4)."""
    return RADIUS * x[:, 2:] - x[:, :2] @ RLMA.rolling[:2].T


def rms(error: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(error**2)))


def pictures(title: str, drive: RecordedDrive, wrong: WrongNoise) -> tuple[Figure, ...]:
    """Speed, wheel speed, slip, yaw rate and the error of the speed, of UKF and AUKF with the same wrong start."""
    t = drive.time_s
    found = {kind: estimate(observer(kind, wrong), drive, wrong)[0] for kind in (UKF, AUKF)}

    def figure(heading: str, label: str, of: Callable[[np.ndarray], np.ndarray]) -> Figure:
        lines = [
            Series(t, of(found[UKF]), "UKF", role="comparison"),
            Series(t, of(found[AUKF]), "AUKF", role="estimate"),
            Series(t, of(drive.truth), "truth", "dashed", "reference"),
        ]
        return Figure(heading, TIME, label, lines, height_px=170)

    wrongly = [
        Series(t, 1e3 * (found[UKF] - drive.truth)[:, 0], "UKF", role="comparison"),
        Series(t, 1e3 * (found[AUKF] - drive.truth)[:, 0], "AUKF", role="estimate"),
    ]
    return (
        figure(f"{title}, started with {wrong.name}: speed", "v [m/s]", lambda x: x[:, 0]),
        figure("Front left wheel", "omega [rad/s]", lambda x: x[:, 2]),
        figure("Its slip", "s [mm/s]", lambda x: 1e3 * slip_speed(x)[:, 0]),
        figure("Yaw rate", "psi_dot [rad/s]", lambda x: x[:, 1]),
        Figure("Error of the speed", TIME, "v_hat - v [mm/s]", wrongly, y_limits=(-6.0, 6.0), height_px=170),
    )


def observers() -> Result:
    """Figures 4.7 to 4.16: both drives."""
    parts = [_result(name) for name in DRIVES]
    return Result(tuple(r for part in parts for r in part.rows), tuple(f for part in parts for f in part.figures))


@cache
def drives_of(name: str) -> list[RecordedDrive]:
    """The runs of a drive."""
    return [record(DRIVES[name], np.random.default_rng(seed)) for seed in range(RUNS)]


@cache
def errors_of(name: str, wrong: WrongNoise, kind: MatchingFilter) -> ObserverErrors:
    """Errors over all runs of a drive."""
    return errors(drives_of(name), kind, wrong)


_WHY = (
    "[T] shows pictures of wheel speed and speed in which the AUKF is nearer to the truth, without a number. `as "
    "printed` is the AUKF that matches Q and R (3.49, 3.50), `corrected` the one that matches R alone"
)


def _result(name: str) -> Result:
    """Errors of UKF and AUKF for each initial noise; figures of a run with R / 100."""
    title = DRIVES[name].title
    rows = []
    for wrong in STARTS:
        ukf, matched, both = (errors_of(name, wrong, kind) for kind in (UKF, AUKF, AUKF_T))
        what = f"{title}, noise at first: {wrong.name}"
        rows += [
            ResultRow(f"{what}: speed, UKF", "mm/s", None, ukf.speed_mm_s, ukf.speed_mm_s),
            ResultRow(f"{what}: speed, AUKF", "mm/s", None, both.speed_mm_s, matched.speed_mm_s, None, _WHY),
            ResultRow(f"{what}: wheel speed, UKF", "rad/s", None, ukf.wheel_rad_s, ukf.wheel_rad_s),
            ResultRow(f"{what}: wheel speed, AUKF", "rad/s", None, both.wheel_rad_s, matched.wheel_rad_s),
            ResultRow(f"{what}: slip speed, UKF", "mm/s", None, ukf.slip_mm_s, ukf.slip_mm_s),
            ResultRow(f"{what}: slip speed, AUKF", "mm/s", None, both.slip_mm_s, matched.slip_mm_s),
            ResultRow(f"{what}: NEES of the speed, UKF", "", None, ukf.nees, ukf.nees),
            ResultRow(f"{what}: NEES of the speed, AUKF", "", None, both.nees, matched.nees),
        ]
    return Result(tuple(rows), pictures(title, drives_of(name)[0], STARTS[1]))
