"""Pose after 50 m on flat ground from encoders and a gyro with an offset, beside plain wheel odometry.

The robot is [T]'s on the plant of our own, which creeps as the wheels drive, and on MuJoCo's, whose four fixed wheels
scrub in turns. Every run rests for 1 to 5 s, then drives straight and curved, and has its own radius (0.5 %), unequal
wheels (0.06 %), scale of the gyro (1 %) and sign of its offset of 0.01 rad/s; the filter is told none of them. The
wheels that are not driven have encoders in some rows only. A robot whose wheels are exactly alike is beside them, and
one that turns on the spot and stops in turn, with coarser counts and with a gyro that is late, judged by the way that
the gyro less its mean at the first rest makes of the wheels' speed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from figure import Figure, at_least, at_most
from ohmward.filters.consistency import mean_bounds
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA, Odometry
from ohmward.traction.robot.robot import motion_from_wheels
from ohmward.traction.speed_observer.estimator import SlipEstimator
from ohmward_lab.simulate.closed_loop import Patch
from ohmward_lab.simulate.closed_loop.traction_plant import TractionPlant
from ohmward_lab.simulate.mujoco_plant import RlmaParameters, RlmaPlant
from ohmward_lab.simulate.robot_sensors import GYRO, RobotTruth, stack

RUNS, DISTANCE_M, DT_S = 50, 50.0, 0.02
OFFSET_RAD_S, RADIUS, UNEQUAL, SCALE = 0.01, 0.005, 0.0006, 0.01
COUNTS = 4096

#: Of the runs; the shares of slip in the default noise were chosen on those of 1000 to 1049.
FIRST_SEED = 1100

#: Runs that stop and go, and their length.
STOPS, STOPS_M = 16, 100.0

ALONE = "that over the driven wheels' alone"
AT_REST = "that over wheels and gyro less its mean at rest"

#: Ways to the pose: which wheels have encoders, and whether a speed observer is one of them.
METHODS = (
    ("encoders, gyro", 2, False),
    ("encoders of all four wheels, gyro", 4, False),
    ("encoders, gyro, currents by the observer", 2, True),
)

#: Gains of the driver: N m for each m/s and rad/s, and the most that it gives of each.
OWN, MUJOCO = (40.0, 8.0, 2.5, 1.5), (25.0, 20.0, 3.0, 6.0)


class Recording(NamedTuple):
    """What the robot measured, and its true pose (T, 3)."""

    log: DriveLog
    pose: np.ndarray


class Score(NamedTuple):
    """Errors of the position at the end [m], and the NEES of the pose, of each run."""

    odometry: np.ndarray
    wheels: np.ndarray  #: alone
    at_rest: np.ndarray  #: by wheels, and the gyro less its mean at rest
    nees: np.ndarray


def rows() -> Iterator[Figure]:
    """Every figure of this page."""
    for plant, maker, gains in (("own plant", own_plant, OWN), ("MuJoCo", mujoco_plant, MUJOCO)):
        runs = [recording(maker, gains, seed) for seed in range(RUNS)]
        for method, encoders, observed in METHODS:
            yield from scores(f"{plant}, 50 m", method, scored(runs, encoders, observed))
    alike = [recording(own_plant, OWN, seed, unequal=0.0) for seed in range(RUNS)]
    for method, encoders, observed in METHODS[:2]:
        found = scored(alike, encoders, observed)
        yield at_most("own plant, 50 m, wheels exactly alike", method, ALONE, beside(found), 1.0, ".2f")
    yield from stop_and_go_rows()


def stop_and_go_rows() -> Iterator[Figure]:
    """Figures of robots that stop and go."""
    rngs = [np.random.default_rng(FIRST_SEED + RUNS + seed) for seed in range(STOPS)]
    truths = [stopping(own_plant(rng), OWN, rng) for rng in rngs]
    cases = ("4096 counts", 4096, 0.0, 0.01), ("1024 counts", 1024, 0.0, 0.01), ("gyro 100 ms late", 4096, 0.1, 0.015)
    for seen, counts, late_s, most in cases:
        runs = [measured(truth, np.random.default_rng(seed), counts, late_s) for seed, truth in enumerate(truths)]
        for method, encoders, observed in METHODS[::2]:
            found, data = scored(runs, encoders, observed), f"own plant, {STOPS_M:.0f} m, stop and go, {seen}"
            error = mean(found.odometry) / STOPS_M
            yield at_most(data, method, "error at the end over the way, mean", error, most, ".2%")
            yield at_most(data, method, AT_REST, mean(found.odometry) / mean(found.at_rest), 1.1, ".2f")
            yield at_most(data, method, "NEES of the pose, mean of the runs", mean(found.nees), 4.5, ".2f")
            yield at_least(data, method, "NEES of the pose, mean of the runs", mean(found.nees), 2.0, ".2f")


def scores(data: str, method: str, found: Score) -> Iterator[Figure]:
    """Error of the position and NEES of the pose at the end of the runs."""
    lower, upper = mean_bounds(3, RUNS)
    yield at_most(data, method, "error at the end over the way, mean", mean(found.odometry) / DISTANCE_M, 0.01, ".2%")
    yield at_most(data, method, ALONE, beside(found), 1.0, ".2f")
    yield at_most(data, method, "NEES of the pose, mean of the runs", mean(found.nees), upper, ".2f")
    yield at_least(data, method, "NEES of the pose, mean of the runs", mean(found.nees), lower, ".2f")


def mean(values: np.ndarray) -> float:
    return float(np.mean(values))


def beside(found: Score) -> float:
    """Mean error of odometry over that of the wheels alone."""
    return mean(found.odometry) / mean(found.wheels)


def own_plant(rng: np.random.Generator) -> TractionPlant:
    return TractionPlant(RLMA, [Patch(friction=float(rng.uniform(0.5, 0.9)), rolling=0.02)], longest_step_s=0.01)


def mujoco_plant(rng: np.random.Generator) -> RlmaPlant:
    return RlmaPlant(RlmaParameters(), [Patch(friction=float(rng.uniform(0.5, 0.9)))])


def recording(
    plant: Callable[[np.random.Generator], Any], gains: tuple[float, ...], seed: int, unequal: float = UNEQUAL
) -> Recording:
    """A drive of 50 m as its sensors saw it; unequal: standard deviation of a wheel's radius about their mean."""
    rng = np.random.default_rng(FIRST_SEED + seed)
    return measured(driven(plant(rng), gains, rng), rng, unequal=unequal)


def measured(
    truth: RobotTruth,
    rng: np.random.Generator,
    counts_per_turn: int = COUNTS,
    late_s: float = 0.0,
    unequal: float = UNEQUAL,
) -> Recording:
    """A drive as its sensors saw it.

    late_s: time by which the gyro is late.
    unequal: standard deviation of a wheel's radius about their mean.
    """
    radius = 1.0 + RADIUS * rng.standard_normal()
    driven_wheels = unequal * rng.standard_normal(2)
    rate = (truth.yaw_rate_rad_s[1:] + truth.yaw_rate_rad_s[:-1]) / 2
    late = round(late_s / DT_S)
    rate = np.concatenate([np.full(late, rate[0]), rate[: len(rate) - late]])
    offset = OFFSET_RAD_S * rng.choice([-1.0, 1.0])
    gyro = rate * (1 + SCALE * rng.standard_normal()) + offset + GYRO.noise_std * rng.standard_normal(len(rate))
    wheels = radius + np.concatenate([driven_wheels, unequal * rng.standard_normal(2)])
    counts = np.floor(counts_per_turn * truth.wheel_angle_rad / (2 * np.pi) / wheels)
    speeds = np.diff(counts, axis=0) * 2 * np.pi / counts_per_turn / DT_S
    current_A = truth.torque_N_m[1:, :2] / RLMA.motor.torque_constant_Nm_per_A
    log = DriveLog("run", truth.time_s[1:], speeds, current_A, yaw_rate_rad_s=gyro)
    return Recording(log, np.column_stack([truth.position_m[1:, :2], np.unwrap(truth.heading_rad)[1:]]))


def driven(plant: Any, gains: tuple[float, ...], rng: np.random.Generator) -> RobotTruth:
    """The truth of a drive of a driver who knows it: a rest, then straight and curved stretches in turn."""
    rest_s, speed, turn, period_s = (rng.uniform(*span) for span in ((1, 5), (0.4, 1.0), (0.2, 0.8), (6, 20)))
    phases = rng.uniform(0, 2 * np.pi, 2)
    per_speed, per_turn, most, most_turn = gains
    truths, way_m = [plant.reset()], 0.0
    while way_m < DISTANCE_M:
        now = truths[-1]
        t = now.time_s - rest_s
        curve = np.sin(2 * np.pi * t / 37 + phases[1]) > 0
        wanted = min(speed * (1 + 0.3 * np.sin(0.5 * t)), 0.5 * t)
        turning = turn * np.sin(2 * np.pi * t / period_s + phases[0]) * curve
        both = np.clip(per_speed * (wanted - now.speed_m_s), -most, most)
        apart = np.clip(per_turn * (turning - now.yaw_rate_rad_s), -most_turn, most_turn)
        truths.append(plant.step(np.array([both - apart, both + apart]) * (t > 0), DT_S))
        way_m += abs(truths[-1].speed_m_s) * DT_S
    return stack(truths)


def stopping(plant: Any, gains: tuple[float, ...], rng: np.random.Generator) -> RobotTruth:
    """The truth of a driver who goes straight on, goes round a curve, stops, and turns on the spot, for 5 s each."""
    rest_s, speed, turn = (rng.uniform(*span) for span in ((1, 5), (0.4, 1.0), (0.3, 0.9)))
    first, (per_speed, per_turn, most, most_turn) = int(rng.integers(4)), gains
    truths, way_m = [plant.reset()], 0.0
    while way_m < STOPS_M:
        now = truths[-1]
        t = now.time_s - rest_s
        phase, side = (int(t // 5) + first) % 4, 1 if int(t // 20) % 2 else -1
        wanted = (speed, speed, 0.0, 0.0)[phase]
        turning = (0.0, turn * np.sin(t), 0.0, turn * side)[phase]
        both = np.clip(per_speed * (wanted - now.speed_m_s), -most, most)
        apart = np.clip(per_turn * (turning - now.yaw_rate_rad_s), -most_turn, most_turn)
        stands = t <= 0 or (phase == 2 and abs(now.speed_m_s) < 0.01 and abs(now.yaw_rate_rad_s) < 0.02)
        truths.append(plant.step(np.array([both - apart, both + apart]) * (not stands), DT_S))
        way_m += abs(truths[-1].speed_m_s) * DT_S
    return stack(truths)


def scored(recordings: list[Recording], encoders: int, observed: bool) -> Score:
    """Errors at the end of every run, and the NEES of the pose there.

    encoders: number of wheels that have one, driven ones first.
    observed: with the slip of a speed observer.
    """
    found = [score(run, encoders, observed) for run in recordings]
    return Score(*(np.array(values) for values in zip(*found, strict=True)))


def score(run: Recording, encoders: int, observed: bool) -> tuple[float, float, float, float]:
    """Errors of odometry, of the wheels alone, and with the gyro less its mean at rest, and the NEES of the pose."""
    speeds = run.log.wheel_speed_rad_s.copy()
    speeds[:, encoders:] = np.nan
    log = replace(run.log, wheel_speed_rad_s=speeds)
    slip = SlipEstimator(RLMA, filter="ekf").run(log).estimates if observed else None
    e = Odometry(RLMA).run(log, slip).estimates
    error = np.array([e.x_m[-1], e.y_m[-1], e.yaw_rad[-1]]) - run.pose[-1]
    nees = error @ np.linalg.solve(e.pose_cov[-1], error)
    plain = [np.hypot(*(position - run.pose[-1, :2])) for position in reckoned(run.log)]
    return float(np.hypot(*error[:2])), float(plain[0]), float(plain[1]), float(nees)


def reckoned(log: DriveLog) -> tuple[np.ndarray, np.ndarray]:
    """Positions (2,) at the end by plain wheel odometry, and with the gyro's turn less its mean at the first rest."""
    motion = np.array([motion_from_wheels(RLMA, speeds) for speeds in log.wheel_speed_rad_s[:, :2]])
    return _position(motion[:, 0], motion[:, 1]), _position(motion[:, 0], without_offset(log))


def without_offset(log: DriveLog) -> np.ndarray:
    """The gyro's yaw rate (T,) less its mean at the first rest."""
    gyro, speeds = np.asarray(log.yaw_rate_rad_s), log.wheel_speed_rad_s[:, :2]
    moves = int(np.argmax(np.abs(speeds).max(axis=1) > 0.0))
    return np.asarray(gyro - gyro[: max(moves - 2, 5)].mean())


def _position(speed_m_s: np.ndarray, yaw_rate_rad_s: np.ndarray) -> np.ndarray:
    turned = yaw_rate_rad_s * DT_S
    middle = np.cumsum(turned) - turned / 2
    return DT_S * np.array([speed_m_s @ np.cos(middle), speed_m_s @ np.sin(middle)])
