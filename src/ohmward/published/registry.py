"""All estimators of the state of charge by name: those for use, and those that reproduce a publication."""

from __future__ import annotations

from ohmward.battery.battery import Battery, require_rc
from ohmward.battery.soc import registry
from ohmward.battery.soc.protocol import Estimator
from ohmward.battery.soc.registry import Choice, EstimatorSettings, rc_filter, thevenin_filter
from ohmward.published.hybrid import Hybrid
from ohmward.published.rc_adaptive_soc import adaptive_soc_of


def _adaptive_soc(battery: Battery, settings: EstimatorSettings) -> Estimator:
    return adaptive_soc_of(require_rc(battery), battery.rc_noise, battery.sensor)


def _hybrid(battery: Battery, settings: EstimatorSettings) -> Estimator:
    return Hybrid(thevenin_filter("ekf")(battery, settings), rc_filter("curve")(battery, settings))


PUBLISHED: dict[str, Choice] = {
    "published.aekf": Choice("Thevenin model, adaptive extended Kalman filter", thevenin_filter("ekf", matching=True)),
    "published.aukf": Choice("Thevenin model, adaptive unscented Kalman filter", thevenin_filter("ukf", matching=True)),
    "published.hybrid": Choice("Thevenin model, initialised and corrected at rests by the RC model", _hybrid),
    "published.rc-kf": Choice("RC model, Kalman filter through the inverse OCV curve", rc_filter("curve")),
    "published.rc-aukf": Choice(
        "RC model, joint adaptive unscented filter of its parameters feeding rc", _adaptive_soc
    ),
}

ESTIMATORS: dict[str, Choice] = registry.ESTIMATORS | PUBLISHED


def title_of(name: str) -> str:
    """Title of the estimator called `name`."""
    return ESTIMATORS[name].title


def make_estimator(name: str, battery: Battery, settings: EstimatorSettings | None = None) -> Estimator:
    """The estimator called `name` for a battery.

    Raises:
        InputError: there is none of that name, or the battery file lacks the model it needs.
    """
    return registry.make_from(ESTIMATORS, name, battery, settings)


def available(battery: Battery) -> tuple[str, ...]:
    """Names of all estimators that the models in the battery file allow, those for use first."""
    return registry.available_from(ESTIMATORS, battery)
