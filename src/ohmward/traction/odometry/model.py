"""Dead reckoning with the errors of its sensors as states.

    v = c v_r (1 + k) + sigma_v z_v,   l = l_r (1 + k) + sigma_l z_l
    w_s = w_g - b with a gyro, else w_w = (w_r + q v_r) (1 + k_w) + sigma_w z_w,   w = w_s (1 + k_g)
    x+ = x + dt (v cos m - l sin m),   y+ = y + dt (v sin m + l cos m),   m = yaw + w (t_g + dt/2),   yaw+ = yaw + w dt
    d+ = d + dt (w_w - (w_g - b))

The yaw is the gyro's, which is t_g late. d is the angle by which the wheels have turned more than the gyro shows.
Counts measure angles to within a fraction of a count, however far the wheels have turned: d stays that close to (t_g +
t_w) w, where wheels slip t_w ahead to begin a turn. d is in gyro units, and the gyro's scale k_g enters only in the
pose: with (w_g - b)(1 + k_g) the noise of a gyro at rest would be likelier for a smaller scale, and the filter would
learn that. So k_w contains the errors of the track and of the gyro's scale, and its correction is shared between them.
Wheels that scrub turn the robot less by all that they show, so k_w multiplies the curvature q from unequal ones too.

A compass measures yaw + h, where h, its heading at yaw 0, is constant. Pose increments show 1 + s of the way.
An outside speed shows 1 + c_s of the speed, and has an error that lasts, sigma z as those of the wheels, so that two
sources that disagree for long share the correction.

v_r, l_r, w_r is the motion of the wheels' rims, or of a speed observer; w_g is the gyro's yaw rate. The scales k, k_g,
k_w, the curvature q from unequal wheels and the offset b are persistent. Slip is correlated over seconds: z is a
Gauss-Markov process of unit variance, scaled by the current standard deviation. So the position error grows with the
root of time, and faster than with errors that are independent at every sample. `OdometryNoise` holds persistent errors,
those correlated over seconds, and white ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_length, require_positive
from ohmward.filters.belief import Belief
from ohmward.filters.linear_algebra import std
from ohmward.trace import Scalar, clip, cos, exp, maximum, sin, sqrt, where
from ohmward.traction.motion.outside_speed import USUAL_STD_M_S
from ohmward.traction.robot.chassis import Mecanum, SkidSteer, Steered
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.floor import ROLLING, STIFFNESS


@dataclass(frozen=True)
class OdometryNoise:
    """Standard deviations, all >= 0; shares and scales are relative.

    The first group are persistent errors, the second change within `correlation_s`, the third are white.
    """

    gyro_offset_std_rad_s: float = 0.02  #: of a gyro at rest; data sheets usually give 1 degree per second
    gyro_scale_std: float = 0.01  #: of its sensitivity; data sheets usually give 1 %
    #: of the effective radius of all wheels: half a millimetre in 120 mm, and half of the creep of driven wheels; 0.003
    #: or less if it was calibrated on the ground that the robot drives on
    radius_std: float = 0.006
    #: of the effective track, by where wide tyres touch the ground and by slip that is the same in every turn; 0.01 or
    #: less if it was calibrated by turning
    turn_scale_std: float = 0.03
    #: of a wheel's radius about the mean of all; 0.06 % is 0.1 mm in a diameter of 160 mm
    wheel_difference_std: float = 0.0006
    #: slip ratio of the driven wheels at constant speed; 0 if the radius contains it, because it was calibrated by
    #: driving
    creep: float = 0.0
    #: share by which the robot turns less than its wheels show, as these scrub: 1 less the track over the effective one
    scrub: float = 0.0
    #: random walk of the offset [rad/s per root of a second]: two thirds of a degree per second in an hour; a drive
    #: shows whether it is 0.3 to 15 times that, as in a gyro that warms up
    gyro_offset_walk: float = 2e-4
    slip_share: float = 0.005  #: slip of the wheels over their speed, if no observer estimates it
    slip_difference_share: float = 3e-4  #: slip of one wheel beyond that of the others, over their speed
    turn_share: float = 0.06  #: relative error of the wheels' yaw rate, by slip in turns
    gyro_delay_std_s: float = 0.1  #: of the gyro's delay behind the wheels, by its filter and transmission
    #: of the time by which the wheels turn before the robot does, by the slip that turns it: I B^2 v / (k N), for [T]'s
    #: robot 0.04 s at 0.6 m/s on a hard floor
    wheels_ahead_std_s: float = 0.1
    side_slip_share: float = 0.003  #: sideways speed over the speed
    #: sideways speed over the yaw rate [m], by a centre of rotation away from that of the robot file
    side_arm_std_m: float = 0.005
    #: share of the sideways speed that rollers at 45 degrees lose or gain: it lasts, as rollers and floor do
    roller_slip_std: float = 0.0
    forward_arm_std_m: float = 0.0  #: forward speed over the yaw rate that the wheels show [m], likewise
    correlation_s: float = 2.0  #: time constant of the slip errors [s], > 0
    turn_correlation_s: float = 10.0  #: time constant of the yaw rate errors [s], > 0
    #: angle random walk of the gyro [rad per root of a second]; MEMS gyros have 0.2 to 1 degree per root of an hour
    gyro_walk: float = 3e-4
    encoder_std_rad: float = 6e-4  #: of the angle of a wheel between two instants: 6e-4 rad for 4096 counts per turn
    speed_std_m_s: float = USUAL_STD_M_S  #: of an outside speed without one, until its errors have shown it
    #: relative error of an outside speed that lasts, beside one as large as its noise, and its time constant [s], > 0
    speed_share: float = 0.03
    speed_correlation_s: float = 30.0
    #: of the scale of outside speeds; one that proves larger, as a camera's by its baseline, is taken for that
    speed_scale_std: float = 0.02
    heading_std_rad: float = 0.05  #: of a heading without one; a compass away from iron has 2 to 5 degrees
    #: of a pose increment without one [m, m, rad, per root of a second]
    increment_walk: tuple[float, float, float] = (0.02, 0.02, 0.005)
    #: of the length of pose increments: cameras know their baseline to some per cent, and a lidar in a long corridor
    #: shows too little of the way
    increment_scale_std: float = 0.03

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name != "scrub":
                require_between(f"noise.{field.name}", getattr(self, field.name), 0.0, float("inf"))
        require_between("noise.scrub", self.scrub, -1.0, 1.0)
        require_positive("noise.correlation_s", self.correlation_s)
        require_positive("noise.turn_correlation_s", self.turn_correlation_s)
        require_positive("noise.speed_correlation_s", self.speed_correlation_s)
        require_length("noise.increment_walk", self.increment_walk, 3, "forward, left, turn")


#: Standard deviation of an effective radius measured with a ruler (relative).
RADIUS_STD = 0.01

#: A skid-steered robot drags its wheels sideways: its effective track is 1.2 to 2 times the real one, depending on
#: ground and load (a Husky and a Warthog turn by 0.50 to 0.69 of what their wheels show on five floors, on snow by
#: 0.09), and its centre of rotation moves between the axles and the sides. A Warthog's turn differs from its
#: wheels' by 8 % over 1.5 s, and by more while the turn begins; its speed by 9 %, and in turns by 0.1 m times the rate.
SCRUBBING = OdometryNoise(
    radius_std=RADIUS_STD,
    turn_scale_std=0.2,
    scrub=1.0 / 3.0,
    slip_share=0.1,
    turn_share=0.2,
    side_arm_std_m=0.1,
    forward_arm_std_m=0.1,
    side_slip_share=0.02,
)


#: Standard deviation of the share by which a robot on mecanum wheels moves sideways by more or less than these show, as
#: its rollers slip, an assumption without data of our own; and time [s] for which that lasts.
ROLLER_SLIP_STD, ROLLER_SLIP_LASTS_S = 0.07, 100.0

#: Standard deviation of the share by which a robot of known effective track scrubs: it was found on one floor.
KNOWN_SCRUB_STD = 0.1

#: Error of a steering angle [rad] that lasts, by a servo's or a potentiometer's zero, and one that changes, by play;
#: relative error of its scale, with that of the linkage.
STEERING_ZERO_RAD, STEERING_PLAY_RAD, STEERING_SCALE_STD = 0.015, 0.005, 0.05


def noise_of(robot: Robot) -> OdometryNoise:
    """Default noise of a robot, from its file alone."""
    chassis, noise = robot.chassis, OdometryNoise()
    if isinstance(chassis, SkidSteer):
        noise = SCRUBBING
        if chassis.effective_track_m is not None:
            scrub = 1.0 - chassis.track_m / chassis.effective_track_m
            noise = replace(noise, scrub=scrub, turn_scale_std=KNOWN_SCRUB_STD)
    elif isinstance(chassis, Mecanum):
        noise = replace(noise, roller_slip_std=ROLLER_SLIP_STD)
    elif isinstance(chassis, Steered):
        # An error of the steering angle changes the speeds of the rear wheels as unequal radii do.
        apart_per_rad = chassis.track_m / chassis.wheelbase_m / math.sqrt(2.0)
        noise = replace(
            noise,
            turn_scale_std=STEERING_SCALE_STD,
            wheel_difference_std=STEERING_ZERO_RAD * apart_per_rad,
            slip_difference_share=STEERING_PLAY_RAD * apart_per_rad,
        )
    return replace(noise, creep=rolling_creep(robot))


def rolling_creep(robot: Robot) -> float:
    """Slip ratio at which the driven wheels of a robot overcome the rolling resistance of all its wheels.

    lambda = rho sum_all(N) / (C sum_driven(N)), with medians over floors for the resistance rho (over load) and the
    tyre's stiffness C: 0.0075 with half of the weight on driven wheels.
    """
    return ROLLING / STIFFNESS / float(robot.loads[: robot.driven, 0].sum())


#: The state, in order.
NAMES = (
    "x_m",
    "y_m",
    "yaw_rad",
    "gyro_offset_rad_s",
    "gyro_scale",
    "radius_scale",
    "turn_scale",
    "curvature_1_m",
    "heading_zero_rad",
    "gyro_delay_s",
    "wheels_ahead_s",
    "increment_scale",
    "speed_scale",
    "turned_apart_rad",
    "slip",
    "side_slip",
    "turn_slip",
    "speed_error",
)
X, Y, YAW, OFFSET, GYRO_SCALE, RADIUS, TURN_SCALE, CURVATURE, HEADING_ZERO = range(9)
DELAY, AHEAD, INCREMENT_SCALE, SPEED_SCALE, APART = range(9, 14)
SLIP, SIDE_SLIP, TURN_SLIP, SPEED_ERROR = range(14, len(NAMES))
#: Gauss-Markov states of unit variance.
CORRELATED = (SLIP, SIDE_SLIP, TURN_SLIP, SPEED_ERROR)

#: Standard deviation [rad] of an unknown heading.
ANY_HEADING_RAD = math.pi / math.sqrt(3.0)

#: Time constant [s] of the wheels' average yaw rate, and multiple of `MotionInput.straight_std_rad_s` below which it
#: may be that of a robot that drives straight on.
USUAL_TURN_S, STRAIGHT_STDS = 0.5, 5.0

#: Standard deviations from which a slip is of another kind, and largest factor on its correlation time then.
GROSS_SLIP, GROSS_LASTS = 5.0, 15.0

#: Acceleration [m/s2, m/s2, rad/s2] that is possible while the motion is unobserved.
UNOBSERVED = np.array([0.5, 0.1, 0.5])


class MotionInput(NamedTuple):
    """Measured motion over a step."""

    dt_s: Scalar  #: step [s]
    motion: np.ndarray  #: (3,) forward, left [m/s] and turning [rad/s], from the wheels or an observer
    way: np.ndarray  #: (3,) displacement over the step [m, m, rad] from these
    #: (3,) standard deviations of its correlated errors; negative where they follow a motion or a turn to the right
    motion_std: np.ndarray
    scale: Scalar  #: share of the radius's standard deviation contained in its speed
    gyro_rad_s: Scalar  #: yaw rate of the gyro
    gyro_variance: Scalar  #: of its angle over time [rad2/s]
    by_gyro: Any  #: the condition that the gyro gives the turn
    comparable: Any  #: the condition that the wheels measure the turn too
    count_rad: Any  #: standard deviation of the wheels' turn, by quantisation
    unobserved_s: np.ndarray  #: (3,) time since each motion was last observed
    usual_turn_rad_s: Any = 0.0  #: yaw rate of the wheels, averaged over the time before the step
    straight_std_rad_s: Any = 0.0  #: of that of a robot that drives straight on, by quantisation and unequal wheels
    #: estimates of k_w, of c_s and of the forward slip before the step
    turn_scale: Any = 0.0
    speed_scale: Any = 0.0
    slip_sigmas: Any = 0.0
    offset_walk: Any = 0.0  #: variance of the gyro's offset over time [rad2/s3]
    wheels_variance: Any = 0.0  #: of the wheels' turn over time, by noise of their speeds [rad2/s]


def first_belief(noise: OdometryNoise, turn_per_slip: float, count_rad: float) -> Belief:
    """Belief at the start of the frame `odom`.

    k_w = k_t - k_g with the error k_t of the track, so that Var k_w = Var k_t + Var k_g and Cov(k_w, k_g) = -Var k_g.

    turn_per_slip: yaw rate over independent slip of the wheels [1/m].
    count_rad: standard deviation of the wheels' turn, by quantisation.
    """
    stds = {
        OFFSET: noise.gyro_offset_std_rad_s,
        GYRO_SCALE: noise.gyro_scale_std,
        RADIUS: noise.radius_std,
        TURN_SCALE: noise.turn_scale_std,
        CURVATURE: noise.wheel_difference_std * turn_per_slip,
        HEADING_ZERO: ANY_HEADING_RAD,
        DELAY: noise.gyro_delay_std_s,
        AHEAD: noise.wheels_ahead_std_s,
        INCREMENT_SCALE: noise.increment_scale_std,
        SPEED_SCALE: noise.speed_scale_std,
        APART: count_rad,
        SLIP: 1.0,
        SIDE_SLIP: 1.0,
        TURN_SLIP: 1.0,
        SPEED_ERROR: 1.0,
    }
    mean, cov = vector({TURN_SCALE: -noise.scrub}), np.diag(vector(stds) ** 2)
    cov[TURN_SCALE, TURN_SCALE] += cov[GYRO_SCALE, GYRO_SCALE]
    cov[TURN_SCALE, GYRO_SCALE] = cov[GYRO_SCALE, TURN_SCALE] = -cov[GYRO_SCALE, GYRO_SCALE]
    return Belief(mean, cov)


def vector(values: Mapping[int, Any]) -> np.ndarray:
    """Vector (n,) with these elements, zero elsewhere."""
    return np.array([values.get(i, 0.0) for i in range(len(NAMES))])


def twist(x: np.ndarray, u: MotionInput) -> np.ndarray:
    """Forward and leftward speed [m/s] and yaw rate [rad/s], (3,), in state x (n,)."""
    by_wheels, by_gyro = moved(x, u, u.motion, 1.0)
    return np.array([*by_wheels[:2], where(u.by_gyro, by_gyro, by_wheels[2]) * (1.0 + x[GYRO_SCALE])])


def moved(x: np.ndarray, u: MotionInput, rims: np.ndarray, time_s: Scalar) -> tuple[np.ndarray, Scalar]:
    """Displacement (3,) forward, left [m] and turn [rad] by the wheels, and turn by the gyro, both in gyro units.

    rims: (3,) displacement by the rims in that time.

    The scale of the wheels' turn multiplies the turn of the step, or the average one while the robot may drive straight
    on: wheels and gyro then differ by quantisation and unequal wheels, and the filter would learn the scale from it.
    """
    scale = 1.0 + u.scale * x[RADIUS]
    forward = rims[0] * scale + u.motion_std[0] * time_s * x[SLIP]
    left = rims[1] * scale + u.motion_std[1] * time_s * x[SIDE_SLIP]
    by_rims = (rims[2] + rims[0] * x[CURVATURE]) * (1.0 + u.turn_scale)
    turned = by_rims + u.motion_std[2] * time_s * x[TURN_SLIP]
    straight = u.by_gyro & (abs(u.usual_turn_rad_s) < STRAIGHT_STDS * u.straight_std_rad_s)
    scaled = where(straight, u.usual_turn_rad_s * time_s, rims[2])
    turn = turned + scaled * (x[TURN_SCALE] - u.turn_scale)
    return np.array([forward, left, turn]), (u.gyro_rad_s - x[OFFSET]) * time_s


def next_state(x: np.ndarray, u: MotionInput, noise: OdometryNoise) -> np.ndarray:
    """State (n,) after the step."""
    (forward, left, by_wheels), by_gyro = moved(x, u, u.way, u.dt_s)
    turn = where(u.by_gyro, by_gyro, by_wheels) * (1.0 + x[GYRO_SCALE])
    middle = yaw_now(x, u) + turn / 2.0
    c, s = cos(middle), sin(middle)
    pose = [x[X] + forward * c - left * s, x[Y] + forward * s + left * c, x[YAW] + turn]
    apart = where(u.comparable, x[APART] + by_wheels - by_gyro, 0.0)
    return np.array([*pose, *x[OFFSET:APART], apart, *(decays(u, noise) * x[SLIP:])])


def yaw_now(x: np.ndarray, u: MotionInput) -> Scalar:
    """Yaw [rad] in state x, including the turn that a late gyro has yet to report."""
    return x[YAW] + where(u.by_gyro, x[DELAY] * (u.gyro_rad_s - x[OFFSET]), 0.0)


def decays(u: MotionInput, noise: OdometryNoise) -> np.ndarray:
    """Decay factors (4,) of the `CORRELATED` errors over the step.

    A slip so large that it is another kind of motion, as of a stuck robot, lasts until a sensor shows its end: its
    correlation time grows with its square.
    """
    sigmas = u.slip_sigmas / GROSS_SLIP
    lasts_s = noise.correlation_s * clip(sigmas * sigmas, 1.0, GROSS_LASTS)
    side_lasts_s = ROLLER_SLIP_LASTS_S if noise.roller_slip_std else noise.correlation_s
    forward, side = exp(-u.dt_s / lasts_s), exp(-u.dt_s / side_lasts_s)
    turn, speed = (exp(-u.dt_s / lasts_s) for lasts_s in (noise.turn_correlation_s, noise.speed_correlation_s))
    return np.array([forward, side, turn, speed])


def process_noise(x: np.ndarray, u: MotionInput, noise: OdometryNoise) -> np.ndarray:
    """Q (n, n) of a step from state x (n,)."""
    decay = decays(u, noise)
    drift = unobserved_variance(u)
    c, s = cos(x[YAW]), sin(x[YAW])
    along, across = drift[0], drift[1]
    by_gyro = where(u.by_gyro, u.gyro_variance * u.dt_s, 0.0)
    turned = drift[2] + by_gyro
    pose = np.array([
        [along * c * c + across * s * s, (along - across) * c * s, 0.0],
        [(along - across) * c * s, along * s * s + across * c * c, 0.0],
        [0.0, 0.0, turned],
    ])  # fmt: skip
    apart = where(u.comparable, by_gyro + u.wheels_variance * u.dt_s, u.count_rad * u.count_rad)
    variances = [u.offset_walk * u.dt_s, *[0.0] * (APART - OFFSET - 1), apart, *(1.0 - decay * decay)]
    Q = np.zeros((len(NAMES), len(NAMES)), dtype=np.result_type(pose, np.asarray(variances)))
    Q[:3, :3] = pose
    Q[range(3, len(NAMES)), range(3, len(NAMES))] = variances
    Q[YAW, APART] = Q[APART, YAW] = where(u.comparable, -by_gyro, 0.0)
    return Q


def unobserved_variance(u: MotionInput) -> np.ndarray:
    """Variance (3,) that unobserved motion adds in the step to the displacement forward and left and to the turn.

    An acceleration a moves the robot by a t^2 / 2, all of it error: Var+ - Var = (a/2)^2 (t+^4
    - t^4).
    """
    before_s = maximum(u.unobserved_s - u.dt_s, 0.0)
    return (UNOBSERVED / 2.0) ** 2 * (u.unobserved_s**4 - before_s**4)


def position_std(cov: np.ndarray) -> Scalar:
    """Largest standard deviation [m] of the position in any direction: the semi-major axis of its 1-sigma ellipse.

    cov: covariance of x, y and whatever follows.
    """
    mean, half = (cov[0, 0] + cov[1, 1]) / 2.0, (cov[0, 0] - cov[1, 1]) / 2.0
    return std(mean + sqrt(half * half + cov[0, 1] * cov[0, 1]))
