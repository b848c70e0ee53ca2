"""Days of one battery teach its file; a day of another one, or of the same one with other cells, does not."""

import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cli.examples import MODEL
from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.learning import learn
from ohmward.battery.learning.learn import learn_log
from ohmward.battery.models.thevenin import Thevenin
from ohmward.logs import Log
from ohmward.logs.log import Note
from ohmward_lab.simulate.voltage import simulate_voltage


def day(model: Thevenin, seed: int, name: str = "") -> Log:
    """From full through a day of changing loads to a fifth, a rest, and back to full; a sample every 10 s."""
    rng = np.random.default_rng(seed)
    loads_A = -np.repeat(rng.uniform(0.0, 0.5 * model.capacity_Ah, 120), 12)
    loads_A *= 0.8 * model.capacity_Ah * 360 / -loads_A.sum()
    charge_A = 0.5 * model.capacity_Ah * np.minimum(1.0, np.exp(-(np.arange(900) - 500) / 100))
    charge_A *= 0.8 * model.capacity_Ah * 360 / charge_A.sum()
    current_A = np.concatenate([np.zeros(180), loads_A, np.zeros(180), charge_A, np.zeros(60)])
    time_s = 10.0 * np.arange(current_A.size)
    log = Log(name or f"day {seed}", time_s, current_A, np.zeros(time_s.size), np.full(time_s.size, 25.0))
    voltage_V = simulate_voltage(model, log, 1.0).voltage_V + 0.005 * rng.standard_normal(time_s.size)
    return replace(log, voltage_V=voltage_V, current_A=current_A + 0.02 * rng.standard_normal(time_s.size))


@cache
def taught_by(*seeds: int) -> Battery:
    """The battery of a label after these days of the example's, each of which it has learnt from."""
    learnt = learn(generic_battery("nmc", 12.0, 3), [day(MODEL, seed) for seed in seeds])
    assert [update.verdict for update in learnt.updates] == ["learnt"] * len(seeds)
    return learnt.battery


def pulse_ohm(model: Thevenin) -> float:
    """Resistance to ten seconds of current; the resistances of the example are the same at every SoC."""
    pairs = zip(model.r_ohm, model.tau_s, strict=True)
    return model.r0_discharge_ohm[0] + sum(row[0] * (1 - np.exp(-10.0 / tau_s)) for row, tau_s in pairs)


@pytest.fixture
def taught() -> Battery:
    return taught_by(1, 2)


def test_a_third_day_of_the_same_battery_is_learnt(taught):
    (update,) = learn(taught, [day(MODEL, 3)]).updates
    assert update.verdict == "learnt"
    # three days down to a fifth leave the knee at empty open
    assert abs(update.capacity_Ah.mean - MODEL.capacity_Ah) < 2 * update.capacity_Ah.std < 0.2 * MODEL.capacity_Ah


def test_a_swapped_battery_is_noticed_and_the_file_stays(taught):
    learnt = learn(taught, [day(MODEL.worn(0.75, 1.7), 3)])
    (update,) = learnt.updates
    assert update.verdict == "set aside"
    assert update.reason.startswith("this is not the battery of the file: its ")
    assert "resistance is" in update.reason
    assert learnt.battery is taught


def test_a_swap_is_noticed_by_a_file_that_many_days_have_confirmed(taught):
    days = [day(MODEL, k) for k in range(3, 9)]
    updates = learn(taught, [*days, day(MODEL.worn(0.85, 1.35), 99)]).updates
    assert [update.verdict for update in updates] == [*["learnt"] * 6, "set aside"]


def test_the_day_after_a_swap_back_is_learnt(taught):
    updates = learn(taught, [day(MODEL.worn(0.75, 1.7), 3), day(MODEL, 4)]).updates
    assert [update.verdict for update in updates] == ["set aside", "learnt"]


def test_a_day_that_the_file_does_not_fit_by_the_check_of_soc_is_set_aside(monkeypatch):
    """One policy: whatever `misfits` says of a log, it is not learnt."""
    wrong = (Note("the battery file does not fit the log: as soc says", "warning"),)
    monkeypatch.setattr(sys.modules[learn_log.__module__], "misfits", lambda *_, **__: wrong)
    before = generic_battery("nmc", 12.0, 3)
    after, update = learn_log(before, day(MODEL, 1))
    assert after is before and update.verdict == "set aside"
    assert update.reason == wrong[0].text


def test_a_day_whose_sensor_has_another_offset_is_set_aside(taught):
    third = day(MODEL, 3)
    (update,) = learn(taught, [replace(third, current_A=third.current_A + 1.0)]).updates
    assert update.verdict == "set aside"
    assert "its current sensor shows" in update.reason and "A where none flows" in update.reason


@pytest.mark.parametrize("known", [False, True])
def test_a_current_without_its_sign_is_set_aside(taught, known):
    third = day(MODEL, 3)
    battery = taught if known else generic_battery("nmc", 12.0, 3)
    (update,) = learn(battery, [replace(third, current_A=-np.abs(third.current_A))]).updates
    assert update.verdict == "set aside"


def test_a_battery_of_twice_the_label_is_refused():
    (update,) = learn(generic_battery("nmc", 6.0, 3), [day(MODEL, 1)]).updates
    assert update.verdict == "set aside" and "its capacity is" in update.reason


def test_an_aged_battery_may_still_have_its_label():
    learnt = learn(generic_battery("nmc", 12.0, 3), [day(MODEL.worn(0.78, 1.6), k) for k in (1, 2)])
    assert [update.verdict for update in learnt.updates] == ["learnt", "learnt"]
    mean, std = learnt.updates[-1].capacity_Ah
    assert mean == pytest.approx(0.78 * 12.0, abs=2.5 * std)
    assert learnt.updates[-1].resistance_ohm.mean == pytest.approx(1.6 * pulse_ohm(MODEL), rel=0.05)
