"""Battery files of format 1: the keys of today, the chemistry's priors for what they lack, and a sentence on each.

Format 1 knew no doubt of the activations nor of the curve against temperature, had the current sensor in [noise], and
`activation_K = 0` wherever one temperature had been tested. Taken as it stands, such a file is sure in the cold.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ohmward.battery.chemistries import (
    AGED_CAPACITY_STD,
    AGED_RESISTANCE_STD,
    CELL_V,
    CHEMISTRIES,
    ChemistryPrior,
    chemistry_prior,
    start_noise,
)
from ohmward.battery.models.noise import BatteryNoise

#: Keys of [sensor] by those that [noise] and [rc_noise] had for them.
_SENSOR_KEYS = {
    "current_std_A": "noise_std_A",
    "current_offset_std_A": "offset_std_A",
    "current_offset_walk_A": "offset_walk_A",
}


def from_format_1(table: dict[str, Any]) -> dict[str, Any]:
    """The table of a file of today for one of format 1; what is no table is left for the check that follows."""
    table = dict(table)
    named = table.get("chemistry", "")
    chemistry = named if isinstance(named, str) and named in CHEMISTRIES else ""
    prior = chemistry_prior(chemistry)
    kind = f"{chemistry} cells" if chemistry else "batteries (name the chemistry in the file for narrower values)"
    lacks = [
        *_take_sensor(table),
        *_take_activation(table, prior, kind),
        *_take_ocv_temperature(table, prior, kind),
        *_take_hysteresis(table, prior, kind),
        *_doubt_age(table, prior),
        *_doubt_label(table, chemistry),
    ]
    if not isinstance(table.get("thevenin"), dict):
        return table
    known = table.get("not_identified", [])
    return table | ({"not_identified": [*known, *lacks]} if isinstance(known, list) else {})


def _take_sensor(table: dict[str, Any]) -> list[str]:
    """Move the current sensor out of the noise into a table of its own."""
    sensor: dict[str, Any] = {}
    for name in ("rc_noise", "noise"):
        if isinstance(table.get(name), dict):
            table[name] = dict(table[name])
            sensor |= {new: table[name].pop(old) for old, new in _SENSOR_KEYS.items() if old in table[name]}
    if sensor:
        table["sensor"] = sensor
    return ["current sensor: a file of format 1 has no [sensor]; its gain was taken as right within 1 % (1 sigma)"]


def _take_activation(table: dict[str, Any], prior: ChemistryPrior, kind: str) -> list[str]:
    """Doubt the activations, and take the chemistry's where the file has none."""
    model = table.get("thevenin")
    if not isinstance(model, dict):
        return []
    _into_noise(table, "activation_std_K", prior.activation_std_K)
    _into_noise(table, "empty_activation_std_K", prior.empty_activation_K.std)
    tested = bool(model.get("activation_K"))
    ohmic, pairs, tau = (A.mean for A in prior.activations_K)
    taken = {"tau_activation_K": tau} if tested else _activations(ohmic, pairs, tau)
    table["thevenin"] = model | taken | {"empty_activation_K": prior.empty_activation_K.mean}
    if tested:
        return [
            f"activation_std_K: a file of format 1 does not say it; ± {prior.activation_std_K:.0f} K, and {tau:.0f} K "
            f"for the time constants, were taken, as usual for {kind}"
        ]
    return [
        f"activation: this file of format 1 was tested at one temperature; {ohmic:.0f} K (R0), {pairs:.0f} K (RC pairs)"
        f" and {tau:.0f} K (time constants), all ± {prior.activation_std_K:.0f} K, were taken, as usual for {kind}"
    ]


def _activations(ohmic_K: float, pairs_K: float, tau_K: float) -> dict[str, float]:
    return {"activation_K": ohmic_K, "pair_activation_K": pairs_K, "tau_activation_K": tau_K}


def _take_ocv_temperature(table: dict[str, Any], prior: ChemistryPrior, kind: str) -> list[str]:
    """Doubt the curve away from its temperature."""
    curve = table.get("thevenin", {}).get("ocv") if isinstance(table.get("thevenin"), dict) else None
    voltage_V = curve.get("voltage_V") if isinstance(curve, Mapping) else None
    try:
        usual_V = float(np.mean(voltage_V)) if voltage_V else CELL_V
    except (TypeError, ValueError):
        return []
    std = prior.ocv_std_V_per_K * usual_V / CELL_V
    _into_noise(table, "ocv_std_V_per_K", std)
    return [
        f"open-circuit voltage against temperature: a file of format 1 does not doubt it; ± {1e3 * std:.2g} mV/K was "
        f"taken, as usual for {kind}"
    ]


def _take_hysteresis(table: dict[str, Any], prior: ChemistryPrior, kind: str) -> list[str]:
    """Doubt the voltage by the usual hysteresis where the file has none."""
    model, noise = table.get("thevenin"), table.get("noise")
    curve = model.get("ocv") if isinstance(model, dict) else None
    if not isinstance(curve, dict) or not isinstance(noise, dict) or not _are_numbers(curve.get("voltage_V")):
        return []
    measured = curve.get("hysteresis_V")
    known_V = noise.get("model_std_V", list(BatteryNoise().model_std_V))
    error_V = prior.hysteresis_V * float(np.mean(curve["voltage_V"])) / CELL_V
    if (measured and _are_numbers(measured) and any(measured)) or not _are_numbers(known_V) or not error_V:
        return []
    table["noise"] = noise | {"model_std_V": np.hypot(known_V, error_V).tolist()}
    return [
        f"hysteresis: an error of the voltage of {1e3 * error_V:.2g} mV was taken in its place, as usual for {kind}"
    ]


def _doubt_age(table: dict[str, Any], prior: ChemistryPrior) -> list[str]:
    """Doubt capacity, resistance and curve of a battery that has aged since its test."""
    noise, model = table.get("noise"), table.get("thevenin")
    least = {"capacity_std": AGED_CAPACITY_STD, "resistance_std": AGED_RESISTANCE_STD}
    if not isinstance(noise, dict) or not _are_numbers([noise.get(key, 0.0) for key in least]):
        return []
    table["noise"] = noise | {key: max(noise.get(key, 0.0), std) for key, std in least.items()}
    table["noise"]["ocv_slip_std"] = prior.ocv_slip.std
    if isinstance(model, dict):
        table["thevenin"] = {"ocv_slip": prior.ocv_slip.mean} | model
    return [
        f"age: a file of format 1 took the battery as it was tested; its capacity is now doubted by "
        f"{AGED_CAPACITY_STD:.0%}, its resistance by {AGED_RESISTANCE_STD:.0%} (1 sigma)"
    ]


def _are_numbers(values: Any) -> bool:
    """True for a list of numbers."""
    return isinstance(values, list) and all(isinstance(value, int | float) for value in values)


def _doubt_label(table: dict[str, Any], chemistry: str) -> list[str]:
    """Doubt capacity, resistance and curve of a file of start values as much as cells with one label differ."""
    noise = table.get("noise")
    if not chemistry or "identification" in table or not isinstance(noise, dict):
        return []
    cells = table.get("n_series", 1)
    label = start_noise(chemistry, cells if isinstance(cells, int) else 1)
    table["noise"] = noise | {
        "capacity_std": label.capacity_std,
        "resistance_std": label.resistance_std,
        "model_std_V": list(label.model_std_V),
        "model_soc_length": label.model_soc_length,
    }
    return [
        f"capacity within {label.capacity_std:.0%}, resistance within {label.resistance_std:.0%} (1 sigma), and the "
        "curve: doubted as much as cells with one label differ; a file of format 1 without a test was surer than that"
    ]


def _into_noise(table: dict[str, Any], key: str, value: float) -> None:
    noise = table.get("noise", {})
    if isinstance(noise, dict):
        table["noise"] = {key: value} | noise
