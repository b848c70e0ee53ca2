"""Steps of the voltage that another battery makes, and those that it does not."""

import math
from typing import Any

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.learning.learn import learn
from ohmward.battery.soc import estimator as along
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.exchange_watch import ExchangeWatch
from ohmward.battery.soc.registry import DEFAULT, make_estimator
from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.fleet.lanes import estimate_logs
from ohmward.logs.log import Log
from ohmward.onboard.estimation import Estimation

MODEL = generic_battery("lfp", 20.0, 8).thevenin
OHM = 0.3 * MODEL.largest_ohm


def found(*, step_V=0.0, expected_V=0.0, load_A=0.0, silent_s=0.0, flags=0, lasts=50, wrong=0.9, unused=0):
    """Whether another battery is found after a step of 10 min; the filter's resistance is `wrong` of the true one.

    unused: number of the samples after the step whose voltage the filter takes for a fault.
    """
    rng, watch = np.random.default_rng(3), ExchangeWatch()
    for k in range(600 + lasts):
        now = k >= 600
        current_A = -2.0 - 6.0 * ((k + 13) // 25 % 2) + load_A * now
        measured_V = 26.4 + OHM * current_A + 0.01 * rng.standard_normal() + step_V * now
        innovation_V = measured_V - 26.4 - wrong * OHM * current_A - expected_V * now
        innovation_V = math.nan if 600 <= k < 600 + unused else innovation_V
        estimate = SocEstimate(0.5, 0.1, innovation_V=innovation_V, flags=SocFlag(flags * (k == 600)))
        watch, exchanged = watch.after(1.0 + silent_s * (k == 600), current_A, 25.0, measured_V, estimate, MODEL)
        if exchanged:
            return True
    return False


@pytest.mark.parametrize(("step_V", "unused"), [(0.2, 0), (-0.2, 0), (1.5, 30)])
def test_a_step_that_no_load_explains_is_another_battery(step_V, unused):
    assert found(step_V=step_V, silent_s=5.0, unused=unused)


@pytest.mark.parametrize("silent_s", [0.0, 5.0, 30.0])
@pytest.mark.parametrize(
    "same",
    [
        {},
        {"load_A": -15.0},  # or a charger is plugged in
        {"load_A": 20.0},
        {"expected_V": 0.5},  # the filter changes its mind
        {"step_V": 0.5, "flags": SocFlag.GAP},  # the filter began afresh
        {"step_V": 0.5, "lasts": 2},  # a glitch
        {"step_V": math.nan},
    ],
)
def test_what_the_same_battery_shows_is_none(same, silent_s):
    assert not found(silent_s=silent_s, **same)


@pytest.mark.parametrize("unused", [0, 30])
def test_a_step_without_a_silence_is_none(unused):
    assert not found(step_V=0.5, unused=unused)


NMC = generic_battery("nmc", 10.0, 7)


def exchanged_log(*socs, count=1800):
    """Log of batteries that are put in one after the other at these states of charge, each for `count` seconds."""
    rng = np.random.default_rng(1)
    current_A = -2.0 - 4.0 * (np.arange(count) // 30 % 2)
    soc = np.concatenate([first + np.cumsum(current_A) / 36000.0 for first in socs])
    time_s = np.arange(soc.size) + 20.0 * (np.arange(soc.size) // count)
    current_A = np.tile(current_A, len(socs))
    open_V = NMC.thevenin.ocv.mean_V(soc, 25.0)
    voltage_V = open_V + 0.35 * NMC.thevenin.largest_ohm * current_A + 0.005 * rng.standard_normal(soc.size)
    return Log("exchanged", time_s, current_A, voltage_V, np.full(soc.size, 25.0)), soc


@pytest.mark.parametrize("piece", [1 << 18, 1802])
@pytest.mark.parametrize("socs", [(0.8,), (0.8, 0.4), (0.5, 0.95), (0.8, 0.4, 0.9)])
def test_a_log_gives_what_live_gives(socs, piece, monkeypatch):
    monkeypatch.setattr(along, "_PIECE", piece)
    log, soc = exchanged_log(*socs)
    run, live = SocEstimator(NMC).run(log), Estimation(NMC)
    names = "battery_current_A", "battery_voltage_V", "battery_temperature_degC"
    columns = log.current_A, log.voltage_V, np.full(len(log), 25.0)
    states: Any = [
        live.put(t, dict(zip(names, row, strict=True)))[0] for t, *row in zip(log.time_s, *columns, strict=True)
    ]
    assert run.soc == pytest.approx(np.array([state.battery.soc for state in states]), abs=1e-9)
    assert run.flags.tolist() == [int(state.battery.flags) for state in states]
    assert len(run.exchanges) == live.swaps == len(socs) - 1
    assert abs(run.soc[-1] - soc[-1]) < 2.0 * run.soc_std[-1]


def test_a_log_in_a_lane_gives_what_it_gives_alone():
    log, _ = exchanged_log(0.8, 0.4, count=60)
    run, (lane,) = SocEstimator(NMC).run(log), estimate_logs(make_estimator(DEFAULT, NMC), [log])
    assert len(run.exchanges) == 1
    assert lane.soc == pytest.approx(run.soc, abs=1e-9)


def test_a_log_of_two_batteries_is_not_learnt():
    (update,) = learn(NMC, exchanged_log(0.8, 0.4)[0]).updates
    assert update.verdict == "set aside" and "another battery was put in" in update.reason
