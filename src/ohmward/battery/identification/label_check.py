"""Check of the chemistry and the number of cells that the user names against the voltage of the logs."""

from __future__ import annotations

import numpy as np

from ohmward.battery.chemistries import chemistry as chemistry_of
from ohmward.logs.log import Note

#: Cells of one chemistry differ, and a log may be a charge: usual voltages beyond the curve by this share are others'.
_BEYOND_CURVE = 0.08


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
