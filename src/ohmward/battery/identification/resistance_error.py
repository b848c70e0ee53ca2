"""Error of the resistances where no rest shows how far a lasting load has lowered the voltage."""

from __future__ import annotations

import numpy as np

from ohmward.battery.identification.circuit_design import RESISTANCE_GRID
from ohmward.battery.models.thevenin import Thevenin

#: A rest of this length shows the overpotential of the load before it [s].
_TELLING_REST_S = 600.0
#: Relative error of the overpotential of a lasting load where no such rest shows it: from one drive of an NMC cell to
#: another of the same cell it was 18 %, with the open-circuit voltage known.
_LASTING_SHARE = 0.15


def lasting_error_V(p: Thevenin, typical_A: float, longest_rest_s: float) -> np.ndarray:
    """(21,) error of the voltage [V] under a lasting load of typical_A; 0 where a rest of 10 min shows what it does."""
    if longest_rest_s >= _TELLING_REST_S:
        return np.zeros(RESISTANCE_GRID.size)
    ohm = np.sum([p.r0_discharge_ohm, *p.r_ohm], axis=0)
    return _LASTING_SHARE * typical_A * np.interp(RESISTANCE_GRID, np.linspace(0, 1, ohm.size), ohm)
