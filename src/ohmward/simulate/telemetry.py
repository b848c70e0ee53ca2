"""When samples arrive: nearly periodic, and at times not at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ohmward.checks import require_between, require_positive


@dataclass(frozen=True)
class Telemetry:
    """A logger that is late by a little and loses its link now and then.

    Attributes:
        interval_s: wanted interval.
        jitter_std_s: of each sample about its place in the raster, cut at 0.4 intervals.
        dropouts_per_hour: how often the link is lost (Poisson).
        dropout_mean_s: how long (exponential).

    Raises:
        InputError: a value out of its range.
    """

    interval_s: float = 1.0
    jitter_std_s: float = 0.05
    dropouts_per_hour: float = 1.0
    dropout_mean_s: float = 25.0

    def __post_init__(self) -> None:
        require_positive("telemetry.interval_s", self.interval_s)
        for name in ("jitter_std_s", "dropouts_per_hour", "dropout_mean_s"):
            require_between(f"telemetry.{name}", getattr(self, name), 0.0, np.inf)

    def times(self, duration_s: float, rng: np.random.Generator) -> np.ndarray:
        """(T,) strictly increasing sample times [s] in [0, duration_s]; the first sample always arrives."""
        raster = np.arange(0.0, duration_s, self.interval_s)
        most = 0.4 * self.interval_s
        late = np.clip(self.jitter_std_s * rng.standard_normal(raster.size), -most, most)
        times = np.clip(raster + late, 0.0, duration_s)
        arrives = ~self._lost(times, duration_s, rng)
        arrives[0] = True
        return times[arrives]

    def _lost(self, times: np.ndarray, duration_s: float, rng: np.random.Generator) -> np.ndarray:
        count = rng.poisson(self.dropouts_per_hour * duration_s / 3600.0)
        start = rng.uniform(0.0, duration_s, count)[:, None]
        stop = start + rng.exponential(self.dropout_mean_s, count)[:, None]
        return np.any((times >= start) & (times < stop), axis=0)
