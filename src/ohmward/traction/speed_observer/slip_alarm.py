"""Alarms for a wheel that slips and for a robot that is stuck: tests of an estimate against its own sigma.

A wheel slips where |s| - s_allowed > z sigma_s. As long as the sigma is true, a wheel whose slip is just the allowed
one raises the alarm in a share 1 - Phi(z) of the samples, one that slips less in fewer: that is the false-alarm rate.
Samples of one wheel are correlated, so alarms come in bursts: the rate is a share of time, not a count of events.

The robot is immobilised where its wheels turn and its speed, z sigma_v added, is below a share of theirs, for a while.
Where nothing shows the speed of the body, sigma_v grows and the test falls silent: it never guesses.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

from ohmward.checks import require_each_not_negative, require_positive
from ohmward.errors import InputError


@dataclass(frozen=True)
class SlipAlarm:
    """Settings of both tests."""

    #: share of the samples in which a wheel at the allowed slip raises the alarm, in (0, 0.5)
    false_alarm_rate: float = 1e-3
    allowed_m_s: float = 0.03  #: slip speed that is always allowed, >= 0
    allowed_ratio: float = 0.05  #: slip that is allowed besides, over the speed of the wheel's rim, >= 0
    stuck_rim_m_s: float = 0.1  #: the wheels count as turning from this speed of their rims on, > 0
    stuck_ratio: float = 0.2  #: the robot counts as stuck below this share of it, in (0, 1)
    stuck_s: float = 1.0  #: for so long, >= 0

    def __post_init__(self) -> None:
        if not 0 < self.false_alarm_rate < 0.5:
            raise InputError(f"slip_alarm.false_alarm_rate must be > 0 and < 0.5, got {self.false_alarm_rate:g}")
        if not 0 < self.stuck_ratio < 1:
            raise InputError(f"slip_alarm.stuck_ratio must be > 0 and < 1, got {self.stuck_ratio:g}")
        require_each_not_negative("slip_alarm.", self, "allowed_m_s", "allowed_ratio", "stuck_s")
        require_positive("slip_alarm.stuck_rim_m_s", self.stuck_rim_m_s)

    @property
    def z(self) -> float:
        """Sigmas to the alarm; two-sided tests of a slip near 0 have no more false alarms than twice the rate."""
        return NormalDist().inv_cdf(1 - self.false_alarm_rate)

    def slips(self, slip_m_s: Any, slip_std_m_s: Any, rim_m_s: Any) -> Any:
        """True where a wheel slips."""
        return abs(slip_m_s) - self.allowed_m_s - self.allowed_ratio * abs(rim_m_s) > self.z * slip_std_m_s

    def stands(self, speed_m_s: Any, speed_std_m_s: Any, rim_m_s: Any) -> Any:
        """True where the body stands while this wheel turns."""
        turns = abs(rim_m_s) > self.stuck_rim_m_s
        return turns & (abs(speed_m_s) + self.z * speed_std_m_s < self.stuck_ratio * abs(rim_m_s))
