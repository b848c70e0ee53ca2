"""Charge that a battery has given down to its cut-off, counted in the robot's own drives.

One discharge to the cut-off under load measures the charge that this battery gives to this robot, whatever reduces it:
a capacity below the label, resistance near empty, diffusion in the particles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.energy.leg import STRETCH_S
from ohmward.logs.log import Log
from ohmward.quantities import SECONDS_PER_HOUR

#: Time [s] for which a peak of power must last to count: a protection opens after some seconds.
PROTECTION_OPENS_S = 3.0
#: Longest gap [s] over which the charge is counted; after a longer one the count restarts.
_UNCOUNTED_S = 60.0
#: Share of the cut-off voltage above it at which a discharge counts as ended.
_NEAR_CUTOFF = 0.01
#: Least state of charge from which a discharge is counted: a shorter one measures less than is known already.
_LEAST_START_SOC = 0.5


class DischargeEnd(NamedTuple):
    """End of a discharge at the cut-off, under load."""

    given_Ah: float  #: charge that the battery gave since `start_soc`
    start_soc: float  #: state of charge from which it was counted
    start_soc_std: float  #: its standard deviation
    hours: float  #: duration of the count
    #: at the end: current out of the battery over the time of a stretch, and current and voltage held for some seconds
    mean_A: float
    last_A: float
    voltage_V: float
    temperature_degC: float  #: of the battery


class DischargeMeter(NamedTuple):
    """Charge given since the highest state of charge of a drive, and the loads of the last seconds and minutes."""

    start_soc: float = 0.0  #: highest state of charge
    start_soc_std: float = 0.0
    given_Ah: float = 0.0  #: since then
    seconds: float = 0.0  #: likewise
    mean_A: float = 0.0  #: out of the battery, over the time of a stretch
    #: power out of the battery and voltage, sustained for some seconds
    held_W: float = 0.0
    held_V: float = math.nan

    def with_soc(self, soc: float, soc_std: float) -> DischargeMeter:
        """State after an estimate of the state of charge; a higher one than before restarts the count."""
        if not soc > self.start_soc:
            return self
        return self._replace(start_soc=soc, start_soc_std=soc_std, given_Ah=0.0, seconds=0.0)

    def with_sample(self, dt_s: float, current_A: float, voltage_V: float) -> DischargeMeter:
        """State after a sample taken dt_s after the previous one; a missing current is assumed to be the mean.

        current_A: > 0 charges.
        """
        if not dt_s > 0.0:
            return self
        if dt_s > _UNCOUNTED_S:
            return DischargeMeter()
        given_A = -current_A if math.isfinite(current_A) else self.mean_A
        counted = self._replace(
            given_Ah=self.given_Ah + given_A * dt_s / SECONDS_PER_HOUR,
            seconds=self.seconds + dt_s,
            mean_A=self.mean_A + (1.0 - math.exp(-dt_s / STRETCH_S)) * (given_A - self.mean_A),
        )
        if not math.isfinite(current_A * voltage_V):
            return counted
        share = 1.0 - math.exp(-dt_s / PROTECTION_OPENS_S)
        before_V = self.held_V if math.isfinite(self.held_V) else voltage_V
        return counted._replace(
            held_W=self.held_W + share * (given_A * voltage_V - self.held_W),
            held_V=before_V + share * (voltage_V - before_V),
        )

    def end(self, cutoff_V: float, temperature_degC: float) -> DischargeEnd | None:
        """The end of a discharge from above half charge; None without a load, or above the cut-off."""
        ends = self.held_V <= (1.0 + _NEAR_CUTOFF) * cutoff_V and self.held_W > 0.0
        if not (ends and self.given_Ah > 0.0 and self.start_soc >= _LEAST_START_SOC):
            return None
        return DischargeEnd(
            self.given_Ah,
            self.start_soc,
            self.start_soc_std,
            self.seconds / SECONDS_PER_HOUR,
            self.mean_A,
            self.held_W / self.held_V,
            self.held_V,
            temperature_degC,
        )


def end_along(log: Log, soc: np.ndarray, soc_std: np.ndarray, cutoff_V: float) -> DischargeEnd | None:
    """The last end of a discharge in a log of the battery; None where there is none.

    soc, soc_std: (T,) state of charge and its standard deviation.
    """
    temperature_degC = np.full(len(log), ROOM_DEGC) if log.temperature_degC is None else log.temperature_degC
    columns = (np.diff(log.time_s, prepend=math.nan), log.current_A, log.voltage_V, soc, soc_std, temperature_degC)
    meter, found = DischargeMeter(), None
    for dt_s, amperes, volts, estimate, std, degC in zip(*(column.tolist() for column in columns), strict=True):
        meter = meter.with_soc(estimate, std).with_sample(dt_s, amperes, volts)
        found = meter.end(cutoff_V, degC if math.isfinite(degC) else ROOM_DEGC) or found
    return found
