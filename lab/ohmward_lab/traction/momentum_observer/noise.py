"""Noise of the sensors and of the momentum balance, on which the sigmas of the observer rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ohmward.checks import require_positive
from ohmward.traction.speed_observer.noise import require_stds

_OPTIONAL = ("edge_std_counts", "passive_std_rad", "accelerometer_std_m_s2", "gyro_std_rad_s", "speed_std_m_s")


@dataclass(frozen=True)
class MomentumNoise:
    """Standard deviations of sensors for one sample, and random walks over the root of a second.

    A sensor with None does not exist: nothing is compiled for it.
    """

    encoder_std_rad: float  #: of the angle of a driven wheel; `count_std_rad`
    #: of the position of an edge, as a share of a count; None where the time of edges is not captured
    edge_std_counts: float | None = None
    torque_std_Nm: float = 0.05  #: of the torque at a wheel
    passive_std_rad: float | None = None  #: of the angle of a wheel that is not driven
    accelerometer_std_m_s2: float | None = None  #: of an accelerometer along x; offset and slope are learnt at rest
    gyro_std_rad_s: float | None = None  #: of a yaw gyro, offset included
    speed_std_m_s: float | None = None  #: of an external speed
    #: of the ground's force while the torque does not change: in N, and as a share of the force, which loads and ground
    #: make
    force_walk_N: float = 1.0
    force_walk_share: float = 0.1
    mass_std: float = 0.2  #: share of the mass that may be payload, or missing
    accelerometer_gain_std: float = 0.01  #: share by which the accelerometer shows too much
    #: m/s^2 that it shows for each N m of the motors, by which the body tilts on its tyres
    accelerometer_tilt_std: float = 0.001
    passive_radius_std: float = 0.003  #: share of the radius of the wheels that are not driven
    #: speed by which these wheels lag behind the robot
    passive_creep_std_m_s: float = 0.004
    passive_creep_walk: float = 0.008
    #: of unknown accelerations [m/s, rad/s]
    speed_walk: float = 0.001
    yaw_rate_walk: float = 3.0
    #: of the unmodelled acceleration: 0.17 m/s^2 for each degree of unknown slope and 0.1 m/s^2 for a rolling
    #: resistance that is unknown by 1 % of the weight. Where no pitch is measured, a slope of `slope_std_rad` comes on
    #: top.
    disturbance_std_m_s2: float = 0.17
    disturbance_walk: float = 0.1
    slope_std_rad: float = 0.05  #: of the ground where no pitch is measured
    #: before the first rest, and after it
    accelerometer_offset_std_m_s2: float = 0.5
    accelerometer_offset_walk: float = 0.002
    standstill_std_m_s: float = 0.001  #: of the zero speed of a robot at rest

    def __post_init__(self) -> None:
        stds = {field.name: getattr(self, field.name) for field in fields(self)}
        require_stds("momentum_noise", stds, _OPTIONAL)


def count_std_rad(counts_per_turn: float) -> float:
    """Standard deviation [rad] of an angle that is known to within a count: the count over the root of 12."""
    require_positive("counts_per_turn", counts_per_turn)
    return 2 * math.pi / counts_per_turn / math.sqrt(12)
