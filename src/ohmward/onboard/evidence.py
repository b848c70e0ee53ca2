"""Age of the evidence: wider bands for a state whose sensors have not reported for a while.

Every state passes through here on its way to the sinks. The bands grow by what may have happened since the last
measurement:

    charge     sigma^2 + (c t)^2                c: an unknown current over the capacity
    speed      sigma^2 + (dv / 1.96)^2          dv = min(g t, |v| + v_max)
    position   sigma^2 + ((|v| + dv) t / 1.96)^2

Wheels held by friction alone brake or accelerate a robot by at most g, and its motors turn no faster than
without load, v_max. The current is a usual one, or the last one if that was larger. Once a band carries no information,
or the wheel sensors are silent, the estimate is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.cells.pack_estimator import PackEstimate
from ohmward.battery.models.noise import USUAL_C
from ohmward.energy.points import P90_SIGMA, Quantiles
from ohmward.filters.consistency import BAND_95
from ohmward.onboard.robot_state import Level, RobotState
from ohmward.quantities import SECONDS_PER_HOUR, limits_of
from ohmward.traction.odometry.sample import OdometryEstimate
from ohmward.traction.robot.robot import GRAVITY, Robot
from ohmward.traction.speed_observer.estimate import SlipEstimate

#: Quantities of which at least one is needed to know anything about the battery.
OF_CHARGE = frozenset({"battery_current_A", "battery_voltage_V", "cell_voltage_V"})

#: Evidence of the estimates: without a recent value of at least one of these quantities they are guesses.
EVIDENCE: dict[str, frozenset[str]] = {
    "battery": OF_CHARGE,
    "cells": frozenset({"cell_voltage_V"}),
    "drive": frozenset({"wheel_speed_rad_s", "wheel_counts", "speed_m_s"}),
}

#: Standard deviation of a charge uniformly distributed from empty to full.
ANY_SOC_STD = 1.0 / math.sqrt(12.0)


def usable(values: Mapping[str, float], state: RobotState) -> dict[str, float]:
    """Latest values of the sensors by signal, nan for a silent or faulty one.

    A silent battery makes its sensors nan at once; their own conditions follow at the next look.
    """
    useless = {condition.name for condition in state.diagnostics if condition.level >= Level.ERROR}
    if state.is_silent("battery"):
        useless |= {name for name in values if name.partition(".")[0] in {*OF_CHARGE, "battery_full"}}
    return {signal: math.nan if signal in useless else value for signal, value in values.items()}


class Age(NamedTuple):
    """Age of overdue evidence."""

    age_s: float  #: time since any of its sensors reported
    silent: bool  #: True if its sensors are reported as silent


@dataclass(frozen=True)
class AgeingModel:
    """Model of what a robot and its battery can do while nothing is measured."""

    battery: Battery | None = None
    robot: Robot | None = None

    def aged(self, state: RobotState, ages: Mapping[str, Age], current_A: float = math.nan) -> RobotState:
        """The state with bands as of its time, and None for what is unknown.

        ages: overdue evidence, by the keys of `EVIDENCE`.
        current_A: last current of the battery, nan if there was none.
        """
        changed: dict[str, Any] = {"silent": tuple(name for name, age in ages.items() if age.silent)}
        if "battery" in ages and state.battery:
            growth = self._soc_growth(ages["battery"].age_s, current_A)
            changed |= _aged_charge(state, growth)
        if "cells" in ages and state.cells:
            growth = self._soc_growth(ages["cells"].age_s, current_A)
            changed["cells"] = _aged_cells(state.cells, growth)
        if "drive" in ages:
            age_s, silent = ages["drive"]
            changed["slip"] = self._aged_slip(state.slip, age_s) if state.slip and not silent else None
            changed["pose"] = self._aged_pose(state.pose, age_s) if state.pose and not silent else None
        return state._replace(**changed)

    def _soc_growth(self, age_s: float, current_A: float) -> float:
        """Standard deviation of the charge moved by an unknown current: c t of the equation at the head."""
        assert self.battery is not None
        last_C = abs(current_A) / self.battery.capacity_Ah
        rate_C = last_C if last_C > USUAL_C else USUAL_C
        return rate_C * age_s / SECONDS_PER_HOUR

    @cached_property
    def fastest_m_s(self) -> float:
        """Rim speed at which the motors give no torque; without a battery, the limit of the wheel speed."""
        assert self.robot is not None
        radius_m = self.robot.wheel.radius_m
        fastest_m_s = limits_of("wheel_speed_rad_s", robot=self.robot).highest * radius_m
        if self.battery:
            no_load_m_s = self.battery.voltage_max_V / self.robot.motor.wheel_constant_Nm_per_A * radius_m
            fastest_m_s = min(fastest_m_s, no_load_m_s)
        return fastest_m_s

    @cached_property
    def lever_m(self) -> float:
        """Ratio of the outermost wheel's speed to the yaw rate."""
        assert self.robot is not None
        return float(np.max(np.abs(self.robot.rolling[:, -1])))

    def _speed_change_m_s(self, speed_m_s: float, age_s: float) -> float:
        return min(GRAVITY * age_s, abs(speed_m_s) + self.fastest_m_s)

    def _aged_slip(self, slip: SlipEstimate, age_s: float) -> SlipEstimate:
        """Speed and yaw rate with wider bands; the quantities of the wheels, which have no band, become unknown."""
        change_m_s = self._speed_change_m_s(slip.speed_m_s, age_s) / BAND_95
        of_wheels = ("wheel_speed_rad_s", "slip_speed_m_s", "slip_speed_std_m_s", "slip_ratio", "traction_N")
        return slip._replace(
            speed_std_m_s=math.hypot(slip.speed_std_m_s, change_m_s),
            yaw_rate_std_rad_s=math.hypot(slip.yaw_rate_std_rad_s, change_m_s / self.lever_m),
            **dict.fromkeys(of_wheels, np.full(len(slip.slip_ratio), math.nan)),
        )

    def _aged_pose(self, pose: OdometryEstimate, age_s: float) -> OdometryEstimate:
        speed_m_s = math.hypot(pose.speed_m_s, pose.speed_left_m_s)
        change_m_s = self._speed_change_m_s(speed_m_s, age_s)
        moved_m = (speed_m_s + change_m_s) * age_s / BAND_95
        turned_rad = (abs(pose.yaw_rate_rad_s) + change_m_s / self.lever_m) * age_s / BAND_95
        changed = np.array([1.0, 1.0, 1.0 / self.lever_m]) * change_m_s / BAND_95
        return pose._replace(
            pose_cov=pose.pose_cov + np.diag(np.square([moved_m, moved_m, turned_rad])),
            position_std_m=math.hypot(pose.position_std_m, moved_m),
            twist_cov=pose.twist_cov + np.diag(np.square(changed)),
        )


def _aged_charge(state: RobotState, growth: float) -> dict[str, Any]:
    """Charge and range; growth: standard deviation of the change of the charge."""
    assert state.battery is not None
    if growth > ANY_SOC_STD:
        return {"battery": None, "range": None}
    share = growth / max(state.battery.soc, growth)
    reach = state.range and state.range._replace(
        distance_m=_widened(state.range.distance_m, share),
        duration_s=_widened(state.range.duration_s, share),
        home_probability=math.nan,
    )
    return {"battery": state.battery._replace(soc_std=math.hypot(state.battery.soc_std, growth)), "range": reach}


def _widened(quantiles: Quantiles, share: float) -> Quantiles:
    """Quantiles of the range after a change of the charge; share: its standard deviation relative to the charge."""
    p10, p50, p90 = quantiles
    moved = P90_SIGMA * share * p50
    return Quantiles(max(p50 - math.hypot(p50 - p10, moved), 0.0), p50, p50 + math.hypot(p90 - p50, moved))


def _aged_cells(cells: PackEstimate, growth: float) -> PackEstimate | None:
    """The cells with bands as of now; the same current goes through all of them."""
    if growth > ANY_SOC_STD:
        return None
    return cells._replace(
        pack=cells.pack._replace(
            soc_std=math.hypot(cells.pack.soc_std, growth),
            usable_std_Ah=math.hypot(cells.pack.usable_std_Ah, growth * cells.pack.capacity_Ah),
            weakest_soc_std=math.hypot(cells.pack.weakest_soc_std, growth),
        ),
        typical=cells.typical._replace(soc_std=math.hypot(cells.typical.soc_std, growth)),
        cells=cells.cells._replace(soc_std=np.hypot(cells.cells.soc_std, growth)),
    )
