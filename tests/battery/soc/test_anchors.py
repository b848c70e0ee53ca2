"""Anchors in logs: simulated charges, cut-offs and rests, whose state of charge is known, and what is none of them."""

from dataclasses import replace

import numpy as np
import pytest

from battery.anchor_examples import HOUR, day, drained, label
from ohmward.battery.soc import anchors
from ohmward.battery.soc.anchors import find_anchors
from ohmward.logs.log import Log

CHEMISTRIES = pytest.mark.parametrize("chemistry", ("lfp", "nca"))


def columns_of(log):
    return log.time_s, log.current_A, log.voltage_V, log.temperature_degC


def kinds(anchors):
    return [anchor.kind for anchor in anchors]


@CHEMISTRIES
@pytest.mark.parametrize("offset_C", (-0.01, 0.0, 0.01))
@pytest.mark.parametrize("degC", (0.0, 25.0, 40.0))
def test_a_full_charge_is_found_once_and_holds_the_truth(chemistry, offset_C, degC):
    log, truth = day(chemistry, 0.3, [(0.2, 0.0), (7.0, 0.3), (0.5, 0.0), (0.5, -0.5)], degC, offset_C=offset_C)
    anchors = find_anchors(log, label(chemistry))
    (full,) = (anchor for anchor in anchors if anchor.kind == "full charge")
    assert set(kinds(anchors)) <= {"full charge", "nearly full", "rest"}
    assert abs(truth[full.sample] - full.soc) < 2.5 * full.soc_std
    assert full.soc_std < 0.03


@CHEMISTRIES
@pytest.mark.parametrize("hours", (0.5, 1.0, 1.5, 2.0))
def test_a_charge_that_is_broken_off_is_no_full_one(chemistry, hours):
    log, truth = day(chemistry, 0.2, [(0.2, 0.0), (hours, 0.36), (3.0, 0.0), (0.3, -0.5)])
    assert truth.max() < 0.97
    assert "full charge" not in kinds(find_anchors(log, label(chemistry)))


def test_a_battery_of_lead_acid_is_full_after_its_absorption_and_not_at_rest_after_a_short_one():
    log, truth = day("lead-acid", 0.4, [(0.2, 0.0), (14.0, 0.15), (1.0, 0.0), (1.0, -0.2)])
    (full,) = (anchor for anchor in find_anchors(log, label("lead-acid")) if anchor.kind == "full charge")
    assert abs(truth[full.sample] - full.soc) < 2 * full.soc_std
    short, truth = day("lead-acid", 0.4, [(0.2, 0.0), (3.0, 0.15), (6.0, 0.0)])
    assert truth.max() < 0.9
    assert "full charge" not in kinds(find_anchors(short, label("lead-acid")))


@CHEMISTRIES
def test_each_full_charge_counts_once_however_long_the_charger_stays(chemistry):
    charge, drive = (8.0, 0.3), (1.0, -0.4)
    log, _ = day(chemistry, 0.5, [charge, (3.0, 0.0), drive, charge, drive, charge])
    assert kinds(find_anchors(log, label(chemistry))).count("full charge") == 3


@CHEMISTRIES
@pytest.mark.parametrize("rate", (0.2, 0.5))
def test_a_cut_off_under_load_is_empty(chemistry, rate):
    log, truth = drained(chemistry, rate)
    (empty,) = find_anchors(log, label(chemistry))
    assert empty.kind == "empty"
    assert abs(truth[empty.sample] - empty.soc) < 2 * empty.soc_std


@CHEMISTRIES
def test_a_strong_load_on_a_half_full_battery_in_the_cold_is_no_cut_off(chemistry):
    log, truth = day(chemistry, 0.5, [(0.2, 0.0), (0.1, -1.5), (0.2, 0.0), (0.1, -1.5), (0.3, 0.0)], degC=-15.0)
    assert truth.min() > 0.15
    assert kinds(find_anchors(log, label(chemistry))) == []


def test_a_long_rest_tells_what_the_curve_tells():
    log, truth = day("nca", 0.6, [(0.2, 0.0), (0.5, -0.5), (4.0, 0.0), (0.3, -0.5), (0.5, 0.0)])
    battery = label("nca")
    (rest,) = find_anchors(log, battery)
    assert rest.kind == "rest" and rest.time_s == pytest.approx(4.7 * HOUR, abs=20.0)
    by_curve = battery.thevenin.ocv.soc_at(log.voltage_V[rest.sample])
    assert rest.soc == pytest.approx(by_curve, abs=2e-3)
    assert abs(truth[rest.sample] - rest.soc) < 2 * rest.soc_std


def test_a_rest_tells_less_where_the_voltage_sensor_is_not_the_one_of_the_test():
    log, _ = day("nca", 0.6, [(0.2, 0.0), (0.5, -0.5), (4.0, 0.0), (0.3, -0.5), (0.5, 0.0)])
    battery = label("nca")
    other = replace(battery, noise=replace(battery.noise, voltage_gain_std=0.01))
    (same,), (rest,) = find_anchors(log, battery), find_anchors(log, other)
    curve, voltage_V = battery.thevenin.ocv, log.voltage_V[rest.sample]
    by_gain = 0.5 * (curve.soc_at(1.01 * voltage_V) - curve.soc_at(0.99 * voltage_V))
    assert rest.soc == pytest.approx(same.soc)
    assert rest.soc_std == pytest.approx(np.hypot(same.soc_std, by_gain), rel=0.05)


def test_a_rest_on_a_plateau_tells_nothing():
    log, _ = day("lfp", 0.6, [(0.2, 0.0), (0.2, -0.5), (8.0, 0.0), (0.2, -0.5)])
    assert find_anchors(log, label("lfp")) == ()


def test_a_log_that_ends_low_was_cut_off_and_so_was_one_before_a_gap():
    log, truth = drained("nca", 0.2)
    lowest = int(np.argmin(log.voltage_V))
    ended = log.select(slice(0, lowest + 1))
    (empty,) = (anchor for anchor in find_anchors(ended, label("nca")) if anchor.kind == "empty")
    assert empty.sample == lowest
    assert abs(truth[lowest] - empty.soc) < 2 * empty.soc_std
    later = Log("later", ended.time_s + 2 * ended.time_s[-1], ended.current_A, ended.voltage_V, ended.temperature_degC)
    time_s, current_A, voltage_V, degC = map(np.concatenate, zip(columns_of(ended), columns_of(later), strict=True))
    day_and_day = Log("two days", time_s, current_A, voltage_V, degC)
    assert [anchor.sample for anchor in find_anchors(day_and_day, label("nca"))] == [lowest]


@pytest.mark.parametrize("stretch", (1, 97, 1000))
def test_an_event_that_lasts_is_found_in_a_log_that_is_searched_in_stretches(stretch, monkeypatch):
    log, _ = day("nca", 0.5, [(3.0, 0.0), (8.0, 0.3), (4.0, 0.0), (0.5, -0.5)])
    whole = find_anchors(log, label("nca"))
    assert kinds(whole) == ["rest", "full charge", "rest"]
    monkeypatch.setattr(anchors, "_STRETCH", stretch)
    assert find_anchors(log, label("nca")) == whole


@pytest.mark.parametrize(
    ("name", "full"), [("charger_full", 1.0), ("is_fully_charged", 1.0), ("power_supply_status", 4.0)]
)
def test_a_charger_says_that_the_battery_is_full(name, full):
    log, _ = day("lfp", 0.6, [(0.2, -0.3), (0.5, 0.3), (0.2, -0.3)])
    says = np.where(np.abs(log.time_s - 0.65 * HOUR) < 120.0, full, 0.0)
    (anchor,) = find_anchors(replace(log, extra={name: says}), label("lfp"))
    assert (anchor.kind, anchor.source, anchor.soc) == ("full charge", name, 1.0)
    assert anchor.time_s == pytest.approx(0.65 * HOUR - 120.0, abs=10.0)


def test_samples_without_numbers_change_nothing_and_hide_what_they_hide():
    log, _ = day("nca", 0.3, [(0.2, 0.0), (7.0, 0.3), (0.5, 0.0)])
    rng = np.random.default_rng(3)
    voltage_V = np.where(rng.random(len(log)) < 0.1, np.nan, log.voltage_V)
    found = find_anchors(replace(log, voltage_V=voltage_V), label("nca"))
    assert kinds(found) in (["full charge"], ["full charge", "rest"], [])
    nothing = replace(log, voltage_V=np.full(len(log), np.nan))
    assert find_anchors(nothing, label("nca")) == ()
