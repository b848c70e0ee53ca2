"""Warnings of a drive: deviations from its commands, in sentences."""

from __future__ import annotations

from enum import IntFlag

import numpy as np

from ohmward.traction.control import ControlFlag, Report
from ohmward.traction.control.limits import SAME_TORQUE
from ohmward_lab.simulate.closed_loop.scenario import Scenario

_SENTENCES: dict[IntFlag, str] = {
    ControlFlag.STALE: "the speed was too old or too uncertain to act on, and the torque went to zero; give the robot "
    "another sensor (sensors.speed, sensors.encoders, sensors.pitch) or a faster link",
    ControlFlag.UNREACHABLE: "the slip asked for did not come about although the torque was at its limit: friction or "
    "torque cannot give it; ask for another slip or raise controller.torque_limit_Nm",
    ControlFlag.BAD_COMMAND: "the command was not understood, and the torque went to zero",
}


class DriveWarnings:
    """Time spent under each deviation, wheel by wheel.

    Args:
        scenario: that is driven.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._places = [p.name for p in scenario.model.places]
        self._duration_s = 0.0
        self._flagged_s = {flag: np.zeros(scenario.model.driven) for flag in _SENTENCES}
        self._short_s = 0.0
        self._empty = False

    def add_step(self, report: Report, demanded_Nm: np.ndarray, torque_Nm: np.ndarray, dt_s: float) -> None:
        """Count one step of the controller; torque_Nm: what the battery left of the demanded torque."""
        self._duration_s += dt_s
        flags = np.asarray(report.flags).astype(int)
        for flag, seconds in self._flagged_s.items():
            seconds += np.where(flags & flag, dt_s, 0.0)
        if np.abs(demanded_Nm - torque_Nm).max() > SAME_TORQUE:
            self._short_s += dt_s

    def battery_empty(self) -> None:
        """Note that the battery can no longer feed the electronics."""
        self._empty = True

    def sentences(self) -> tuple[str, ...]:
        """One sentence for each kind of deviation."""
        found = [
            f"{self._shares(seconds)} of the time: {_SENTENCES[flag]}"
            for flag, seconds in self._flagged_s.items()
            if seconds.any()
        ]
        if self._short_s:
            share = 100 * self._short_s / self._duration_s
            found.append(f"{share:.1f} % of the time: the battery's voltage or power limited the torque")
        if self._empty:
            found.append(
                f"the battery is empty after {self._duration_s:.3g} s and the drive ends there; raise battery.start_soc"
            )
        return tuple(found)

    def _shares(self, seconds: np.ndarray) -> str:
        shares = 100 * seconds / self._duration_s
        return ", ".join(f"{self._places[k]} {shares[k]:.1f} %" for k in np.flatnonzero(seconds))
