import numpy as np
import pytest

from ohmward_lab.reproduce.batteries import joystick_drive, lithium_polymer_pack, scaled, sealed_lead_acid
from ohmward_lab.simulate.cells import BATTERIES


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
    assert log.current_A.max() < 0.1 and log.current_A.min() < -6.0
