"""Estimators by name: what the command line offers and what `compare` runs side by side."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc.coulomb import CoulombCounting
from ohmward.battery.soc.protocol import Estimator
from ohmward.battery.soc.rc_filter import RcFilter
from ohmward.battery.soc.rest_ocv import RestOcv
from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.errors import InputError
from ohmward.published.hybrid import Hybrid
from ohmward.published.rc_adaptive_soc import adaptive_soc_of

if TYPE_CHECKING:
    from ohmward.battery.battery import Battery
    from ohmward.battery.models.rc import RcModel

#: What a user gets who does not choose.
DEFAULT = "ekf"


class EstimatorSettings(NamedTuple):
    """What a user may say about the use of the battery, whatever the estimator.

    idle_current_A: true current of a rest [A], > 0 charges: 0 in a laboratory, minus the idle draw on a robot; None
        when unknown.
    gap_s: a longer step between two samples says nothing about the current in between [s].
    """

    idle_current_A: float | None = None
    gap_s: float = 600.0


class Choice(NamedTuple):
    """One estimator: what it is, and how to make it from a battery file."""

    title: str
    make: Callable[[Battery, EstimatorSettings], Estimator]


def make_estimator(name: str, battery: Battery, settings: EstimatorSettings | None = None) -> Estimator:
    """The estimator called `name` for a battery.

    Raises:
        InputError: there is none of that name, or the battery file lacks the model it needs.
    """
    if name not in ESTIMATORS:
        raise InputError(f"filter must be one of {', '.join(ESTIMATORS)}, got {name!r}")
    return ESTIMATORS[name].make(battery, settings or EstimatorSettings(battery.idle_current_A))


def available(battery: Battery) -> tuple[str, ...]:
    """Names of the estimators that the models in the battery file allow."""

    def possible(name: str) -> bool:
        try:
            make_estimator(name, battery)
        except InputError:
            return False
        return True

    return tuple(filter(possible, ESTIMATORS))


def require_thevenin(battery: Battery) -> Thevenin:
    """The Thevenin model of a battery file, or InputError where it has none."""
    if battery.thevenin is None:
        raise InputError(
            f"{battery.name}: the battery file has no [thevenin] model, which this filter needs; "
            "identify one with `ohmward identify ... --model thevenin-2rc`"
        )
    return battery.thevenin


def _rc(battery: Battery) -> RcModel:
    if battery.rc is None:
        raise InputError(
            f"{battery.name}: the battery file has no [rc] model, which this filter needs; "
            "identify one with `ohmward identify ... --model rc`"
        )
    return battery.rc


def _filter(method: str, matching: bool) -> Callable[[Battery, EstimatorSettings], TheveninFilter]:
    def make(battery: Battery, settings: EstimatorSettings) -> TheveninFilter:
        return TheveninFilter(
            require_thevenin(battery),
            battery.noise,
            method=method,
            matching=matching,
            idle_current_A=settings.idle_current_A,
            gap_s=settings.gap_s,
        )

    return make


def _textbook(method: str) -> Callable[[Battery, EstimatorSettings], Estimator]:
    return lambda battery, settings: TextbookFilter(require_thevenin(battery), battery.noise, method)


def _coulomb(battery: Battery, settings: EstimatorSettings) -> Estimator:
    return CoulombCounting(require_thevenin(battery), battery.noise, settings.gap_s)


def _rest_ocv(battery: Battery, settings: EstimatorSettings) -> Estimator:
    return RestOcv(require_thevenin(battery), battery.noise, settings.gap_s)


def _rc_kalman(battery: Battery, settings: EstimatorSettings) -> RcFilter:
    return RcFilter(_rc(battery), battery.rc_noise, "curve", settings.gap_s)


def _rc_soc(battery: Battery, settings: EstimatorSettings) -> Estimator:
    return RcFilter(_rc(battery), battery.rc_noise, gap_s=settings.gap_s)


def _rc_adaptive(battery: Battery, settings: EstimatorSettings) -> Estimator:
    return adaptive_soc_of(_rc(battery), battery.rc_noise)


def _hybrid(battery: Battery, settings: EstimatorSettings) -> Estimator:
    return Hybrid(_filter("ekf", matching=False)(battery, settings), _rc_kalman(battery, settings))


ESTIMATORS: dict[str, Choice] = {
    "coulomb": Choice("coulomb counting", _coulomb),
    "ocv": Choice("coulomb counting, corrected by the open-circuit voltage at rests", _rest_ocv),
    "textbook-ekf": Choice("Thevenin model, SoC and RC voltages only, extended Kalman filter", _textbook("ekf")),
    "textbook-ukf": Choice("the same, unscented Kalman filter, as in [P]", _textbook("ukf")),
    "rc-kf": Choice("RC model, Kalman filter through the inverse OCV curve", _rc_kalman),
    "rc-soc": Choice("RC model, Kalman filter with SoC as third state and a straight OCV", _rc_soc),
    "rc-aukf": Choice("RC model, joint adaptive unscented filter of its parameters feeding rc-soc", _rc_adaptive),
    "ekf": Choice("Thevenin model, extended Kalman filter", _filter("ekf", matching=False)),
    "aekf": Choice("Thevenin model, adaptive extended Kalman filter", _filter("ekf", matching=True)),
    "ukf": Choice("Thevenin model, unscented Kalman filter", _filter("ukf", matching=False)),
    "aukf": Choice("Thevenin model, adaptive unscented Kalman filter", _filter("ukf", matching=True)),
    "hybrid": Choice("Thevenin model, initialised and corrected at rests by the RC model", _hybrid),
}
