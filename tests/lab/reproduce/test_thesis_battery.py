"""Results of [T] chapter 3 on its own conditions, mean of three drives."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ohmward_lab.published.scheme_by_method import R0_V2
from ohmward_lab.reproduce import thesis_battery
from ohmward_lab.reproduce.measured import measured
from ohmward_lab.reproduce.row import ResultRow
from ohmward_lab.reproduce.thesis_battery import FIRST, SOC_PERCENT, VOLTAGE_V, case, offline_voltage
from ohmward_lab.reproduce.thesis_cases import stop_on_ice


@pytest.fixture(scope="module")
def voltage() -> dict[str, ResultRow]:
    return {row.quantity: row for row in thesis_battery.voltage_by_method().rows}


def test_the_AUKF_and_the_UKF_reach_table_3_2_after_the_sample(voltage):
    for method in ("aukf", "ukf"):
        row = voltage[f"Voltage after the sample, {method.upper()}: mean"]
        assert row.printed == VOLTAGE_V[method].mean
        assert 0.0 < row.corrected < VOLTAGE_V[method].mean


def test_no_filter_is_better_than_its_sensor_before_the_sample(voltage):
    for method in ("ekf", "aekf", "ukf", "aukf"):
        assert voltage[f"Voltage before the sample, {method.upper()}: mean"].corrected > 0.0016
    assert voltage["Voltage before the sample, AUKF, 8 bit oscilloscope: mean"].corrected > 0.01
    assert voltage["Voltage after the sample, AUKF, 8 bit oscilloscope: mean"].corrected < 0.002


def test_of_the_orders_of_table_3_2_those_of_the_AUKF_hold(voltage):
    orders = {q.split(" in ")[0]: row.corrected for q, row in voltage.items() if " in voltage after" in q}
    assert orders == {
        "AUKF < UKF": 100.0,
        "AUKF < AEKF": 100.0,
        "AEKF < UKF": 100.0,
        "AEKF < EKF": 0.0,
        "UKF < EKF": 0.0,
    }


def test_what_a_filter_says_of_its_own_error_is_finite_where_it_is_stable(voltage):
    by = {m: voltage[f"Standard deviation of the voltage by {m} itself"] for m in ("EKF", "AEKF", "UKF", "AUKF")}
    assert 1e3 * R0_V2**0.5 > by["EKF"].corrected > by["AUKF"].corrected > by["AEKF"].corrected > 1.0  # mV


def test_as_printed_the_UKF_ends_in_no_number_and_the_extended_two_do_not(voltage):
    ended = {
        method: not voltage[f"Voltage before the sample, {method}: largest"].as_printed < 1e6
        for method in ("EKF", "AEKF", "UKF", "AUKF")
    }
    assert ended == {"EKF": False, "AEKF": False, "UKF": True, "AUKF": True}


def test_the_state_of_charge_is_by_each_method_and_the_default_is_better():
    rows = {row.quantity: row for row in thesis_battery.soc_by_method().rows}
    means: dict[str, Any] = {m: rows[f"SoC, 98 to 90 %, {m.upper()}: mean"] for m in SOC_PERCENT}
    assert len({row.corrected for row in means.values()}) == 4
    assert means["aukf"].corrected < means["ukf"].corrected
    assert all(row.default < row.corrected for row in means.values())


def test_a_missing_voltage_of_a_measured_log_is_left_out_counted_and_said():
    here = case(*FIRST)
    log = here.log.between(0.0, 200.0)
    voltage_V = log.voltage_V.copy()
    voltage_V[[0, 100]] = np.nan
    rows: Any = measured(replace(log, voltage_V=voltage_V), here.battery, 0.98).rows
    assert "2 of 200 samples have no voltage" in rows[0].why
    assert all(math.isfinite(row.corrected) and math.isfinite(row.default) for row in rows)
    assert all(math.isfinite(row.as_printed) for row in rows if "Voltage" in row.quantity and ", EKF" in row.quantity)


def test_the_offline_model_starts_at_rest_on_its_curve():
    here = case(*FIRST)
    expected = offline_voltage(here, here.offline.rule)
    assert len(expected) == len(here.log)
    assert np.abs(expected - here.log.voltage_V).max() < 1.0


def test_a_robot_that_brakes_on_ice_as_in_cases_I_and_II_has_stopped_within_its_braking_distance():
    """v / a and v^2 / (2 a) with the force of ice on the driven half of the weight, and the rolling resistance."""
    stop, full_m_s2 = stop_on_ice(), 9.81 * (0.1 / 2 + 0.01)
    assert 0.2 / full_m_s2 < stop.time_s < 4 * 0.2 / full_m_s2 < 2.0
    assert 0.02 / full_m_s2 < stop.way_m < 4 * 0.02 / full_m_s2 < 0.2
