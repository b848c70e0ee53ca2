"""Temperatures and the Arrhenius law of resistances."""

from __future__ import annotations

from typing import Any

from ohmward.trace import exp

#: 0 degC in kelvin.
KELVIN = 273.15

#: Gas constant and charge of a mole of electrons: their ratio times T is the thermal voltage.
GAS_J_PER_MOL_K, FARADAY_C_PER_MOL = 8.314462618, 96485.33212

#: Room temperature [degC], at which tests are made, and which is assumed where it is not measured.
ROOM_DEGC = 25.0


def arrhenius_factor(temperature_degC: Any, activation_K: float, reference_degC: float) -> Any:
    """exp(A (1/T - 1/T_0)), the factor of resistances that hold at a reference temperature; 1 for A = 0.

    temperature_degC: T, float, array or traced; activation_K: A, activation energy over the gas constant [K].
    """
    if activation_K == 0.0:
        return 1.0
    return exp(activation_K * coldness_per_K(temperature_degC, reference_degC))


def coldness_per_K(temperature_degC: Any, reference_degC: float) -> Any:
    """1/T - 1/T_0 [1/K], the distance from a reference temperature in an Arrhenius law; > 0 where it is colder."""
    return 1 / (temperature_degC + KELVIN) - 1 / (reference_degC + KELVIN)
