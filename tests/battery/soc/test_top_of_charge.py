"""The steep end of a flat curve, reached by a charge that nobody tapers, in the filter."""

from dataclasses import replace

import numpy as np
import pytest

from battery.anchor_examples import day, label
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.anchor_rule import AnchorRule
from ohmward.battery.soc.anchors import find_anchors
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocFlag
from ohmward_lab.simulate import BATTERIES

CHARGE, DRIVE = (8.0, 0.3), (1.0, -0.3)


def broken_off(log, truth, voltage_V):
    """Log and truth up to the first sample of at least this voltage, at which a protection opens."""
    end = int(np.argmax(log.voltage_V >= voltage_V)) + 1
    assert end > 1
    measured = {name: values[:end] for name, values in log.measured().items()}
    return replace(log, **measured), truth[:end]


def reached(run):
    return np.flatnonzero(run.flags.astype(int) & SocFlag.ANCHORED)


@pytest.mark.parametrize("interval_s", (1.0, 30.0, 120.0))
def test_a_charge_that_is_cut_off_at_its_limit_tells_that_the_battery_is_full(interval_s):
    log, truth = day("lfp", 0.5, [CHARGE], interval_s=interval_s, limit_V=14.6)
    log, truth = broken_off(log, truth, 14.2)
    run = SocEstimator(label("lfp"), initial_soc=0.4).run(log)
    (at,) = reached(run)
    assert truth[at] > 0.97
    assert abs(run.soc[-1] - truth[-1]) < 2 * run.soc_std[-1] < 0.06
    (found,) = (anchor for anchor in find_anchors(log, label("lfp")) if anchor.kind == "nearly full")
    assert found.sample == at and found.soc == pytest.approx(truth[at], abs=2 * found.soc_std)


def test_missing_voltages_and_currents_hide_it_from_nobody():
    log, truth = day("lfp", 0.5, [CHARGE], interval_s=1.0, limit_V=14.6)
    log, truth = broken_off(log, truth, 14.2)
    rng = np.random.default_rng(4)
    voltage_V, current_A = (np.where(rng.random(truth.size) < 0.3, np.nan, v) for v in (log.voltage_V, log.current_A))
    run = SocEstimator(label("lfp"), initial_soc=0.4).run(replace(log, voltage_V=voltage_V, current_A=current_A))
    (at,) = reached(run)
    assert truth[at] > 0.97


@pytest.mark.parametrize("offset_V", (-0.03, 0.05))
def test_the_level_of_the_plateau_is_no_evidence(offset_V):
    log, truth = day("lfp", 0.3, [(1.9, 0.3), (0.2, 0.0), (0.1, -0.3)], interval_s=30.0)
    assert 0.8 < truth.max() < 0.93
    moved = replace(log, voltage_V=log.voltage_V + label("lfp").n_series * offset_V)
    assert not reached(SocEstimator(label("lfp")).run(moved)).size


@pytest.mark.parametrize("degC", (0.0, 25.0))
def test_a_charge_from_empty_is_not_near_full(degC):
    log, truth = day("lfp", 0.02, [(1.5, 0.5)], degC, interval_s=10.0)
    run = SocEstimator(label("lfp")).run(log)
    assert truth.max() < 0.8 and not reached(run).size


def test_resistances_of_twice_the_label_are_not_taken_for_it():
    log, truth = day("lfp", 0.3, [(0.5, 0.0), (0.8, 0.7), (0.3, -0.7), (0.2, 0.7)], interval_s=5.0)
    battery = label("lfp")
    rule = AnchorRule(battery.thevenin, battery.noise, battery.sensor)
    ohm = rule.steady_ohm(0.5, CircuitInput(1.0, 25.0))
    higher = replace(log, voltage_V=log.voltage_V + ohm * log.current_A)
    assert truth.max() < 0.93 and not reached(SocEstimator(battery).run(higher)).size


def test_each_charge_tells_it_once():
    phases = [(1.8, 0.3), (0.1, -0.2), (0.2, 0.3), DRIVE, CHARGE]
    log, truth = day("lfp", 0.5, phases, interval_s=30.0, limit_V=14.6)
    at = reached(SocEstimator(label("lfp")).run(log))
    assert at.size == 2 and truth[at].min() > 0.97


def test_a_curve_that_rises_everywhere_has_no_such_end():
    log, _ = day("nca", 0.5, [CHARGE, DRIVE, CHARGE], interval_s=30.0)
    assert not reached(SocEstimator(label("nca")).run(log)).size


def test_the_cells_of_these_tests_are_other_ones_than_that_of_the_label():
    own, usual = BATTERIES["lfp"].circuit.ocv, label("lfp").thevenin.ocv
    assert np.abs(np.subtract(own.voltage_V, usual.voltage_V)).max() > 0.02
