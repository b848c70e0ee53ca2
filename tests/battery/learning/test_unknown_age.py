"""Batteries that have aged since their file was written, by nobody knows how much."""

from dataclasses import replace

import numpy as np
import pytest

from battery.learning.test_another_battery import day
from battery.learning.test_learn import TESTED, problem
from cli.examples import MODEL
from ohmward.battery.learning import learn
from ohmward.battery.learning.fold import pulse_ohm
from ohmward.battery.learning.start import prior_of_age


@pytest.fixture(scope="module")
def part():
    return problem(TESTED, day(MODEL, 1))


def test_a_battery_that_has_not_aged_keeps_its_prior(part):
    model, prior = part
    assert np.array_equal(prior_of_age(model, prior, prior.mean).cov, prior.cov)


def test_a_larger_capacity_and_a_smaller_resistance_are_no_ageing(part):
    model, prior = part
    x = prior.mean.copy()
    x[model.parameters.group("capacity")] = 0.3
    x[model.parameters.group("ohmic")] = -2.0
    assert np.array_equal(prior_of_age(model, prior, x).cov, prior.cov)


def test_what_has_aged_is_within_one_standard_deviation_of_its_prior(part):
    model, prior = part
    p, x = model.parameters, prior.mean.copy()
    resistances = np.r_[p.group("ohmic"), p.group("pair")]
    x[p.group("capacity")], x[resistances] = np.log(0.7), np.log(2.0)
    found = prior_of_age(model, prior, x)
    assert found.cov[p.group("capacity"), p.group("capacity")].item() == pytest.approx((1.5 * np.log(0.7)) ** 2)
    shared = found.cov[np.ix_(resistances, resistances)]
    assert shared.min() == pytest.approx((1.5 * np.log(2.0)) ** 2)
    added = found.cov - prior.cov
    assert np.linalg.eigvalsh(added).min() > -1e-12  # nothing gets surer
    assert np.diag(added)[p.group("ocv")][[0, -1]] == pytest.approx(0.0)  # full and empty stay


def test_cycles_of_an_aged_cell_teach_its_capacity_and_its_resistance():
    old = MODEL.worn(0.8, 1.5)
    # its curve stays as it is along SoC: the electrodes have not slipped
    unslipped = replace(MODEL, ocv_slip=0.0)
    file = replace(TESTED, thevenin=unslipped, noise=replace(TESTED.noise, resistance_std=0.3))
    update = learn(file, [day(old, k) for k in (1, 2)]).updates[-1]
    # down to a fifth, little tells the slip of the electrodes from the loss
    assert update.capacity_Ah.mean == pytest.approx(old.capacity_Ah, rel=0.06)
    assert abs(update.capacity_Ah.mean - old.capacity_Ah) < 2 * update.capacity_Ah.std
    assert update.resistance_ohm.mean == pytest.approx(pulse_ohm(old), rel=0.05)
