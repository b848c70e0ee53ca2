"""Full end of a label where its charger stops lower: exact curves, simulated charges, charges without a limit."""

import math
from dataclasses import replace

import numpy as np
import pytest

from battery.anchor_examples import day, label
from ohmward.battery.battery import Knowledge, Provenance, SeenLog
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.learning import learn
from ohmward.battery.learning.charger_limit import (
    full_at_charger_limit,
    limit_sentence,
    raised_to,
    with_charge_seen,
    with_full_at,
)
from ohmward.battery.learning.parameters import parameters_of, prior_covariance
from ohmward.battery.soc.anchors import find_anchors, scan_anchors, with_known_full
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocFlag
from ohmward.logs.log import Log
from ohmward_lab.simulate import BATTERIES

#: Voltage of a full simulated cell is 4.18 V; its charger stops at this one [V].
LIMIT_V = 4.05
PHASES = [(0.2, 0.0), (7.0, 0.3), (0.5, 0.0), (1.0, -0.5), (0.5, 0.0)]


def lower_charge(soc=0.3):
    """A charge that its charger ends at a lower limit, and a drive after it."""
    return day("nca", soc, PHASES, limit_V=LIMIT_V)


def own_full():
    """SoC of the simulated cell at which its charger stops."""
    cell = BATTERIES["nca"]
    return float(cell.circuit.ocv.soc_at(LIMIT_V))


@pytest.mark.parametrize("soc", [0.8, 0.9, 1.0])
def test_the_curve_up_to_the_limit_becomes_the_whole_curve(soc):
    before = generic_battery("nmc", 10.0, 3)
    after = with_full_at(before, soc)
    z = np.linspace(0.0, 1.0, 11)
    curve, degC = before.thevenin.ocv, 25.0
    np.testing.assert_allclose(after.thevenin.ocv.mean_V(z, degC), curve.mean_V(soc * z, degC), atol=2e-3)
    assert after.capacity_Ah == after.thevenin.capacity_Ah == pytest.approx(10.0 * (1.0 + soc) / 2)
    assert after.noise.soc_axis_std == pytest.approx(np.hypot(before.noise.soc_axis_std, 0.5 * (1.0 - soc)))
    assert after.noise.capacity_std == pytest.approx(np.hypot(before.noise.capacity_std, 0.5 * (1.0 - soc)))


def test_only_a_full_end_that_moved_is_reported():
    before = generic_battery("nmc", 10.0)
    assert limit_sentence(before, replace(before, noise=replace(before.noise, capacity_std=0.2))) == ""
    assert limit_sentence(before, with_full_at(before, 0.9)).startswith("full is where its charger stops")


def test_what_logs_have_shown_keeps_the_charge_along_the_curve():
    label_ = generic_battery("nmc", 10.0)
    knowledge = Knowledge.of(parameters_of(label_).names, prior_covariance(label_), (SeenLog("day"),), 0.45)
    before = replace(label_, knowledge=knowledge)
    after = with_full_at(before, 0.9)
    z = np.array([0.3, 0.6, 1.0])
    below_full_Ah = after.capacity_Ah * (1.0 - z)
    np.testing.assert_allclose(below_full_Ah, before.capacity_Ah * (0.9 - 0.9 * z))
    assert after.knowledge is not None
    assert after.knowledge.seen_from_soc == pytest.approx(0.5)


@pytest.mark.parametrize("soc", [0.3, 0.6])
def test_a_label_holds_a_charge_that_ends_below_its_curve_for_one_between_full_and_its_voltage(soc):
    log, truth = lower_charge(soc)
    estimates = SocEstimator(label("nca")).run(log).estimates
    (event,) = np.flatnonzero(estimates.flags.astype(int) & SocFlag.ANCHORED)
    settled = log.time_s >= log.time_s[event]
    for full in (1.0, own_full()):  # whether the robot calls this full, or the data sheet of its cells
        error = np.abs(estimates.soc - truth / own_full() * full)[settled]
        assert np.mean(error < 1.96 * estimates.soc_std[settled]) > 0.9


@pytest.mark.parametrize("limit_V", [None, LIMIT_V])
def test_a_charge_shows_where_full_is(limit_V):
    log, _ = day("nca", 0.3, PHASES, limit_V=limit_V)
    assert label("nca").noise.full_soc_std > 0.0
    assert full_at_charger_limit(label("nca"), log).noise.full_soc_std == 0.0
    broken_off = log.between(0.0, 3600.0)
    assert full_at_charger_limit(label("nca"), broken_off).noise.full_soc_std > 0.0


@pytest.mark.parametrize(("soc", "current_C", "left"), [(0.98, 0.0, 0.02), (0.98, 0.5, None), (0.9, 0.0, None)])
def test_full_is_no_farther_below_its_curve_than_a_voltage_without_charge(soc, current_C, left):
    battery = label("nca")
    voltage_V = np.full(60, float(battery.thevenin.ocv.mean_V(soc, 25.0)))
    log = Log("rest", np.arange(60.0), np.full(60, current_C * battery.capacity_Ah), voltage_V)
    expected = battery.noise.full_soc_std if left is None else left
    assert with_charge_seen(battery, log).noise.full_soc_std == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("soc", [0.3, 0.6])
def test_a_charger_that_stops_lower_defines_full(soc):
    log, truth = lower_charge(soc)
    assert scan_anchors(log, label("nca"))[1].limit_V == pytest.approx(LIMIT_V, abs=5e-3)
    ready = full_at_charger_limit(label("nca"), log)
    assert ready.thevenin.ocv.voltage_V[-1] == pytest.approx(LIMIT_V, abs=5e-3)
    (full,) = (anchor for anchor in find_anchors(log, ready) if anchor.kind == "full charge")
    assert full.soc == pytest.approx(1.0, abs=0.01)
    assert truth[full.sample] == pytest.approx(own_full(), abs=0.01)
    assert full_at_charger_limit(ready, log) is ready


@pytest.mark.parametrize("stretch", [97, 1000])
def test_a_lower_limit_is_found_in_a_log_that_is_searched_in_stretches(stretch, monkeypatch):
    log, _ = lower_charge()
    whole = scan_anchors(log, label("nca"))
    monkeypatch.setattr("ohmward.battery.soc.anchors._STRETCH", stretch)
    assert scan_anchors(log, label("nca")) == whole


@pytest.mark.parametrize("limit_V", [None, LIMIT_V])
def test_one_pass_finds_the_anchors_of_a_known_full_end_beside_those_of_an_unknown_one(limit_V):
    log, _ = day("nca", 0.3, PHASES, limit_V=limit_V)
    _, known = scan_anchors(log, label("nca"))
    assert known == scan_anchors(log, with_known_full(label("nca")))[0]


@pytest.mark.parametrize("spike_V", [math.nan, 0.1, -0.1, 4.0])
def test_spikes_do_not_hide_the_limit_of_a_charger(spike_V):
    log, _ = lower_charge()
    voltage_V = log.voltage_V.copy()
    voltage_V[::20] += spike_V
    _, (_, limit_V) = scan_anchors(replace(log, voltage_V=voltage_V), label("nca"))
    assert limit_V == pytest.approx(LIMIT_V, abs=5e-3)


def test_a_log_teaches_the_charge_below_the_limit_of_its_charger():
    log, truth = lower_charge()
    learnt = learn(label("nca"), [log])
    (update,) = learnt.updates
    assert update.reason.startswith("full is where its charger stops, at 4.0")
    of_robot = truth / own_full()
    for found, true in ((update.soc_start, of_robot[0]), (update.soc_end, of_robot[-1])):
        assert abs(found.mean - true) < 2.5 * found.std
    assert learnt.battery.thevenin.ocv.voltage_V[-1] == pytest.approx(LIMIT_V, abs=0.015)


def test_a_charger_that_goes_higher_later_raises_full_again():
    battery = label("nca")
    for limit_V in (LIMIT_V, LIMIT_V, None, None):
        log, truth = day("nca", 0.3, PHASES, limit_V=limit_V)
        battery = learn(battery, [replace(log, name=f"at {limit_V}", start_unix_s=None)]).battery
    cell = BATTERIES["nca"]
    assert battery.thevenin.ocv.voltage_V[-1] == pytest.approx(cell.circuit.ocv.voltage_V[-1], abs=0.015)
    assert battery.capacity_Ah == pytest.approx(cell.circuit.capacity_Ah, rel=0.1)
    run = SocEstimator(battery).run(log)
    settled = log.time_s > 3600.0
    assert np.mean(np.abs(run.soc - truth)[settled] < 1.96 * run.soc_std[settled]) > 0.9


def test_a_raised_curve_is_the_lower_one_and_that_of_the_chemistry_above_it():
    before = with_full_at(generic_battery("nmc", 10.0, 3), 0.9)
    after = raised_to(before, 3 * 4.19)
    z = np.linspace(0.0, 1.0, 11)
    whole = generic_battery("nmc", 10.0, 3).thevenin.ocv
    np.testing.assert_allclose(after.thevenin.ocv.mean_V(z, 25.0), whole.mean_V(z, 25.0), atol=0.01)
    assert after.capacity_Ah == pytest.approx(before.capacity_Ah / 0.9, rel=2e-3)
    assert after.noise.soc_axis_std >= generic_battery("nmc", 10.0, 3).noise.soc_axis_std
    assert raised_to(after, 3 * 4.19) is after


@pytest.mark.parametrize(
    ("chemistry", "phases"),
    [
        ("nca", PHASES),
        ("nca", [(0.2, 0.0), (1.5, 0.36), (3.0, 0.0)]),
        ("lfp", PHASES),
        # the sun sets
        ("lfp", [(0.2, 0.0), *((0.25, rate) for rate in np.linspace(0.4, 0.01, 12)), (1.0, 0.0)]),
        ("nca", [(0.2, 0.0), *((0.25, rate) for rate in np.linspace(0.4, 0.01, 12)), (1.0, 0.0)]),
    ],
)
def test_other_charges_have_no_lower_limit(chemistry, phases):
    log, _ = day(chemistry, 0.3, phases)
    assert scan_anchors(log, label(chemistry))[1].limit_V is None


def test_a_full_end_that_is_known_stays():
    log, _ = lower_charge()
    tested = replace(label("nca"), identification=Provenance(3.0))
    assert full_at_charger_limit(tested, log) is tested
    anchored = replace(with_known_full(label("nca")), knowledge=Knowledge((), (), (SeenLog("day", anchors=1),)))
    assert full_at_charger_limit(anchored, log) is anchored
    lead = generic_battery("lead-acid", 7.0, 6)
    assert full_at_charger_limit(lead, log) is lead
