"""An observer over a recorded drive, and for people one that remembers its state."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from functools import partial, reduce
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.flags import count_flags
from ohmward.logs.drive_log import DriveLog
from ohmward.trace import Kernel, maximum, snapshot
from ohmward.trace.live import Live
from ohmward.trace.structure import check
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.clean_sample import clock_after
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipFlag, SlipSample
from ohmward.traction.speed_observer.slow_channel import held
from ohmward.traction.speed_observer.speed_observer import ObserverState, SpeedObserver

Progress = Callable[[int, int], None]


class Track(NamedTuple):
    """An observer's answer to a whole drive.

    time_s: (T,) the log's.
    estimates: every field with time (T,) in front: (T,) of the body, (T, driven) of the wheels.
    seconds: what it took, compilation included.
    """

    time_s: np.ndarray
    estimates: SlipEstimate
    seconds: float

    def counts(self) -> dict[str, int]:
        """How many samples carry each flag, by name; flags that never occur are left out."""
        return count_flags(self.estimates.flags, SlipFlag)


def observe(observer: SpeedObserver, log: DriveLog, progress: Progress | None = None) -> Track:
    """What the observer knows at every sample of a drive.

    progress: called now and then with (steps done, T).

    Raises:
        InputError: the log is of a robot with other wheels.
    """
    return SlipEstimator(observer).run(log, progress)


class SlipEstimator:
    """Speed and slip, live or from logs.

    >>> estimator = SlipEstimator(SpeedObserver(scene(RLMA, hard_terrain("gravel"))))    # doctest: +SKIP
    >>> estimator.update(Sample(0.01, np.array([1.0, 1.0, nan, nan]), np.array([0.5, 0.5]))).speed_m_s
    0.119

    Args:
        observer: settings; `make_observer` finds some for a robot and a log.
        lowering: "python", "machine" or "auto", see `ohmward.trace.Kernel`; results differ in their last digits.
    """

    def __init__(self, observer: SpeedObserver, lowering: str | None = None):
        self.observer = observer
        self.lowering = lowering
        self.time_s = math.nan
        self._state: ObserverState | None = None
        self._live: Live | None = None
        self._kernel: Kernel | None = None

    @property
    def state(self) -> ObserverState | None:
        """The observer's state after the last sample; None before the first. What is assigned goes on from there."""
        return self._state if self._live is None else self._live.state

    @state.setter
    def state(self, state: ObserverState | None) -> None:
        self._state, self._live = state, None

    def update(self, sample: SlipSample) -> SlipEstimate:
        """What is known after one live sample. A bad sample is survived and flagged, see `SlipFlag`.

        Raises:
            InputError: the sample has other wheels or motors than the observer's robot.
        """
        if self._live is None:
            if self._state is None:
                self.state = self.observer.init(sample)
            self._live = self.kernel.live(self._state)
        try:
            estimate = self._live.step(sample)
        except (TypeError, ValueError):
            check(self.kernel.program.argument_structure, (self.state, sample))
            raise
        self.time_s = clock_after(self.time_s, sample.dt_s)
        return estimate

    def run(self, log: DriveLog, progress: Progress | None = None) -> Track:
        """Estimates for every sample of a log, from this estimator's state on; a new one starts at the log's start."""
        began = time.perf_counter()
        samples = samples_of(log, self.observer, self.time_s)
        if self.state is None:
            self.state = self.observer.init(first_of(samples))
        self.state, estimates = self.kernel.scan(self.state, samples, progress)
        self.time_s = float(log.time_s[-1])
        return Track(log.time_s, estimates, time.perf_counter() - began)

    def snapshot(self) -> dict[str, Any]:
        """The state as a dict for JSON; an estimator with the same settings that restores it goes on to the bit.

        Raises:
            InputError: there is no state before the first sample.
        """
        return snapshot.take(self.observer, self.state, self.time_s)

    def restore(self, taken: Mapping[str, Any]) -> None:
        """Go on from a snapshot.

        Raises:
            InputError: it is of another version, another robot, ground or other settings, or damaged.
        """
        example = self.observer.init(self.observer.no_sample())
        self.state, self.time_s = snapshot.resume(self.observer, example, taken)

    @property
    def kernel(self) -> Kernel:
        """The compiled step."""
        if self._kernel is None:
            step = partial(considered_step, self.observer)
            self._kernel = Kernel(step, self._state, self.observer.no_sample(), lowering=self.lowering)
        return self._kernel


def samples_of(log: DriveLog, observer: SpeedObserver, before_s: float = math.nan) -> SlipSample:
    """The log as samples (T, ...), its first step counted from `before_s` where that is a time before it.

    Raises:
        InputError: the log has other wheels than the observer's robot.
    """
    robot, found = observer.scene.robot, (log.wheel_speed_rad_s.shape[1], log.motor_current_A.shape[1])
    if found != (len(robot.places), robot.driven):
        raise InputError(
            f"log {log.name!r} has {found[0]} wheels and {found[1]} motors, robot {robot.name!r} has "
            f"{len(robot.places)} and {robot.driven}; read the log for this robot"
        )
    start_s = log.time_s[0] if not before_s < log.time_s[0] else before_s
    nothing = np.full(len(log), math.nan)
    given = {name: nothing if (values := getattr(log, name)) is None else values for name in SlipSample._fields[3:]}
    current_A = held(log.time_s, log.motor_current_A)
    return SlipSample(np.diff(log.time_s, prepend=start_s), log.wheel_speed_rad_s, current_A, **given)


def considered_step(
    observer: SpeedObserver, state: ObserverState, sample: SlipSample
) -> tuple[ObserverState, SlipEstimate]:
    """A step of the observer, and its estimate with what the radius is not known by."""
    after, estimate = observer.step(state, sample)
    return after, consider_radius(estimate, observer)


def consider_radius(estimate: SlipEstimate, observer: SpeedObserver) -> SlipEstimate:
    """The estimate with what the radius is not known by in the sigmas of speed and slip, where it is no state."""
    if observer.states.radius:
        return estimate
    std_m_s = observer.noise.radius_std * observer.scene.robot.wheel.radius_m * abs(estimate.wheel_speed_rad_s)
    return estimate._replace(
        speed_std_m_s=np.sqrt(estimate.speed_std_m_s**2 + reduce(maximum, std_m_s) ** 2),
        slip_speed_std_m_s=np.sqrt(estimate.slip_speed_std_m_s**2 + std_m_s**2),
    )


def motion_of(robot: Robot, estimates: SlipEstimate) -> np.ndarray:
    """(T, freedoms) the motion of the body that estimates (T, ...) hold in the speeds of the wheels' centres."""
    rim = robot.wheel.radius_m * estimates.radius_ratio[:, None] * estimates.wheel_speed_rad_s
    return (rim - estimates.slip_speed_m_s) @ np.linalg.pinv(robot.rolling[: robot.driven]).T


def first_of(samples: SlipSample) -> SlipSample:
    """A sample to start from: of every wheel and motor the first value that was measured."""
    wheels, currents = _first_known(samples.wheel_speed_rad_s), _first_known(samples.current_A)
    return SlipSample(0.0, wheels, currents)


def _first_known(values: np.ndarray) -> np.ndarray:
    """(N,) of each column of (T, N) the first finite value, nan where there is none."""
    rows = np.argmax(np.isfinite(values), axis=0)
    return values[rows, np.arange(values.shape[1])]
