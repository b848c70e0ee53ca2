"""Resistance to a pulse, as testers of batteries measure it and people quote it.

After a rest a current I of one capacity per hour flows for t = 10 s:

    R = (f(R_0 I) R_0 I + sum R_j (1 - exp(-t / tau_j)) I + (I t / Q) dOCV/ds) / I

f is the share of the ohmic drop that the transfer of charge leaves at this current (`models.thevenin`). The last term
is what the charge drawn moves the open-circuit voltage: a tester's voltage falls by it as well.
"""

from __future__ import annotations

import numpy as np

from ohmward.battery.learning.parameters import mean_slope_V
from ohmward.battery.models.noise import on_soc_grid
from ohmward.battery.models.thevenin import Thevenin, transfer_share
from ohmward.logs.log import SECONDS_PER_HOUR

#: Duration of the pulse [s], and the state of charge before the one that is quoted.
PULSE_S, _HALF = 10.0, 0.5


def pulse_ohm(model: Thevenin) -> float:
    """Resistance [ohm] to ten seconds of 1 C at half charge and the temperature of the file."""
    return float(pulse_ohm_along(model, np.array([_HALF]))[0])


def pulse_ohm_along(model: Thevenin, soc: np.ndarray) -> np.ndarray:
    """Resistance [ohm] to ten seconds of 1 C at these states of charge and the temperature of the file."""
    current_A = model.capacity_Ah
    ohm = np.asarray(on_soc_grid(model.r0_discharge_ohm, soc))
    if model.transfer_V is not None:
        ohm = ohm * np.asarray(transfer_share(ohm * current_A / model.transfer_V))
    for row, tau_s in zip(model.r_ohm, model.tau_s, strict=True):
        ohm = ohm + np.asarray(on_soc_grid(row, soc)) * (1.0 - np.exp(-PULSE_S / tau_s))
    return ohm + mean_slope_V(model.ocv, soc) * PULSE_S / SECONDS_PER_HOUR / current_A
