"""Knowledge of a battery file in a few numbers, for reports."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.chemistries import Normal
from ohmward.battery.learning.fold import capacity_normal, offset_normal, resistance_normal
from ohmward.battery.learning.parameters import prior_covariance

#: Grid of SoC on which the error of the curve is told.
_GRID = np.linspace(0.0, 1.0, 21)


class KnownBattery(NamedTuple):
    """Quantities of a battery file with their standard deviations."""

    #: the resistance to ten seconds of 1 C at half charge
    capacity_Ah: Normal
    resistance_ohm: Normal
    offset_A: Normal
    #: (21,) standard deviation of the open-circuit curve that the estimators assume, from SoC 0 to 1
    ocv_std_V: np.ndarray
    #: what it has learnt from
    logs: int
    hours: float


def known(battery: Battery) -> KnownBattery:
    """Quantities that a battery file knows, and how well."""
    covariance = prior_covariance(battery)
    logs = battery.knowledge.logs if battery.knowledge else ()
    return KnownBattery(
        capacity_normal(battery, covariance),
        resistance_normal(battery, covariance),
        offset_normal(battery, covariance),
        ocv_std_V(battery, _GRID),
        len(logs),
        sum(log.hours for log in logs),
    )


def ocv_std_V(battery: Battery, soc: Any) -> np.ndarray:
    """Standard deviation of the open-circuit curve [V] that the estimators assume, its SoC axis included."""
    model = require_thevenin(battery)
    slope_V = np.gradient(np.asarray(model.ocv.mean_V(soc, model.reference_degC)), soc)
    return np.hypot(np.asarray(battery.noise.model_std_at(soc)), slope_V * battery.noise.soc_axis_std)
