"""Arrival times of samples: nearly periodic, with dropouts of the link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ohmward.checks import require_each_not_negative, require_positive


@dataclass(frozen=True)
class Telemetry:
    """A logger with jitter and dropouts.

    Raises:
        InputError: a value out of its range.
    """

    interval_s: float = 1.0  #: nominal interval
    jitter_std_s: float = 0.05  #: of each sample about its nominal time, limited to 0.4 intervals
    dropouts_per_hour: float = 1.0  #: mean number of dropouts (Poisson)
    dropout_mean_s: float = 25.0  #: mean duration of a dropout (exponential)

    def __post_init__(self) -> None:
        require_positive("telemetry.interval_s", self.interval_s)
        require_each_not_negative("telemetry.", self, "jitter_std_s", "dropouts_per_hour", "dropout_mean_s")

    def times(self, duration_s: float, rng: np.random.Generator) -> np.ndarray:
        """(T,) strictly increasing sample times [s] in [0, duration_s]; the first sample always arrives."""
        nominal = np.arange(0.0, duration_s, self.interval_s)
        most = 0.4 * self.interval_s
        jitter = np.clip(self.jitter_std_s * rng.standard_normal(nominal.size), -most, most)
        times = np.clip(nominal + jitter, 0.0, duration_s)
        arrives = ~self._dropped(times, duration_s, rng)
        arrives[0] = True
        return times[arrives]

    def _dropped(self, times: np.ndarray, duration_s: float, rng: np.random.Generator) -> np.ndarray:
        """(T,) True for samples during a dropout."""
        count = rng.poisson(self.dropouts_per_hour * duration_s / 3600.0)
        start = rng.uniform(0.0, duration_s, count)[:, None]
        stop = start + rng.exponential(self.dropout_mean_s, count)[:, None]
        return np.any((times >= start) & (times < stop), axis=0)
