"""A cell that is lost in use, and falls of the voltage that are none."""

import math
from typing import Any

import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.cell_loss import CellLoss
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.resume import remember, resume

BATTERY = generic_battery("lfp", 20.0, 8)
PACK_V, OHM = 26.4, 0.02


def voltages(*, share=7 / 8, load_A=0.0, silent_s=0.0, lasts=60):
    """The watch and the voltages that it gives along a load, of which the battery shows a share after a minute."""
    watch, given = CellLoss(BATTERY), []
    for k in range(60 + lasts):
        now = k >= 60
        current_A = -1.0 - 2.0 * (k // 10 % 2) + load_A * now
        voltage_V = (PACK_V + OHM * current_A) * (share if now else 1.0)
        given.append(watch.take(k + silent_s * now, current_A, voltage_V))
    return watch, given


def test_the_voltage_of_a_lost_cell_is_that_of_the_others():
    watch, given = voltages()
    assert watch.lost == 1
    assert all(map(math.isnan, given[60:62]))
    assert given[63:] == pytest.approx([PACK_V - OHM * (1.0 + 2.0 * (k // 10 % 2)) for k in range(63, 120)])


def test_a_cell_that_comes_back_is_there_again():
    watch, _ = voltages()
    for k in range(5):
        given_V = watch.take(120.0 + k, -1.0, PACK_V)
    assert watch.lost == 0 and given_V == PACK_V


@pytest.mark.parametrize(
    "other",
    [
        {"lasts": 2},  # a glitch
        {"silent_s": 5.0},  # perhaps another battery
        {"load_A": -60.0},  # a load
        {"share": 0.95},
        {"share": 0.8},
        {"share": 9 / 8},
        {"share": math.nan},
    ],
)
def test_another_fall_is_no_lost_cell(other):
    watch, given = voltages(**other)
    assert watch.lost == 0
    assert math.isnan(given[-1]) == (math.isnan(other.get("share", 0.0)) or "lasts" in other)


@pytest.mark.parametrize(("chemistry", "n"), [("nmc", 7), ("lfp", 24), ("lead-acid", 6)])
def test_the_charge_goes_on_without_a_lost_cell(chemistry, n):
    battery = generic_battery(chemistry, 20.0, n)
    open_V = float(battery.thevenin.ocv.mean_V(0.6, 25.0))
    whole: Any = Estimation(battery)
    short: Any = Estimation(battery)
    for k in range(600):
        current_A = -1.0 - 2.0 * (k // 10 % 2)
        voltage_V = open_V + 0.3 * battery.thevenin.largest_ohm * current_A
        for estimation, share in ((whole, 1.0), (short, 1.0 - (k > 300) / n)):
            estimation.put(float(k), {"battery_current_A": current_A, "battery_voltage_V": share * voltage_V})
    assert short.cell_loss.lost == 1 and short.swaps == 0
    assert short.state.battery[:2] == pytest.approx(whole.state.battery[:2], abs=0.01)
    content = remember(short, 600.0)
    for away_s, lost in ((20.0, 1), (3600.0, 0)):
        after: Any = Estimation(battery)
        assert resume(after, content, away_s, 5.0) == []
        assert after.cell_loss.lost == lost
    assert "cells_lost" in resume(Estimation(battery), content | {"cells_lost": n}, 20.0, 5.0)[0]
