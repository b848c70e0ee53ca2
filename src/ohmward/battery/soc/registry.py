"""Estimators of the state of charge by name, made from a battery file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from ohmward.battery.battery import Battery, require_battery, require_rc, require_thevenin
from ohmward.battery.soc.clean_sample import CURRENT_GAP_S
from ohmward.battery.soc.coulomb import CoulombCounting, RestOcv
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter
from ohmward.battery.soc.rc_filter import RcFilter
from ohmward.battery.soc.sample import Estimator
from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.errors import InputError
from ohmward.lab import lab

#: So begin the names of the estimators that reproduce a publication.
_PUBLISHED = "published."

#: The estimator of a user who does not choose: that of the battery, see `chosen_name`.
DEFAULT = "default"


class EstimatorSettings(NamedTuple):
    """Settings of the use of a battery, the same for every estimator."""

    #: true current of a rest, > 0 charges: 0 in a laboratory, minus the idle draw on a robot; None when unknown
    idle_current_A: float | None = None
    gap_s: float = CURRENT_GAP_S  #: a longer step between two samples says nothing about the current in between
    #: let full charges and cut-offs correct the filters on the Thevenin model. None does so where the battery gases:
    #: there the voltage of a charge says nothing. Cells of lithium show by their voltage that they are full, and
    #: whether a worn one is empty at its cut-off is a matter of the load.
    anchors: bool | None = None


class Choice(NamedTuple):
    """An estimator to choose: its title, and the function that makes it from a battery file."""

    title: str
    make: Callable[[Battery, EstimatorSettings], Estimator]


def make_estimator(name: str, battery: Battery, settings: EstimatorSettings | None = None) -> Estimator:
    """The estimator called `name` for a battery, in capitals or not.

    Raises:
        InputError: there is none of that name, the battery is none, or its file lacks the model it needs.
    """
    require_battery(battery)
    choice = _find(chosen_name(name.lower(), battery)) if isinstance(name, str) else None
    if choice is None:
        raise InputError(f"filter must be one of {', '.join((DEFAULT, *ESTIMATORS, *published()))}, got {name!r}")
    return choice.make(battery, settings or EstimatorSettings(battery.idle_current_A))


def chosen_name(name: str, battery: Battery) -> str:
    """The name itself, and for `DEFAULT` that of the estimator that wins where the battery has its model."""
    if name != DEFAULT:
        return name
    return "rc" if battery.thevenin is None else "gsf"


def is_estimator(name: str) -> bool:
    """True for the name of an estimator."""
    return _find(name) is not None


def title_of(name: str) -> str:
    """Title of the estimator called `name`; KeyError where there is none."""
    return (published() if name.startswith(_PUBLISHED) else ESTIMATORS)[name].title


def available(battery: Battery, with_published: bool = False) -> tuple[str, ...]:
    """Names of the estimators that the models in the battery file allow.

    with_published: among these, after those for use, the ones that reproduce a publication.
    """

    def possible(name: str) -> bool:
        try:
            make_estimator(name, battery)
        except InputError:
            return False
        return True

    return tuple(filter(possible, (*ESTIMATORS, *(published() if with_published else ()))))


def published() -> Mapping[str, Choice]:
    """Estimators that reproduce a publication, by name, of the laboratory."""
    return lab("published.registry").PUBLISHED


def _find(name: str) -> Choice | None:
    return published().get(name) if name.startswith(_PUBLISHED) else ESTIMATORS.get(name)


def thevenin_filter(method: str, matching: bool = False) -> Callable[[Battery, EstimatorSettings], TheveninFilter]:
    """The function that makes the Thevenin filter of this method."""

    def make(battery: Battery, settings: EstimatorSettings) -> TheveninFilter:
        model = require_thevenin(battery)
        return TheveninFilter(
            model,
            battery.noise,
            battery.sensor,
            method=method,
            matching=matching,
            idle_current_A=settings.idle_current_A,
            gap_s=settings.gap_s,
            anchors=model.gassing_V is not None if settings.anchors is None else settings.anchors,
        )

    return make


def rc_filter(soc_as: str) -> Callable[[Battery, EstimatorSettings], RcFilter]:
    """The function that makes the RC filter with SoC as this."""
    return lambda battery, settings: RcFilter(
        require_rc(battery), battery.rc_noise, battery.sensor, soc_as, settings.gap_s
    )


def _gaussian_sum(battery: Battery, settings: EstimatorSettings) -> GaussianSumFilter:
    return GaussianSumFilter(thevenin_filter("ekf")(battery, settings))


def _textbook(method: str) -> Callable[[Battery, EstimatorSettings], Estimator]:
    return lambda battery, settings: TextbookFilter(require_thevenin(battery), battery.noise, battery.sensor, method)


def _counting(cls: type[CoulombCounting] | type[RestOcv]) -> Callable[[Battery, EstimatorSettings], Estimator]:
    return lambda battery, settings: cls(require_thevenin(battery), battery.noise, battery.sensor, gap_s=settings.gap_s)


#: The estimators for use.
ESTIMATORS: dict[str, Choice] = {
    "ekf": Choice("Thevenin model, extended Kalman filter", thevenin_filter("ekf")),
    "ukf": Choice("Thevenin model, unscented Kalman filter", thevenin_filter("ukf")),
    "gsf": Choice("Thevenin model, Gaussian sum of three extended Kalman filters", _gaussian_sum),
    "rc": Choice("RC model, Kalman filter with SoC as third state and a straight OCV", rc_filter("state")),
    "textbook-ekf": Choice("Thevenin model, SoC and RC voltages only, extended Kalman filter", _textbook("ekf")),
    "textbook-ukf": Choice("the same, unscented Kalman filter, as in [P]", _textbook("ukf")),
    "coulomb": Choice("coulomb counting", _counting(CoulombCounting)),
    "ocv": Choice("coulomb counting, corrected by the open-circuit voltage at rests", _counting(RestOcv)),
}
