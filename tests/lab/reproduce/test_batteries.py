import numpy as np
import pytest

from ohmward_lab.reproduce.batteries import (
    joystick_drive,
    resistor_pulses,
    robot_discharge,
    sealed_lead_acid,
)
from ohmward_lab.simulate.cells import BATTERIES, lithium_polymer_pack, scaled


def test_a_larger_battery_in_series_has_the_same_relative_voltages():
    cell = BATTERIES["nca"]
    pack = scaled("pack", cell, 2.0, 10)
    assert pack.circuit.capacity_Ah == pytest.approx(2.0 * cell.circuit.capacity_Ah)
    assert np.allclose(pack.circuit.ocv.voltage_V, 10 * np.array(cell.circuit.ocv.voltage_V))
    assert np.allclose(pack.circuit.r0_discharge_ohm, 5 * np.array(cell.circuit.r0_discharge_ohm))
    assert pack.exchange_A == 2.0 * cell.exchange_A and pack.transfer_V == 10 * cell.transfer_V


def test_the_pack_of_the_thesis_has_37_V_and_8_Ah():
    pack = lithium_polymer_pack()
    assert pack.circuit.capacity_Ah == pytest.approx(8.0) and pack.n_series == 10
    assert float(pack.circuit.ocv.mean_V(0.5, 25.0)) == pytest.approx(37.0, abs=0.5)
    assert sealed_lead_acid().circuit.capacity_Ah == pytest.approx(5.0)


def test_a_joystick_drive_goes_from_98_to_90_percent_at_1_Hz():
    log = joystick_drive(lithium_polymer_pack(), (0.98, 0.90), seed=3).drive
    soc = log.extra["soc_true"]
    assert soc[0] == 0.98 and soc[-1] == pytest.approx(0.90, abs=0.001)
    assert np.allclose(np.diff(log.time_s), 1.0)
    assert log.current_A.max() > 0.5 and log.current_A.min() < -6.0  # charges too, [T] 3.3.5


def test_the_pulses_of_the_paper_take_ten_percent_each_into_13_ohm_and_a_half():
    profile = resistor_pulses(sealed_lead_acid(), 13.5, 7)
    starts = np.flatnonzero(np.diff(profile.current_A) < -0.5)
    assert len(starts) == 7
    assert np.allclose(np.diff(profile.time_s[starts]), 5400.0, atol=0.2)
    taken_Ah = -np.trapezoid(profile.current_A, profile.time_s) / 3600.0
    assert taken_Ah / 5.0 / 7 == pytest.approx(0.093, abs=0.004)


def test_the_robot_of_the_paper_takes_25_minutes_from_full_to_60_percent():
    battery = sealed_lead_acid()
    log = robot_discharge(battery, resistor_pulses(battery, 13.5, 1), 0.6, seed=1, mean_A=4.8).drive
    assert log.extra["soc_true"][-1] == pytest.approx(0.6, abs=0.01)
    assert log.duration_s / 60.0 == pytest.approx(25.0, abs=2.0)
