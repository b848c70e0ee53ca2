"""Speed and slip for users: an observer with its state. `update` takes live samples, `run` takes a whole drive."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from functools import partial, reduce
from typing import Any, Self

import numpy as np

from ohmward.filters.consistency import BAND_95
from ohmward.filters.estimator import LiveEstimator, PerWheel, Progress, number, numbers
from ohmward.filters.run import Run
from ohmward.logs.drive_log import DriveLog, DriveSource, as_drive
from ohmward.trace import Kernel, maximum
from ohmward.trace.snapshot import take
from ohmward.traction.friction.terrain import DEFAULT_TERRAIN, Terrain
from ohmward.traction.motion.sample import LONGEST_STEP_S, RobotSample, first_of, samples_of, wheel_values
from ohmward.traction.odometry.pose_filter import pose_filter
from ohmward.traction.odometry.slip import SlipByOdometry
from ohmward.traction.robot.chassis import currents_show_force
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipFlag
from ohmward.traction.speed_observer.make_observer import DEFAULT_FILTER, default_observer
from ohmward.traction.speed_observer.speed_observer import SpeedObserver


class SlipRun(Run[SlipEstimate]):
    """Estimates for a whole drive, every field (T,) of the body or (T, driven) of the wheels."""

    flag_type = SlipFlag


def observe(observer: SpeedObserver | SlipByOdometry, log: DriveLog, progress: Progress | None = None) -> SlipRun:
    """Estimates at every sample of a drive.

    progress: called now and then with (steps done, T).

    Raises:
        InputError: the log is of a robot with other wheels.
    """
    return SlipEstimator(observer).run(log, progress)


class SlipEstimator(LiveEstimator[RobotSample, SlipEstimate]):
    """Speed and slip, live or from logs.

    Until a motor current shows the force that drives the robot, speed and slip are those of an `Odometry` of the same
    samples; the motors of wheels that scrub never show it. Traction is then nan.

    >>> estimator = ow.SlipEstimator("rlma", terrain="gravel")
    >>> estimator.update(time_s=0.0, wheel_speed_rad_s=[0.0, 0.0], current_A=[0.5, 0.5]).slip_speed_m_s.shape
    (2,)

    Args:
        robot: a robot, the path of its file, or the name of a packaged one, see `PACKAGED`. Or the
            settings of an observer, which then estimates alone; `make_observer` finds them for a robot and a log, whose
            noise it measures.
        lowering: "python", "machine" or None, see `ohmward.trace.Kernel`; results differ in their last digits.
        terrain: ground that is assumed at first, by name; its friction is estimated.
        filter: "ekf", "aekf", "ukf" or "aukf".
    """

    flag_type = SlipFlag
    known = SlipEstimate._fields.index("speed_m_s"), SlipEstimate._fields.index("speed_std_m_s")
    longest_step_s = LONGEST_STEP_S

    def __init__(
        self,
        robot: Robot | SpeedObserver | SlipByOdometry | str,
        lowering: str | None = None,
        terrain: Terrain | str = DEFAULT_TERRAIN,
        filter: str = DEFAULT_FILTER,
    ):
        if not isinstance(robot, Robot | SpeedObserver | SlipByOdometry):
            robot = load_robot(robot)
        observer = default_observer(robot, terrain, filter) if isinstance(robot, Robot) else robot
        super().__init__(observer, lowering)
        self.observer = observer
        #: Estimates until a motor current shows the force that drives the robot; None from then on.
        self._unforced: SlipEstimator | None = None
        if isinstance(robot, Robot) and isinstance(observer, SpeedObserver):
            self._unforced = SlipEstimator(SlipByOdometry(pose_filter(robot)), lowering)

    def update(
        self,
        time_s: float,
        wheel_speed_rad_s: PerWheel,
        current_A: PerWheel | None = None,
        yaw_rate_rad_s: float | None = None,
        acceleration_m_s2: float | None = None,
        pitch_rad: float | None = None,
        speed_m_s: float | None = None,
        speed_std_m_s: float | None = None,
        speed_age_s: float = 0.0,
        steering_rad: float | None = None,
    ) -> SlipEstimate:
        """Estimate after one live sample. A bad sample is flagged, see `SlipFlag`; None and nan mean missing.

        A sensor slower than the samples is held for its usual interval. Samples should end with the wheel speeds:
        `ohmward.traction.SensorInbox` makes such samples from messages that arrive one by one, late and out of order.

        time_s: of the sample. A late one (before the previous sample's time) is used without a step in time; if it is
            early by more than a minute, or the fifth late one in a row, the clock was set, and time continues from
            there.
        wheel_speed_rad_s: (wheels,) or (driven,) from encoders, driven wheels first. (1,) of a steered robot.
        current_A: (driven,) of the motors, > 0 drives forward; not used of a robot that scrubs or steers.
        steering_rad: angle of its steered wheel, > 0 to the left; needed with each of its speeds.
        All others: see `RobotSample`. A sensor without noise settings in the observer is not used.

        Raises:
            InputError: a value is not a number, or there is not one for each wheel or motor.
        """
        robot = self.observer.robot
        time_s = number("time_s", time_s)
        sample = RobotSample(
            self._since_last(time_s),
            wheel_values(robot, wheel_speed_rad_s, steering_rad),
            numbers("current_A", current_A if currents_show_force(robot.chassis) else None, robot.driven),
            number("yaw_rate_rad_s", yaw_rate_rad_s),
            number("acceleration_m_s2", acceleration_m_s2),
            number("pitch_rad", pitch_rad),
            number("speed_m_s", speed_m_s),
            number("speed_std_m_s", speed_std_m_s),
            number("speed_age_s", speed_age_s),
        )
        return self._advance(sample, self._clock(time_s))

    def run(self, log: DriveSource, progress: Progress | None = None) -> SlipRun:
        """Estimates for every sample of a log, continuing from the current state; a new one starts with the log.

        log: a DriveLog, or a path or DataFrame of one.
        progress: called now and then with (steps done, T).

        Raises:
            InputError: the log is of a robot with other wheels.
        """
        log = as_drive(log, self.observer.robot)
        samples = samples_of(log, self.observer.robot, self.time_s)
        alone, self._unforced = self._unforced, None
        estimates, seconds = self._scan(samples, first_of(samples), float(log.time_s[-1]), progress)
        unforced = np.cumsum(np.isfinite(samples.current_A).any(axis=1)) == 0
        if alone is not None and unforced.any():
            by_wheels = alone.run(log)
            pairs = zip(by_wheels.estimates, estimates, strict=True)
            estimates = SlipEstimate(*(np.where(unforced, a.T, b.T).T for a, b in pairs))
            seconds += by_wheels.seconds
            self._unforced = alone if unforced[-1] else None
            self.last = self._last_of(estimates)
        return SlipRun(log.time_s, estimates, seconds)

    def snapshot(self) -> dict[str, Any]:
        """The state as a dict for JSON, see `LiveEstimator.snapshot`."""
        if self._unforced is None:
            return super().snapshot()
        return take(self.settings, self.state, self.time_s, unforced=self._unforced.snapshot())

    @classmethod
    def restore(cls, settings: Any, snapshot: Mapping[str, Any], **options: Any) -> Self:
        """The estimator that continues from a snapshot, see `LiveEstimator.restore`."""
        estimator = super().restore(settings, snapshot, **options)
        if estimator._unforced is not None:
            before, alone = snapshot.get("unforced"), estimator._unforced.settings
            estimator._unforced = SlipEstimator.restore(alone, before, lowering=estimator.lowering) if before else None
        return estimator

    def _advance(self, sample: RobotSample, clock_s: float) -> SlipEstimate:
        estimate = super()._advance(sample, clock_s)
        if self._unforced is not None and np.isfinite(sample.current_A).any():
            self._unforced = None
        if self._unforced is not None:
            estimate = self.last = self._unforced.step(sample)
        return estimate

    def compiled(self) -> Kernel:
        """The step, compiled."""
        nothing = self.no_sample()
        step = partial(considered_step, self.observer)
        return Kernel(step, self.observer.init(nothing), nothing, lowering=self.lowering)

    def __copy__(self) -> Self:
        other = super().__copy__()
        other._unforced = copy(self._unforced)
        return other

    def __repr__(self) -> str:
        observer, e = self.observer, self.last
        how = f"odometry, {observer.robot.name}"
        if isinstance(observer, SpeedObserver):
            how = f"{observer.method}, {observer.robot.name} on {observer.scene.terrains[0].name}"
        now = f", speed {e.speed_m_s:z.3f} ± {BAND_95 * e.speed_std_m_s:.3f} m/s" if e else ""
        return f"SlipEstimator({how}{now})"


def considered_step(
    observer: SpeedObserver | SlipByOdometry, state: Any, sample: RobotSample
) -> tuple[Any, SlipEstimate]:
    """A step, with the uncertainty of the wheel radius in its estimate, which that of the odometry contains."""
    after, estimate = observer.step(state, sample)
    return after, consider_radius(estimate, observer) if isinstance(observer, SpeedObserver) else estimate


def consider_radius(estimate: SlipEstimate, observer: SpeedObserver) -> SlipEstimate:
    """The estimate with its std of speed and slip inflated by that of the wheel radius, where it is not a state."""
    if observer.states.radius:
        return estimate
    std_m_s = observer.noise.radius_std * observer.scene.robot.wheel.radius_m * abs(estimate.wheel_speed_rad_s)
    return estimate._replace(
        speed_std_m_s=np.sqrt(estimate.speed_std_m_s**2 + reduce(maximum, std_m_s) ** 2),
        slip_speed_std_m_s=np.sqrt(estimate.slip_speed_std_m_s**2 + std_m_s**2),
    )


def motion_of(robot: Robot, estimates: SlipEstimate) -> np.ndarray:
    """Motion (..., freedoms) of the body from the speeds of the wheels' centres in estimates (...)."""
    rim = robot.wheel.radius_m * np.asarray(estimates.radius_ratio)[..., None] * estimates.wheel_speed_rad_s
    return (rim - estimates.slip_speed_m_s) @ robot.motion_by_rims.T
