"""Logs side by side are the logs one by one."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from battery.examples import NMC, drive, samples, simulate
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.soc.coulomb import CoulombCounting
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import ESTIMATORS, make_estimator
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.fleet.lanes import _parts, estimate_logs
from ohmward.logs.log import Log

NOISE = BatteryNoise()


def a_log(seed: int, steps: int) -> Log:
    truth = simulate(NMC, drive(np.random.default_rng(seed), steps), 0.9 - 0.05 * seed)
    columns = samples(truth, 0.0, NOISE)
    return Log(f"log {seed}", truth.time_s, columns.current_A, columns.voltage_V)


LOGS = [a_log(seed, steps) for seed, steps in enumerate([120, 37, 300, 300, 1, 150, 2])]


@pytest.mark.parametrize("lowering", ["python", "machine"])
@pytest.mark.parametrize("estimator", [TheveninFilter(NMC, NOISE), CoulombCounting(NMC, NOISE)], ids=["ekf", "coulomb"])
def test_logs_of_many_lengths_are_the_logs_one_by_one(estimator, lowering):
    together = estimate_logs(estimator, LOGS, lowering=lowering)
    for log, found in zip(LOGS, together, strict=True):
        alone = SocEstimator(estimator, lowering="python").run(log).estimates
        for name in alone._fields:
            assert getattr(found, name).shape == (len(log),)
            np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-7, atol=1e-9, err_msg=name)


def test_each_log_begins_on_its_own_day():
    noise = replace(NOISE, capacity_std=0.1, capacity_known_unix_s=1.79e9, capacity_known_std=0.02)
    logs = [replace(log, start_unix_s=1.79e9 + 86400.0 * 60 * k) for k, log in enumerate(LOGS[:3])]
    together = estimate_logs(TheveninFilter(NMC, noise), logs)
    for log, found in zip(logs, together, strict=True):
        alone = SocEstimator(TheveninFilter(NMC, noise)).run(log).estimates
        np.testing.assert_allclose(found.soh_capacity_std, alone.soh_capacity_std, rtol=1e-7)
    assert together[0].soh_capacity_std[0] < together[1].soh_capacity_std[0] < together[2].soh_capacity_std[0]


def test_a_given_start_is_that_of_every_log():
    found = estimate_logs(CoulombCounting(NMC, NOISE), LOGS[:2], initial_soc=0.88, initial_soc_std=1e-3)
    assert [e.soc[0] for e in found] == pytest.approx([0.88, 0.88], abs=1e-3)


def test_no_logs_give_no_estimates():
    assert estimate_logs(CoulombCounting(NMC, NOISE), []) == []


@pytest.mark.parametrize("lengths", [[5], [100, 100, 100], [100, 99, 3, 1], list(range(1000, 0, -7))])
def test_parts_cover_every_step_of_every_log(lengths):
    parts = list(_parts(np.array(lengths)))
    assert [p[0] for p in parts] == [0, *(p[1] for p in parts[:-1])] and parts[-1][1] == lengths[0]
    assert len(parts) <= 16
    for first, last, lanes in parts:
        assert first < last and lanes == sum(length > first for length in lengths)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_is_traced_once_for_all_batches(name):
    battery = generic_battery("nmc", 2.0)
    first: Any = make_estimator(name, battery)
    again: Any = make_estimator(name, battery)
    assert SocEstimator(first, lowering="python").kernel is SocEstimator(again, lowering="python").kernel
