import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.models.thevenin import CircuitInput, voltage
from ohmward.errors import InputError
from ohmward_lab.simulate import BATTERIES
from ohmward_lab.simulate.cells import of_battery_file
from ohmward_lab.simulate.plant import resting_state, terminal_voltage
from simulate.examples import simple_battery


def ocv(chemistry, soc):
    return BATTERIES[chemistry].circuit.ocv.mean_V(np.asarray(soc, dtype=float), 25.0)


@pytest.mark.parametrize("chemistry", sorted(BATTERIES))
def test_each_says_that_it_is_simulated_and_is_richer_than_a_fitted_model(chemistry):
    battery = BATTERIES[chemistry]
    assert battery.name.startswith("simulated ")
    assert battery.circuit.pairs >= 3
    assert battery.transfer_V > 0.0
    assert battery.circuit.activation_K > 0.0
    for row in (battery.circuit.r0_discharge_ohm, *battery.circuit.r_ohm):
        assert row[0] > 1.3 * row[10]


def test_lfp_has_a_plateau_with_two_steps():
    slope = np.gradient(ocv("lfp", np.linspace(0.1, 0.95, 171)), 0.85 / 170)
    soc = np.linspace(0.1, 0.95, 171)
    steps = soc[1:-1][(slope[1:-1] > slope[:-2]) & (slope[1:-1] > slope[2:])]
    np.testing.assert_allclose(steps, [0.27, 0.68], atol=0.02)
    assert ocv("lfp", 0.9) - ocv("lfp", 0.2) < 0.5


def test_lead_acid_is_nearly_linear():
    soc = np.linspace(0.05, 1.0, 50)
    residual = ocv("lead-acid", soc) - np.polyval(np.polyfit(soc, ocv("lead-acid", soc), 1), soc)
    assert abs(residual).max() < 0.05
    assert ocv("lead-acid", 0.05) == pytest.approx(11.6, abs=0.1)
    assert ocv("lead-acid", 1.0) == pytest.approx(12.9, abs=0.05)


@pytest.mark.parametrize("chemistry", ["lfp", "nca"])
def test_a_lithium_battery_at_its_limits_is_full_or_empty(chemistry):
    battery = BATTERIES[chemistry]
    assert ocv(chemistry, 1.0) == pytest.approx(battery.voltage_max_V, abs=1e-6)
    assert ocv(chemistry, 0.0) == pytest.approx(battery.voltage_min_V, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [("exchange_A", 0.0), ("cooling_W_per_K", -1.0), ("full_width", 2.0), ("voltage_min_V", 101.0)],
)
def test_impossible_values_are_refused(name, value):
    with pytest.raises(InputError, match=rf"battery\.{name} must be .*got"):
        simple_battery(**{name: value})


@pytest.mark.parametrize("chemistry, n_series", [("lipo", 10), ("lfp", 4), ("lead-acid", 6)])
def test_the_plant_of_a_battery_file_has_its_voltage_and_keeps_the_charge_in_range(chemistry, n_series):
    file = generic_battery(chemistry, 8.0, n_series)
    circuit = file.thevenin
    plant = of_battery_file(file)
    x, u = resting_state(plant, 0.5).x, CircuitInput(-4.0, 10.0)
    assert terminal_voltage(x, u, plant) == pytest.approx(voltage(x, u, circuit)[0], rel=1e-12)
    full, empty = (resting_state(plant, soc, hysteresis=h).x for soc, h in ((1.0, 1.0), (0.0, -1.0)))
    assert plant.full_width > 0 or plant.voltage_max_V <= voltage(full, CircuitInput(0.0, 25.0), circuit)[0]
    assert plant.voltage_min_V >= voltage(empty, CircuitInput(0.0, 25.0), circuit)[0]
    assert plant.heat_capacity_J_per_K > 100.0
