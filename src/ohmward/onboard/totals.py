"""Totals of a robot since ever: charge and energy through its battery, and the way that it has driven."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

#: Samples further apart have nothing between them that was measured [s].
TOTALS_GAP_S = 60.0

_S_PER_H, _WH_PER_KWH, _M_PER_KM = 3600.0, 1e3, 1e3


class Totals(NamedTuple):
    """Sums over everything that was measured; nothing is counted while no sensor reports."""

    charge_in_Ah: float = 0.0  #: into the battery
    charge_out_Ah: float = 0.0  #: out of it
    energy_in_kWh: float = 0.0  #: into the battery
    energy_out_kWh: float = 0.0  #: out of it
    #: equivalent full cycles: charge both ways over twice the capacity of the battery file
    cycles: float = 0.0
    distance_km: float = 0.0  #: driven

    def plus_charge(self, charge_Ah: float, voltage_V: float, capacity_Ah: float) -> Totals:
        """The totals after a charge of one sign at a voltage.

        charge_Ah: > 0 into the battery.  voltage_V: mean, nan where it was not measured: no energy is counted.
        """
        energy_kWh = abs(charge_Ah) * voltage_V / _WH_PER_KWH if math.isfinite(voltage_V) else 0.0
        cycles = self.cycles + abs(charge_Ah) / (2.0 * capacity_Ah)
        if charge_Ah > 0.0:
            charge_in_Ah, energy_in_kWh = self.charge_in_Ah + charge_Ah, self.energy_in_kWh + energy_kWh
            return self._replace(charge_in_Ah=charge_in_Ah, energy_in_kWh=energy_in_kWh, cycles=cycles)
        charge_out_Ah, energy_out_kWh = self.charge_out_Ah - charge_Ah, self.energy_out_kWh + energy_kWh
        return self._replace(charge_out_Ah=charge_out_Ah, energy_out_kWh=energy_out_kWh, cycles=cycles)

    def after_battery(self, dt_s: float, current_A: float, voltage_V: float, capacity_Ah: float) -> Totals:
        """The totals after a step with these means, unless it is a gap.

        dt_s: since the sample before.  current_A: > 0 charges; nan is not measured, as of the voltage.
        """
        if not (0.0 < dt_s <= TOTALS_GAP_S and math.isfinite(current_A)):
            return self
        return self.plus_charge(current_A * dt_s / _S_PER_H, voltage_V, capacity_Ah)

    def after_drive(self, before_m: float, distance_m: float) -> Totals:
        """The totals after the path has grown from one length to another; one that is shorter has begun again."""
        grown_m = distance_m - before_m if distance_m >= before_m else distance_m
        return self._replace(distance_km=self.distance_km + grown_m / _M_PER_KM) if math.isfinite(grown_m) else self


def totals_from(content: Mapping[str, Any]) -> Totals:
    """The totals in a snapshot; nothing of a number that cannot be one."""
    known = {name: content.get(name) for name in Totals._fields}
    return Totals(**{name: float(v) for name, v in known.items() if isinstance(v, int | float) and 0.0 <= v < 1e12})
