"""Check that a log can be of the battery that it is estimated with."""

from __future__ import annotations

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.errors import InputError
from ohmward.logs.log import Log, Note

#: The tests behind a battery file cover its usual voltages: beyond them by this share the log is of another battery,
OTHER_BATTERY = 0.2
#: and by this share single voltages are worth a warning.
BEYOND_TESTS = 0.02


def check_log(log: Log, battery: Battery) -> Log:
    """The log, with a warning where its voltage leaves the range of the battery's tests by more than 2 %.

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
    outside = (log.voltage_V < (1 - BEYOND_TESTS) * low_V) | (log.voltage_V > (1 + BEYOND_TESTS) * high_V)
    if not outside.any():
        return log
    text = f"{outside.mean():.2%} of the voltages lie outside the battery's tests, {low_V:g} to {high_V:g} V"
    return log.with_notes(Note(text, "warning"))
