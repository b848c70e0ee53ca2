"""Check that a log is of the battery of the file: estimates from the log alone against those of the file.

The log is learnt once more with the prior of a label, as if nothing else were known. Where its estimates then differ
from the file's by far more than the errors of both, it is of another battery, or of this one after a change that no log
showed; where only the offset of the current sensor does, of another sensor. A log whose voltage follows from its
current for no parameter values contradicts itself: its current is not that of the battery.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal, start_noise
from ohmward.battery.learning.fold import KnownBattery
from ohmward.battery.learning.log_update import LogUpdate
from ohmward.battery.models.noise import OFFSET_SHARE
from ohmward.filters.consistency import BAND_95

#: Norm of both differences, in their standard deviations, above which a log is set aside. Later logs of one battery
#: stay below 2.0 in six simulated cells and below 2.6 in measured ones; the same cell with 80 % of its charge and 1.5
#: times its resistance lies 3 to 5 off.
_OTHER_BATTERY_STD = 3.5
#: A smaller norm is enough where the file explains the log far worse than a fit to the log alone: by this much of the
#: logarithm of the likelihood. It is below 40 for later logs of one battery, and 61 to 300 for that other cell.
_DOUBTFUL, _EXPLAINED_WORSE = 1.5, 60.0
#: A label may be wrong by more than a battery file: a battery at the end of its life has 70 % of its capacity.
_OTHER_LABEL = 4.5
#: A log that goes through more than this multiple of the capacity that was fitted to it is of a larger battery: SoC
#: axis and sensor err by less.
_DEEPEST_DISCHARGE = 1.15
#: A log that moves capacity and resistance together by less than this many standard deviations of the file, with a
#: misfit below this, confirms it: a file's standard deviations are never below a seventh of those of a log alone, so
#: that a log which differed by `_OTHER_BATTERY_STD` would move them by 0.5.
_CONFIRMS, _FITS = 0.2, 1.1
#: Smallest difference that is reported, in standard deviations, where both together have set a log aside.
_WORTH_REPORTING = 1.0
#: Difference of the sensor's offset, in standard deviations, beyond which the sensor is another one, or has a fault.
_OTHER_SENSOR = 4.5
#: Largest change of capacity and resistance by one log, in standard deviations of a file that has learnt. Good logs of
#: nine measured and six simulated batteries move them by less than 2.5, a voltage that reads 3 % too high by 4.6.
_MOVED = 4.0
#: Misfit of a log whose voltage does not follow from its current. It is 1.0 to 1.6 in good logs of these batteries, 6
#: in one at 0 degC that follows one at -10 degC, and 15 to 1300 where a sensor was dead for hours, has lost the sign,
#: or does not see the charger. From a label, whose wide prior fits any good log, a smaller one is suspect: it is 4 to
#: 8 where the sign is lost.
_UNEXPLAINED_MISFIT, MISFITS = 12.0, 3.0


def forgotten(battery: Battery) -> Battery:
    """The battery as its label gives it: the values of the file, with standard deviations as before any test or log."""
    label, noise, sensor = start_noise(battery.chemistry, battery.n_series), battery.noise, battery.sensor
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
    offset_std_A = max(sensor.offset_std_A, OFFSET_SHARE * battery.capacity_Ah)
    return replace(battery, noise=wide, sensor=replace(sensor, offset_std_A=offset_std_A), knowledge=None)


def is_label(battery: Battery) -> bool:
    """True for a file that is as uncertain as a label."""
    label = start_noise(battery.chemistry, battery.n_series)
    return battery.knowledge is None and battery.noise.resistance_std >= label.resistance_std


def unexplained(found: LogUpdate, most: float = _UNEXPLAINED_MISFIT) -> str:
    """Contradiction of a log with itself: its voltage does not follow from its current; "" for none."""
    if not found.misfit > most:
        return ""
    expected_V = found.residual_rms_V / math.sqrt(found.misfit)
    return (
        f"its voltage does not follow from its current: {1e3 * found.residual_rms_V:.3g} mV off, where "
        f"{1e3 * expected_V:.2g} mV are expected; was the current sensor dead for a while, does it miss the charger or "
        "a load, has the column lost its sign or its unit?"
    )


def confirms(known: KnownBattery, after: LogUpdate) -> bool:
    """True for a log that fits its file and moves nothing in it: it need not be learnt alone."""
    return bool(np.linalg.norm(_moved(known, after)) < _CONFIRMS and after.misfit < _FITS)


def other_label(known: KnownBattery, after: LogUpdate) -> str:
    """Contradiction of a log with the label that the file was made from; "" for none."""
    limit = _OTHER_BATTERY_STD if after.misfit > MISFITS else _OTHER_LABEL
    return _contradiction(known, after, _moved(known, after), limit) or _other_sensor(known, after, known.offset_A.std)


def moved_too_far(known: KnownBattery, after: LogUpdate) -> str:
    """Contradiction of a log that moves the file's values further than their errors allow; "" for none."""
    return _contradiction(known, after, _moved(known, after), _MOVED)


def too_small(capacity_Ah: Normal, depth: float) -> str:
    """Contradiction of a log with a capacity [Ah] of which it goes through a share `depth`; "" for none."""
    if depth <= _DEEPEST_DISCHARGE:
        return ""
    larger = f"its capacity is {depth * capacity_Ah.mean:.3g} Ah at least, by the charge that the log counts"
    return _refusal(f"{larger}, in the file {_band(capacity_Ah)} Ah")


def other_battery(known: KnownBattery, alone: LogUpdate, explained_worse: float = 0.0) -> str:
    """Contradiction of a log with a file that knows its battery; "" for none.

    alone: estimates from the log with nothing else known.
    explained_worse: see the function of this name.
    """
    pairs = _pairs(known, alone)
    z = [_log_ratio(old, new) / np.hypot(old.relative_std, new.relative_std) for old, new in pairs]
    if explained_worse <= _EXPLAINED_WORSE:
        return _contradiction(known, alone, z, _OTHER_BATTERY_STD)
    sensor_std_A = float(np.hypot(known.offset_A.std, alone.offset_A.std))
    return _other_sensor(known, alone, sensor_std_A) or _contradiction(known, alone, z, _DOUBTFUL)


def explained_worse(duration_s: float, correlation_s: float, rms_V: float, alone_rms_V: float) -> float:
    """Logarithm of the likelihood that a log loses where the file, not the log alone, has to explain it.

    n ln(rms / rms_alone) with n = duration / (2 correlation time) errors that are independent, each counting twice.

    correlation_s: correlation time of the model's error; rms_V, alone_rms_V: of the errors of the voltage.
    """
    if not (rms_V > 0.0 and alone_rms_V > 0.0):
        return 0.0
    return float(duration_s / correlation_s * np.log(rms_V / alone_rms_V))


def _other_sensor(known: KnownBattery, found: LogUpdate, std_A: float) -> str:
    """Contradiction of the offset of the current sensor with the one of the file; "" for none."""
    off_A = found.offset_A.mean - known.offset_A.mean
    if abs(off_A) <= _OTHER_SENSOR * std_A:
        return ""
    return (
        f"its current sensor shows {_band(found.offset_A)} A where none flows, in the file "
        f"{_band(known.offset_A)} A (95 %); check the sensor; "
        "for another one start again with `ohmward generic` and the present capacity"
    )


def _contradiction(known: KnownBattery, found: LogUpdate, z: list[float], limit: float) -> str:
    """Sentence on the differences, z in standard deviations, where their norm is beyond the limit."""
    if np.linalg.norm(z) < limit:
        return ""
    units = (("capacity", "Ah", 1.0), ("resistance", "mohm", 1e3))
    differences = [
        f"its {name} is {_band(new, scale)} {unit}, in the file {_band(old, scale)} {unit}"
        for (name, unit, scale), (old, new) in zip(units, _pairs(known, found), strict=True)
    ]
    reported = [text for text, off in zip(differences, z, strict=True) if abs(off) > _WORTH_REPORTING]
    return _refusal(" and ".join(reported))


def _refusal(difference: str) -> str:
    return (
        f"this is not the battery of the file: {difference} (95 %); keep a file for each battery. If "
        "it is the same one nevertheless, start again with `ohmward generic` and its present capacity"
    )


def _moved(known: KnownBattery, after: LogUpdate) -> list[float]:
    """Changes of the logarithms of capacity and resistance in standard deviations of what was known before."""
    return [_log_ratio(old, new) / old.relative_std for old, new in _pairs(known, after)]


def _pairs(known: KnownBattery, found: LogUpdate) -> tuple[tuple[Normal, Normal], tuple[Normal, Normal]]:
    """Capacity and resistance of the file, each beside that of the log."""
    return (known.capacity_Ah, found.capacity_Ah), (known.resistance_ohm, found.resistance_ohm)


def _log_ratio(old: Normal, new: Normal) -> float:
    return float(np.log(new.mean / old.mean))


def _band(value: Normal, scale: float = 1.0) -> str:
    """A mean and the half width of its 95 % band."""
    return f"{scale * value.mean:.3g} ± {scale * BAND_95 * value.std:.2g}"
