"""Methods of the study, from counting alone to the default estimator, each made from the same battery file."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from ohmward.battery.battery import Battery, require_rc, require_thevenin
from ohmward.battery.soc.protocol import Estimator
from ohmward.battery.soc.registry import DEFAULT, chosen_name, make_estimator, title_of
from ohmward.battery.soc.sample import SocSample
from ohmward_lab.assess.recommendation import Processor
from ohmward_lab.published.rc_three_states import RcThreeState, RcThreeStates
from ohmward_lab.published.registry import GivenStart
from ohmward_lab.published.scheme_by_method import SchemeByMethod, SchemeSoc


class SocMethod(NamedTuple):
    """A method by its name, in words, and the function that makes its estimator."""

    name: str
    title: str
    make: Callable[[Battery], Estimator]


def _of_registry(name: str) -> SocMethod:
    return SocMethod(name, title_of(name), lambda battery: make_estimator(name, battery))


def _default(battery: Battery) -> Estimator:
    return make_estimator(chosen_name(DEFAULT, battery), battery)


class _FullStart(RcThreeStates):
    """[P] 3.1: the filter starts at the OCV of a full battery, whatever is known."""

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> RcThreeState:
        return super().init(first, 1.0, soc_std)


def _t2rc_ukf(battery: Battery) -> Estimator:
    return GivenStart(require_thevenin(battery), battery.noise, battery.sensor)


def _rc_kf(battery: Battery) -> Estimator:
    return _FullStart(require_rc(battery))


def _scheme(battery: Battery) -> Estimator:
    return SchemeSoc(SchemeByMethod(require_rc(battery)))


METHODS: tuple[SocMethod, ...] = (
    _of_registry("coulomb"),
    _of_registry("ocv"),
    SocMethod("[P] RC + KF", "RC model, Q and R of [P] (25), full at the start", _rc_kf),
    SocMethod("[P] T2RC + UKF", "Thevenin model, unscented filter, start taken as given", _t2rc_ukf),
    SocMethod("[P] hybrid", title_of("published.hybrid"), lambda battery: make_estimator("published.hybrid", battery)),
    SocMethod("[T] AUKF", "RC model, joint adaptive unscented filter, P0, Q0 and R0 of [T] (3.51)", _scheme),
    *map(_of_registry, ("published.rc-aukf", "textbook-ekf", "rc", "ekf", "ukf", "published.aukf")),
    SocMethod(DEFAULT, title_of("gsf"), _default),
)

#: 2 KB of code hold about 350 operations in single precision, 16 KB about 2,500; see docs/export.md.
PROCESSORS = (
    Processor("2 KB of flash", 350.0),
    Processor("16 KB of flash", 2500.0),
    Processor("computer", math.inf),
)
