"""A log is checked against the range of its battery's tests."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.log_check import check_log, other_cells
from ohmward.errors import InputError
from ohmward.logs import Log

BATTERY = generic_battery("lfp", 12.0, 4)
TIME_S = np.arange(100.0)


def log(voltage_V):
    return Log("day", TIME_S, 0.0 * TIME_S, np.broadcast_to(voltage_V, TIME_S.shape), np.full(TIME_S.size, 25.0))


def test_a_log_within_the_tests_stays_as_it_is():
    inside = log(0.5 * (BATTERY.voltage_min_V + BATTERY.voltage_max_V))
    assert check_log(inside, BATTERY) is inside


def test_voltages_beyond_the_tests_are_a_warning():
    voltage_V = np.where(TIME_S < 5, 1.1 * BATTERY.voltage_max_V, BATTERY.voltage_max_V)
    (note,) = check_log(log(voltage_V), BATTERY).notes
    assert note.level == "warning" and note.text.startswith("5.00% of the voltages lie outside")


@pytest.mark.parametrize(("cells", "named"), [(3, True), (4, False), (5, True)])
def test_another_number_of_cells_is_named(cells, named):
    """A file of four cells and logs of half charged packs."""
    found = other_cells(log(cells * 3.3), BATTERY)
    assert ("contradicts the battery file" in found and "n_series = 4" in found) == named


@pytest.mark.filterwarnings("error")
def test_a_log_without_a_voltage_contradicts_no_number_of_cells():
    assert other_cells(log(math.nan), BATTERY) == ""


@pytest.mark.filterwarnings("error")
def test_a_log_without_a_voltage_may_be_of_any_battery():
    without = log(math.nan)
    assert check_log(without, BATTERY) is without


@pytest.mark.parametrize("share", [0.25, 2.0])
def test_another_battery_is_refused(share):
    with pytest.raises(InputError, match="is it a log of another battery, of one of its cells, or in another unit"):
        check_log(log(share * BATTERY.voltage_max_V), BATTERY)


@pytest.mark.parametrize(("current_A", "refused"), [(-36.0, False), (-36e3, True), (math.nan, False)])
def test_a_current_that_no_battery_of_the_capacity_carries_is_refused(current_A, refused):
    driven = replace(log(BATTERY.voltage_max_V), current_A=np.full(TIME_S.size, current_A))
    if not refused:
        assert check_log(driven, BATTERY) is driven
        return
    with pytest.raises(InputError, match=r"3000 times the capacity of battery .*--unit current=mA"):
        check_log(driven, BATTERY)


def test_a_temperature_that_the_tests_do_not_show_is_a_warning_and_no_refusal():
    usual_V = 0.5 * (BATTERY.voltage_min_V + BATTERY.voltage_max_V)
    warm = replace(log(usual_V), temperature_degC=np.full(100, 20.0))
    assert check_log(warm, BATTERY) is warm
    cold = replace(warm, temperature_degC=np.where(TIME_S < 50, 20.0, -30.0))
    (note,) = check_log(cold, BATTERY).notes
    assert note.level == "warning" and note.text.startswith("the log goes to -30 degC, where the resistance follows")
    (note,) = check_log(replace(warm, temperature_degC=np.full(100, -0.04)), BATTERY).notes
    assert note.text.startswith("the log goes to 0 degC")


@pytest.mark.parametrize("unmeasured", [None, np.full(100, np.nan)])
def test_a_log_without_a_temperature_says_which_one_is_taken(unmeasured):
    half = replace(log(0.5 * (BATTERY.voltage_min_V + BATTERY.voltage_max_V)), temperature_degC=unmeasured)
    (note,) = check_log(half, BATTERY).notes
    assert note.level == "info" and note.text.startswith("no temperature: the battery is taken to be at 25 ± 15 degC")
