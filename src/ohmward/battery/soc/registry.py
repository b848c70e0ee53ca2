"""Estimators of the state of charge by name, made from a battery file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.models.one_pair import one_pair, one_pair_noise
from ohmward.battery.soc.clean_sample import CURRENT_GAP_S
from ohmward.battery.soc.coulomb import CoulombCounting, RestOcv
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter
from ohmward.battery.soc.sample import Estimator
from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.errors import InputError
from ohmward.lab import lab

#: Prefix of the names of estimators that reproduce a publication.
_PUBLISHED = "published."

#: Name that stands for the default estimator, see `chosen_name`.
DEFAULT = "default"


class EstimatorSettings(NamedTuple):
    """Settings for the use of a battery, the same for every estimator.

    >>> settings = ow.EstimatorSettings(idle_current_A=-0.15)
    >>> ow.SocEstimator(ow.make_estimator("ekf", ow.load_battery("battery.toml"), settings))
    SocEstimator(TheveninFilter)
    """

    #: true current of a rest, > 0 charges: 0 in a laboratory, minus the idle draw on a robot; None when unknown
    idle_current_A: float | None = None
    gap_s: float = CURRENT_GAP_S  #: a longer step between two samples says nothing about the current in between
    #: let full charges and cut-offs correct the filters on the Thevenin model. None does so for a battery that gases,
    #: whose voltage says nothing while charging. Lithium cells show by their voltage that they are full, and whether
    #: a worn one is empty at its cut-off depends on the load.
    anchors: bool | None = None


class Choice(NamedTuple):
    """Title of an estimator, and the function that makes it from a battery file."""

    title: str
    make: Callable[[Battery, EstimatorSettings], Estimator]


def make_estimator(name: str, battery: Battery, settings: EstimatorSettings | None = None) -> Estimator:
    """Make the estimator called `name` for a battery; upper and lower case are the same.

    >>> estimator = ow.SocEstimator(ow.make_estimator("textbook-ukf", ow.load_battery("battery.toml")))

    Raises:
        InputError: no estimator of that name, not a battery, or a battery file without the model that it needs.
    """
    require_battery(battery)
    choice = _find(chosen_name(name.lower())) if isinstance(name, str) else None
    if choice is None:
        raise InputError(f"filter must be one of {', '.join((DEFAULT, *ESTIMATORS, *published()))}, got {name!r}")
    return choice.make(battery, settings or EstimatorSettings(battery.idle_current_A))


def chosen_name(name: str) -> str:
    """The name itself; for `DEFAULT` that of the default estimator."""
    return "gsf" if name == DEFAULT else name


def is_estimator(name: str) -> bool:
    """True for the name of an estimator."""
    return _find(name) is not None


def title_of(name: str) -> str:
    """Title of the estimator called `name`; KeyError where there is none."""
    return (published() if name.startswith(_PUBLISHED) else ESTIMATORS)[name].title


def available(battery: Battery, with_published: bool = False) -> tuple[str, ...]:
    """Names of the estimators that the models in the battery file allow.

    >>> ow.available(ow.load_battery("battery.toml"))
    ('ekf', 'ukf', 'gsf', 'rc', 'textbook-ekf', 'textbook-ukf', 'coulomb', 'ocv')

    with_published: append the estimators that reproduce a publication.
    """

    def possible(name: str) -> bool:
        try:
            make_estimator(name, battery)
        except InputError:
            return False
        return True

    return tuple(filter(possible, (*ESTIMATORS, *(published() if with_published else ()))))


def published() -> Mapping[str, Choice]:
    """Estimators of the laboratory that reproduce a publication, by name."""
    return lab("published.registry").PUBLISHED


def _find(name: str) -> Choice | None:
    return published().get(name) if name.startswith(_PUBLISHED) else ESTIMATORS.get(name)


def thevenin_filter(method: str, matching: bool = False) -> Callable[[Battery, EstimatorSettings], TheveninFilter]:
    """Function that makes the Thevenin filter with this method."""

    def make(battery: Battery, settings: EstimatorSettings) -> TheveninFilter:
        pinned = battery.pinned
        return TheveninFilter(
            pinned.thevenin,
            pinned.noise,
            battery.sensor,
            method=method,
            matching=matching,
            idle_current_A=settings.idle_current_A,
            gap_s=settings.gap_s,
            anchors=battery.thevenin.gassing_V is not None if settings.anchors is None else settings.anchors,
        )

    return make


def _one_pair(battery: Battery, settings: EstimatorSettings) -> TheveninFilter:
    """Extended Kalman filter on the circuit of the RC model of [P]: one RC pair, the same at every SoC."""
    model, noise = one_pair(battery.thevenin), one_pair_noise(battery.thevenin, battery.noise)
    return thevenin_filter("ekf")(replace(battery, thevenin=model, noise=noise), settings)


def _gaussian_sum(battery: Battery, settings: EstimatorSettings) -> GaussianSumFilter:
    return GaussianSumFilter(thevenin_filter("ekf")(battery, settings))


def _textbook(method: str) -> Callable[[Battery, EstimatorSettings], Estimator]:
    return lambda battery, settings: TextbookFilter(battery.thevenin, battery.noise, battery.sensor, method)


def _counting(cls: type[CoulombCounting] | type[RestOcv]) -> Callable[[Battery, EstimatorSettings], Estimator]:
    return lambda battery, settings: cls(battery.thevenin, battery.noise, battery.sensor, gap_s=settings.gap_s)


#: Estimators for general use, by name.
ESTIMATORS: dict[str, Choice] = {
    "ekf": Choice("Thevenin model, extended Kalman filter", thevenin_filter("ekf")),
    "ukf": Choice("Thevenin model, unscented Kalman filter", thevenin_filter("ukf")),
    "gsf": Choice("Thevenin model, Gaussian sum of three extended Kalman filters", _gaussian_sum),
    "rc": Choice("RC model, one RC pair alike at every SoC, extended Kalman filter", _one_pair),
    "textbook-ekf": Choice("Thevenin model, SoC and RC voltages only, extended Kalman filter", _textbook("ekf")),
    "textbook-ukf": Choice("Thevenin model, SoC and RC voltages only, unscented filter, as in [P]", _textbook("ukf")),
    "coulomb": Choice("coulomb counting", _counting(CoulombCounting)),
    "ocv": Choice("coulomb counting, corrected by the open-circuit voltage at rests", _counting(RestOcv)),
}
