"""A log made ready for identification: its charge, its phases and what kind of test it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.charge import Charge, count_charge, known_current_A
from ohmward.battery.identification.segments import Phase, Test, find_phases, kind_of_test
from ohmward.logs.log import Log


class Record(NamedTuple):
    """A log with the charge of each interval, its phases and the kind of test."""

    log: Log
    charge: Charge
    phases: tuple[Phase, ...]
    test: Test

    @property
    def current_A(self) -> np.ndarray:
        """(T,) current [A], > 0 charges, without holes."""
        return known_current_A(self.log)

    def temperature_degC(self, otherwise: float) -> np.ndarray:
        """(T,) temperature [degC]; `otherwise` where the log has none."""
        if self.log.temperature_degC is None:
            return np.full(len(self.log), otherwise)
        return np.where(np.isfinite(self.log.temperature_degC), self.log.temperature_degC, otherwise)

    def typical_degC(self) -> float | None:
        """Median temperature of the log, or None."""
        values = self.log.temperature_degC
        return None if values is None or not np.isfinite(values).any() else float(np.nanmedian(values))


def make_record(log: Log, capacity_Ah: float, idle_current_A: float = 0.0) -> Record:
    """Stages 1 and 2 for one log.

    Raises:
        InputError: no current in the log, or too short for a pulse.
    """
    charge = count_charge(log)
    phases = find_phases(log, capacity_Ah, idle_current_A)
    return Record(log, charge, phases, kind_of_test(log, charge, phases, capacity_Ah))
