"""On-board learning: what the live filter has found stands in the file, bounded, once, and over a restart."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery, start_model
from ohmward.battery.learning.on_board import MOST_CORRECTION_STD, learnt_on_board
from ohmward.battery.learning.parameters import parameters_of, prior_covariance
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.errors import InputError
from ohmward.logs import Log
from ohmward_lab.simulate.voltage import simulate_voltage

LABEL = generic_battery("nmc", 10.0)


def day(capacity_Ah: float = 9.0, resistance: float = 1.4, offset_A: float = 0.0, hours: float = 10.0) -> Log:
    """Changing load and charge between 20 and 100 % of a battery that is not quite that of the label."""
    model = start_model("nmc", 10.0)
    true = replace(
        model,
        capacity_Ah=capacity_Ah,
        r0_discharge_ohm=tuple(resistance * r for r in model.r0_discharge_ohm),
        r0_charge_ohm=tuple(resistance * r for r in model.r0_charge_ohm),
        r_ohm=tuple(tuple(resistance * r for r in row) for row in model.r_ohm),
    )
    time_s = np.arange(0.0, 3600.0 * hours, 10.0)
    phase = time_s / 3600.0 % 5.0
    charge_A = np.where((phase > 2.5) & (phase < 4.5), 3.6, 0.0)
    current_A = np.where(phase < 2.0, -3.6 - 3.0 * np.sin(time_s / 40.0), charge_A)
    log = Log("day", time_s, current_A, np.zeros(time_s.size), np.full(time_s.size, 25.0))
    voltage_V = simulate_voltage(true, log, 1.0).voltage_V
    return replace(log, voltage_V=voltage_V, current_A=current_A + offset_A)


def after(battery: Battery, log: Log) -> SocEstimator:
    estimator = SocEstimator(battery)
    estimator.run(log)
    return estimator


@pytest.fixture(scope="module")
def estimator() -> SocEstimator:
    return after(LABEL, day())


def test_the_file_has_the_capacity_and_the_resistance_that_the_filter_has_found(estimator):
    learnt, now = learnt_on_board(LABEL, estimator), estimator.last
    assert learnt.thevenin is not None and now is not None
    assert learnt.capacity_Ah == pytest.approx(now.soh_capacity * LABEL.capacity_Ah, rel=0.02)
    assert 8.5 < learnt.capacity_Ah < 9.8
    model = learnt.thevenin
    assert model.r0_discharge_ohm[len(model.r0_discharge_ohm) // 2] == pytest.approx(1.4 * 0.01, rel=0.2)
    assert learnt.sensor.offset_A == pytest.approx(now.current_offset_A, abs=0.02)


def test_the_file_is_surer_than_before_and_no_surer_than_its_floors(estimator):
    learnt = learnt_on_board(LABEL, estimator)
    assert 0.01 <= learnt.noise.capacity_std < LABEL.noise.capacity_std
    assert 0.05 <= learnt.noise.resistance_std < LABEL.noise.resistance_std
    before, p = prior_covariance(LABEL), parameters_of(LABEL)
    now = prior_covariance(learnt)
    assert np.linalg.eigvalsh(now).min() > 0.0
    assert now[p.group("capacity"), p.group("capacity")] < before[p.group("capacity"), p.group("capacity")]


def test_asked_twice_it_says_the_same(estimator):
    assert learnt_on_board(LABEL, estimator) == learnt_on_board(LABEL, estimator)


def test_a_snapshot_carries_it(estimator):
    restored = SocEstimator.restore(LABEL, estimator.snapshot())
    assert learnt_on_board(LABEL, restored) == learnt_on_board(LABEL, estimator)


def test_a_filter_that_has_seen_nothing_teaches_nothing():
    rest = Log("rest", np.arange(3.0), np.zeros(3), np.full(3, 3.7), np.full(3, 25.0))
    learnt = learnt_on_board(LABEL, after(LABEL, rest))
    assert learnt.capacity_Ah == pytest.approx(LABEL.capacity_Ah, rel=1e-3)
    assert learnt.noise.resistance_std == pytest.approx(LABEL.noise.resistance_std, rel=0.1)


def test_the_next_estimator_goes_on_from_the_new_file(estimator):
    """A day of the same battery with the file that has learnt: surer from the start on, and rightly."""
    log = day(hours=5.0)
    truth = 1.0 + log.charge_Ah() / 9.0
    label, learnt = (SocEstimator(b, 1.0).run(log) for b in (LABEL, learnt_on_board(LABEL, estimator)))
    assert np.mean(learnt.soc_std) < 0.9 * np.mean(label.soc_std)
    assert np.all(np.abs(learnt.soc - truth) < 2.0 * learnt.soc_std)


def test_no_correction_goes_beyond_its_bound():
    spoilt = day(capacity_Ah=5.0, resistance=4.0, offset_A=2.0)
    learnt = learnt_on_board(LABEL, after(LABEL, spoilt))
    std = math.hypot(LABEL.noise.capacity_std, LABEL.sensor.gain_std)
    assert abs(math.log(learnt.capacity_Ah / LABEL.capacity_Ah)) <= MOST_CORRECTION_STD * std + 1e-9
    assert abs(learnt.sensor.offset_A) <= MOST_CORRECTION_STD * LABEL.sensor.offset_std_A + 1e-9


def test_another_battery_is_refused(estimator):
    with pytest.raises(InputError, match="not the one that this estimator was made with"):
        learnt_on_board(generic_battery("nmc", 20.0), estimator)


def test_a_filter_without_corrections_is_refused():
    counter = SocEstimator(LABEL, filter="coulomb")
    counter.update(0.0, 0.0, 3.7)
    with pytest.raises(InputError, match="carries no corrections"):
        learnt_on_board(LABEL, counter)


def test_before_the_first_sample_nothing_was_learnt():
    with pytest.raises(InputError, match="before the first sample"):
        learnt_on_board(LABEL, SocEstimator(LABEL))
