"""Logs that would teach wrong things are refused with the reason, or repaired with a note."""

from dataclasses import replace

import numpy as np
import pytest

from cli.examples import MODEL, drive
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.learning.log_faults import usable_log
from ohmward.errors import InputError
from ohmward.logs import Log
from ohmward_lab.simulate.voltage import simulate_voltage

BATTERY = generic_battery("nmc", 12.0, 3)


def warnings(log: Log) -> list[str]:
    return [note.text for note in log.notes if note.level == "warning"]


def test_a_good_log_stays_as_it_is():
    log = drive()
    found = usable_log(log, BATTERY)
    np.testing.assert_array_equal(found.voltage_V, log.voltage_V)
    np.testing.assert_array_equal(found.current_A, log.current_A)
    assert found.notes == log.notes


def test_the_wrong_sign_sets_a_log_aside():
    log = drive()
    with pytest.raises(InputError, match=r"answers the current with the wrong sign .* the other --current-sign"):
        usable_log(replace(log, current_A=-log.current_A), BATTERY)


@pytest.mark.parametrize(
    "cells, message", [(1, "seen between"), (2, "another number of cells"), (4, "another number of cells")]
)
def test_another_number_of_cells_sets_a_log_aside(cells, message):
    log = drive()
    with pytest.raises(InputError, match=message):
        usable_log(replace(log, voltage_V=log.voltage_V * cells / 3), BATTERY)


def test_rows_that_miss_the_current_set_a_log_aside():
    """A battery that follows its current exactly, with a row a minute of a current that is new every second."""
    sparse = drive().select(slice(None, None, 30))
    current_A = np.random.default_rng(2).normal(-1.0, 6.0, len(sparse))
    with pytest.raises(InputError, match="rows are 60 s apart"):
        usable_log(replace(sparse, current_A=current_A), BATTERY)


def test_a_voltage_that_stays_while_the_load_changes_is_left_out():
    log = drive()
    voltage_V = log.voltage_V.copy()
    voltage_V[1000:1600] = voltage_V[1000]
    found = usable_log(replace(log, voltage_V=voltage_V), BATTERY)
    assert np.isnan(found.voltage_V[1000:1600]).all()
    assert np.isfinite(found.voltage_V[:1000]).all() and np.isfinite(found.voltage_V[1601:]).all()
    assert warnings(found) == ["the sensor of the voltage was stuck for 0.33 of 2 h: left out"]


def test_a_dead_voltage_sensor_sets_a_log_aside():
    log = drive()
    voltage_V = log.voltage_V.copy()
    voltage_V[500:3000] = voltage_V[500]
    with pytest.raises(InputError, match=r"sensor of the voltage was stuck for 1.4 of 2 h; check it"):
        usable_log(replace(log, voltage_V=voltage_V), BATTERY)


def test_a_current_that_stays_while_the_voltage_jumps_is_left_out():
    """Square loads of 15 A: 60 mV on the voltage."""
    time_s = 2.0 * np.arange(3600)
    current_A = np.where(time_s % 20 < 10, -15.0, -1.0) + 0.05 * np.random.default_rng(1).standard_normal(3600)
    voltage_V = 11.4 + 5 * MODEL.r0_discharge_ohm[0] * current_A
    stuck_A = current_A.copy()
    stuck_A[2000:2500] = stuck_A[2000]
    found = usable_log(Log("square", time_s, stuck_A, voltage_V), BATTERY)
    assert np.isnan(found.current_A[2000:2500]).all()
    assert "the sensor of the current was stuck" in warnings(found)[0]


def charge_and_rest(hours: float) -> Log:
    """Half an hour of load, a rest in which the battery is charged at C/5, and half an hour of load again."""
    time_s = 10.0 * np.arange(360.0 * (1.0 + hours))
    charging = (time_s >= 1800) & (time_s < 1800 + 3600 * hours)
    current_A = np.where(charging, 2.4, -2.4)
    log = Log("day", time_s, current_A, np.zeros(time_s.size), np.full(time_s.size, 25.0))
    return replace(log, voltage_V=simulate_voltage(MODEL, log, 0.3).voltage_V)


def test_a_charge_that_the_sensor_does_not_show_is_left_out():
    log = charge_and_rest(2.0)
    hidden = replace(log, current_A=np.minimum(log.current_A, 0.0))
    with pytest.raises(
        InputError, match=r"sensor of the current did not show what charged or discharged .* for 2 of 3"
    ):
        usable_log(hidden, BATTERY)
    half = charge_and_rest(1.0)
    found = usable_log(replace(half, current_A=np.minimum(half.current_A, 0.0)), BATTERY)
    np.testing.assert_array_equal(np.isnan(found.current_A), half.current_A > 0.0)
    assert "did not show what charged or discharged the battery for 1 of 2 h" in warnings(found)[0]
    assert usable_log(half, BATTERY).notes == ()


@pytest.mark.parametrize("idle_A", [-0.3, -0.8])
def test_a_charge_past_the_sensor_of_an_idle_robot_is_left_out(idle_A):
    """The charger is not wired through the shunt, which shows what the robot draws at the dock."""
    log = charge_and_rest(1.0)
    noisy_A = idle_A + 0.02 * np.random.default_rng(5).standard_normal(len(log))
    found = usable_log(replace(log, current_A=np.where(log.current_A > 0.0, noisy_A, log.current_A)), BATTERY)
    np.testing.assert_array_equal(np.isnan(found.current_A), log.current_A > 0.0)
    assert "the voltage rises as by a charge" in warnings(found)[0]


def test_a_gap_of_the_log_is_no_rest():
    """Discharged by a fifth while nothing was logged."""
    time_s = np.r_[10.0 * np.arange(300), 20000.0 + 10.0 * np.arange(300)]
    voltage_V = np.where(time_s < 10000, 12.3, 11.4)
    assert usable_log(Log("gap", time_s, np.full(600, -0.05), voltage_V), BATTERY).notes == ()


def test_the_relaxation_of_a_rest_is_no_hidden_charge():
    """From a load of 1 C at 20 % the voltage comes back by 0.4 V in three hours."""
    time_s = 10.0 * np.arange(1440)
    current_A = np.where(time_s < 1800, -12.0, 0.0)
    log = Log("rest", time_s, current_A, np.zeros(time_s.size), np.full(time_s.size, 25.0))
    log = replace(log, voltage_V=simulate_voltage(MODEL, log, 0.7).voltage_V)
    assert usable_log(log, BATTERY).notes == ()


def test_a_load_against_which_the_voltage_moves_is_a_stuck_sensor():
    """The sensor holds the last load of a drive while the battery is charged."""
    log = charge_and_rest(1.0)
    stuck = replace(log, current_A=np.where(log.current_A > 0.0, -2.4, log.current_A))
    noisy = np.random.default_rng(2).standard_normal(len(log)) * (log.current_A < 0.0)
    found = usable_log(replace(stuck, current_A=stuck.current_A + 0.05 * noisy), BATTERY)
    np.testing.assert_array_equal(np.isnan(found.current_A), log.current_A > 0.0)
    assert "the sensor of the current was stuck for 1 of 2 h" in warnings(found)[0]


def test_a_charger_that_holds_the_voltage_is_no_stuck_sensor():
    time_s = 10.0 * np.arange(720)
    current_A = np.where(time_s < 3600, 4.0, 4.0 * np.exp(-(time_s - 3600) / 1500))
    voltage_V = np.minimum(11.5 + 1.1 * time_s / 3600, 12.6)
    log = Log("charge", time_s, current_A, voltage_V)
    assert usable_log(log, BATTERY).notes == ()


def test_a_rest_and_a_constant_load_are_no_stuck_sensors():
    time_s = 10.0 * np.arange(1000)
    current_A = np.where(time_s < 5000, 0.0, -2.0)
    voltage_V = np.round(np.where(time_s < 5000, 11.6, 11.5 - (time_s - 5000) / 2e4), 1)
    assert usable_log(Log("rest", time_s, current_A, voltage_V), BATTERY).notes == ()


def test_temperatures_that_no_battery_has_are_left_out():
    log = drive()
    degC = np.where(log.time_s < 100, -127.0, 25.0)
    found = usable_log(replace(log, temperature_degC=degC), BATTERY)
    assert found.temperature_degC is not None
    assert np.isnan(found.temperature_degC[:50]).all() and (found.temperature_degC[50:] == 25.0).all()
    assert usable_log(replace(log, temperature_degC=np.full(3600, 850.0)), BATTERY).temperature_degC is None


@pytest.mark.parametrize("log", [drive().select(slice(0, 5)), drive().select(slice(0, 20))])
def test_a_log_that_is_too_short_sets_itself_aside(log):
    with pytest.raises(InputError, match=r"only \d+ samples .* are needed"):
        usable_log(log, BATTERY)
