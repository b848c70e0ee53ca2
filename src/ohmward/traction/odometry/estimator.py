"""Odometry for users: a filter with its state. `update` takes live samples, `run` takes a whole drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.filters.estimator import LiveEstimator, PerWheel, Progress, number, numbers
from ohmward.filters.run import Run
from ohmward.logs.drive_log import DriveLog, DriveSource, as_drive
from ohmward.traction.motion.sample import LONGEST_STEP_S, RobotSample, first_of, samples_of, wheel_values
from ohmward.traction.odometry.model import OdometryNoise
from ohmward.traction.odometry.pose_filter import PoseFilter, pose_filter
from ohmward.traction.odometry.sample import Observed, OdometryEstimate, OdometryFlag, OdometrySample
from ohmward.traction.robot.chassis import currents_show_force
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipFlag

#: A pose increment: forward, left [m] and turn [rad].
Increment = Sequence[float] | np.ndarray


#: No pose increment, and no speed observer.
NO_INCREMENT, NOT_OBSERVED = np.full(3, np.nan), Observed()


class OdometryRun(Run[OdometryEstimate]):
    """Pose and twist along a whole drive: every field of `OdometryEstimate` with time as first axis."""

    flag_type = OdometryFlag


class Odometry(LiveEstimator[OdometrySample, OdometryEstimate]):
    """Pose and twist with their covariances, live or from logs.

    >>> odometry = ow.Odometry("robot.toml")
    >>> for k in range(100):
    ...     pose = odometry.update(time_s=0.02 * k, wheel_speed_rad_s=[5.0, 5.0], yaw_rate_rad_s=0.0)
    >>> round(pose.x_m, 2), pose.pose_cov.shape
    (0.35, (3, 3))

    With a speed observer the slip of the wheels is known: `odometry.update(..., observed=slip.update(...))`.

    Args:
        robot: a robot, the path of its file, or the name of a packaged one. Or the settings of a filter.
        lowering: "python", "machine" or None, see `ohmward.trace.Kernel`; results differ in their last digits.
        noise: of sensors and wheels; by default that of the chassis type.
    """

    flag_type = OdometryFlag
    known = OdometryEstimate._fields.index("x_m"), OdometryEstimate._fields.index("position_std_m")
    longest_step_s = LONGEST_STEP_S

    def __init__(
        self, robot: Robot | PoseFilter | str, lowering: str | None = None, noise: OdometryNoise | None = None
    ):
        if isinstance(robot, PoseFilter):
            settings = robot
        else:
            settings = pose_filter(robot if isinstance(robot, Robot) else load_robot(robot), noise)
        super().__init__(settings, lowering)
        self._no_current_A = np.full(settings.robot.driven, np.nan)

    def update(
        self,
        time_s: float,
        wheel_speed_rad_s: PerWheel | None = None,
        yaw_rate_rad_s: float | None = None,
        *,
        speed_m_s: float | None = None,
        speed_std_m_s: float | None = None,
        speed_left_m_s: float | None = None,
        speed_left_std_m_s: float | None = None,
        speed_age_s: float = 0.0,
        heading_rad: float | None = None,
        heading_std_rad: float | None = None,
        increment: Increment | None = None,
        increment_std: Increment | None = None,
        increment_s: float | None = None,
        increment_age_s: float = 0.0,
        steering_rad: float | None = None,
        observed: SlipEstimate | None = None,
    ) -> OdometryEstimate:
        """Estimate after one live sample; None and nan mean missing. A bad sample is flagged (`OdometryFlag`).

        time_s: of the sample. A late one (before the previous sample's time) is used without a step in time; if it is
            early by more than a minute, or the fifth late one in a row, the clock was set, and time continues from
            there.
        wheel_speed_rad_s: (wheels,) or (driven,), driven wheels first. Undriven wheels measure the motion, as they
            neither creep nor spin. (1,) of a steered robot.
        steering_rad: angle of its steered wheel, > 0 to the left; needed with each of its speeds.
        observed: estimate of a speed observer after the same sample. If it had the motor currents, its motion is used,
            and it already includes an outside speed; without them it adds nothing to the wheels, the gyro and the speed
            given here, and is ignored.
        All others: see `OdometrySample`.

        Raises:
            InputError: a value is not a number, or an array has the wrong length.
        """
        time_s = number("time_s", time_s)
        speeds = wheel_values(self.settings.robot, wheel_speed_rad_s, steering_rad)
        if observed is not None and not force_known(self.settings.robot, observed):
            observed = None
        robot = RobotSample(
            self._since_last(time_s),
            speeds,
            self._no_current_A,
            number("yaw_rate_rad_s", yaw_rate_rad_s),
            speed_m_s=number("speed_m_s", speed_m_s if observed is None else None),
            speed_std_m_s=number("speed_std_m_s", speed_std_m_s),
            speed_age_s=number("speed_age_s", speed_age_s),
        )
        sample = OdometrySample(
            robot,
            number("speed_left_m_s", speed_left_m_s),
            number("speed_left_std_m_s", speed_left_std_m_s),
            number("heading_rad", heading_rad),
            number("heading_std_rad", heading_std_rad),
            NO_INCREMENT if increment is None else numbers("increment", increment, 3),
            NO_INCREMENT if increment_std is None else numbers("increment_std", increment_std, 3),
            number("increment_s", increment_s),
            number("increment_age_s", increment_age_s),
            NOT_OBSERVED if observed is None else motion_of_observer(self.settings, observed),
        )
        return self._advance(sample, self._clock(time_s))

    def run(
        self, log: DriveSource, observed: SlipEstimate | None = None, progress: Progress | None = None
    ) -> OdometryRun:
        """Pose and twist at every sample of a log, continuing from the current state; a new one starts with the log.

        log: a DriveLog, or a path or DataFrame of one.
        observed: estimates (T, ...) of a speed observer along the same log, see `update`; they already include the
            log's external speed, if any.
        progress: called now and then with (steps done, T).

        Raises:
            InputError: the log is of a robot with other wheels, or `observed` of another log.
        """
        log = as_drive(log, self.settings.robot)
        samples = odometry_samples(log, self.settings, observed, self.time_s)
        return OdometryRun(log.time_s, *self._scan(samples, first_of(samples), float(log.time_s[-1]), progress))

    def __repr__(self) -> str:
        e = self.last
        now = f", at ({e.x_m:.2f}, {e.y_m:.2f}) ± {BAND_95 * e.position_std_m:.2f} m" if e else ""
        return f"Odometry({self.settings.robot.name}{now})"


def odometry_samples(
    log: DriveLog, settings: PoseFilter, observed: SlipEstimate | None = None, before_s: float = np.nan
) -> OdometrySample:
    """The log as samples (T, ...), its first step counted from `before_s` if that is earlier.

    Raises:
        InputError: the log has other wheels than the robot, or `observed` another number of samples.
    """
    T = len(log)
    if observed is not None and len(observed.speed_m_s) != T:
        raise InputError(f"observed must have the {T} samples of log {log.name!r}, got {len(observed.speed_m_s)}")
    robot, nothing = samples_of(log, settings.robot, before_s), settings.no_sample()
    body = {name: values for name, values in log.quantities("body").items() if name in OdometrySample._fields}
    other: dict[str, Any] = {
        name: body.get(name, np.broadcast_to(value, (T, *np.shape(value))))
        for name, value in nothing._asdict().items()
        if name not in ("robot", "observed")
    }
    motion = Observed(*(np.broadcast_to(value, T) for value in nothing.observed))
    if observed is not None:
        known, motion = force_known(settings.robot, observed), motion_of_observer(settings, observed)
        motion = motion._replace(speed_m_s=np.where(known, motion.speed_m_s, np.nan))
        robot = robot._replace(speed_m_s=np.where(known, np.nan, robot.speed_m_s))
    return OdometrySample(robot, **other, observed=motion)


def force_known(robot: Robot, observed: SlipEstimate) -> np.ndarray:
    """Conditions (...) that the observer knew the force of every motor; never true of one that scrubs or steers.

    Otherwise any torque is possible: the wheels may slip at any time, which widens the band, and they are never
    compared with the gyro, whose offset stays unknown.
    """
    measured = np.asarray(observed.flags, dtype=int) & SlipFlag.NO_CURRENT == 0
    return measured & currents_show_force(robot.chassis)


def motion_of_observer(settings: PoseFilter, estimate: SlipEstimate) -> Observed:
    """Motion of the body from estimates (...) of a speed observer."""
    radius_m, most_std = settings.robot.wheel.radius_m * estimate.radius_ratio, settings.noise.radius_std
    # A single estimate uses floats: an eighth of the time of arrays with two elements.
    many = estimate.grip.ndim > 1
    of_wheels = (estimate.wheel_speed_rad_s, estimate.slip_speed_m_s, estimate.grip)
    speeds, slips, grips = ([*values.T] if many else values.tolist() for values in of_wheels)
    wheels = zip(settings.rims[1].tolist(), speeds, slips, strict=True)
    lowest: Callable[[Any, Any], Any] = np.minimum if many else min
    share = lowest(estimate.radius_std / most_std, 1.0) if most_std else 0.0 * estimate.radius_std
    estimated = estimate.radius_std > 0.0
    return Observed(
        estimate.speed_m_s,
        estimate.speed_std_m_s,
        sum(left * (radius_m * speed_rad_s - slip_m_s) for left, speed_rad_s, slip_m_s in wheels),
        estimate.yaw_rate_rad_s,
        estimate.yaw_rate_std_rad_s,
        np.where(estimated, share, 1.0) if many else share if estimated else 1.0,
        reduce(lowest, grips),
    )
