"""Steps of the voltage that another battery makes, and those that it does not."""

import math

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.onboard.exchange_watch import ExchangeWatch

MODEL = generic_battery("lfp", 20.0, 8).thevenin
OHM = 0.3 * MODEL.largest_ohm


def found(*, step_V=0.0, expected_V=0.0, load_A=0.0, silent_s=0.0, flags=0, lasts=50, wrong=0.9):
    """Whether another battery is found after a step of 10 min; the filter's resistance is `wrong` of the true one."""
    rng, watch = np.random.default_rng(3), ExchangeWatch()
    for k in range(600 + lasts):
        now = k >= 600
        current_A = -2.0 - 6.0 * ((k + 13) // 25 % 2) + load_A * now
        measured_V = 26.4 + OHM * current_A + 0.01 * rng.standard_normal() + step_V * now
        innovation_V = measured_V - 26.4 - wrong * OHM * current_A - expected_V * now
        estimate = SocEstimate(0.5, 0.1, innovation_V=innovation_V, flags=SocFlag(flags * (k == 600)))
        watch, exchanged = watch.after(1.0 + silent_s * (k == 600), current_A, 25.0, measured_V, estimate, MODEL)
        if exchanged:
            return True
    return False


@pytest.mark.parametrize(("step_V", "silent_s"), [(0.2, 5.0), (-0.2, 5.0)])
def test_a_step_that_no_load_explains_is_another_battery(step_V, silent_s):
    assert found(step_V=step_V, silent_s=silent_s)


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


def test_a_step_without_a_silence_is_none():
    assert not found(step_V=0.5)
