"""Alarms of a robot: conditions that need somebody's attention, each raised once and ended with hysteresis.

A value that stays beyond its limit raises an alarm; the alarm ends once the value has returned by the hysteresis, and
is unchanged while the value is unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ohmward.battery.soc.sample import SocFlag
from ohmward.checks import require_between
from ohmward.onboard.part import LOG
from ohmward.onboard.robot_state import Alarm, RobotState, is_charging, soc_band, stale

#: Width beyond which the 95 % band of the charge is of no use to an operator.
ANYTHING = 0.6

#: Names of the alarms.
_MOST_URGENT_FIRST = ("stuck", "bms", "empty", "low", "charge", "home", "cells", "slip")


@dataclass(frozen=True)
class AlarmLimits:
    """Limits of the alarms: the table [alarms] of a setup."""

    soc_empty: float = 0.05  #: low end of the SoC band below which the battery may be nearly empty; 0: never
    soc_low: float = 0.15  #: low end of the SoC band below which it is time to drive home; 0: never
    #: the SoC band is wider than 60 points, so that the two limits above say nothing, or there is none
    charge: bool = True
    home_probability: float = 0.9  #: least probability of reaching home, where `home_distance_m` is given; 0: never
    cell_spread: float = 0.1  #: largest SoC difference between cells; 1: never
    slip_ratio: float = 1.0  #: largest slip ratio of a wheel; 1: never
    stuck: bool = True  #: the wheels turn and the robot does not move
    bms: bool = True  #: the BMS reports an alarm, `bms_alarm`
    hysteresis: float = 0.03  #: distance by which a value must return to end its alarm, >= 0; for cells a tenth of it
    after_s: float = 2.0  #: time that a value must stay beyond its limit, >= 0

    def __post_init__(self) -> None:
        for name in ("soc_empty", "soc_low", "home_probability", "cell_spread", "slip_ratio", "hysteresis"):
            require_between(f"alarms.{name}", getattr(self, name), 0.0, 1.0)
        require_between("alarms.after_s", self.after_s, 0.0, 3600.0)


class AlarmWatch:
    """Alarms from states in order.

    Args:
        limits: of the alarms.
        look_s: least time between two checked states; current and BMS alarm measured in between are not missed.

    Attributes:
        alarms: raised alarms, the most urgent first.
    """

    def __init__(self, limits: AlarmLimits | None = None, look_s: float = 0.0):
        self.limits, self._look_s = limits or AlarmLimits(), look_s
        self._looked_s = -math.inf
        self.alarms: tuple[Alarm, ...] = ()
        self._current_A = self._bms_alarm = 0.0
        self._beyond_s: dict[str, float] = {}  #: since when each value is beyond its limit

    def take(self, state: RobotState) -> tuple[Alarm, ...]:
        """The alarms after a state."""
        self._current_A = state.sample.get("battery_current_A", self._current_A)
        self._bms_alarm = state.sample.get("bms_alarm", self._bms_alarm)
        if 0.0 <= state.time_s - self._looked_s < self._look_s:
            return self.alarms
        self._looked_s = state.time_s
        before = {alarm.name: alarm for alarm in self.alarms}
        found: list[Alarm] = []
        for name, (excess, hysteresis, text) in self._excesses(state).items():
            if not excess > 0.0 and not math.isnan(excess):
                self._beyond_s.pop(name, None)
            if last := before.get(name):
                found += [] if excess < -hysteresis else [last._replace(text=text or last.text)]
            elif excess > 0.0:
                beyond_s = self._beyond_s.setdefault(name, state.time_s)
                if not 0.0 <= state.time_s - beyond_s < self.limits.after_s:
                    found.append(Alarm(name, text, state.unix_s))
        for alarm in found:
            if alarm.name not in before:
                LOG.warning("alarm %s: %s", alarm.name, alarm.text)
        for name in before.keys() - {alarm.name for alarm in found}:
            LOG.info("alarm %s has ended", name)
        self.alarms = tuple(found)
        return self.alarms

    def _excesses(self, state: RobotState) -> dict[str, tuple[float, float, str]]:
        """For each alarm, excess of its value over the limit (nan if unknown), hysteresis and sentence."""
        limits, hysteresis = self.limits, self.limits.hysteresis
        found = dict.fromkeys(_MOST_URGENT_FIRST, (math.nan, 0.0, ""))
        if state.slip and limits.stuck:
            stuck = float(state.slip.immobilised) - 0.5
            found["stuck"] = stuck, 0.0, _stuck(state) if stuck > 0.0 else ""
        if limits.bms:
            text = f"The battery's own management reports an alarm ({self._bms_alarm:g})."
            found["bms"] = self._bms_alarm - 0.5, 0.0, text
        low, home = _low(state), state.range.home_probability if state.range else math.nan
        charges = is_charging(self._current_A, state.battery)
        if charges:
            low = home = math.inf
        if limits.charge:
            found["charge"] = width_of_charge(state) - ANYTHING, hysteresis, not_known(state)
            if charges and not state.is_silent("battery"):
                found["charge"] = -math.inf, hysteresis, ""
        found["empty"] = limits.soc_empty - low, hysteresis, "Charge now: the battery may be nearly empty."
        down = f"the battery may be down to {100 * low:.0f} %" if math.isfinite(low) else "the charge may not last"
        text = f"Drive home now: {down}."
        found["low"] = limits.soc_low - low, hysteresis, text
        found["home"] = limits.home_probability - home, hysteresis, text
        if state.cells:
            spread = float(state.cells.pack.soc_spread)
            text = f"Balance the cells: their charges are {100 * spread:.0f} points apart."
            found["cells"] = spread - limits.cell_spread, 0.1 * hysteresis, text
        if state.slip:
            ratio = float(np.max(np.abs(np.nan_to_num(state.slip.slip_ratio)), initial=0.0))
            found["slip"] = ratio - limits.slip_ratio, hysteresis, f"A wheel slips by {100 * ratio:.0f} %."
        return found


def not_known(state: RobotState) -> str:
    """Sentence on a charge that is not known, with what helps."""
    reason = "charge the battery fully once"
    if state.is_silent("battery"):
        reason = stale(state)
    elif state.battery and int(state.battery.flags) & SocFlag.NO_CURRENT:
        reason = "its current is not measured"
    return f"The charge is not known: {reason}."


def width_of_charge(state: RobotState) -> float:
    """Width of the band of the charge; inf if it is no longer known, nan if it is not known yet."""
    if state.battery is None:
        return math.inf if state.is_silent("battery") else math.nan
    low, high = soc_band(state.battery.soc, state.battery.soc_std)
    return high - low


def _low(state: RobotState) -> float:
    """Low end of the band of the charge; nan if there is none or it is too wide to be of use."""
    width = width_of_charge(state)
    return soc_band(state.battery.soc, state.battery.soc_std)[0] if state.battery and width <= ANYTHING else math.nan


def _stuck(state: RobotState) -> str:
    assert state.slip is not None
    known = np.abs(np.nan_to_num(state.slip.slip_speed_m_s))
    wheel = state.wheels[int(np.argmax(known))].replace("_", " ") if state.wheels else "driven"
    return f"Stop and look at the {wheel} wheel: it turns and the robot does not move."
