"""Knowledge of a battery file in a few numbers, for reports."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.chemistries import Normal, chemistry
from ohmward.battery.learning.fold import capacity_normal, offset_normal, resistance_normal
from ohmward.battery.learning.parameters import prior_covariance

#: How the sentences of a label begin; those of a test stay as they are.
_OF_A_LABEL = ("everything", "capacity: ", "resistances: ", "open-circuit voltage: ")
#: A curve that is seen down to this SoC is seen to its end.
_SEEN_TO_THE_END = 0.02


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


def not_identified_sentences(battery: Battery) -> tuple[str, ...]:
    """The sentences on what is not known of the battery, those of its label brought up to what it has learnt."""
    others = tuple(text for text in battery.not_identified if not text.startswith(_OF_A_LABEL))
    if battery.knowledge is None or not any(text.startswith(_OF_A_LABEL[0]) for text in battery.not_identified):
        return battery.not_identified
    found, seen_soc = known(battery), battery.knowledge.seen_from_soc
    capacity = found.capacity_Ah.std / found.capacity_Ah.mean
    resistance = found.resistance_ohm.std / found.resistance_ohm.mean
    kind = f"cells of {chemistry(battery.chemistry).title}" if battery.chemistry else "batteries"
    sentences = [
        f"everything that no log has shown: start values that {kind} have in common",
        f"capacity: learnt within {capacity:.1%} (1 sigma) from {found.logs} log{'s' * (found.logs != 1)}",
        f"resistances: learnt within {resistance:.0%} (1 sigma)",
    ]
    if seen_soc > _SEEN_TO_THE_END:
        sentences.append(f"open-circuit voltage: no log went below {seen_soc:.0%} of charge")
    return (*sentences, *others)
