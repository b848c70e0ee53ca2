"""Limits of a robot that an operator drives."""

from __future__ import annotations

from dataclasses import dataclass

from ohmward.checks import require_between, require_each_positive

#: A robot stops within this time [s] of any fault; timeouts are shorter by a step of the loop and a frame on the bus.
SAFE_STOP_S = 0.1


@dataclass(frozen=True)
class DriveLimits:
    """Limits that no operator can exceed."""

    #: largest set-points, > 0
    speed_m_s: float = 0.5
    yaw_rate_rad_s: float = 1.0
    acceleration_m_s2: float = 0.5  #: of the ramps, > 0
    #: of each driven wheel, > 0
    torque_Nm: float = 5.0
    torque_rate_Nm_per_s: float = 500.0
    slip: float = 0.3  #: largest slip ratio, as a bound and as a set-point, in [0.001, 0.999]
    friction: float = 0.5  #: that the law assumes, with an error of up to as much, > 0
    #: age of the last estimate and of the operator's last word that stop the robot; up to 0.08 s it stops within 0.1 s.
    #: Longer ones, for slow sensors and radios, let it drive on for as long.
    estimate_timeout_s: float = 0.08
    operator_timeout_s: float = 0.08

    def __post_init__(self) -> None:
        require_each_positive("limits.", self, "speed_m_s", "yaw_rate_rad_s", "acceleration_m_s2", "friction")
        require_each_positive("limits.", self, "torque_Nm", "torque_rate_Nm_per_s")
        require_between("limits.slip", self.slip, 0.001, 0.999)
        require_between("limits.estimate_timeout_s", self.estimate_timeout_s, 0.01, 1.0)
        require_between("limits.operator_timeout_s", self.operator_timeout_s, 0.04, 1.0)
