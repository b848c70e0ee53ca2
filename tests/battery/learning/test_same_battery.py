"""A log of another battery contradicts a file that knows its own; later logs of the same one do not."""

import numpy as np
import pytest

from ohmward.battery.chemistries import Normal, generic_battery
from ohmward.battery.learning.fold import KnownBattery
from ohmward.battery.learning.log_update import LogUpdate
from ohmward.battery.learning.same_battery import (
    confirms,
    explained_worse,
    forgotten,
    is_label,
    moved_too_far,
    other_battery,
    other_label,
    too_small,
    unexplained,
)

FILE = KnownBattery(Normal(10.0, 0.2), Normal(0.020, 0.0012), Normal(0.0, 0.01), np.zeros(21), 3, 20.0)


def seen(capacity_Ah: float, resistance_ohm: float, offset_A: float = 0.0, std_A: float = 0.02) -> LogUpdate:
    capacity, resistance = Normal(capacity_Ah, 0.03 * capacity_Ah), Normal(resistance_ohm, 0.1 * resistance_ohm)
    return LogUpdate("day", "learnt", "", 8.0, capacity, resistance, Normal(offset_A, std_A), misfit=1.0)


@pytest.mark.parametrize("capacity_Ah, resistance_ohm", [(10.0, 0.020), (9.6, 0.022), (10.5, 0.018)])
def test_what_both_may_err_is_no_contradiction(capacity_Ah, resistance_ohm):
    assert other_battery(FILE, seen(capacity_Ah, resistance_ohm)) == ""


def test_the_quantities_that_differ_are_told():
    text = other_battery(FILE, seen(8.0, 0.030))
    assert text.startswith("this is not the battery of the file: its capacity is 8 ± 0.47 Ah, in the file 10 ±")
    assert "its resistance is 30 ± 5.9 mohm, in the file 20 ± 2.4 mohm" in text
    assert "capacity" not in other_battery(FILE, seen(10.0, 0.035)).partition("(95 %)")[0].replace("of the file", "")


def test_both_differences_count_together():
    assert other_battery(FILE, seen(8.9, 0.020)) == ""
    assert other_battery(FILE, seen(10.0, 0.0285)) == ""
    assert other_battery(FILE, seen(8.9, 0.0285)) != ""


def test_a_log_that_the_file_explains_far_worse_needs_a_smaller_difference():
    assert other_battery(FILE, seen(9.2, 0.024), 20.0) == ""
    assert other_battery(FILE, seen(9.2, 0.024), 100.0) != ""
    assert other_battery(FILE, seen(9.8, 0.021), 200.0) == ""


def test_the_likelihood_that_is_lost_counts_independent_errors():
    """Eight hours of errors that hold on for 200 s: 72 of them, whose squares are four times as large."""
    assert explained_worse(8 * 3600.0, 200.0, 0.010, 0.005) == pytest.approx(72 * np.log(4.0))
    assert explained_worse(8 * 3600.0, 200.0, 0.005, 0.005) == 0.0
    assert explained_worse(8 * 3600.0, 200.0, np.nan, 0.005) == 0.0


def test_a_label_may_be_wrong_by_more():
    label = FILE._replace(
        capacity_Ah=Normal(10.0, 1.0), resistance_ohm=Normal(0.020, 0.016), offset_A=Normal(0.0, 0.25)
    )
    assert other_label(label, seen(7.0, 0.040)) == ""
    assert "its capacity is 5 ±" in other_label(label, seen(5.0, 0.020))
    assert "its capacity is 6.8 ±" in other_label(label, seen(6.8, 0.020)._replace(misfit=4.0))
    assert other_label(label, seen(6.8, 0.020)) == ""


def test_a_sensor_with_another_offset_is_told_from_another_battery():
    other = seen(8.0, 0.030)._replace(offset_A=Normal(0.5, 0.02))
    assert other_battery(FILE, other, 100.0).startswith("its current sensor shows 0.5 ± 0.039 A where none flows")
    assert "is not the battery of the file" in other_battery(FILE, other, 0.0)
    label = FILE._replace(capacity_Ah=Normal(10.0, 1.0), resistance_ohm=Normal(0.020, 0.016))
    assert other_label(label, seen(10.0, 0.020, 0.04, 0.001)) == ""
    assert "current sensor shows 0.05 ±" in other_label(label, seen(10.0, 0.020, 0.05, 0.001))


def test_a_log_moves_what_a_file_knows_by_no_more_than_that_may_err():
    assert moved_too_far(FILE, seen(10.7, 0.020)) == ""
    assert "its capacity is 10.9 ±" in moved_too_far(FILE, seen(10.9, 0.020))


def test_a_log_that_moves_nothing_confirms_its_file():
    assert confirms(FILE, seen(10.02, 0.0201))
    assert not confirms(FILE, seen(10.05, 0.020))
    assert not confirms(FILE, seen(10.02, 0.0201)._replace(misfit=1.5))


def test_a_voltage_that_does_not_follow_from_the_current_is_unexplained():
    assert unexplained(seen(10.0, 0.020)._replace(residual_rms_V=0.02, misfit=6.0)) == ""
    text = unexplained(seen(10.0, 0.020)._replace(residual_rms_V=0.05, misfit=25.0))
    assert text.startswith("its voltage does not follow from its current: 50 mV off, where 10 mV are expected")


def test_a_file_without_its_knowledge_is_a_label():
    battery = generic_battery("nmc", 10.0, 3)
    assert is_label(battery)
    assert forgotten(battery) == battery


def test_a_log_that_goes_through_more_than_all_of_the_charge_is_of_a_larger_battery():
    assert too_small(Normal(6.0, 0.6), 1.1) == ""
    assert "its capacity is 9 Ah at least" in too_small(Normal(6.0, 0.6), 1.5)
