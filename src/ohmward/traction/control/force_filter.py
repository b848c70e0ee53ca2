"""Force of the ground and acceleration of the body, from the signals that every drive has.

F_hat = (tau - J domega/dt) / r,   a_hat = dv/dt,   each through a lag of the first order.

An estimator that runs as fast as the controller knows both better: its acceleration is used as it is, its force goes
through the same lag. While a wheel grips, the force of the ground is the torque over the radius; fed back at once it
would sustain any torque once caused by noise.

The lag is implicit in time: e+ = e + dt (raw - e) / (lag + dt). With a difference for the derivative dt cancels, so dt
= 0 is allowed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.checks import require_each_positive
from ohmward.trace import where
from ohmward.traction.control.signals import DrivenWheel, Measurement

#: Larger values [rad/s, m/s, N, m/s^2] are faults, as nan is: no wheel or robot has them.
IMPOSSIBLE_RAD_S = 1e5
IMPOSSIBLE_M_S = 1e3
IMPOSSIBLE_N = 1e7
IMPOSSIBLE_M_S2 = 1e5
#: A longer time [s] between two steps is a fault of the clock.
LONGEST_CONTROL_STEP_S = 60.0
#: Shortest time [s] that rates divide by, for steps of no length.
SHORTEST_CONTROL_STEP_S = 1e-9


class WheelEstimate(NamedTuple):
    """Estimate of a wheel: its last usable speeds, and the force and acceleration that follow from their change."""

    wheel_speed_rad_s: Any  #:  last usable one
    travel_speed_m_s: Any  #:   last usable one, predicted by its age; held while none is usable
    force_N: Any  #:          of the ground along x
    acceleration_m_s2: Any  #: of the wheel's centre
    known: Any  #:            1 where the last measurement was usable, else 0


@dataclass(frozen=True)
class ForceFilter:
    """Lags, and limits of a usable measurement."""

    force_lag_s: float = 0.005  #: of the force, > 0; a few steps of the controller
    acceleration_lag_s: float = 0.05  #: of the acceleration, > 0
    oldest_s: float = 0.1  #: an older travel speed is stale
    largest_std_m_s: float = 0.1  #: a travel speed with a larger standard deviation is not used

    def __post_init__(self) -> None:
        require_each_positive("force_filter.", self, "force_lag_s", "acceleration_lag_s", "oldest_s", "largest_std_m_s")

    def init(self, first: Measurement) -> WheelEstimate:
        """Estimate before the first step: no force and no acceleration; a wheel that is not measured is at rest."""
        usable = self.usable(first)
        zero = where(usable, 0.0, 0.0)
        return WheelEstimate(
            where(usable, first.wheel_speed_rad_s, 0.0),
            where(usable, first.travel_speed_m_s, 0.0),
            zero,
            zero,
            where(usable, 1.0, 0.0),
        )

    def usable(self, m: Measurement) -> Any:
        """True where a controller may act on a measurement."""
        possible = (abs(m.wheel_speed_rad_s) <= IMPOSSIBLE_RAD_S) & (abs(m.travel_speed_m_s) <= IMPOSSIBLE_M_S)
        recent = (m.age_s >= 0.0) & (m.age_s <= self.oldest_s)
        return possible & recent & (m.travel_speed_std_m_s <= self.largest_std_m_s)

    def update(
        self, before: WheelEstimate, torque_Nm: Any, m: Measurement, wheel: DrivenWheel, dt_s: Any
    ) -> WheelEstimate:
        """Estimate after a step under `torque_Nm`; force and acceleration hold across a gap in the measurements."""
        usable = self.usable(m)
        omega = where(usable, m.wheel_speed_rad_s, before.wheel_speed_rad_s)
        v = where(usable, m.travel_speed_m_s + before.acceleration_m_s2 * m.age_s, before.travel_speed_m_s)
        impulse = torque_Nm * dt_s - wheel.inertia_kg_m2 * (omega - before.wheel_speed_rad_s)
        force_change = (impulse / wheel.radius_m - before.force_N * dt_s) / (self.force_lag_s + dt_s)
        speed_change = v - before.travel_speed_m_s - before.acceleration_m_s2 * dt_s
        acceleration_change = speed_change / (self.acceleration_lag_s + dt_s)
        observed_N = before.force_N + (m.force_N - before.force_N) * dt_s / (self.force_lag_s + dt_s)
        continuous = usable & (before.known > 0.5)
        filtered_N = before.force_N + where(continuous, force_change, 0.0)
        filtered_m_s2 = before.acceleration_m_s2 + where(continuous, acceleration_change, 0.0)
        return WheelEstimate(
            omega,
            v,
            where(usable & (abs(m.force_N) <= IMPOSSIBLE_N), observed_N, filtered_N),
            where(usable & (abs(m.acceleration_m_s2) <= IMPOSSIBLE_M_S2), m.acceleration_m_s2, filtered_m_s2),
            where(usable, 1.0, 0.0),
        )


def plausible_step_s(dt_s: Any) -> Any:
    """The time since the previous step [s]; 0, in which nothing changes, if the clock gives an impossible one."""
    return where((dt_s > 0.0) & (dt_s <= LONGEST_CONTROL_STEP_S), dt_s, 0.0)
