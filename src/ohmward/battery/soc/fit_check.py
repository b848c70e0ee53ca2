"""Checks that the battery file fits the log: the estimates must not need errors that sensor and battery cannot have.

With a file of another battery, chemistry or capacity, or a current of the wrong sign or unit, the filter explains the
voltage by whatever state may be in error, and is confident. Four signs are in its estimates: an offset that the
current sensor cannot have, a capacity that no such battery has, innovations that stay larger than the filter expects,
and a state of charge that leaves its own band although hardly any charge flowed. Two are in the log itself: another
number of cells or capacity explains the voltage, or the current misses a charge.

A spike of the voltage says nothing about the file. An innovation outside the gate counts as its limit, so that only
errors over a large share of the time make a misfit.
"""

from __future__ import annotations

import math

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.log_check import OTHER_FILE, contradictions
from ohmward.battery.models.noise import CurrentSensor
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter, carries_errors
from ohmward.battery.soc.sample import Estimator, SocEstimate, SocFlag
from ohmward.battery.soc.thevenin_filter import TheveninFilter, implausible_capacity
from ohmward.logs.log import Log, Note
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.runs import window_starts

#: Root mean square of innovations over their standard deviations. It is 1 for single samples where the model holds, and
#: at most 1 for their means over some minutes, however long an error of the model lasts.
MOST_EXCESS = 1.0
LASTING_S = 600.0
#: First words where the battery file does not fit.
DO_NOT_TRUST = "The battery file does not fit this log, do not trust the estimate."
#: A battery below this state of charge by the estimate gives no more than this share of its capacity.
AFTER_EMPTY_SOC, MOST_AFTER_EMPTY = 0.02, 0.15
#: An estimate moves, beyond the counted charge, by no more than its standard deviation before, on average. More than
#: this many times that contradict it: the most on measured cells is 1.7, also from starts that were given 30 points
#: wrong. The counted charge, at most this share of the capacity, is known to within this share of itself.
MOST_MOVED, MOST_COUNTED, COUNTED_STD = 3.5, 0.1, 0.2
#: Number of estimates along a log that are compared, and how many with all before them at once, so that the tables stay
#: in the cache; none across samples with these flags.
_COMPARED, _WITH_ALL_BEFORE = 500, 64
_APART = SocFlag.GAP | SocFlag.RESTARTED | SocFlag.DIVERGED | SocFlag.NO_CURRENT | SocFlag.EXCHANGED
#: A filter with the right battery misses half of the voltages by less than this share of them.
MOST_MISSED = 0.05
#: Fewer innovations are too few for a mean.
LEAST_INNOVATIONS = 100
#: Larger innovations, in their standard deviations, count as this: the limit of the filters' gate.
LARGEST = math.sqrt(TheveninFilter.gate)


def misfits(
    battery: Battery, log: Log, settings: Estimator, estimates: SocEstimate, in_itself: bool = True
) -> tuple[Note, ...]:
    """Warnings that the battery file does not fit the log and the estimates are not to be trusted; () where it does.

    settings, estimates: of the estimator that ran over the log. Only filters that have the errors of sensor and model
        as states are judged; the innovations of others are always larger than they expect.
    in_itself: False leaves out estimates that contradict themselves and another capacity: learning from the log may
        cure these.
    """
    found = list(contradictions(log, battery, of_capacity=in_itself))
    if carries_errors(settings) and (needed := _needed(battery, log, settings, estimates, in_itself)):
        found.append(f"it would need {' and '.join(needed)}{'' if found else f'; {OTHER_FILE}'}")
    return (Note(f"the battery file does not fit the log: {'; '.join(found)}", "warning"),) if found else ()


def _needed(
    battery: Battery,
    log: Log,
    settings: TheveninFilter | GaussianSumFilter,
    estimates: SocEstimate,
    in_itself: bool,
) -> list[str]:
    """Errors that it would take to explain the log with this file, but that sensor and battery cannot have."""
    sensor, charge_Ah = settings.sensor, log.charge_Ah()
    offset_A, capacity = float(estimates.current_offset_A[-1]), float(estimates.soh_capacity[-1])
    needed = []
    if sensor.contradicts(offset_A):
        times = abs(offset_A - sensor.offset_A) / sensor.offset_after_a_day_std_A
        needed.append(f"an offset of the current sensor of {offset_A:.3g} A, {times:.1f} times its standard deviation")
    if implausible_capacity(capacity):
        needed.append(f"a capacity of {capacity:.2g} times the file's")
    if (after_empty := given_after_empty(battery, charge_Ah, estimates)) > MOST_AFTER_EMPTY:
        needed.append(f"{after_empty:.0%} of its capacity given after it was empty")
    moved = moved_uncounted(log.time_s, charge_Ah, estimates, battery.capacity_Ah, sensor) if in_itself else 0.0
    if moved > MOST_MOVED:
        needed.append(f"a state of charge that moved by itself, by {moved:.1f} of its standard deviations")
    if (excess := lasting_error(log.time_s, estimates)) > MOST_EXCESS:
        needed.append(f"errors of the voltage {excess:.2f} times as large as the file expects")
    return needed


def voltage_missed(voltage_V: np.ndarray, estimates: SocEstimate) -> tuple[Note, ...]:
    """A warning where a filter without its battery file, as on a microcontroller, never comes near the voltage.

    voltage_V: (T,) of the log.
    """
    known = np.isfinite(voltage_V)
    used = np.isfinite(estimates.innovation_V[known])
    usual_V = float(np.median(np.abs(voltage_V[known]))) if known.any() else 0.0
    missed_V = float(np.median(np.abs(estimates.innovation_V[known][used]))) if used.any() else 0.0
    if used.any() and missed_V > MOST_MISSED * usual_V:
        fault = f"half of the voltages are missed by more than {missed_V:.3g} V of {usual_V:.4g} V"
    elif known.any() and not used.any() and np.isfinite(estimates.voltage_V).any():
        fault = f"its battery shows no voltage like the {usual_V:.4g} V of the log, which is not used"
    else:
        return ()
    return (Note(f"the library does not fit the log, do not trust its estimate: {fault}; {OTHER_FILE}", "warning"),)


def given_after_empty(battery: Battery, charge_Ah: np.ndarray, estimates: SocEstimate) -> float:
    """Charge that the battery gave on balance where the estimate was empty, over the capacity of the file.

    charge_Ah: (T,) counted along the log.
    """
    rows = np.flatnonzero(estimates.soc[1:] < AFTER_EMPTY_SOC)
    moved_Ah = charge_Ah[rows + 1] - charge_Ah[rows]
    return -float(np.nansum(moved_Ah)) / battery.capacity_Ah


def moved_uncounted(
    time_s: np.ndarray, charge_Ah: np.ndarray, estimates: SocEstimate, capacity_Ah: float, sensor: CurrentSensor
) -> float:
    """Largest move of the state of charge beyond the counted charge, over the standard deviation before it.

    The means of a filter are a martingale: later ones lie about an earlier one as widely as it is uncertain. The
    counted charge is without the offset of the file.

    time_s, charge_Ah: (T,) along the log.
    """
    rows = np.unique(np.linspace(0, len(time_s) - 1, min(_COMPARED, len(time_s))).astype(int))
    flagged = np.flatnonzero(estimates.flags)
    begins = flagged[np.asarray(estimates.flags)[flagged].astype(int) & int(_APART) > 0]
    part = np.searchsorted(begins, rows, side="right")
    time_s = time_s[rows]
    offset_Ah = sensor.offset_A / SECONDS_PER_HOUR * (time_s - time_s[0])
    counted = (charge_Ah[rows] - offset_Ah) / capacity_Ah
    uncounted, soc_std = estimates.soc[rows] - counted, estimates.soc_std[rows]
    offset_std_per_s = sensor.offset_std_A / SECONDS_PER_HOUR / capacity_Ah
    most = 0.0
    for first in range(0, len(rows), _WITH_ALL_BEFORE):
        now, before = slice(first, first + _WITH_ALL_BEFORE), slice(first + _WITH_ALL_BEFORE)
        apart = np.subtract.outer(uncounted[now], uncounted[before])
        counted_std = COUNTED_STD * np.subtract.outer(counted[now], counted[before])
        offset_std = offset_std_per_s * np.subtract.outer(time_s[now], time_s[before])
        std = np.sqrt(soc_std[before] ** 2 + counted_std**2 + offset_std**2)
        comparable = np.equal.outer(part[now], part[before]) & (np.abs(counted_std) < COUNTED_STD * MOST_COUNTED)
        later = comparable & np.greater.outer(rows[now], rows[before])
        most = float(np.max(np.abs(apart) / std, initial=most, where=later & (std > 0.0)))
    return most


def lasting_error(time_s: np.ndarray, estimates: SocEstimate) -> float:
    """Errors of the voltage over the expected ones: of single samples or of means over minutes, whichever is larger.

    nan where there are too few.
    """
    e = estimates
    used = np.flatnonzero(np.isfinite(e.innovation_V) & (e.voltage_std_V > 0.0))
    if used.size < LEAST_INNOVATIONS:
        return math.nan
    rows = slice(None) if used.size == time_s.size else used
    normalised = e.innovation_V[rows] / e.voltage_std_V[rows]
    np.clip(normalised, -LARGEST, LARGEST, out=normalised)
    begins = window_starts(time_s[rows], LASTING_S, time_s[0] // LASTING_S * LASTING_S)
    means = np.add.reduceat(normalised, begins) / np.diff(begins, append=normalised.size)
    return float(np.sqrt(max(normalised @ normalised / normalised.size, np.mean(means**2))))
