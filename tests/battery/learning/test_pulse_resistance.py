"""The resistance that a tester would read from a simulated pulse."""

from dataclasses import replace

import numpy as np
import pytest

from cli.examples import MODEL
from ohmward.battery.learning.fold import pulse_ohm
from ohmward.battery.models.thevenin import Thevenin
from ohmward.logs import Log
from ohmward_lab.simulate.voltage import simulate_voltage

TRANSFER = replace(MODEL, transfer_V=0.4)


@pytest.mark.parametrize("model", [MODEL, TRANSFER], ids=["linear", "with transfer of charge"])
def test_it_is_the_fall_of_the_voltage_in_ten_seconds_over_the_current(model: Thevenin) -> None:
    time_s = np.arange(0.0, 16.0)
    current_A = np.where((time_s > 0.0) & (time_s <= 10.0), -model.capacity_Ah, 0.0)
    degC = np.full(time_s.size, model.reference_degC)
    voltage_V = simulate_voltage(model, Log("pulse", time_s, current_A, np.zeros(time_s.size), degC), 0.5).voltage_V
    measured_ohm = (voltage_V[0] - voltage_V[10]) / model.capacity_Ah
    # the curve bends a little over the charge of a pulse
    assert pulse_ohm(model) == pytest.approx(measured_ohm, rel=0.01)
