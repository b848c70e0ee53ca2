"""Checks of a fitted circuit: tests that it does not reproduce, and the part of them that no circuit can."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.battery.battery import Battery, LogFit
from ohmward.battery.chemistries import chemistry as chemistry_of
from ohmward.battery.identification.log_details import LogDetails
from ohmward.battery.log_check import OTHER_FILE
from ohmward.battery.models.ocv import OcvCurve
from ohmward.logs.log import Note

#: Cells of one chemistry differ, and a log may be a charge: usual voltages beyond the curve by this share are others'.
_BEYOND_CURVE = 0.08


#: Largest error of the voltage, RMS, over the range of the open-circuit voltage from empty to full. Tests of twenty
#: cells, measured and of porous electrodes, are reproduced within 0.041 by files that then estimate well.
MOST_OF_RANGE = 0.1


def reproduces(battery: Battery) -> bool:
    """True where the circuit of the battery reproduces every log that it was fitted to."""
    model, origin = battery.thevenin, battery.identification
    return model is None or origin is None or all(_within(fit, model.ocv) for fit in origin.logs)


def _within(fit: LogFit, ocv: OcvCurve) -> bool:
    return fit.residual_rms_V <= MOST_OF_RANGE * _range_V(ocv)


def _range_V(ocv: OcvCurve) -> float:
    return ocv.voltage_V[-1] - ocv.voltage_V[0]


def fit_notes(logs: Sequence[LogDetails], fits: Sequence[LogFit], ocv: OcvCurve) -> tuple[Note, ...]:
    """A warning for each log that the circuit does not reproduce, and where gassing was left out."""
    doubted = (_misfit(fit, ocv) for fit in fits if not _within(fit, ocv))
    return (*(_gassing(log) for log in logs if log.gassing_share > 0.0), *doubted)


def _misfit(fit: LogFit, ocv: OcvCurve) -> Note:
    text = (
        f"the model does not fit {fit.log!r}: its voltage is off by {fit.residual_rms_V:.3g} V RMS "
        f"where empty and full are {_range_V(ocv):.3g} V apart; {OTHER_FILE}"
    )
    return Note(text, "warning")


def _gassing(log: LogDetails) -> Note:
    text = (
        f"{log.gassing_share:.0%} of {log.record.log.name!r} lie above {log.gassing_V:.4g} V, where the battery gases: "
        "no circuit models that, the voltage error leaves it out, and the filters do not use it"
    )
    return Note(text)


def label_notes(voltage_V: np.ndarray, chemistry: str, n_series: int) -> tuple[Note, ...]:
    """A warning where the usual voltage of the logs is not that of so many cells of this chemistry.

    voltage_V: (T,) of all logs.  chemistry: "" where nobody says.
    """
    if not chemistry:
        return ()
    empty_V, *_, full_V = chemistry_of(chemistry).ocv_V
    low_V, high_V = (1 - _BEYOND_CURVE) * empty_V, (1 + _BEYOND_CURVE) * full_V
    usual_V = float(np.nanmedian(voltage_V))
    if low_V <= usual_V / n_series <= high_V:
        return ()
    fitting = [n for n in range(1, int(usual_V / low_V) + 1) if low_V <= usual_V / n <= high_V]
    advice = f"; {' or '.join(map(str, fitting))} would fit" if fitting else "; is the chemistry another one?"
    text = (
        f"the usual voltage of the logs, {usual_V:.4g} V, is {usual_V / n_series:.3g} V a cell with n_series = "
        f"{n_series}, but cells of {chemistry} have {empty_V:g} to {full_V:g} V{advice}"
    )
    return (Note(text, "warning"),)
