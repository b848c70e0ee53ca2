"""Unknowns of one part of a log that are not those of the battery: where it began, and what its sensors did."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.learning.samples import Samples
from ohmward.battery.models.knots import correlation
from ohmward.battery.models.noise import HYSTERESIS_UNKNOWN_STD, walk_variance
from ohmward.battery.models.thevenin import Thevenin
from ohmward.logs.log import SECONDS_PER_HOUR

#: The offset of a current sensor is followed in steps of so many hours, at most so many of them.
_OFFSET_HOURS, _MOST_OFFSETS = 6.0, 30
#: Knots of SoC of the error that one log has for itself, however well the model fits all others.
MISFIT_KNOTS = np.linspace(0.0, 1.0, 11)
_MISFIT_LENGTH = 0.1
#: RC voltages at the start of a part, as those of this current in multiples of the capacity per hour.
_START_C = 0.15
#: Keeps the walk of a sensor that has none from being singular [A].
_LEAST_WALK_A = 1e-9
#: Least standard deviation of an RC voltage at the start, for each volt of the battery.
_LEAST_PAIR_SHARE = 5e-4


class Nuisances(NamedTuple):
    """Places of the unknowns of a part in their vector (M,), and their prior standard deviations.

    soc: the SoC at the start; jumps: changes of SoC that no current shows; offsets: changes of the sensor's offset.
    pairs: (n, segments) voltages of the RC pairs at the start and after every gap; hysteresis: its state there.
    misfit: error of the voltage [V] of this log on MISFIT_KNOTS.
    """

    segments: int
    n_pairs: int
    n_jumps: int
    offset_from_s: np.ndarray  #: times at which the offset changes
    has_hysteresis: bool

    @property
    def soc(self) -> int:
        """Place of the SoC at the start."""
        return 0

    @property
    def jumps(self) -> slice:
        """Places of the jumps."""
        return slice(1, 1 + self.n_jumps)

    @property
    def offsets(self) -> slice:
        """Places of the changes of the offset."""
        return slice(self.jumps.stop, self.jumps.stop + self.offset_from_s.size)

    def pair(self, j: int) -> slice:
        """Places of the voltage of pair j at the start of each segment."""
        first = self.offsets.stop + j * self.segments
        return slice(first, first + self.segments)

    @property
    def hysteresis(self) -> slice:
        """Places of the hysteresis at the start of each segment."""
        first = self.offsets.stop + self.n_pairs * self.segments
        return slice(first, first + self.has_hysteresis * self.segments)

    @property
    def misfit(self) -> slice:
        """Places of the misfit."""
        return slice(self.hysteresis.stop, self.hysteresis.stop + MISFIT_KNOTS.size)

    @property
    def size(self) -> int:
        """Number M of unknowns."""
        return self.misfit.stop


def nuisances_of(samples: Samples, model: Thevenin) -> Nuisances:
    """The unknowns of a part."""
    steps = int(min(samples.hours / _OFFSET_HOURS, _MOST_OFFSETS))
    from_s = samples.time_s[0] + (samples.time_s[-1] - samples.time_s[0]) * np.arange(1, steps + 1) / (steps + 1)
    hysteresis = any(model.ocv.hysteresis_V)
    return Nuisances(1 + samples.gaps.size, model.pairs, len(samples.jumps), from_s, hysteresis)


def nuisance_covariance(
    nuisances: Nuisances, samples: Samples, battery: Battery, soc_std: float, misfit_V: float
) -> np.ndarray:
    """(M, M) prior covariance of the unknowns of a part; soc_std: of the SoC at its start."""
    model = battery.thevenin
    assert model is not None
    std = np.zeros(nuisances.size)
    std[nuisances.soc] = soc_std
    std[nuisances.jumps] = [jump.std for jump in samples.jumps]
    if nuisances.offset_from_s.size:
        step_s = float(samples.time_s[-1] - samples.time_s[0]) / (nuisances.offset_from_s.size + 1)
        walk_A2: Any = walk_variance(max(battery.sensor.offset_walk_A, _LEAST_WALK_A), SECONDS_PER_HOUR, step_s)
        std[nuisances.offsets] = np.sqrt(walk_A2)
    least_V = _LEAST_PAIR_SHARE * float(np.mean(model.ocv.voltage_V))
    for j, row in enumerate(model.r_ohm):
        std[nuisances.pair(j)] = least_V + _START_C * model.capacity_Ah * float(np.mean(row))
    std[nuisances.hysteresis] = HYSTERESIS_UNKNOWN_STD
    covariance = np.diag(std**2)
    covariance[nuisances.misfit, nuisances.misfit] = misfit_V**2 * correlation(MISFIT_KNOTS, _MISFIT_LENGTH)
    return covariance
