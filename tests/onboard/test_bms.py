"""What the battery's own management says: read from every source, stored, and shown beside our estimates."""

import pytest

from ohmward import generic_battery
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.page.view import view
from ohmward.onboard.ros import types
from ohmward.onboard.sources.json_lines import own_names
from ohmward.onboard.sources.ros2 import _of_table
from ohmward.onboard.store.rows import RowMaker

SAID = {"bms_soc": 0.61, "bms_charge_limit_A": 20.0, "bms_discharge_limit_A": 80.0, "bms_alarm": 0.0}


def test_it_is_shown_beside_ours_and_stored_and_changes_nothing():
    ours, alone = (Estimation(generic_battery("lfp", 12.0, 4)) for _ in range(2))
    values = {"battery_current_A": -2.0, "battery_voltage_V": 13.2}
    (state,) = ours.put(0.0, values | own_names({**SAID}))
    (other,) = alone.put(0.0, values)
    assert state.battery is not None and other.battery is not None
    assert state.battery.soc == other.battery.soc
    shown = {one["label"]: (one["value"], one["unit"]) for one in view(state)["charge"]["beside"]}
    assert shown["BMS: charge"] == (pytest.approx(61.0), "%")
    assert shown["BMS: discharge limit"] == (80.0, "A")
    (row,) = RowMaker().rows(state._replace(unix_s=1.8e9))
    assert {name: row.values[name] for name in SAID} == SAID


def test_the_percentage_of_ros_is_that_of_the_management():
    numbers = {"current": -2.0, "voltage": 13.2, "temperature": 25.0, "percentage": 0.61}
    assert _of_table(types.BATTERY_STATE, numbers)["bms_soc"] == 0.61
