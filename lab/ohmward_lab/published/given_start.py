"""T2RC + UKF of [P] 2.3 and 3.2: the textbook filter, with a wrong start taken as given (figure 12 of [P])."""

from __future__ import annotations

from dataclasses import dataclass

from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.textbook import TextbookFilter, TextbookState


@dataclass(frozen=True)
class GivenStart(TextbookFilter):
    """Settings of the textbook filter. The first voltage does not overrule the SoC that it is told to start from."""

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> TextbookState:
        """State before the first sample; a SoC that is None comes from its voltage, any other is taken as it is."""
        return super().init(first) if soc is None else self.start(first, soc, soc_std)
