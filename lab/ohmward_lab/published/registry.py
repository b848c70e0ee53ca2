"""Estimators of the state of charge that reproduce a publication, by name, for `ohmward.battery.soc.registry`."""

from __future__ import annotations

from dataclasses import dataclass

from ohmward.battery.battery import Battery
from ohmward.battery.models.one_pair import one_pair_noise
from ohmward.battery.soc.registry import Choice, EstimatorSettings, thevenin_filter
from ohmward.battery.soc.sample import INITIAL_SOC_STD, Estimator, SocSample
from ohmward.battery.soc.textbook import TextbookFilter, TextbookState
from ohmward_lab.published.hybrid import Hybrid
from ohmward_lab.published.rc import rc_of_thevenin
from ohmward_lab.published.rc_filter import RcFilter


@dataclass(frozen=True)
class GivenStart(TextbookFilter):
    """Settings of the textbook filter, with an initial SoC that the first voltage does not overrule."""

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> TextbookState:
        """State before the first sample; `soc` None is found from its voltage, any other value is used as given."""
        return super().init(first) if soc is None else self.start(first, soc, soc_std)


def _by_curve(battery: Battery, settings: EstimatorSettings) -> RcFilter:
    noise = one_pair_noise(battery.thevenin, battery.noise)
    return RcFilter(rc_of_thevenin(battery.thevenin), noise, battery.sensor, settings.gap_s)


def _hybrid(battery: Battery, settings: EstimatorSettings) -> Estimator:
    return Hybrid(thevenin_filter("ekf")(battery, settings), _by_curve(battery, settings))


PUBLISHED: dict[str, Choice] = {
    "published.aekf": Choice("Thevenin model, adaptive extended Kalman filter", thevenin_filter("ekf", matching=True)),
    "published.aukf": Choice("Thevenin model, adaptive unscented Kalman filter", thevenin_filter("ukf", matching=True)),
    "published.hybrid": Choice("Thevenin model, initialised and corrected at rests by the RC model", _hybrid),
    "published.rc-kf": Choice("RC model, Kalman filter through the inverse OCV curve", _by_curve),
}
