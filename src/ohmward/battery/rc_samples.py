"""A log as the identification of the RC model reads it: charge counted, samples without a voltage left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.logs.log import SECONDS_PER_HOUR, Log


class Samples(NamedTuple):
    """The samples with a voltage, (T,) each.

    time_s, dt_s: time and step [s].
    current_A, mean_A: current at the sample and its mean over the step.
    charge_As: since the start.
    gap: whether the step is a gap in the recording.
    """

    time_s: np.ndarray
    dt_s: np.ndarray
    current_A: np.ndarray
    charge_As: np.ndarray
    mean_A: np.ndarray
    voltage_V: np.ndarray
    gap: np.ndarray


def samples_of(log: Log) -> Samples:
    """The log without the samples that have no voltage; their charge is kept."""
    # Here, because the identification of all models imports that of this one.
    from ohmward.battery.identification.charge import count_charge, find_gaps, known_current_A

    charge = count_charge(log)
    known = np.isfinite(log.voltage_V)
    time_s, charge_As = log.time_s[known], SECONDS_PER_HOUR * charge.total_Ah[known]
    dt_s = np.diff(time_s, prepend=time_s[:1])
    mean_A = np.diff(charge_As, prepend=charge_As[:1]) / np.where(dt_s > 0, dt_s, 1.0)
    return Samples(
        time_s, dt_s, known_current_A(log)[known], charge_As, mean_A, log.voltage_V[known], find_gaps(time_s)
    )
