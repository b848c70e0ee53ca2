"""Currents and voltages that come at rates of their own, one after the other, or seldom, as in the logs of a robot."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from battery.examples import drive, simulate
from ohmward import SocEstimator, generic_battery
from ohmward.battery.models.noise import path_std_A
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.clean_sample import WAITS_S, CleanSocSample, sample_limits, sanitize
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.battery.soc.voltage_faults import HeldVoltage, beside_current
from ohmward.logs.log import Log

BATTERY = generic_battery("nmc", 10.0)
START, STEPS = 0.8, 7200
K = np.arange(STEPS)
NAN = math.nan


@cache
def mission():
    """Two hours of a drive, a sample a second."""
    current_A = np.repeat(3.0 * drive(np.random.default_rng(4), STEPS // 20, -0.4), 20)
    return simulate(BATTERY.thevenin, current_A, START, 1.0)


def run_with(has_current, has_voltage):
    """Error at the end, its standard deviation, and the run; has_current, has_voltage: conditions (T,)."""
    truth = mission()
    current_A = np.where(has_current, truth.current_A, NAN)
    voltage_V = np.where(has_voltage, np.round(truth.voltage_V, 3), NAN)
    log = Log("drive", truth.time_s, current_A, voltage_V, np.full(STEPS, 25.0))
    run = SocEstimator(BATTERY).run(log)
    return run.soc[-1] - truth.soc[-1], run.soc_std[-1], run


@pytest.mark.parametrize("every", [5, 30])
def test_voltages_at_a_lower_rate_show_as_much(every):
    """Their errors last for minutes: one a second shows no more than one in half a minute."""
    _, std, _ = run_with(K >= 0, K >= 0)
    error, sparse_std, _ = run_with(K >= 0, K % every == 0)
    assert sparse_std == pytest.approx(std, rel=0.1)
    assert abs(error) < 2.0 * sparse_std


@pytest.mark.parametrize(
    ("has_current", "has_voltage"), [(K % 2 == 0, K % 2 == 1), (K % 2 == 1, K % 2 == 0), (K % 5 == 0, K % 5 == 1)]
)
def test_current_and_voltage_one_after_the_other_show_as_much_as_together(has_current, has_voltage):
    """Where each is measured once in two seconds, or in five."""
    _, std, _ = run_with(K >= 0, K >= 0)
    error, apart_std, run = run_with(has_current, has_voltage)
    assert apart_std < 1.6 * std
    assert abs(error) < 2.0 * apart_std
    assert np.isfinite(run.estimates.innovation_V[100:]).mean() > 0.9 * has_voltage.mean()


def cleaned(dt_s, current_A, voltage_V, before_A, unknown_s=0.0):
    """A sample after a current."""
    limits = sample_limits(BATTERY.thevenin)
    return sanitize(SocSample(dt_s, current_A, voltage_V, 25.0), CircuitInput(before_A, 25.0), limits, unknown_s)


def test_a_voltage_is_used_with_the_current_at_its_time():
    """A quarter of the way from one current to the next."""
    waits, alone = beside_current(HeldVoltage(), cleaned(0.5, NAN, 3.7, -1.0), 0.0)
    assert not alone.voltage_measured
    held, paired = beside_current(waits, cleaned(1.5, -5.0, NAN, -1.0, unknown_s=0.5), 0.5)
    assert (paired.voltage_measured, paired.voltage_V, held.waiting_V) == (True, 3.7, 0.0)
    assert paired.now.current_A == pytest.approx(-2.0, abs=1e-12)
    assert paired.latest_A == -5.0


@pytest.mark.parametrize(("unknown_s", "is_used"), [(WAITS_S - 2.0, False), (WAITS_S, True)])
def test_a_voltage_waits_only_while_a_current_may_come(unknown_s, is_used):
    _, clean = beside_current(HeldVoltage(), cleaned(1.0, NAN, 3.7, -1.0, unknown_s), unknown_s)
    assert bool(clean.voltage_measured) == is_used


def test_a_sample_with_both_drops_the_voltage_that_waits():
    clean: CleanSocSample = cleaned(1.0, -2.0, 3.6, -1.0, unknown_s=1.0)
    held, paired = beside_current(HeldVoltage(waiting_V=3.7, waiting_s=1.0), clean, 1.0)
    assert (held.waiting_V, paired.voltage_V, paired.now.current_A) == (0.0, 3.6, -2.0)


@pytest.mark.parametrize("voltage_first", [False, True])
@pytest.mark.parametrize("chemistry", ["nmc", "lfp"])
def test_a_start_under_load_has_the_current_beside_its_voltage(chemistry, voltage_first):
    """Taken for a rest, the first voltage would put the charge of a loaded battery too low, and surely."""
    battery = generic_battery(chemistry, 10.0)
    truth = simulate(battery.thevenin, np.full(20, -10.0), 0.9, 1.0)
    estimator, n = SocEstimator(battery), int(voltage_first)
    rows = [(t, i, v) for t, i, v in zip(truth.time_s, truth.current_A, truth.voltage_V, strict=True)]
    for k, (t, i, v) in enumerate(rows):
        now = estimator.update(float(t), None if k % 2 != n else float(i), None if k % 2 == n else float(v))
    assert abs(now.soc - truth.soc[-1]) < 2.0 * now.soc_std
    assert not now.flags & SocFlag.RESTARTED


@pytest.mark.parametrize(("every_s", "within"), [(60, (0.9, 1.1)), (10, (0.7, 1.1)), (2, (0.7, 1.3))])
def test_a_sampled_current_misses_as_much_charge_as_is_assumed(every_s, within):
    """A current that is new every three seconds, summed up over a hundred samples; four hundred times."""
    rng = np.random.default_rng(3)
    current_A = np.repeat(rng.standard_normal((400, 34 * every_s)), 3, axis=1)[:, : 100 * every_s + 1]
    charge_As = 0.5 * (current_A[:, 1:] + current_A[:, :-1]).sum(axis=1)
    sampled_A = current_A[:, ::every_s]
    missed_As = 0.5 * every_s * (sampled_A[:, 1:] + sampled_A[:, :-1]).sum(axis=1) - charge_As
    path_As = every_s * path_std_A(np.diff(sampled_A), every_s)
    assert within[0] < np.std(missed_As) / np.sqrt(np.mean(np.sum(path_As**2, axis=1))) < within[1]


def test_a_sparsely_sampled_drive_stays_within_the_band():
    """Bursts of seconds in a log with a row every 20 s, of a known capacity: 1.5 sigma without this."""
    lfp = generic_battery("lfp", 10.0)
    noise = replace(lfp.noise, capacity_std=0.01, resistance_std=0.05, model_std_V=(0.005, 0.005))
    battery = replace(lfp, noise=noise, sensor=replace(lfp.sensor, offset_std_A=0.02, offset_walk_A=0.0))
    squares = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        current_A = np.repeat(rng.choice([0.0, -1.0, -9.0, 6.0], STEPS, p=[0.35, 0.4, 0.15, 0.1]), 3)[: 2 * STEPS]
        truth = simulate(battery.thevenin, current_A, 0.9, 1.0)
        time_s, sampled_A, soc, voltage_V = (column[::20] for column in truth)
        log = Log("drive", time_s, sampled_A, voltage_V, np.full(len(soc), 25.0))
        run = SocEstimator(battery, initial_soc=0.9, initial_soc_std=0.01).run(log)
        squares.append(np.mean(((run.soc - soc) / run.soc_std)[90:] ** 2))
    assert np.sqrt(np.mean(squares)) < 1.2
