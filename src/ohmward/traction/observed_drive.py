"""Speed and slip of a recorded drive: check the log, choose an estimator, run it, and summarise the drive.

observed = observe_drive(robot, log, hard_terrain("gravel"))
drive_figures(observed).slip_episodes

Alarms in consecutive samples are joined into episodes with wheel, start, end and largest slip. An alarm of one sample
alone is no episode: the test raises such alarms by chance, at the rate of `SlipAlarm`, and at a jitter of time stamps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Note
from ohmward.traction.drive_checks import check_drive
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.friction.terrain import Terrain
from ohmward.traction.odometry.estimator import Odometry, OdometryRun
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipAlarm, SlipEstimate, SlipFlag
from ohmward.traction.speed_observer.estimator import SlipRun, motion_of, observe
from ohmward.traction.speed_observer.make_observer import make_observer, odometry_for
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.terrain.crossing import Crossing
from ohmward.traction.terrain.floor import Floors, travel_speed
from ohmward.traction.terrain.slip_on_floors import FloorRun, slip_on_floors

#: Alarms of a wheel at most this far apart form one episode: time [s], and usual steps of a slow log.
JOINED_S, JOINED_STEPS = 0.5, 1.5
#: Sigmas above which 5 % of a normal distribution lie.
ONE_SIDED_95 = NormalDist().inv_cdf(0.95)


class SlipEpisode(NamedTuple):
    """Period in which a wheel, or the robot as a whole, slipped more than allowed."""

    wheel: str  #: its name, or "robot"
    #: of the alarm, on the log's clock
    start_s: float
    end_s: float
    greatest_slip_m_s: float  #: slip speed r omega - v of the largest magnitude
    greatest_slip: float  #: slip ratio of the largest magnitude, nan below the speed floor


class ImmobilisedEpisode(NamedTuple):
    """Period in which the wheels turned but the robot did not, on the log's clock."""

    start_s: float
    end_s: float


def slip_episodes(track: SlipRun, wheels: Sequence[str]) -> list[SlipEpisode]:
    """Slip episodes in order of time; wheels: names of the driven wheels."""
    e, found = track.estimates, []
    for k, wheel in enumerate(wheels):
        found += _episodes_of(wheel, track.time_s, e.slipping[:, k] > 0.5, e.slip_speed_m_s[:, k], e.slip_ratio[:, k])
    return sorted(found, key=lambda episode: episode.start_s)


def robot_episodes(track: FloorRun) -> list[SlipEpisode]:
    """Episodes in which a robot on learnt floors slips more than allowed along its way, with 95 % confidence."""
    slip, std = np.nan_to_num(track.travel_slip), np.nan_to_num(track.travel_slip_std)
    alarm = slip - SlipAlarm().allowed_ratio > ONE_SIDED_95 * std
    return _episodes_of("robot", track.time_s, alarm, slip * travel_speed(track.rim), slip)


def _episodes_of(
    wheel: str, time_s: np.ndarray, alarm: np.ndarray, speed_m_s: np.ndarray, ratio: np.ndarray
) -> list[SlipEpisode]:
    """Episodes of alarms (T,) with the largest slip in each."""
    found = []
    for first, last in _joined_runs(time_s, alarm):
        greatest = (_greatest(values[first : last + 1]) for values in (speed_m_s, ratio))
        found.append(SlipEpisode(wheel, float(time_s[first]), float(time_s[last]), *greatest))
    return found


def immobilised_episodes(track: SlipRun) -> list[ImmobilisedEpisode]:
    """Periods in which the robot was stuck, in order."""
    episodes = _joined_runs(track.time_s, track.estimates.immobilised > 0.5)
    return [ImmobilisedEpisode(float(track.time_s[first]), float(track.time_s[last])) for first, last in episodes]


def _joined_runs(time_s: np.ndarray, alarm: np.ndarray) -> list[tuple[int, int]]:
    """First and last sample of every stretch of alarms (T,), short pauses bridged; two in a row begin or end one."""
    repeated = alarm[1:] & alarm[:-1]
    at = np.flatnonzero(np.append(repeated, False) | np.append(False, repeated))
    if not at.size:
        return []
    joined_s = max(JOINED_S, JOINED_STEPS * float(np.median(np.diff(time_s))))
    pauses = np.flatnonzero(np.diff(time_s[at]) > joined_s)
    first, last = np.append(0, pauses + 1), np.append(pauses, at.size - 1)
    return [(int(at[a]), int(at[b])) for a, b in zip(first, last, strict=True)]


def _greatest(values: np.ndarray) -> float:
    """Value of the largest magnitude; nan if none is finite."""
    known = values[np.isfinite(values)]
    return float(known[np.argmax(np.abs(known))]) if known.size else float("nan")


#: A sensor contradicts the model if it is rejected in more than this share of the samples; a robot that slips now and
#: then reaches a hundredth of that.
CONTRADICTS = 0.1

#: Flags of a sensor that the model contradicts, and the advice.
CONTRADICTIONS = {
    SlipFlag.ENCODER_REJECTED: "encoders do not move as motors and ground allow: check their signs, their order, "
    "their shaft (--motor-shaft, at_motor_shaft=True) and the mass and torque constant of the robot file",
    SlipFlag.GYRO_REJECTED: "the gyro turns otherwise than the wheels: check its sign and unit, left and right, and "
    "the track; wheels that scrub in turns need the chassis skid-steer in the robot file",
    SlipFlag.SPEED_REJECTED: "the speed from outside contradicts wheels and motors: check its unit, its delay "
    "(speed_age_s) and its standard deviation",
}


def fit_notes(run: SlipRun) -> tuple[Note, ...]:
    """Warnings about encoder spikes, and about a model that does not fit the log."""
    spikes = int(np.count_nonzero(run.flags & SlipFlag.ENCODER_SPIKE))
    text = (
        f"{spikes} of {len(run.flags)} samples in which an encoder jumps as no wheel can: "
        "not used; check its cable and counter"
    )
    return (*([Note(text, "warning")] if spikes else []), *misfits(run))


def misfits(run: SlipRun) -> tuple[Note, ...]:
    """Warnings that the model does not fit the log, so the estimates cannot be trusted; empty if it fits."""
    shares = {flag: float(np.mean(run.flags & flag != 0)) for flag in CONTRADICTIONS}
    found = [
        f"the model does not fit {100 * share:.2g} % of the log: {CONTRADICTIONS[flag]}"
        for flag, share in shares.items()
        if share > CONTRADICTS
    ]
    restarts = int(np.count_nonzero(run.flags & SlipFlag.RESTARTED))
    if restarts:
        found.append(
            f"the observer started again {restarts} times, because its state was none that this robot can "
            "have: robot file, units or sensors are wrong"
        )
    return tuple(Note(text, "warning") for text in found)


#: Method of a drive without known forces.
ODOMETRY = "odometry"

#: Elements of the pose in the names of its covariances.
POSE = ("x", "y", "yaw")

#: Flags of an estimate on learnt floors that mean a fault in the log.
FAULTS = ("bad_time", "gap", "no_current", "no_encoder", "encoder_stopped", "speed_refused")


class OnFloors(NamedTuple):
    """Slip of a drive on learnt floors."""

    track: FloorRun  #: of the floors' own estimator
    floors: tuple[str, ...]  #: their names, in the order of `track.floor_probability`

    def columns(self, wheels: Sequence[str]) -> dict[str, np.ndarray]:
        """Columns (T,) that learnt floors add, by name; wheels: names of the driven ones."""
        columns = {
            "travel_slip": self.track.travel_slip,
            "travel_slip_std": self.track.travel_slip_std,
            "speed_over_ground_m_s": self.track.speed_m_s,
            "speed_over_ground_std_m_s": self.track.speed_std_m_s,
        }
        for w, wheel in enumerate(wheels):
            for k, floor in enumerate(self.floors):
                columns[f"{wheel}_on_{floor.replace(' ', '_')}"] = self.track.floor_probability[:, w, k]
        return columns


class ObservedDrive(NamedTuple):
    """Estimates along a recorded drive."""

    robot: Robot  #: the robot that drove
    track: SlipRun  #: speed and slip
    path: OdometryRun  #: pose and twist
    notes: tuple[Note, ...]  #: faults of the log, and everything that was assumed
    method: str  #: name of the filter; "odometry" where no motor current shows the force that drives the robot
    fits: bool = True  #: the model fits the log, so that the estimates can be trusted
    on_floors: OnFloors | None = None  #: None without learnt floors

    def columns(self) -> dict[str, np.ndarray]:
        """Columns (T,) of all estimates, by name; the covariance of the pose by its lower triangle."""
        e, path = self.track.estimates, self.path.estimates
        columns = {
            "time_s": self.track.time_s,
            "speed_m_s": e.speed_m_s,
            "speed_std_m_s": e.speed_std_m_s,
            "yaw_rate_rad_s": e.yaw_rate_rad_s,
            "yaw_rate_std_rad_s": e.yaw_rate_std_rad_s,
            "grade_rad": e.grade_rad,
            "grade_std_rad": e.grade_std_rad,
            "radius_ratio": e.radius_ratio,
            "unobserved_s": e.unobserved_s,
            "immobilised": e.immobilised.astype(int),
            "flags": e.flags.astype(int),
        }
        for k, wheel in enumerate(self.robot.driven_wheels):
            columns |= {
                f"{wheel}_wheel_speed_rad_s": e.wheel_speed_rad_s[:, k],
                f"{wheel}_slip": e.slip_ratio[:, k],
                f"{wheel}_slip_speed_m_s": e.slip_speed_m_s[:, k],
                f"{wheel}_slip_speed_std_m_s": e.slip_speed_std_m_s[:, k],
                f"{wheel}_traction_N": e.traction_N[:, k],
                f"{wheel}_friction_ratio": e.friction_ratio[:, k],
                f"{wheel}_slipping": e.slipping[:, k].astype(int),
            }
        columns |= {"x_m": path.x_m, "y_m": path.y_m, "yaw_rad": path.yaw_rad}
        for i, row in enumerate(POSE):
            columns |= {f"cov_{column}_{row}": path.pose_cov[:, i, j] for j, column in enumerate(POSE[: i + 1])}
        columns |= {"speed_left_m_s": path.speed_left_m_s, "gyro_offset_rad_s": path.gyro_offset_rad_s}
        return columns | (self.on_floors.columns(self.robot.driven_wheels) if self.on_floors else {})


class DriveFigures(NamedTuple):
    """A drive in figures; None where nothing was estimated."""

    distance_m: float  #: along the ground, forward or backward
    #: of the body
    speed_min_m_s: float
    speed_max_m_s: float
    speed_final_m_s: float
    speed_std_final_m_s: float
    #: in order of time
    slip_episodes: list[SlipEpisode]
    immobilised_episodes: list[ImmobilisedEpisode]
    unobserved_share: float  #: of the samples in which the speed was not observable
    #: at the end, of the first wheel, over the assumed ground's; the std is relative
    friction_ratio: float | None
    friction_std: float | None
    #: at the end
    grade_rad: float | None
    grade_std_rad: float | None
    #: at the end, over the robot's radius
    radius_ratio: float | None
    radius_std: float | None


class PoseFigures(NamedTuple):
    """Pose at the end of a drive, in the frame of its start, and the gyro's offset."""

    #: forward, to the left, and the turn
    x_m: float
    y_m: float
    yaw_rad: float
    #: standard deviations, of the position in the direction of the largest one
    position_std_m: float
    yaw_std_rad: float
    #: None without a gyro
    gyro_offset_rad_s: float | None
    gyro_offset_std_rad_s: float | None


class FloorFigures(NamedTuple):
    """A drive on learnt floors in figures."""

    #: slip of the robot and its std, mean over the drive; None where it stood
    travel_slip_mean: float | None
    travel_slip_std: float | None
    floor_share: dict[str, float]  #: mean probability of each floor under the wheels, by name
    floor_crossings: tuple[Crossing, ...]  #: times at which the floor changed


def observe_drive(
    robot: Robot,
    log: DriveLog,
    terrain: Terrain,
    method: str = "ukf",
    progress: Callable[[int, int], None] | None = None,
) -> ObservedDrive:
    """Speed and slip by an observer of wheels, motors and all other sensors in the log.

    terrain: ground that is assumed at first.
    method: "ekf", "aekf", "ukf" or "aukf".
    progress: called now and then with (steps done, T).

    Raises:
        InputError: the method is unknown, or the log cannot be of this robot.
    """
    log = check_drive(robot, log)
    chosen = make_observer(robot, log, terrain, method)
    track = observe(chosen.observer, log, progress)
    path = Odometry(odometry_for(robot, log)).run(log, track.estimates)
    notes = (*log.notes, *chosen.notes, *fit_notes(track))
    by = method if isinstance(chosen.observer, SpeedObserver) else ODOMETRY
    return ObservedDrive(robot, track, path, notes, by, not misfits(track))


def observe_on_floors(
    robot: Robot, log: DriveLog, known: Floors, method: str = "ukf", on: Sequence[str] = ()
) -> ObservedDrive:
    """Speed and slip from motor currents on learnt floors.

    known: floors and the robot that learnt them.
    on: names of the only floors that the robot drives on; empty if these are not known.

    Raises:
        InputError: there are no floors, a floor or the method is unknown, or a driven wheel has no encoder or motor
            current.
    """
    log = check_drive(robot, log)
    began = time.perf_counter()
    estimator = slip_on_floors(robot, known.named(on).floor if on else known.floor, method, known_only=bool(on))
    on_floors = estimator.run(log)
    track = SlipRun(log.time_s, as_estimates(on_floors, robot), time.perf_counter() - began)
    notes = (*log.notes, *_floor_notes(robot, known, on_floors, on))
    if "speed_m_s" in log.channels:
        notes += (Note("the outside speed shows slip: it indicates the floor, and narrows the band"),)
    path = Odometry(odometry_for(robot, log)).run(log, track.estimates)
    return ObservedDrive(robot, track, path, notes, method, on_floors=OnFloors(on_floors, estimator.recognition.names))


def as_estimates(run: FloorRun, robot: Robot) -> SlipEstimate:
    """Slip on floors as estimates (T, ...) of the speed observer; radius, grade and friction as assumed."""
    rim = run.rim @ robot.rolling[: robot.driven].T
    travel = travel_speed(run.rim)[:, None]
    slip, std = np.nan_to_num(run.slip_ratio) * travel, np.nan_to_num(run.slip_ratio_std) * travel
    nothing, ones = np.zeros(len(run.time_s)), np.ones(len(run.time_s))
    return SlipEstimate(
        speed_m_s=run.motion[:, 0],
        speed_std_m_s=run.motion_std[:, 0],
        yaw_rate_rad_s=run.motion[:, -1],
        yaw_rate_std_rad_s=run.motion_std[:, -1],
        wheel_speed_rad_s=rim / robot.wheel.radius_m,
        slip_speed_m_s=slip,
        slip_speed_std_m_s=std,
        slip_ratio=slip_ratio(rim, rim - slip),
        traction_N=run.force_N,
        friction_ratio=np.ones_like(slip),
        friction_std=np.zeros_like(slip),
        grade_rad=nothing,
        grade_std_rad=nothing,
        radius_ratio=ones,
        radius_std=nothing,
        grip=np.ones_like(slip),
        unobserved_s=nothing,
        slipping=SlipAlarm().slips(slip, std, rim).astype(float),
        immobilised=nothing,
        flags=nothing,
    )


def _floor_notes(robot: Robot, known: Floors, track: FloorRun, on: Sequence[str]) -> list[Note]:
    names = ", ".join(on or [floor.name for floor in known.floor]) or "none"
    others = ", and no other: the robot is given it" if on else " or an unknown one"
    notes = [Note(f"slip follows from motor currents on learnt floors ({names}){others}")]
    if known.robot != robot.name:
        notes.append(Note(f"the floors were learnt by {known.robot!r}, the robot is {robot.name!r}", "warning"))
    faults = {flag: count for flag, count in track.counts().items() if flag in FAULTS}
    notes += [Note(f"{count} samples with {flag.replace('_', ' ')}", "warning") for flag, count in faults.items()]
    return notes


def drive_figures(observed: ObservedDrive) -> DriveFigures:
    """Distance, speeds, episodes of slip, and the final estimates of friction, grade and radius."""
    track = observed.track
    e = track.estimates
    unobserved = e.flags.astype(int) & SlipFlag.SPEED_UNOBSERVED != 0
    return DriveFigures(
        float(np.trapezoid(travel_speed_m_s(observed), track.time_s)),
        float(e.speed_m_s.min()),
        float(e.speed_m_s.max()),
        float(e.speed_m_s[-1]),
        float(e.speed_std_m_s[-1]),
        _episodes(observed),
        immobilised_episodes(track),
        float(np.mean(unobserved)),
        *_estimated(e.friction_ratio[-1, 0], e.friction_std[-1, 0]),
        *_estimated(e.grade_rad[-1], e.grade_std_rad[-1]),
        *_estimated(e.radius_ratio[-1], e.radius_std[-1]),
    )


def pose_figures(observed: ObservedDrive, has_gyro: bool) -> PoseFigures:
    """Pose at the end, and the offset of the gyro if the robot has one."""
    e = observed.path.estimates
    gyro = (float(e.gyro_offset_rad_s[-1]), float(e.gyro_offset_std_rad_s[-1])) if has_gyro else (None, None)
    return PoseFigures(
        float(e.x_m[-1]),
        float(e.y_m[-1]),
        float(e.yaw_rad[-1]),
        float(e.position_std_m[-1]),
        float(np.sqrt(e.pose_cov[-1, 2, 2])),
        *gyro,
    )


def _episodes(observed: ObservedDrive) -> list[SlipEpisode]:
    """Episodes of the wheels, and of the robot on learnt floors, in order of time."""
    of_robot = robot_episodes(observed.on_floors.track) if observed.on_floors else []
    return sorted(
        [*slip_episodes(observed.track, observed.robot.driven_wheels), *of_robot], key=lambda episode: episode.start_s
    )


def travel_speed_m_s(observed: ObservedDrive) -> np.ndarray:
    """(T,) speed of the body, in any direction."""
    return travel_speed(motion_of(observed.robot, observed.track.estimates))


def floor_figures(on_floors: OnFloors) -> FloorFigures:
    """Slip of the robot, share of each floor, and crossings."""
    track = on_floors.track
    moving = np.isfinite(track.travel_slip)
    nothing = np.full(len(on_floors.floors), np.nan)
    share = track.floor_probability[moving].mean(axis=(0, 1)) if moving.any() else nothing
    return FloorFigures(
        _mean(track.travel_slip[moving]),
        _mean(track.travel_slip_std[moving]),
        dict(zip(on_floors.floors, share.tolist(), strict=True)),
        tuple(track.crossings),
    )


def _estimated(value: float, std: float) -> tuple[float, float] | tuple[None, None]:
    """A value and its std; None for a value that is assumed, which has no std."""
    return (float(value), float(std)) if std > 0 else (None, None)


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if values.size else None
