"""A first voltage that is possible but not the battery's: of a converter that starts, or of a message too early."""

import copy
import math
from typing import Any

import numpy as np
import pytest

from battery.examples import Truth, drive, simulate
from ohmward import SocEstimator, generic_battery, make_estimator
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.battery.soc.voltage_faults import START_SETTLED_S, watch_start, wrong_starts
from ohmward.fleet.lanes import estimate_logs
from ohmward.logs.log import Log

CAPACITY_AH = 10.0
TRUE_SOC = 0.7


def battery_of(chemistry):
    """The label of a battery of 12 V."""
    return generic_battery(chemistry, CAPACITY_AH, {"lfp": 4, "nmc": 3, "nca": 3, "lead-acid": 6}[chemistry])


def mission(chemistry, steps=600, dt_s=1.0):
    """A drive of this battery."""
    current_A = 3.0 * drive(np.random.default_rng(1), steps, -0.3)
    return simulate(battery_of(chemistry).thevenin, current_A, TRUE_SOC, dt_s)


def log_of(truth: Truth, wrong_V: float | None = None, wrong: int = 1) -> Log:
    """Its log, with `wrong` first voltages that are not the battery's."""
    voltage_V = np.round(truth.voltage_V, 3)
    if wrong_V is not None:
        voltage_V[:wrong] = wrong_V
    return Log("drive", truth.time_s, truth.current_A, voltage_V, np.full(len(voltage_V), 25.0))


def rows_of(log: Log) -> list[tuple[float, ...]]:
    """The arguments of `update` for every sample."""
    columns = zip(log.time_s, log.current_A, log.voltage_V, strict=True)
    return [(*map(float, row), 25.0) for row in columns]


@pytest.mark.parametrize("wrong_V", [8.0, 16.0])
@pytest.mark.parametrize("initial_soc", [None, TRUE_SOC])
@pytest.mark.parametrize("chemistry", ["lfp", "nmc", "nca", "lead-acid"])
def test_a_wrong_first_voltage_costs_nothing_but_its_sample(chemistry, initial_soc, wrong_V):
    truth, battery = mission(chemistry), battery_of(chemistry)
    good, bad = (SocEstimator(battery, initial_soc).run(log_of(truth, v)) for v in (None, wrong_V))
    assert np.abs(bad.soc - good.soc)[2:].max() < 0.02
    assert np.abs(bad.soc_std - good.soc_std)[2:].max() < 0.02
    assert bad.counts()["restarted"] == 1


@pytest.mark.parametrize("name", ["ekf", "ukf", "textbook-ekf", "coulomb", "ocv"])
def test_every_estimator_that_starts_from_the_first_voltage_starts_again(name):
    truth, battery = mission("nmc"), battery_of("nmc")
    good, bad = (SocEstimator(battery, filter=name).run(log_of(truth, v)) for v in (None, 8.0))
    assert np.abs(bad.soc - good.soc)[-1] < 0.02


@pytest.mark.parametrize(("dt_s", "wrong"), [(0.01, 1), (0.01, 100), (0.1, 10), (1.0, 3), (10.0, 1), (10.0, 4)])
def test_a_wrong_start_is_found_at_every_rate(dt_s, wrong):
    truth, battery = mission("lfp", dt_s=dt_s), battery_of("lfp")
    good, bad = (SocEstimator(battery, TRUE_SOC).run(log_of(truth, v, wrong)) for v in (None, 8.0))
    assert np.abs(bad.soc - good.soc)[2 * wrong + 1 :].max() < 0.02


def test_a_right_start_is_the_same_to_the_last_bit():
    """The kernel from the state of `init` has no watch."""
    log, battery = log_of(mission("lfp")), battery_of("lfp")
    estimator = SocEstimator(battery, TRUE_SOC)
    settings, first = estimator.settings, SocSample(0.0, log.current_A[0], log.voltage_V[0], 25.0)
    columns = SocSample(np.diff(log.time_s, prepend=0.0), log.current_A, log.voltage_V, log.temperature_degC)
    _, estimates = estimator.kernel.scan(settings.init(first, TRUE_SOC), columns)
    np.testing.assert_array_equal(estimator.run(log).soc, estimates.soc)


WRONG_STARTS = ([8.0, 0, 0], [8.0, 8.0, 0], [0, 8.0, 0], [8.0, np.nan, 0], [np.nan, 8.0, 0])


def started_wrong(voltages):
    """A log with these first voltages, 0 for the right one, and its run."""
    truth = mission("lfp")
    truth.voltage_V[:3] = np.where(np.array(voltages) == 0, truth.voltage_V[:3], voltages)
    log = log_of(truth)
    return log, SocEstimator(battery_of("lfp"), TRUE_SOC).run(log)


@pytest.mark.parametrize("voltages", WRONG_STARTS)
def test_live_and_along_a_log_alike(voltages):
    log, run = started_wrong(voltages)
    live = SocEstimator(battery_of("lfp"), TRUE_SOC)
    found = [live.update(*row) for row in rows_of(log)]
    np.testing.assert_allclose([estimate.soc for estimate in found], run.soc, atol=1e-9)
    assert [int(estimate.flags) for estimate in found] == run.flags.tolist()


def test_in_lanes_and_alone_alike():
    logs, runs = zip(*map(started_wrong, WRONG_STARTS), strict=True)
    for lane, run in zip(estimate_logs(runs[0].settings, logs, TRUE_SOC), runs, strict=True):
        np.testing.assert_allclose(lane.soc, run.soc, atol=1e-9)


def test_a_log_that_goes_on_from_wrong_live_samples_starts_again():
    log = log_of(mission("lfp"), 8.0)
    estimator = SocEstimator(battery_of("lfp"), TRUE_SOC)
    estimator.update(log.time_s[0], log.current_A[0], log.voltage_V[0], 25.0)
    found = copy.copy(estimator).run(log.select(slice(1, None)))
    np.testing.assert_allclose(found.soc, SocEstimator(battery_of("lfp"), TRUE_SOC).run(log).soc[1:], atol=1e-9)


@pytest.mark.parametrize("chemistry", ["lfp", "nmc"])
def test_an_unknown_start_waits_for_the_first_voltage(chemistry):
    """However long: what was estimated before knew nothing."""
    log, missing = log_of(mission(chemistry), math.nan, 200), 200
    found = SocEstimator(battery_of(chemistry)).run(log)
    of_rest = SocEstimator(battery_of(chemistry)).run(log.select(slice(missing, None)))
    np.testing.assert_allclose(found.soc[missing:], of_rest.soc, atol=0.002)  # the charge of one step apart
    np.testing.assert_allclose(found.soc_std[missing:], of_rest.soc_std, atol=0.002)
    assert found.soc_std[missing - 1] > 0.25


@pytest.mark.parametrize(("missing", "starts_again"), [(10, True), (40, False)])
def test_a_given_start_waits_for_the_first_voltage_while_little_charge_moves(missing, starts_again):
    run = SocEstimator(battery_of("nmc"), 0.3).run(log_of(mission("nmc"), math.nan, missing))
    assert [k for k, flag in enumerate(run.flags) if int(flag) & SocFlag.RESTARTED] == [missing] * starts_again


def test_live_an_unknown_start_waits_as_along_a_log():
    log = log_of(mission("lfp"), math.nan, 50)
    live = SocEstimator(battery_of("lfp"))
    found = [live.update(*row) for row in rows_of(log)]
    run = SocEstimator(battery_of("lfp")).run(log)
    np.testing.assert_allclose([estimate.soc for estimate in found], run.soc, atol=1e-9)
    (lane,) = estimate_logs(run.settings, [log])
    np.testing.assert_allclose(lane.soc, run.soc, atol=1e-9)


def test_a_wrong_voltage_after_a_right_first_one_is_no_wrong_start():
    truth = mission("lfp")
    truth.voltage_V[1] = 8.0
    run = SocEstimator(battery_of("lfp")).run(log_of(truth))
    assert run.counts()["voltage_rejected"] == 1
    assert "restarted" not in run.counts()


def test_a_wrong_voltage_after_a_gap_leaves_the_charge_before_it():
    truth, battery = mission("lfp", 1200), battery_of("lfp")
    log, gap_s = log_of(truth), 10 * 3600.0
    time_s = log.time_s + np.where(np.arange(1200) < 600, 0.0, gap_s)
    wrong_V = log.voltage_V.copy()
    wrong_V[600] = 8.0
    good, bad = (
        SocEstimator(battery, TRUE_SOC).run(Log("gap", time_s, log.current_A, v, log.temperature_degC))
        for v in (log.voltage_V, wrong_V)
    )
    assert np.abs(bad.soc - good.soc)[602:].max() < 0.02


def test_a_charge_that_was_given_since_ends_the_watch():
    log = log_of(mission("lfp"), 8.0)
    estimator = SocEstimator(battery_of("lfp"))
    estimator.update(log.time_s[0], log.current_A[0], log.voltage_V[0], 25.0)
    estimator.correct_soc(TRUE_SOC, 0.01)
    flags = [int(estimator.update(*row).flags) for row in rows_of(log)[1:20]]
    assert not any(flag & SocFlag.RESTARTED for flag in flags)


def test_a_microcontroller_waits_for_the_second_voltage():
    """In C the state begins without the first voltage, at the charge that the caller gives."""
    estimator: Any = make_estimator("gsf", battery_of("lfp"))
    first = SocSample(0.0, 0.0, 8.0, 25.0)
    state, wrong = estimator.step(estimator.start(first, TRUE_SOC, 0.03), first)
    _, right = estimator.step(state, SocSample(1.0, 0.0, 13.2, 25.0))
    assert [bool(int(estimate.flags) & SocFlag.VOLTAGE_REJECTED) for estimate in (wrong, right)] == [True, False]
    assert [wrong.soc, right.soc] == pytest.approx([TRUE_SOC, TRUE_SOC], abs=0.02)


def test_the_start_is_settled_after_a_while():
    battery = battery_of("lfp")
    rows = int(START_SETTLED_S) + 1
    samples = SocSample(np.ones(rows), np.zeros(rows), np.full(rows, 13.2), np.full(rows, 25.0))
    first = watch_start(SocSample(0.0, 0.0, 13.2, 25.0), battery.thevenin)
    again, watch = wrong_starts(samples, battery.thevenin, first)
    assert (again, watch) == ({}, None)


@pytest.mark.parametrize("spread_V", [0.3, 3.0])
@pytest.mark.parametrize("rows", [20, 60])
def test_a_voltage_that_hardly_moves_is_settled_as_one_watched_row_by_row(spread_V, rows):
    model = battery_of("lfp").thevenin
    voltage_V = 13.2 + spread_V * np.random.default_rng(2).uniform(-0.5, 0.5, rows)
    samples = SocSample(np.r_[0.0, np.ones(rows - 1)], np.zeros(rows), voltage_V, np.full(rows, 25.0))
    first, later = (SocSample(*(column[part] for column in samples)) for part in (0, slice(1, None)))
    again, watch = wrong_starts(later, model, watch_start(first, model))
    assert wrong_starts(samples, model) == ({k + 1: sample for k, sample in again.items()}, watch)
