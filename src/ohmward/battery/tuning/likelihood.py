"""Likelihood of the factors of a battery file's noise along logs, for many factors side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ohmward.battery.soc.estimator import samples_of
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.tuning.noise_model import FACTORS, NoiseModel, ScoredSample
from ohmward.logs.log import Log
from ohmward.trace import Kernel
from ohmward.trace.structure import side_by_side

#: Slopes of the likelihood over stretches of this length are independent of each other.
BLOCK_S = 3600.0


@dataclass(frozen=True)
class Likelihood:
    """The logs, their starts, and the noise whose factors are wanted."""

    model: NoiseModel  #: noise of the battery file, with factors
    logs: Sequence[Log]
    initial_soc: Mapping[str, float]  #: of logs by their names, where it is known

    @cached_property
    def kernel(self) -> Kernel:
        """The step of the filter, traced."""
        nothing = SocSample(0.0, np.nan, np.nan, np.nan)
        return Kernel(self.model.step, self.model.init(nothing, np.zeros(len(FACTORS))), nothing)

    def scored(self, log: Log, log_factors: np.ndarray) -> ScoredSample:
        """Every sample of a log under ln factors (P, 3): arrays (T, P)."""
        samples = samples_of(log)
        first = SocSample(*(float(column[0]) for column in samples))
        soc = self.initial_soc.get(log.name)
        states = [self.model.init(first, factors, soc) for factors in log_factors]
        _, found = self.kernel.scan_lanes(side_by_side(states), samples)
        return found

    def blocks(self, log_factors: np.ndarray) -> np.ndarray:
        """(B, P) ln of the likelihood of ln factors (P, 3) in each stretch of `BLOCK_S`, up to a constant.

        -inf where a filter with these factors has lost itself.
        """
        stretches = []
        for log in self.logs:
            density = self.scored(log, log_factors).log_density
            starts = np.unique((log.time_s - log.time_s[0]) // BLOCK_S, return_index=True)[1]
            stretches.append(np.add.reduceat(density, starts, axis=0))
        found = np.vstack(stretches)
        return np.where(np.isfinite(found), found, -np.inf)
