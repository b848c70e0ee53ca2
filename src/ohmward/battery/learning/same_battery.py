"""Check that a log is of the battery of the file: capacity and resistance of the log alone against those of the file.

The log is learnt once more from the widths of a label, as if nothing else were known. Where what it then tells differs
from the file by far more than both may err, it is of another battery, or of this one after a change that no log showed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal, start_noise

#: Length of the vector of both differences, in their standard deviations, that sets a log aside. Later logs of one
#: battery stay below 2.0 in six simulated cells and below 2.6 in measured ones; the same cell with 80 % of its charge
#: and 1.5 times its resistance lies 3 to 5 off.
_OTHER_BATTERY = 3.5
#: A shorter one does where the file explains the log far worse than the log alone would be: by this much of the
#: logarithm of the likelihood. It is below 40 for later logs of one battery, and 61 to 300 for that other cell.
_DOUBTFUL, _EXPLAINED_WORSE = 1.5, 60.0
#: A label may be wrong by more than a battery file: a battery at the end of its life has 70 % of it.
_OTHER_LABEL = 4.5
#: A log that goes through more than this share of the capacity that was fitted to it is of a larger battery: SoC axis
#: and sensor err by less.
_DEEPEST = 1.15
#: A difference that is told, where both together have set a log aside.
_WORTH_TELLING = 1.0


class CapacityAndResistance(NamedTuple):
    """Capacity [Ah] and resistance to ten seconds of current [ohm], as a file or a log tells them."""

    capacity_Ah: Normal
    resistance_ohm: Normal


def forgotten(battery: Battery) -> Battery:
    """The battery as its label tells it: the values of the file, with widths as before any test or log."""
    label, noise = start_noise(battery.chemistry, battery.n_series), battery.noise
    wide = replace(
        noise,
        capacity_std=max(noise.capacity_std, label.capacity_std),
        resistance_std=max(noise.resistance_std, label.resistance_std),
        model_std_V=label.model_std_V,
        model_soc_length=label.model_soc_length,
        overpotential_share=label.overpotential_share,
        soc_axis_std=max(noise.soc_axis_std, label.soc_axis_std),
        activation_std_K=max(noise.activation_std_K, label.activation_std_K),
    )
    return replace(battery, noise=wide, knowledge=None)


def is_label(battery: Battery) -> bool:
    """True for a file that is as doubtful as a label."""
    label = start_noise(battery.chemistry, battery.n_series)
    return battery.knowledge is None and battery.noise.resistance_std >= label.resistance_std


def other_label(known: CapacityAndResistance, after: CapacityAndResistance) -> str:
    """Contradiction of a log with the label that the file was made from; "" for none."""
    return _contradiction(known, after, [_moved(old, new) for old, new in zip(known, after, strict=True)], _OTHER_LABEL)


def too_small(capacity_Ah: Normal, depth: float) -> str:
    """Contradiction of a log with a capacity [Ah] of which it goes through a share `depth`; "" for none."""
    if depth <= _DEEPEST:
        return ""
    larger = f"its capacity is {depth * capacity_Ah.mean:.3g} Ah at least, by the charge that the log counts"
    return _refusal(f"{larger}, that of the file {capacity_Ah.mean:.3g} +- {capacity_Ah.std:.2g} Ah")


def other_battery(known: CapacityAndResistance, alone: CapacityAndResistance, explained_worse: float = 0.0) -> str:
    """Contradiction of a log with a file that knows its battery; "" for none.

    alone: what the log tells with nothing else known.
    explained_worse: see the function of this name.
    """
    z = [_log_ratio(old, new) / np.hypot(_share(old), _share(new)) for old, new in zip(known, alone, strict=True)]
    limit = _DOUBTFUL if explained_worse > _EXPLAINED_WORSE else _OTHER_BATTERY
    return _contradiction(known, alone, z, limit)


def explained_worse(duration_s: float, correlation_s: float, rms_V: float, alone_rms_V: float) -> float:
    """Logarithm of the likelihood that a log loses where the file, not the log alone, has to explain it.

    n ln(rms / rms_alone) with n = duration / (2 correlation time) errors that are independent, each counting twice.

    correlation_s: for which an error of the model holds on; rms_V, alone_rms_V: of the errors of the voltage.
    """
    if not (rms_V > 0.0 and alone_rms_V > 0.0):
        return 0.0
    return float(duration_s / correlation_s * np.log(rms_V / alone_rms_V))


def _contradiction(known: CapacityAndResistance, found: CapacityAndResistance, z: list[float], limit: float) -> str:
    """Sentence on the differences, z of which are those in standard deviations, where they are beyond the limit."""
    if np.linalg.norm(z) < limit:
        return ""
    units = (("capacity", "Ah", 1.0), ("resistance", "mohm", 1e3))
    differ = [
        f"its {name} is {scale * new.mean:.3g} +- {scale * new.std:.2g} {unit}, that of the file "
        f"{scale * old.mean:.3g} +- {scale * old.std:.2g} {unit}"
        for (name, unit, scale), old, new, off in zip(units, known, found, z, strict=True)
        if abs(off) > _WORTH_TELLING
    ]
    return _refusal(" and ".join(differ))


def _refusal(difference: str) -> str:
    return (
        f"this is not the battery of the file: {difference} (1 sigma); keep a file for each battery. If "
        "it is the same one nevertheless, begin anew with `ohmward generic` and its present capacity"
    )


def _moved(old: Normal, new: Normal) -> float:
    """Change of the logarithm in standard deviations of what was known before."""
    return _log_ratio(old, new) / _share(old)


def _log_ratio(old: Normal, new: Normal) -> float:
    return float(np.log(new.mean / old.mean))


def _share(value: Normal) -> float:
    """Relative standard deviation."""
    return value.std / value.mean
