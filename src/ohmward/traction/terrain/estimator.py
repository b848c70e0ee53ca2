"""Slip on floors for people: an estimator that remembers. `update` takes live samples, `run` takes logs."""

from __future__ import annotations

from ohmward.filters.estimator import LiveEstimator, PerWheel, Progress, number, numbers
from ohmward.logs.drive_log import DriveSource, as_drive
from ohmward.traction.motion.sample import RobotSample, first_of
from ohmward.traction.motion.sanitize import LONGEST_STEP_S
from ohmward.traction.terrain.estimate import FloorEstimate, FloorFlag
from ohmward.traction.terrain.slip_on_floors import FloorRun, SlipOnFloors, floor_samples

#: With more combinations of floors than an omni robot has of five, the step is not compiled to machine code by itself:
#: it would take half a minute.
MOST_COMPILED = 221


class FloorSlipEstimator(LiveEstimator[RobotSample, FloorEstimate]):
    """Slip on floors, live or from logs, in machine code where it is installed.

    >>> estimator = FloorSlipEstimator(slip_on_floors(robot, load_floors("floors.toml").floor))    # doctest: +SKIP
    >>> estimator.update(0.0, [-2.1, 0.0, 2.1], [-1.0, 0.1, 1.1]).travel_slip                      # doctest: +SKIP
    0.214

    The first sample waits for the compilation, some seconds; later starts find it in the cache.

    Args:
        floors: settings, of `slip_on_floors`.
        lowering: "python", "machine" or None, see `ohmward.trace.Kernel`; results differ in their last digits.
    """

    flag_type = FloorFlag
    known = FloorEstimate._fields.index("speed_m_s"), FloorEstimate._fields.index("speed_std_m_s")
    longest_step_s = LONGEST_STEP_S

    def __init__(self, floors: SlipOnFloors, lowering: str | None = None):
        if lowering is None and len(floors.recognition.combinations) > MOST_COMPILED:
            lowering = "python"
        super().__init__(floors, lowering)
        self.floors = floors

    def update(
        self,
        time_s: float,
        wheel_speed_rad_s: PerWheel,
        current_A: PerWheel,
        speed_m_s: float | None = None,
        speed_std_m_s: float | None = None,
        speed_age_s: float | None = None,
    ) -> FloorEstimate:
        """Estimate after one live sample. A bad one is survived and flagged, see `FloorFlag`; None and nan are missing.

        time_s: of the sample. A late one (its time before that of the sample before) is used without a step in time;
            where it is earlier by more than a minute, the clock was set, and time goes on from there.
        wheel_speed_rad_s, current_A: (driven,) of each driven wheel and its motor.
        speed_m_s, speed_std_m_s, speed_age_s: outside speed, forward, where there is one; 0.05 m/s and 0 s unless
            given. The slip that it shows tells floors apart that ask for like forces, and narrows the band.

        Raises:
            InputError: something else than a number, or not one for each driven wheel.
        """
        robot, time_s = self.floors.wheels.robot, number("time_s", time_s)
        sample = RobotSample(
            self._since_last(time_s),
            numbers("wheel_speed_rad_s", wheel_speed_rad_s, len(robot.places), robot.driven),
            numbers("current_A", current_A, robot.driven),
            speed_m_s=number("speed_m_s", speed_m_s),
            speed_std_m_s=number("speed_std_m_s", speed_std_m_s),
            speed_age_s=number("speed_age_s", speed_age_s),
        )
        return self._advance(sample, self._clock(time_s))

    def run(self, log: DriveSource, progress: Progress | None = None) -> FloorRun:
        """Slip and floors along a log, from this estimator's state on; a new one starts at the log's start.

        progress: called now and then with (steps done, T).

        Raises:
            InputError: a driven wheel without encoder or motor current.
        """
        log = as_drive(log, self.floors.wheels.robot)
        samples = floor_samples(log, self.floors.wheels.robot, self.time_s)
        return FloorRun(log.time_s, *self._scan(samples, first_of(samples), float(log.time_s[-1]), progress))

    def __repr__(self) -> str:
        names = ", ".join(self.floors.recognition.names)
        now = f", speed {self.last.speed_m_s:.3f} ± {self.last.speed_std_m_s:.3f} m/s" if self.last else ""
        return f"FloorSlipEstimator({self.floors.wheels.robot.name} on {names}{now})"
