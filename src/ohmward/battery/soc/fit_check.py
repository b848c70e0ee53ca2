"""Checks that the battery file fits the log: errors that no sensor and no battery of this kind has are no estimates.

A file of another battery, chemistry or capacity, a current of the wrong sign or unit: the filter then explains the
voltage by whatever state may err, and is sure of it. Three things show it: an offset that the current sensor cannot
have, a capacity that no such battery has, and innovations that stay larger than the filter expects.
"""

from __future__ import annotations

import math

import numpy as np

from ohmward.battery.soc.gaussian_sum import GaussianSumFilter
from ohmward.battery.soc.misfit import implausible_capacity
from ohmward.battery.soc.sample import SocEstimate
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.filters.run import Run
from ohmward.logs.log import Note

#: Root mean square of innovations over their standard deviations. It is 1 for single samples where the model holds, and
#: at most 1 for their means over some minutes, however long an error of the model lasts.
MOST_EXCESS = 1.0
LASTING_S = 600.0
#: Fewer innovations are too few for a mean.
LEAST_INNOVATIONS = 100

_ADVICE = (
    "is the battery file of this battery, with its chemistry and capacity, and are sign and unit of the current right?"
)


def misfits(run: Run[SocEstimate]) -> tuple[Note, ...]:
    """A warning that the battery file does not fit the log and the estimates are not to be trusted; () where it does.

    Only of filters whose states are the errors of sensor and model too; the innovations of others always are larger
    than they expect.
    """
    if not isinstance(run.settings, TheveninFilter | GaussianSumFilter):
        return ()
    sensor = run.settings.sensor
    offset_A, capacity = float(run.estimates.current_offset_A[-1]), float(run.estimates.soh_capacity[-1])
    needed = []
    if sensor.contradicts(offset_A):
        times = abs(offset_A - sensor.offset_A) / sensor.offset_std_A
        needed.append(f"an offset of the current sensor of {offset_A:.3g} A, {times:.1f} times its standard deviation")
    if implausible_capacity(capacity):
        needed.append(f"a capacity of {capacity:.2g} times the file's")
    if (excess := lasting_error(run)) > MOST_EXCESS:
        needed.append(f"errors of the voltage {excess:.1f} times as large as the file expects")
    if not needed:
        return ()
    return (Note(f"the battery file does not fit the log: it would need {' and '.join(needed)}; {_ADVICE}", "warning"),)


def lasting_error(run: Run[SocEstimate]) -> float:
    """Errors of the voltage over those that the filter expects: of single samples or of minutes, whichever is more.

    nan where there are too few.
    """
    e = run.estimates
    used = np.isfinite(e.innovation_V) & (e.voltage_std_V > 0.0)
    if np.count_nonzero(used) < LEAST_INNOVATIONS:
        return math.nan
    normalised = e.innovation_V[used] / e.voltage_std_V[used]
    begins = np.flatnonzero(np.diff(run.time_s[used] // LASTING_S, prepend=-np.inf))
    means = np.add.reduceat(normalised, begins) / np.diff(begins, append=normalised.size)
    return float(np.sqrt(max(normalised @ normalised / normalised.size, np.mean(means**2))))
