"""Columns by which a charger says that the battery is full."""

import numpy as np
import pytest

from ohmward.logs.battery_columns import full_charges


@pytest.mark.parametrize("name", ("charger_full", "Full", "is_fully_charged", "BMS charge complete", "battery.full"))
def test_each_time_that_a_flag_rises_is_one_charge(name):
    assert full_charges({name: np.array([0.0, 1.0, 1.0, np.nan, 0.0, 1.0])}) == ((name, 1), (name, 5))


def test_the_status_of_ros_says_full_by_its_constant():
    assert full_charges({"power_supply_status": np.array([1.0, 4.0, 4.0, 2.0])}) == (("power_supply_status", 1),)


@pytest.mark.parametrize("name", ("full_scale", "charge_Ah", "status", "fuel", "discharge_complete"))
def test_other_columns_say_nothing_of_it(name):
    assert full_charges({name: np.array([0.0, 1.0])}) == ()


def test_a_share_is_no_flag_and_a_log_that_starts_full_was_not_charged_in_it():
    assert full_charges({"full": np.array([0.2, 1.0])}) == ()
    assert full_charges({"full": np.array([1.0, 1.0, 0.0])}) == ()
