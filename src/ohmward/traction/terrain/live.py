"""For people: slip on floors that remembers its state. `update` takes live samples, `run` takes logs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.trace import Kernel, snapshot
from ohmward.trace.live import Live
from ohmward.traction.speed_observer.clean_sample import clock_after
from ohmward.traction.terrain.estimate import FloorEstimate
from ohmward.traction.terrain.slip_on_floors import (
    FloorState,
    SlipOnFloors,
    SlipTrack,
    first_of,
    track_of,
    wheel_samples,
)
from ohmward.traction.terrain.wheel_filter import WheelSample

#: With more combinations of floors the step is not compiled to machine code by itself: it would take half a minute.
MOST_COMPILED = 216


class FloorSlipEstimator:
    """Slip on floors, live or from logs, in machine code where it is installed.

    >>> estimator = FloorSlipEstimator(slip_on_floors(robot, load_floors("floors.toml").floor))    # doctest: +SKIP
    >>> estimator.update(WheelSample(0.03, np.array([-2.1, 0.0, 2.1]), np.array([-1.0, 0.1, 1.1]))).travel_slip
    0.214

    The first sample waits for the compilation, some seconds; later starts find it in the cache.

    Args:
        floors: settings, of `slip_on_floors`.
        lowering: "python", "machine" or "auto", see `ohmward.trace.Kernel`; results differ in their last digits.
    """

    def __init__(self, floors: SlipOnFloors, lowering: str | None = None):
        self.floors = floors
        if lowering is None and len(floors.recognition.combinations) > MOST_COMPILED:
            lowering = "python"
        self.lowering = lowering
        self.time_s = math.nan
        self._state: FloorState | None = None
        self._live: Live | None = None
        self._kernel: Kernel | None = None

    @property
    def state(self) -> FloorState | None:
        """After the last sample; None before the first."""
        return self._state if self._live is None else self._live.state

    def update(self, sample: WheelSample) -> FloorEstimate:
        """What is known after one live sample. A bad sample is survived and flagged, see `FloorFlag`.

        Raises:
            InputError: not one speed and one current for each driven wheel.
        """
        sample = self._shaped(sample)
        if self._live is None:
            state = self.floors.init(sample) if self._state is None else self._state
            self._live = self.kernel.live(state)
        self.time_s = clock_after(self.time_s, sample.dt_s)
        return self._live.step(sample)

    def run(self, log: DriveLog) -> SlipTrack:
        """Slip and floors along a log, from this estimator's state on; a new one starts at the log's start.

        Raises:
            InputError: a driven wheel without encoder or motor current.
        """
        samples = wheel_samples(log, self.floors.wheels.robot.driven, self.time_s)
        state = self.floors.init(first_of(samples)) if self.state is None else self.state
        after, estimates = self.kernel.scan(state, samples)
        self._state, self._live, self.time_s = after, None, float(log.time_s[-1])
        return track_of(log.time_s, estimates)

    def snapshot(self) -> dict[str, Any]:
        """The state as a dict for JSON; an estimator with the same settings that restores it goes on to the bit.

        Raises:
            InputError: there is no state before the first sample.
        """
        return snapshot.take(self.floors, self.state, self.time_s)

    def restore(self, taken: Mapping[str, Any]) -> None:
        """Go on from a snapshot.

        Raises:
            InputError: it is of another version, another robot, other floors or settings, or damaged.
        """
        example = self.floors.init(self.floors.no_sample())
        self._state, self.time_s = snapshot.resume(self.floors, example, taken)
        self._live = None

    def _shaped(self, sample: WheelSample) -> WheelSample:
        robot = self.floors.wheels.robot
        speed, current = (np.asarray(values, dtype=float) for values in sample[1:])
        if speed.shape != (robot.driven,) or current.shape != (robot.driven,):
            raise InputError(
                f"a sample must have {robot.driven} wheel speeds and {robot.driven} motor currents, one for each "
                f"driven wheel of {robot.name!r}, got {speed.size} and {current.size}; nan stands for what did not come"
            )
        return WheelSample(float(sample.dt_s), speed, current)

    @property
    def kernel(self) -> Kernel:
        """The compiled step."""
        if self._kernel is None:
            self._kernel = self.floors.compiled(self.lowering)
        return self._kernel
