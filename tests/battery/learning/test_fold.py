"""Corrections that are put into the file, against its voltages before."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.learning.fold import folded_curve, with_curve_of_file, without_capacity
from ohmward.battery.learning.parameters import parameters_of, prior_covariance
from ohmward.battery.learning.voltage_model import OpenCircuit


@pytest.mark.parametrize("branch", [-1.0, 0.0])
def test_a_learnt_hysteresis_leaves_the_voltage_of_the_tested_branch(branch):
    battery = generic_battery("nmc", 10.0)
    battery = replace(
        battery,
        thevenin=replace(battery.thevenin, tested_branch=branch),
        noise=replace(battery.noise, hysteresis_std=0.5),
    )
    p, before = parameters_of(battery), battery.thevenin.ocv
    theta = np.zeros(p.size)
    theta[p.group("hysteresis")] = np.log(2.0)
    after, soc = folded_curve(OpenCircuit(battery, theta, p), prior_covariance(battery)), np.linspace(0.0, 1.0, 201)
    assert after.hysteresis_at(soc) == pytest.approx(2.0 * before.hysteresis_at(soc), rel=1e-12)
    tested_V = before.mean_V(soc, 25.0) + branch * before.hysteresis_at(soc)
    assert after.mean_V(soc, 25.0) + branch * after.hysteresis_at(soc) == pytest.approx(tested_V, abs=1e-9)


def test_where_the_curve_would_fall_its_uncertain_end_gives_way():
    battery = generic_battery("lfp", 100.0, 8)
    p, covariance, before = parameters_of(battery), prior_covariance(battery), battery.thevenin.ocv
    place = p.group("ocv").start
    theta = np.zeros(p.size)
    theta[place] = 8.0
    shown = np.arange(place + 4, p.group("ocv").stop)
    covariance[shown, shown] = 1e-4
    after, soc = folded_curve(OpenCircuit(battery, theta, p), covariance), np.linspace(0.1, 1.0, 91)
    assert after.mean_V(soc, 25.0) == pytest.approx(before.mean_V(soc, 25.0), abs=0.05)


def test_a_part_that_does_not_show_its_soc_leaves_the_curve_as_it_was():
    battery = generic_battery("lfp", 10.0)
    p, before = parameters_of(battery), prior_covariance(battery)
    theta, covariance = with_curve_of_file(p, np.ones(p.size), 0.25 * before, before)
    curve, others = p.places("slip", "ocv", "entropy"), p.places("capacity", "ohmic", "pair", "tau", "offset")
    assert not theta[curve].any()
    assert covariance[np.ix_(curve, curve)] == pytest.approx(before[np.ix_(curve, curve)], rel=1e-12)
    assert theta[others] == pytest.approx(1.0)
    assert covariance[np.ix_(others, others)] == pytest.approx(0.25 * before[np.ix_(others, others)], rel=1e-12)


@pytest.mark.parametrize("count_error2", [1e-4, 4e-3, 1.0])
def test_capacity_and_offset_stay_correlated_as_far_as_the_charge_was_counted(count_error2):
    battery = generic_battery("lfp", 10.0)
    p, before = parameters_of(battery), prior_covariance(battery)
    q, offset, knot = p.group("capacity").start, p.group("offset").start, p.group("ocv").start
    moves = np.eye(p.size)
    moves[offset, q], moves[knot, offset] = 1e3 * np.sqrt(before[offset, offset] / before[q, q]), 1e-3
    found = without_capacity(moves @ before @ moves.T, battery, count_error2)
    gain = found[offset, q] / found[offset, offset]
    assert before[q, q] - gain * found[offset, q] == pytest.approx(min(count_error2, before[q, q]), rel=0.01)
    assert found[knot, q] == pytest.approx(gain * found[offset, knot], rel=1e-12)
    assert np.linalg.eigvalsh(found).min() > -1e-12
