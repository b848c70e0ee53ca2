"""Methods of the study, from counting alone to the default estimator, each made from the same battery file."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from ohmward.battery.battery import Battery, require_rc, require_thevenin
from ohmward.battery.soc.protocol import Estimator
from ohmward.battery.soc.registry import DEFAULT, chosen_name, make_estimator, title_of
from ohmward_lab.assess.recommendation import Processor
from ohmward_lab.published.rc_three_states import RcThreeStates
from ohmward_lab.published.registry import GivenStart


class SocMethod(NamedTuple):
    """A method by its name, in words, and the function that makes its estimator."""

    name: str
    title: str
    make: Callable[[Battery], Estimator]


def _of_registry(name: str) -> SocMethod:
    return SocMethod(name, title_of(name), lambda battery: make_estimator(name, battery))


def _default(battery: Battery) -> Estimator:
    return make_estimator(chosen_name(DEFAULT, battery), battery)


def _t2rc_ukf(battery: Battery) -> Estimator:
    return GivenStart(require_thevenin(battery), battery.noise, battery.sensor)


METHODS: tuple[SocMethod, ...] = (
    _of_registry("coulomb"),
    _of_registry("ocv"),
    SocMethod(
        "[P] RC + KF", "RC model, three states, as published", lambda battery: RcThreeStates(require_rc(battery))
    ),
    SocMethod("[P] T2RC + UKF", "Thevenin model, unscented filter, start taken as given", _t2rc_ukf),
    SocMethod("[T] AUKF", title_of("published.rc-aukf"), lambda battery: make_estimator("published.rc-aukf", battery)),
    *map(_of_registry, ("textbook-ekf", "rc", "ekf", "ukf", "published.aukf")),
    SocMethod(DEFAULT, title_of("gsf"), _default),
)

#: 2 KB of code hold about 350 operations in single precision, 16 KB about 2,500; see docs/export.md.
PROCESSORS = (
    Processor("2 KB of flash", 350.0),
    Processor("16 KB of flash", 2500.0),
    Processor("computer", math.inf),
)
