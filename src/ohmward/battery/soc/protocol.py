"""Protocol of every estimator of the state of charge."""

from __future__ import annotations

from typing import Any, Protocol

from ohmward.battery.soc.sample import SocEstimate, SocSample


class Estimator(Protocol):
    """Frozen settings with two pure functions."""

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> Any:
        """State before the first sample; `soc` None is unknown."""
        ...

    def step(self, state: Any, sample: SocSample) -> tuple[Any, SocEstimate]:
        """State after a sample, and the estimate then."""
        ...
