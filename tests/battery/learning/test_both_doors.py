"""A log says the same of its battery to `identify`, which is given the capacity, and to `learn`, which has a label."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from battery.identification.examples import pulse_log
from battery.learning.test_another_battery import day, taught_by
from battery.learning.test_learn import difference_in_sigmas
from cli.examples import MODEL
from ohmward.battery.battery import Battery
from ohmward.battery.identification import identify
from ohmward.battery.learning import learn
from ohmward.battery.learning.fold import known, ocv_std_V, pulse_ohm
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.logs import Log

PULSES, DAY = pulse_log(MODEL, std_V=0.003), day(MODEL, 1)
SOC = np.linspace(0.3, 1.0, 15)


def identified(*logs: Log, **starts: float) -> Battery:
    how: dict[str, Any] = {"chemistry": "nmc", "n_series": 3, "model": "thevenin-2rc"}
    return identify(logs, capacity_Ah=12.0, initial_soc=starts, **how)


@pytest.fixture(scope="module")
def batteries() -> dict[str, Battery]:
    """By the way in which each came to its file."""
    tested = identified(PULSES)
    return {
        "test": tested,
        "day, identified": identified(DAY),
        "day, learnt": taught_by(1),
        "test and day, identified": identified(PULSES, DAY),
        "day and test, identified": identified(DAY, PULSES),
        "test, then day": learn(tested, [DAY]).battery,
    }


def test_capacity_and_resistance_are_the_same_through_both_doors(batteries):
    for battery in batteries.values():
        found = known(battery)
        assert abs(found.capacity_Ah.mean - 12.0) < found.capacity_Ah.std
        assert found.resistance_ohm.mean == pytest.approx(pulse_ohm(MODEL), rel=0.03)


def test_the_curve_is_the_same_through_both_doors(batteries):
    one, two = batteries["day, identified"], batteries["day, learnt"]
    curves_V = [np.asarray(b.thevenin.ocv.mean_V(SOC, 25.0)) for b in (one, two)]
    assert np.all(np.abs(curves_V[0] - curves_V[1]) < 2 * np.hypot(ocv_std_V(one, SOC), ocv_std_V(two, SOC)))


def test_a_test_is_learnt_from_as_a_label_is(batteries):
    """The day narrows what the test left open, and the file knows no less than one that began with a label."""
    before, after, of_label = (known(batteries[name]) for name in ("test", "test, then day", "day, learnt"))
    assert after.capacity_Ah.std < 0.6 * before.capacity_Ah.std
    assert after.resistance_ohm.std < 0.5 * before.resistance_ohm.std
    assert after.capacity_Ah.std < of_label.capacity_Ah.std
    assert after.logs == of_label.logs == 1


def test_file_learn_and_filter_give_one_error_of_the_capacity(batteries):
    """By the sensor that counts it, whose gain no log shows: after days in which the capacity walks, too."""
    walked = learn(batteries["test"], [day(MODEL, seed) for seed in (1, 2, 3)]).battery
    for battery in (*batteries.values(), walked):
        gain_std, rest = battery.sensor.gain_std, SocEstimator(battery).update(0.0, 0.0, 11.2, 25.0)
        in_file = math.hypot(battery.noise.capacity_std, gain_std, gain_std)
        assert known(battery).capacity_Ah.relative_std == pytest.approx(in_file, rel=1e-6)
        assert rest.soh_capacity_std == pytest.approx(in_file, rel=1e-3)


def test_the_order_of_tests_does_not_matter(batteries):
    one, two = batteries["test and day, identified"], batteries["day and test, identified"]
    assert difference_in_sigmas(one, two) < 0.3


def test_the_halves_of_a_test_give_what_the_whole_gives(batteries):
    middle_s = float(PULSES.time_s[len(PULSES) // 2])
    first = replace(PULSES.between(-np.inf, middle_s), name="first")
    second = replace(PULSES.between(middle_s, np.inf), name="second")
    halves = identified(first, second, first=1.0, second=1.0 + float(first.charge_Ah()[-1]) / 12.0)
    assert difference_in_sigmas(batteries["test"], halves) < 0.3
