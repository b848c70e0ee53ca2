"""Noise of the odometry: errors that last, errors that are correlated over seconds, and white ones."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from ohmward.checks import require_between, require_length, require_positive
from ohmward.traction.robot.chassis import SkidSteer
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.make_observer import RADIUS_STD
from ohmward.traction.terrain.floor import ROLLING, STIFFNESS


@dataclass(frozen=True)
class OdometryNoise:
    """Standard deviations, all >= 0; shares and scales are relative.

    The first group are errors that last, the second change within `correlation_s`, the third are white.
    """

    gyro_offset_std_rad_s: float = 0.02  #: of a gyro at rest; 1 degree a second is a usual data sheet
    gyro_scale_std: float = 0.01  #: of its sensitivity; 1 % is a usual data sheet
    #: of the effective radius of all wheels: half a millimetre of a radius of 120, and half of the creep of wheels that
    #: drive; 0.003 and less where it was calibrated on the ground that the robot drives on
    radius_std: float = 0.006
    turn_scale_std: float = 0.01  #: of the yaw rate that the wheels show: of the effective track
    #: of a wheel's radius about the mean of all; 0.06 % is 0.1 mm of a diameter of 160
    wheel_difference_std: float = 0.0006
    #: slip ratio of the driven wheels of a robot that keeps its speed; 0 where its radius contains it, because it was
    #: calibrated by driving
    creep: float = 0.0
    #: of the offset [rad/s over the root of a second]; a fifth of a degree a second in an hour, as it warms up
    gyro_offset_walk: float = 6e-5
    slip_share: float = 0.005  #: slip of the wheels over their speed, where no observer tells it
    slip_difference_share: float = 3e-4  #: slip of one wheel beyond that of the others, over their speed
    turn_share: float = 0.06  #: error of the yaw rate that the wheels show, over it, by their slip in turns
    gyro_delay_std_s: float = 0.05  #: of the gyro after the wheels, by its filter and its way to the computer
    #: time by which the wheels show a turn before the robot makes it, by the slip that turns it: I B^2 v / (k N), for
    #: [T]'s robot 0.04 s at 0.6 m/s on a hard floor
    wheels_ahead_std_s: float = 0.05
    side_slip_share: float = 0.003  #: sideways speed over the speed
    #: sideways speed over the yaw rate, by a centre of rotation beside that of the robot file [m]
    side_arm_std_m: float = 0.005
    correlation_s: float = 2.0  #: time constant of these [s], > 0
    turn_correlation_s: float = 10.0  #: that of the errors of the yaw rate [s], > 0
    #: angle random walk of the gyro [rad over the root of a second]; that of MEMS gyros is 0.2 to 1 degree over the
    #: root of an hour
    gyro_walk: float = 3e-4
    encoder_std_rad: float = 6e-4  #: of the angle of a wheel between two instants: 4096 counts a turn have 6e-4 rad
    speed_std_m_s: float = 0.05  #: of an external speed without a standard deviation of its own
    heading_std_rad: float = 0.05  #: of a heading without one; that of a compass away from iron is 2 to 5 degrees
    #: of a pose increment without one [m, m, rad, over the root of a second]
    increment_walk: tuple[float, float, float] = (0.02, 0.02, 0.005)

    def __post_init__(self) -> None:
        for field in fields(self):
            require_between(f"noise.{field.name}", getattr(self, field.name), 0.0, float("inf"))
        require_positive("noise.correlation_s", self.correlation_s)
        require_positive("noise.turn_correlation_s", self.turn_correlation_s)
        require_length("noise.increment_walk", self.increment_walk, 3, "forward, left, turn")


#: A skid-steered robot drags its wheels sideways: its effective track is 1.3 to 2 times the real one, by ground and
#: load, and its centre of rotation wanders between the axles.
SCRUBBING = OdometryNoise(
    radius_std=RADIUS_STD, turn_scale_std=0.3, slip_share=0.01, turn_share=0.1, side_arm_std_m=0.1, side_slip_share=0.02
)


def noise_of(robot: Robot) -> OdometryNoise:
    """Noise of a robot of which only the file is known."""
    noise = SCRUBBING if isinstance(robot.chassis, SkidSteer) else OdometryNoise()
    return replace(noise, creep=rolling_creep(robot))


def rolling_creep(robot: Robot) -> float:
    """Slip ratio at which the driven wheels of a robot overcome the rolling resistance of all its wheels.

    lambda = rho sum_all(N) / (C sum_driven(N)), with the medians of floors for the resistance rho over load and for the
    stiffness C of the tyre: 0.0075 where half of the weight is on driven wheels.
    """
    return ROLLING / STIFFNESS / float(robot.loads[: robot.driven, 0].sum())
