"""Slip of a robot on learnt or new floors, from encoders and motor currents alone.

The filter (`wheel_filter`) gives the motion of the rims and the force of each wheel; the forces identify the floor
under each wheel (`recognition`); the floor gives the creep of a wheel from its force and motion (`floor`). Over several
floors the slip is their terrain mixture, and its band is wide on a new floor.

    lambda_i = sum over floors p_i h_i sigma_i(F_i / N_i),    v = w - G_d^+ (lambda |w|)

All of this is one recursive step: a robot runs it live (`FloorSlipEstimator`), a log is a scan of it. Besides drag, the
forces contain the body's inertia; its acceleration is that of the rims, filtered.

Belief in the slip of wheels on a floor, as curves over their force:

    mean m(F/N),   variance v(F/N),   covariance of two wheels  c(F_i/N_i, F_j/N_j) = sum over k of phi_k phi_k

Friction and stiffness of a floor are common to all wheels, so the errors of their slips are correlated. The phi_k are
the first functions of the Karhunen-Loeve expansion of the slip over all possible versions of this floor. The variance
is exact; the part of the omitted functions counts as each wheel's own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.filters.estimator import LiveEstimator, PerWheel, Progress, number, numbers
from ohmward.filters.flags import SampleFlag, flags_of
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import std
from ohmward.filters.run import Run
from ohmward.filters.sanitize import every, some
from ohmward.logs.drive_log import DriveLog, DriveSource, as_drive
from ohmward.trace import Kernel, Scalar, exp, logical_not, maximum, minimum, sqrt, table, where
from ohmward.traction.dynamics.slip import REPORT_FLOOR
from ohmward.traction.friction.law import direction_and_size
from ohmward.traction.motion.sample import (
    LONGEST_STEP_S,
    EncoderWatch,
    RobotSample,
    first_of,
    no_sample,
    samples_of,
    sanitize,
    watch_encoders,
    without_stopped,
)
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.crossing import Crossing, CrossingState, CrossingTest, crossing_test
from ohmward.traction.terrain.floor import (
    AS_LEARNT,
    Floor,
    SlipBelief,
    SlipScale,
    drag_share,
    inertial_forces,
    mean_load,
    scaled,
    slip_scale,
    slips_of_floors,
    static_loads,
    travel_speed,
    undetermined_force_std,
    wheel_motion,
)
from ohmward.traction.terrain.recognition import (
    FloorForces,
    LossState,
    Recognition,
    RecognitionState,
    averaged,
    corrected,
    log_likelihood,
    loss_sample,
    seen,
)
from ohmward.traction.terrain.wheel_filter import WheelBelief, WheelFilter, WheelState


class FloorEstimate(NamedTuple):
    """Estimate after a sample."""

    rim: np.ndarray  #: (freedoms,) motion of the rims, as if no wheel slipped
    motion: np.ndarray  #: (freedoms,) of the body
    motion_std: np.ndarray  #: its standard deviation
    #: over ground
    speed_m_s: Any
    speed_std_m_s: Any
    travel_slip: Any  #: share of the rims' travel speed that is lost; nan while the wheels hardly turn
    travel_slip_std: Any  #: its standard deviation
    slip_ratio: np.ndarray  #: (driven,) of each wheel, slip speed over the rims' travel speed; likewise nan
    slip_ratio_std: np.ndarray  #: its standard deviation
    force_N: np.ndarray  #: (driven,) of the ground
    floor_probability: np.ndarray  #: (wheels, floors), floors as in `Recognition.names`
    crossing: Any  #: 1 if a wheel has moved to another floor, else 0
    #: drag over the weight, before the last change and now
    drag_before: Any
    drag_after: Any
    #: (wheels,) mean time until a crossing of each wheel is detected at the present motion; inf while none is tested
    #: for, and for a wheel whose floor hardly affects the forces
    crossing_delay_s: np.ndarray
    flags: Any  #: sum of `FloorFlag` values; 0 is a sample without incident


class FloorFlag(SampleFlag):
    """Events at a sample. None of them stops the estimator."""

    BAD_TIME = 1  # dt_s is not a number, negative or longer than an hour: taken as 0
    GAP = 2  # half a second without a sample: floors may have changed
    NO_CURRENT = 4  # of at least one motor: its force continues as a random walk
    NO_ENCODER = 8  # of at least one driven wheel: its speed continues as a random walk
    ENCODER_STOPPED = 16  # one repeats a number to the last bit while others move: not used until it moves again
    MOTION_UNKNOWN = 32  # the wheels hardly turn, or their motion is uncertain: no slip ratio, no floor recognised
    RESTARTED = 64  # in Python: the state was no longer a number, a new one was started from this sample
    SPEED_REFUSED = 128  # an outside speed that no slip of these wheels explains, or older than a second


#: A longer step is a gap [s].
GAP_S = 0.5

#: Largest force over load of the curves, more than any floor gives, and the spacing of their points.
MOST_MU, SPACING = 2.0, 0.01
#: Functions of the expansion.
MODES = 5


@dataclass(frozen=True)
class SlipCurves:
    """The curves of a floor: means over its friction and stiffness, because the law is nonlinear over both."""

    floor: Floor

    @cached_property
    def values(self) -> np.ndarray:
        """Mean, variance, and the functions of the expansion, (2 + MODES, points)."""
        slip, weights = slips_of_floors(self.floor, np.arange(0.0, MOST_MU + SPACING / 2, SPACING))
        mean = (weights * slip).sum(axis=0)
        off = np.sqrt(weights) * (slip - mean)
        cov = off.T @ off
        size, functions = np.linalg.eigh(cov)
        strongest = functions[:, : -MODES - 1 : -1] * np.sqrt(np.maximum(size[: -MODES - 1 : -1], 0.0))
        return np.vstack([mean, np.diag(cov), strongest.T])

    def belief(self, force_share: np.ndarray, force_std: np.ndarray, scale: SlipScale = AS_LEARNT) -> SlipBelief:
        """The slip of n wheels; force_share, force_std: (n,) traction over load, and its standard deviation."""
        mean = np.array([self.mean(share) for share in force_share])
        modes = np.array([self.modes(share) for share in force_share])
        cov = modes @ modes.T
        for i, (share, share_std) in enumerate(zip(force_share, force_std, strict=True)):
            by_force = (self.mean(share + share_std) - self.mean(share - share_std)) / 2
            cov[i, i] = self.variance(share) + by_force * by_force
        return scaled(SlipBelief(mean, cov), scale, self.floor)

    def mean(self, force_share: Any) -> Any:
        """Mean slip ratio of a wheel at a force over its load."""
        sign, size = direction_and_size(force_share)
        return sign * self._at(0, size)

    def variance(self, force_share: Any) -> Any:
        """Variance of the slip ratio over the possible versions of this floor."""
        _, size = direction_and_size(force_share)
        return self._at(1, size)

    def modes(self, force_share: Any) -> np.ndarray:
        """Functions (MODES,) of the expansion."""
        sign, size = direction_and_size(force_share)
        return np.array([sign * self._at(2 + k, size) for k in range(MODES)])

    def _at(self, row: int, size: Any) -> Any:
        return table(self.values[row], 0.0, SPACING, minimum(size, MOST_MU))


#: Speed [m/s] below which no slip ratio is given and no floor is recognised, and the standard deviation of the rims'
#: motion, as a share of it, above which neither is.
SLOWEST_M_S, UNSURE_SHARE = REPORT_FLOOR, 0.5
#: Time constant [s] of each of the two low-pass filters that give the rims' acceleration.
RATE_S = 0.075
#: The slip is the mean over the floors, weighted by this power of their probability: between the mean (1), which a
#: floor of probability 0.1 moves by a tenth of a large difference, and the most probable floor, which jumps.
LEANING = 2.0
_ALMOST_NOTHING = 1e-6


class FloorState(NamedTuple):
    """State from sample to sample: plain numbers."""

    wheels: WheelState  #: of the filter
    slow_rim: np.ndarray  #: (2, freedoms) motion of the rims after one and two first-order low-pass filters
    recognised: RecognitionState  #: belief in the floors
    crossing: CrossingState  #: of the test
    encoders: EncoderWatch  #: values that they repeat
    loss: LossState  #: of the forward motion, as outside speeds have shown it since the last event


class FloorRun(Run[FloorEstimate]):
    """Slip and floors along a log of T samples: every field of `FloorEstimate` with time as first axis."""

    flag_type = FloorFlag

    @property
    def crossings(self) -> list[Crossing]:
        """Changes to another floor under a wheel."""
        e = self.estimates
        rows = np.flatnonzero(e.crossing)
        return [Crossing(float(self.time_s[k]), float(e.drag_before[k]), float(e.drag_after[k])) for k in rows]


@dataclass(frozen=True, eq=False)
class SlipOnFloors:
    """Settings: a filter of the wheels, and the floors that the robot may meet; `init` and `step` are pure."""

    recognition: Recognition  #: robot and floors
    wheels: WheelFilter  #: the filter; its robot must be the same
    crossing: CrossingTest  #: the test for other floors

    def __post_init__(self) -> None:
        if self.wheels.robot != self.recognition.robot:
            raise InputError("wheels.robot and recognition.robot must be the same robot")

    def no_sample(self) -> RobotSample:
        """A sample without any measurement, to be filled with `_replace`."""
        return no_sample(self.wheels.robot)

    def init(self, first: RobotSample) -> FloorState:
        """State before the first sample, with the rim speeds of its encoders."""
        robot = self.wheels.robot
        wheels = self.wheels.init(sanitize(first, GAP_S))
        rim = wheels.belief.mean[: robot.freedoms]
        slow_rim, encoders = np.array([rim, rim]), watch_encoders(robot)
        return FloorState(wheels, slow_rim, self.recognition.init(), self.crossing.init(robot), encoders, LossState())

    def step(self, state: FloorState, sample: RobotSample) -> tuple[FloorState, FloorEstimate]:
        """State and estimate after a sample."""
        robot = self.wheels.robot
        seen_now = sanitize(sample, GAP_S)
        clean, watch = without_stopped(seen_now, state.encoders, robot)
        wheels, belief = self.wheels.step(state.wheels, clean)
        noise_N, belief = belief.force_std_N, with_friction(robot, belief)
        slow_rim, rate = low_pass(state.slow_rim, belief.rim, clean.dt_s)
        moving = knows_motion(belief)
        drag_N = belief.force_N - inertial_forces(robot, rate)
        tested = self.crossing.sample(robot, belief.rim, drag_N, moving, clean.dt_s)
        crossing, result = self.crossing.step(state.crossing, tested)
        forces = FloorForces(belief.rim, drag_N, noise_N, standing_friction(robot, belief))
        slips = self.slips(belief)
        outside = loss_sample(clean, belief.rim, belief.rim_std, rate, maximum(travel_speed(belief.rim), SLOWEST_M_S))
        unsettled = some([result.alarm, result.restart, logical_not(moving)])
        loss = averaged(state.loss, outside, unsettled, clean.dt_s)
        by_outside_speed = log_likelihood(seen(loss), self.recognition.combinations, slips, robot.motion_by_rims[0])
        recognised = self.recognition.step(
            state.recognised, forces, result.alarm, result.restart, clean.dt_s, by_outside_speed
        )
        recognised = choose(moving, recognised, state.recognised)  # forces of standing wheels are no evidence
        probability = self.recognition.by_wheel(recognised.combinations)
        slip = corrected(self.mixture(slips, probability), seen(loss), robot.motion_by_rims[0])
        estimate = self.conclude(belief, slip, probability, moving)._replace(
            crossing=where(result.alarm, 1.0, 0.0),
            drag_before=drag_share(robot, belief.rim, state.crossing.mean * mean_load(robot)),
            drag_after=drag_share(robot, belief.rim, drag_N),
            crossing_delay_s=result.delay_s,
            flags=flags_of({
                FloorFlag.BAD_TIME: logical_not(clean.time_credible),
                FloorFlag.GAP: clean.gap,
                FloorFlag.NO_CURRENT: logical_not(every(clean.current_measured)),
                FloorFlag.NO_ENCODER: logical_not(every(seen_now.wheel_measured[: robot.driven])),
                FloorFlag.ENCODER_STOPPED: some(watch.stopped),
                FloorFlag.MOTION_UNKNOWN: logical_not(moving),
                FloorFlag.SPEED_REFUSED: every([moving, outside.refused]),
            }),
        )  # fmt: skip
        return FloorState(wheels, slow_rim, recognised, crossing, watch, loss), estimate

    @cached_property
    def kernel(self) -> Kernel:
        """The step, compiled."""
        return self.compiled()

    def compiled(self, lowering: str | None = None) -> Kernel:
        """The step, compiled; `lowering` as in `ohmward.trace.Kernel`."""
        sample = self.no_sample()
        return Kernel(self.step, self.init(sample), sample, lowering=lowering)

    def run(self, log: DriveSource) -> FloorRun:
        """Slip and floors along a log.

        Raises:
            InputError: a driven wheel without encoder or motor current.
        """
        began = time.perf_counter()
        log = as_drive(log, self.wheels.robot)
        samples = floor_samples(log, self.wheels.robot)
        _, estimates = self.kernel.scan(self.init(first_of(samples)), samples)
        return FloorRun(log.time_s, estimates, time.perf_counter() - began)

    def slips(self, belief: WheelBelief) -> list[SlipBelief]:
        """Belief in the slip of the driven wheels on each of all floors, from their forces."""
        robot = self.wheels.robot
        load_N = static_loads(robot)[: robot.driven]
        share, share_std = belief.force_N / load_N, belief.force_std_N / load_N
        along, across = (v[: robot.driven] for v in wheel_motion(robot, belief.rim))
        u = travel_speed(belief.rim)
        return [curves.belief(share, share_std, slip_scale(curves.floor, along, across, u)) for curves in self.curves]

    def conclude(
        self, belief: WheelBelief, slips: SlipBelief, probability: np.ndarray, moving: Scalar
    ) -> FloorEstimate:
        """Slip and speed of the body, with u = |w| the travel speed of the rims and B = G_d^+.

        v = w - u B lambda,    var v_i = u^2 B_i C B_i' + var w_i
        |v| / u has the variance a C a' + |B lambda|^2 var u / u^2,   a = v' B / |v|, C the covariance of lambda

        belief: of the wheels.
        slips: of the driven wheels.
        probability: (wheels, floors).
        moving: the condition that the motion of the rims is known.
        """
        robot, B = self.wheels.robot, self.wheels.robot.motion_by_rims
        slip, C = slips
        u, var_u = travel_speed(belief.rim), travel_variance(belief)
        loss = B @ slip
        v = belief.rim - u * loss
        speed = travel_speed(v)
        a = v[:-1] / maximum(speed, _ALMOST_NOTHING) @ B[:-1]
        turned = (loss[:-1] @ loss[:-1]) * var_u / maximum(u * u, _ALMOST_NOTHING)
        ratio_std = std(a @ C @ a + turned)
        rows = zip(B, belief.rim_std, strict=True)
        return FloorEstimate(
            rim=belief.rim,
            motion=v,
            motion_std=np.array([sqrt(u**2 * (row @ C @ row) + rim_std**2) for row, rim_std in rows]),
            speed_m_s=speed,
            speed_std_m_s=sqrt(u**2 * ratio_std**2 + var_u),
            travel_slip=where(moving, 1.0 - speed / maximum(u, SLOWEST_M_S), math.nan),
            travel_slip_std=where(moving, ratio_std, math.nan),
            slip_ratio=where(moving, slip, math.nan),
            slip_ratio_std=where(moving, sqrt(np.diag(C)), math.nan),
            force_N=belief.force_N,
            floor_probability=self.recognition.by_name(probability),
            crossing=0.0,
            drag_before=0.0,
            drag_after=0.0,
            crossing_delay_s=np.zeros(len(robot.places)),
            flags=0.0,
        )

    def mixture(self, slips: Sequence[SlipBelief], probability: np.ndarray) -> SlipBelief:
        """Belief in the slip of the driven wheels over the floors.

        m_i = sum_f p_fi m_fi,   C_ii = sum_f p_fi (C_fii + (m_fi - m_i)^2),   C_ij = sum_f p_fi p_fj C_fij

        slips: on each of all floors.
        probability: p (wheels, floors).
        """
        driven = self.wheels.robot.driven
        floors = list(zip(probability[:driven].T, slips, strict=True))
        weight = probability[:driven] ** LEANING
        mean = sum(w * slip.mean for w, slip in zip((weight.T / weight.sum(axis=1)), slips, strict=True))
        variance = sum(p * (np.diag(slip.cov) + (slip.mean - mean) ** 2) for p, slip in floors)
        common = sum(np.outer(p, p) * slip.cov for p, slip in floors)
        return SlipBelief(mean, np.where(np.eye(driven, dtype=bool), np.diag(variance), common))

    @cached_property
    def curves(self) -> tuple[SlipCurves, ...]:
        """Slip curves of each of all floors."""
        return tuple(SlipCurves(floor) for floor in self.recognition.all_floors)


def slip_on_floors(
    robot: Robot, floors: Sequence[Floor] = (), method: str = "ukf", known_only: bool = False
) -> SlipOnFloors:
    """The estimator of a calibrated robot that has learnt these floors.

    method: as in `wheel_filter.METHODS`.
    known_only: the robot drives on these floors only.
    """
    return SlipOnFloors(
        Recognition(robot, tuple(floors), known_only), WheelFilter(robot, method), crossing_test(floors)
    )


def with_friction(robot: Robot, belief: WheelBelief) -> WheelBelief:
    """The belief with the forces that the friction of standing motors may hold."""
    return belief._replace(force_std_N=sqrt(belief.force_std_N**2 + standing_friction(robot, belief) ** 2))


def standing_friction(robot: Robot, belief: WheelBelief) -> np.ndarray:
    """Standard deviation (driven,) [N] of the forces that the friction of standing motors may hold."""
    return undetermined_force_std(robot, robot.rolling[: robot.driven] @ belief.rim / robot.wheel.radius_m)


def low_pass(slow_rim: np.ndarray, rim: np.ndarray, dt_s: Scalar) -> tuple[np.ndarray, np.ndarray]:
    """The rims' motion (2, freedoms) after one and two first-order low-pass filters, and its rate (freedoms,)."""
    share = 1.0 - exp(-dt_s / RATE_S)
    once = slow_rim[0] + share * (rim - slow_rim[0])
    behind = once - slow_rim[1]
    rate = behind * where(dt_s > _ALMOST_NOTHING, share / maximum(dt_s, _ALMOST_NOTHING), 1.0 / RATE_S)
    return np.array([once, slow_rim[1] + share * behind]), rate


def knows_motion(belief: WheelBelief) -> Scalar:
    """True where the rims turn and their motion is known."""
    travel = travel_speed(belief.rim)
    return (travel >= SLOWEST_M_S) & (travel_variance(belief) <= (UNSURE_SHARE * travel) ** 2)


def travel_variance(belief: WheelBelief) -> Scalar:
    """Variance [m^2/s^2] of the rims' travel speed in any direction."""
    return belief.rim_std[:-1] @ belief.rim_std[:-1]


def floor_samples(log: DriveLog, robot: Robot, before_s: float = math.nan) -> RobotSample:
    """`samples_of` a log that has the encoder and the motor current of every driven wheel.

    Raises:
        InputError: a driven wheel without encoder or motor current.
    """
    for name, values in (("encoder", log.wheel_speed_rad_s[:, : robot.driven]), ("motor current", log.motor_current_A)):
        if values.shape[1] != robot.driven or not np.isfinite(values).any(axis=0).all():
            raise InputError(f"log {log.name!r}: slip on floors needs the {name} of every driven wheel; one has none")
    return samples_of(log, robot, before_s)


#: With more combinations of floors than an omni robot has with five, the step is not compiled to machine code by
#: default: it would take half a minute.
MOST_COMPILED = 221


class FloorSlipEstimator(LiveEstimator[RobotSample, FloorEstimate]):
    """Slip on floors, live or from logs, in machine code where it is installed.

    >>> estimator = FloorSlipEstimator(slip_on_floors(robot, load_floors("floors.toml").floor))    # doctest: +SKIP
    >>> estimator.update(0.0, [-2.1, 0.0, 2.1], [-1.0, 0.1, 1.1]).travel_slip                      # doctest: +SKIP
    0.214

    The first sample waits for the compilation, some seconds; later starts find it in the cache.

    Args:
        floors: settings from `slip_on_floors`.
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
        """Estimate after one live sample. A bad sample is flagged, see `FloorFlag`; None and nan mean missing.

        time_s: of the sample. A late one (before the previous sample's time) is used without a step in time; if it is
            early by more than a minute, or the fifth late one in a row, the clock was set, and time continues from
            there.
        wheel_speed_rad_s, current_A: (driven,) of each driven wheel and its motor.
        speed_m_s, speed_std_m_s, speed_age_s: outside speed, forward, where there is one; 0.05 m/s and 0 s unless
            given. The slip that it shows distinguishes floors that need similar forces, and narrows the band.

        Raises:
            InputError: a value is not a number, or there is not one for each driven wheel.
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
        """Slip and floors along a log, continuing from the current state; a new estimator starts with the log.

        progress: called now and then with (steps done, T).

        Raises:
            InputError: a driven wheel without encoder or motor current.
        """
        log = as_drive(log, self.floors.wheels.robot)
        samples = floor_samples(log, self.floors.wheels.robot, self.time_s)
        return FloorRun(log.time_s, *self._scan(samples, first_of(samples), float(log.time_s[-1]), progress))

    def __repr__(self) -> str:
        names = ", ".join(self.floors.recognition.names)
        e = self.last
        now = f", speed {e.speed_m_s:z.3f} ± {BAND_95 * e.speed_std_m_s:.3f} m/s" if e else ""
        return f"FloorSlipEstimator({self.floors.wheels.robot.name} on {names}{now})"
