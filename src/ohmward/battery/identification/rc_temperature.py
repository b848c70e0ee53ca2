"""Temperature of an RC model from one record: its activation and the doubt about it are found elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ohmward.battery.chemistries import CELL_V, chemistry_prior
from ohmward.battery.identification.rc_identification import RcIdentification
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.temperature import arrhenius_factor


def with_activation(
    found: RcIdentification, activation_K: float, noise: BatteryNoise, record_degC: float | None
) -> RcIdentification:
    """The RC model with an activation and the noise that belongs to it; its resistances at the curve's temperature.

    noise: with the doubts of activation and open-circuit voltage.
    record_degC: temperature of the record that it was identified from; None where that is unknown.
    """
    reference_degC = found.model.ocv.reference_degC
    factor = 1.0 if record_degC is None else arrhenius_factor(record_degC, activation_K, reference_degC)
    names = ("r_bulk_ohm", "r_surface_ohm", "r_terminal_ohm")
    resistances = {name: getattr(found.model, name) / factor for name in names}
    model = replace(found.model, activation_K=activation_K, **resistances)
    own = replace(found.noise, activation_std_K=noise.activation_std_K, ocv_std_V_per_K=noise.ocv_std_V_per_K)
    return found._replace(model=model, noise=own)


def with_usual_activation(found: RcIdentification, chemistry: str, record_degC: float | None) -> RcIdentification:
    """As `with_activation`, with what is usual for the chemistry, "" where that is unknown; half ohmic, half pairs."""
    prior, volts = chemistry_prior(chemistry), float(np.mean(found.model.ocv.voltage_V)) / CELL_V
    activation_K = 0.5 * (prior.activation_K.mean + prior.pair_activation_K.mean)
    noise = BatteryNoise(activation_std_K=prior.activation_std_K, ocv_std_V_per_K=volts * prior.ocv_std_V_per_K)
    sentence = (
        f"activation of the resistances: {activation_K:.0f} ± {prior.activation_std_K:.0f} K was taken, as usual for "
        f"{chemistry or 'batteries'}"
    )
    usual = with_activation(found, activation_K, noise, record_degC)
    return usual._replace(not_identified=(*usual.not_identified, sentence))
