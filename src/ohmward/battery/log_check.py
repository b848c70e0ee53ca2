"""Check that a log can be of the battery that it is estimated with, and under conditions that its tests have shown."""

from __future__ import annotations

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.temperature import KELVIN
from ohmward.errors import InputError
from ohmward.logs.log import Log, Note

#: The tests behind a battery file cover its usual voltages: beyond them by this share the log is of another battery,
OTHER_BATTERY = 0.2
#: and by this share single voltages are worth a warning.
BEYOND_TESTS = 0.02
#: A charger holds a battery above its open-circuit voltage, but not by this share for most of a log.
ABOVE_FULL = 0.1
#: A resistance that is known worse than this at a temperature of the log is worth a warning (1 sigma, relative).
DOUBTFUL_RESISTANCE = 0.1


def check_log(log: Log, battery: Battery) -> Log:
    """The log, with a warning where its voltage leaves the range of the battery's tests by more than 2 %.

    Likewise where the tests say little of the resistance at its temperatures, and where its usual voltage is that of
    another number of cells.

    Raises:
        InputError: the median voltage is more than 20 % outside: another battery, or another unit.
    """
    low_V, high_V = battery.voltage_min_V, battery.voltage_max_V
    usual_V = float(np.nanmedian(log.voltage_V))
    if not (1 - OTHER_BATTERY) * low_V <= usual_V <= (1 + OTHER_BATTERY) * high_V:
        raise InputError(
            f"{log.name}: its voltage is usually {usual_V:.4g} V, but battery {battery.name!r} was seen between "
            f"{low_V:g} and {high_V:g} V; is it a log of another battery, of one of its cells, or in another unit "
            "(--unit voltage=mV)?"
        )
    log = _check_cells(_check_temperature(log, battery), battery)
    outside = (log.voltage_V < (1 - BEYOND_TESTS) * low_V) | (log.voltage_V > (1 + BEYOND_TESTS) * high_V)
    if not outside.any():
        return log
    text = f"{outside.mean():.2%} of the voltages lie outside the battery's tests, {low_V:g} to {high_V:g} V"
    return log.with_notes(Note(text, "warning"))


def _check_cells(log: Log, battery: Battery) -> Log:
    """The log, with a warning where its usual voltage is not between those of the empty and of the full battery."""
    contradiction = other_cells(log, battery)
    return log.with_notes(Note(contradiction, "warning")) if contradiction else log


def other_cells(log: Log, battery: Battery) -> str:
    """Contradiction of the log's usual voltage with the number of cells in the battery file; "" for none."""
    model = battery.thevenin or battery.rc
    curve_V = model.ocv.voltage_V if model else (-np.inf, np.inf)
    usual_V = float(np.nanmedian(log.voltage_V))
    if curve_V[0] <= usual_V <= (1 + ABOVE_FULL) * curve_V[-1]:
        return ""
    return (
        f"its usual voltage, {usual_V:.4g} V, contradicts the battery file, {curve_V[0]:.4g} V (empty) to "
        f"{curve_V[-1]:.4g} V (full) with n_series = {battery.n_series}: another number of cells in series?"
    )


def _check_temperature(log: Log, battery: Battery) -> Log:
    """The log, with a warning where the resistance is doubtful at its temperatures."""
    if battery.thevenin is None or log.temperature_degC is None or not np.isfinite(log.temperature_degC).any():
        return log
    degC, reference_degC = log.temperature_degC, battery.thevenin.reference_degC
    spread = battery.noise.activation_std_K * np.abs(1 / (degC + KELVIN) - 1 / (reference_degC + KELVIN))
    worst = int(np.nanargmax(spread))
    if spread[worst] < DOUBTFUL_RESISTANCE:
        return log
    text = (
        f"the log goes to {degC[worst]:z.0f} degC, where the resistance follows from {reference_degC:z.0f} degC within "
        f"± {spread[worst]:.0%} only (1 sigma); the band is wider there"
    )
    return log.with_notes(Note(text, "warning"))
