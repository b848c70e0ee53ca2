"""A cell of the pack that is lost in use: shorted, or no longer in the voltage because its wire has come off."""

from __future__ import annotations

import math

from ohmward.battery.battery import Battery

#: The voltage falls by that of one cell, within this share of it, while the load moves it by no more than this share.
_WITHIN_CELL, _BY_LOAD = 0.15, 0.1
#: The step is between two samples at most this far apart [s], and lasts for this time and number of samples: a silence
#: may be an exchange of the battery, and a glitch ends.
_APART_S, _LASTS_S, _SAMPLES = 3.0, 2.0, 3


class CellLoss:
    """Watch over the voltage of a pack, which gives that of all its cells from those that are left.

    Attributes:
        lost: number of cells that are lost.
    """

    def __init__(self, battery: Battery):
        self._n, self._ohm = int(battery.n_series), battery.thevenin.largest_ohm
        self.lost = 0
        self._time_s = self._current_A = self._voltage_V = math.nan  # of the last sample that is not suspected
        self._began_s, self._suspected = math.nan, 0

    def take(self, time_s: float, current_A: float, voltage_V: float) -> float:
        """Voltage of the whole pack, the lost cells like the others; nan while it is not clear whether one is lost."""
        if not (math.isfinite(current_A) and math.isfinite(voltage_V)):
            return self._whole(voltage_V)
        change = self._change_in_cells(time_s, current_A, voltage_V)
        if change == 0 or not 0 <= self.lost - change < self._n - 1:
            self._suspected = 0
        else:
            self._began_s = time_s if self._suspected == 0 else self._began_s
            self._suspected += 1
            if self._suspected < _SAMPLES or time_s - self._began_s < _LASTS_S:
                return math.nan
            self.lost, self._suspected = self.lost - change, 0
        self._time_s, self._current_A, self._voltage_V = time_s, current_A, voltage_V
        return self._whole(voltage_V)

    def _change_in_cells(self, time_s: float, current_A: float, voltage_V: float) -> int:
        """-1 if the voltage has fallen by that of a cell at once, 1 if it has risen so, else 0."""
        since_s = (self._began_s if self._suspected else time_s) - self._time_s
        cell_V = self._voltage_V / (self._n - self.lost)
        by_load = self._ohm * abs(current_A - self._current_A) > _BY_LOAD * cell_V
        change = (voltage_V - self._voltage_V) / cell_V
        if not 0.0 <= since_s <= _APART_S or by_load or not abs(abs(change) - 1.0) < _WITHIN_CELL:
            return 0
        return 1 if change > 0.0 else -1

    def _whole(self, voltage_V: float) -> float:
        return voltage_V * self._n / (self._n - self.lost)
