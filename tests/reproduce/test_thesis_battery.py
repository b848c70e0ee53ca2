"""Results of [T] chapter 3 on its own conditions, mean of three drives."""

import math

import numpy as np
import pytest

from ohmward_lab.reproduce import thesis_battery
from ohmward_lab.reproduce.row import ResultRow
from ohmward_lab.reproduce.thesis_battery import SOC_PERCENT, VOLTAGE_V
from ohmward_lab.reproduce.thesis_cases import stop_as_printed
from ohmward_lab.reproduce.thesis_runs import NARROW, case, offline_voltage


@pytest.fixture(scope="module")
def voltage() -> dict[str, ResultRow]:
    return {row.quantity: row for row in thesis_battery.voltage_by_method().rows}


def test_the_corrected_filters_stay_within_the_largest_errors_of_table_3_2(voltage):
    for method in ("ekf", "aekf", "ukf", "aukf"):
        largest = voltage[f"Voltage before the sample, {method.upper()}: largest"].corrected
        assert 0.0 < largest <= VOLTAGE_V[method].largest


def test_the_adaptive_filters_are_better_on_every_drive_once_they_have_settled(voltage):
    for better, worse in (("AUKF", "UKF"), ("AEKF", "EKF")):
        row = voltage[f"{better} < {worse} in mean voltage error before the sample after 100 s, share of drives"]
        assert row.corrected == 100.0


def test_without_the_jump_of_the_voltage_three_of_four_filters_end_in_no_number(voltage):
    ended = [math.isnan(row.as_printed) for q, row in voltage.items() if "before" in q and q.endswith("mean")]
    assert ended == [True, False, True, True]


def test_the_state_of_charge_is_within_the_printed_error_of_the_AUKF():
    rows = {row.quantity: row for row in thesis_battery.soc_by_method().rows}
    largest, mean = (rows[f"SoC, 98 to 90 %, AUKF: {name}"] for name in ("largest", "mean"))
    assert largest.corrected is not None and largest.corrected <= SOC_PERCENT["aukf"].largest
    assert mean.corrected is not None and mean.corrected <= SOC_PERCENT["aukf"].mean
    assert mean.default is not None and mean.default < mean.corrected


def test_the_offline_model_starts_at_rest_on_its_curve():
    here = case(NARROW)
    expected = offline_voltage(here, here.offline.rule)
    assert len(expected) == len(here.log)
    assert np.abs(expected - here.log.voltage_V).max() < 1.0


def test_the_robot_of_case_I_as_printed_has_stopped_within_a_second():
    stop = stop_as_printed()
    assert 0.2 < stop.time_s < 1.0 and 0.01 < stop.way_m < 0.1
