"""Checks that the battery file fits the log: the estimates must not need errors that sensor and battery cannot have.

With a file of another battery, chemistry or capacity, or a current of the wrong sign or unit, the filter explains the
voltage by whatever state may be in error, and is confident. Three signs are in its estimates: an offset that the
current sensor cannot have, a capacity that no such battery has, and innovations that stay larger than the filter
expects. Two are in the log itself: another number of cells explains the voltage, or the current misses a charge.

A spike of the voltage says nothing about the file. An innovation outside the gate counts as its limit, so that only
errors over a large share of the time make a misfit.
"""

from __future__ import annotations

import math
from typing import TypeGuard

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.log_check import OTHER_FILE, contradictions
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter
from ohmward.battery.soc.sample import Estimator, SocEstimate
from ohmward.battery.soc.thevenin_filter import TheveninFilter, implausible_capacity
from ohmward.logs.log import Log, Note
from ohmward.runs import window_starts

#: Root mean square of innovations over their standard deviations. It is 1 for single samples where the model holds, and
#: at most 1 for their means over some minutes, however long an error of the model lasts.
MOST_EXCESS = 1.0
LASTING_S = 600.0
#: First words where the battery file does not fit.
DO_NOT_TRUST = "The battery file does not fit this log, do not trust the estimate."
#: A battery below this state of charge by the estimate gives no more than this share of its capacity.
AFTER_EMPTY_SOC, MOST_AFTER_EMPTY = 0.02, 0.15
#: Fewer innovations are too few for a mean.
LEAST_INNOVATIONS = 100
#: Larger innovations, in their standard deviations, count as this: the limit of the filters' gate.
LARGEST = math.sqrt(TheveninFilter.gate)


def misfits(battery: Battery, log: Log, settings: Estimator, estimates: SocEstimate) -> tuple[Note, ...]:
    """Warnings that the battery file does not fit the log and the estimates are not to be trusted; () where it does.

    settings, estimates: of the estimator that ran over the log. Only filters that have the errors of sensor and model
        as states are judged; the innovations of others are always larger than they expect.
    """
    found = list(contradictions(log, battery))
    if is_judged(settings) and (needed := _needed(battery, log, settings, estimates)):
        found.append(f"it would need {' and '.join(needed)}{'' if found else f'; {OTHER_FILE}'}")
    return (Note(f"the battery file does not fit the log: {'; '.join(found)}", "warning"),) if found else ()


def is_judged(settings: Estimator) -> TypeGuard[TheveninFilter | GaussianSumFilter]:
    """True for an estimator whose estimates show whether the file fits."""
    return isinstance(settings, TheveninFilter | GaussianSumFilter)


def _needed(
    battery: Battery, log: Log, settings: TheveninFilter | GaussianSumFilter, estimates: SocEstimate
) -> list[str]:
    """Errors that it would take to explain the log with this file, but that sensor and battery cannot have."""
    sensor = settings.sensor
    offset_A, capacity = float(estimates.current_offset_A[-1]), float(estimates.soh_capacity[-1])
    needed = []
    if sensor.contradicts(offset_A):
        times = abs(offset_A - sensor.offset_A) / sensor.offset_after_a_day_std_A
        needed.append(f"an offset of the current sensor of {offset_A:.3g} A, {times:.1f} times its standard deviation")
    if implausible_capacity(capacity):
        needed.append(f"a capacity of {capacity:.2g} times the file's")
    if (after_empty := given_after_empty(battery, log, estimates)) > MOST_AFTER_EMPTY:
        needed.append(f"{after_empty:.0%} of its capacity given after it was empty")
    if (excess := lasting_error(log.time_s, estimates)) > MOST_EXCESS:
        needed.append(f"errors of the voltage {excess:.1f} times as large as the file expects")
    return needed


def given_after_empty(battery: Battery, log: Log, estimates: SocEstimate) -> float:
    """Charge that the battery gave on balance where the estimate was empty, over the capacity of the file."""
    charge_Ah = log.charge_Ah()
    empty = estimates.soc < AFTER_EMPTY_SOC
    moved_Ah = np.diff(charge_Ah, prepend=charge_Ah[0])[empty]
    return -float(np.nansum(moved_Ah)) / battery.capacity_Ah


def lasting_error(time_s: np.ndarray, estimates: SocEstimate) -> float:
    """Errors of the voltage over the expected ones: of single samples or of means over minutes, whichever is larger.

    nan where there are too few.
    """
    e = estimates
    used = np.isfinite(e.innovation_V) & (e.voltage_std_V > 0.0)
    if np.count_nonzero(used) < LEAST_INNOVATIONS:
        return math.nan
    normalised = np.clip(e.innovation_V[used] / e.voltage_std_V[used], -LARGEST, LARGEST)
    begins = window_starts(time_s[used], LASTING_S, time_s[0] // LASTING_S * LASTING_S)
    means = np.add.reduceat(normalised, begins) / np.diff(begins, append=normalised.size)
    return float(np.sqrt(max(normalised @ normalised / normalised.size, np.mean(means**2))))
