from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.models import thevenin
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.pybamm_exchange import log_of_solution, to_dataset, to_pybamm
from ohmward.logs.log import Log
from ohmward.trace import Kernel

GENERIC = generic_battery("nmc", 5.0, 4)
#: Resistances along SoC and by direction, no hysteresis: what PyBaMM's circuit has a place for.
BATTERY = replace(
    GENERIC,
    thevenin=replace(
        GENERIC.thevenin,
        ocv=replace(GENERIC.thevenin.ocv, hysteresis_V=()),
        r0_discharge_ohm=(0.06, 0.04, 0.05),
        r0_charge_ohm=(0.05, 0.05, 0.05),
        r_ohm=((0.05, 0.03, 0.03), (0.08, 0.04, 0.04)),
        tau_s=(20.0, 600.0),
        empty_activation_K=0.0,
    ),
)
TIME_S = np.arange(0.0, 1801.0)
CURRENT_A = np.where(TIME_S < 900.0, -4.0, np.where(TIME_S < 1200.0, 0.0, 3.0))


@pytest.fixture(scope="module")
def pybamm():
    """Imported when a test needs it: it takes a second, in every process that collects the tests."""
    return pytest.importorskip("pybamm")


def here(temperature_degC):
    """Voltage (T,) of our model at the currents of the steps before each time."""
    p = BATTERY.thevenin

    def step(x, current_A):
        u = CircuitInput(current_A, temperature_degC)
        after = thevenin.next_state(x, u, p, 1.0)
        return after, thevenin.voltage(after, u, p)[0]

    start = np.zeros(p.pairs + 2)
    start[0] = 0.9
    return np.array([float(v) for v in Kernel(step, start, 0.0).scan(start, CURRENT_A[1:])[1]])


@pytest.mark.parametrize("temperature_degC", [25.0, 5.0])
def test_their_circuit_has_our_voltage(pybamm, temperature_degC):
    values = to_pybamm(BATTERY, soc=0.9, temperature_degC=temperature_degC)
    # their current is that of the instant, ours that of the step before it
    values["Current function [A]"] = pybamm.Interpolant(
        TIME_S[:-1] + 0.5, -CURRENT_A[1:], pybamm.t, interpolator="linear", extrapolate=True
    )
    model = pybamm.equivalent_circuit.Thevenin(options={"number of rc elements": 2})
    solution = pybamm.Simulation(model, parameter_values=values).solve(TIME_S, t_interp=TIME_S)
    found = log_of_solution(solution)
    assert found.temperature_degC == pytest.approx(temperature_degC, abs=0.01)
    changes = np.diff(CURRENT_A) != 0.0
    steady = ~(np.append(changes, False) | np.append(False, changes))
    assert found.current_A[steady] == pytest.approx(CURRENT_A[steady], abs=1e-6)
    assert found.voltage_V[1:][steady[1:]] == pytest.approx(here(temperature_degC)[steady[1:]], abs=0.004)


def test_a_full_battery_can_be_discharged(pybamm):
    model = pybamm.equivalent_circuit.Thevenin(options={"number of rc elements": 2})
    log = log_of_solution(pybamm.Simulation(model, parameter_values=to_pybamm(BATTERY)).solve([0.0, 60.0]))
    assert log.current_A == pytest.approx(-5.0)


def test_a_data_set_has_their_sign_and_no_gaps():
    log = Log("desk", np.arange(3.0), np.array([-1.0, np.nan, 2.0]), np.array([12.0, 12.1, 12.2]))
    columns = to_dataset(log)
    assert {name: values.tolist() for name, values in columns.items()} == {
        "Time [s]": [0.0, 2.0],
        "Current function [A]": [1.0, -2.0],
        "Voltage [V]": [12.0, 12.2],
    }


def test_a_solution_of_a_porous_electrode_is_a_log(pybamm):
    solution = pybamm.Simulation(pybamm.lithium_ion.SPM()).solve([0.0, 600.0])
    log = log_of_solution(solution, "spm")
    assert (log.name, log.duration_s) == ("spm", 600.0)
    assert np.all(log.current_A < 0.0) and log.voltage_V[-1] < log.voltage_V[0]
    assert log.temperature_degC == pytest.approx(25.0)
