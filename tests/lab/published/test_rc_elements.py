"""Elements of the RC model: from four numbers, by the rule, from a Thevenin circuit."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.battery.chemistries import CHEMISTRIES, start_model
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward.logs import Log
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc import (
    circuit_by_rule,
    circuit_of,
    rc_of_thevenin,
)
from ohmward_lab.simulate.voltage import simulate_voltage


@given(st.floats(5e3, 1e5), st.floats(0.005, 0.2), st.floats(1e-4, 0.3), st.floats(0.5, 900.0))
def test_a_circuit_has_its_four_numbers(C, r0, r1, tau_s):
    """Whatever the numbers: a circuit that the model accepts, with the same voltage."""
    p = circuit_of(C, r0, r1, tau_s)
    np.testing.assert_allclose(rc.four_numbers(p), (C, r0, r1, tau_s), rtol=1e-5)
    assert min(p) > 0
    assert rc_circuit.disturbance_rate(p) <= 0


def test_rule_shares_the_resistance_and_keeps_the_charge():
    p = circuit_by_rule(0.04, 0.3, 20_000.0)
    assert (p.r_bulk_ohm, p.r_surface_ohm) == (0.03, 0.03)
    assert p.c_surface_F == pytest.approx(0.3 / 0.06)
    assert p.c_bulk_F + p.c_surface_F == pytest.approx(20_000.0)
    assert rc.instant_resistance(p) == pytest.approx(0.04)


def test_a_circuit_with_one_pair_on_a_straight_line_is_kept():
    ocv = OcvCurve((11.75, 13.0))
    model = Thevenin(6.0, ocv, (0.03, 0.03), (0.03, 0.03), ((0.02, 0.02),), (40.0,))
    again = rc.equivalent_thevenin(rc_of_thevenin(model))
    assert again.r0_discharge_ohm == pytest.approx(model.r0_discharge_ohm)
    assert again.r_ohm[0] == pytest.approx(model.r_ohm[0])
    assert again.tau_s == pytest.approx(model.tau_s)
    assert rc_circuit.capacitance_for(6.0, ocv) == pytest.approx(sum(rc_of_thevenin(model).circuit[:2]))


@pytest.mark.parametrize("name", CHEMISTRIES)
def test_every_start_model_has_one(name):
    """The same resistance to a steady current, a time constant between those of the pairs, the slope of the curve."""
    model = start_model(name, 12.0, 4)
    found = rc_of_thevenin(model)
    steady_ohm = model.r0_discharge_ohm[0] + sum(row[0] for row in model.r_ohm)
    assert rc.dc_resistance(found) == pytest.approx(steady_ohm)
    assert min(model.tau_s) < 1 / rc.relaxation_rate(found) < max(model.tau_s)
    slope_V = model.capacity_As / sum(found.circuit[:2])
    rise_V = float(model.ocv.mean_V(0.8, 25.0)) - float(model.ocv.mean_V(0.2, 25.0))
    assert slope_V == pytest.approx(rise_V / 0.6, rel=0.2)


def test_its_voltage_is_near_that_of_the_circuit():
    """Lead-acid, pulses and rests of 10 min around 60 %: within 10 mV a cell of two pairs and of the straight curve."""
    model = start_model("lead-acid", 12.0, 6)
    current_A = np.tile(np.repeat([-3.0, 0.0], 600), 6)
    log = Log("pulses", np.arange(7200.0), current_A, np.zeros(7200), np.full(7200, 25.0))
    expected_V = simulate_voltage(model, log, 0.6).voltage_V
    found = rc_of_thevenin(model)
    x, voltage_V = rc_circuit.at_rest(found, 0.6), []
    for before, now in zip([0.0, *current_A[:-1]], current_A, strict=True):
        x = rc_circuit.next_state(x, 0.5 * (before + now), found, 1.0)
        voltage_V.append(rc_circuit.voltage(x, now, found)[0])
    assert np.sqrt(np.mean((np.array(voltage_V) - expected_V) ** 2)) < 6 * 0.010


def test_resistances_follow_the_temperature_and_capacitances_stay():
    """Arrhenius about the curve's temperature; R_b = R_s stay the very same object, so that a step need not divide."""
    model = replace(rc_of_thevenin(start_model("lead-acid", 12.0)), activation_K=3000.0)
    cold = rc_circuit.circuit_at(model, -10.0)
    factor = math.exp(3000.0 * (1 / 263.15 - 1 / 298.15))
    np.testing.assert_allclose(cold[2:], factor * np.array(model.circuit[2:]))
    assert cold[:2] == model.circuit[:2]
    np.testing.assert_allclose(rc_circuit.circuit_at(model, 25.0), model.circuit)
    assert rc_circuit.circuit_at(replace(model, activation_K=0.0), -10.0) == model.circuit
    even = rc_circuit.circuit_at(
        rc.RcModel(17_000.0, 300.0, 0.03, 0.03, 0.02, OcvCurve((11.75, 13.0)), 6.0, 3000.0), 0.0
    )
    assert even.r_bulk_ohm is even.r_surface_ohm
    equivalent = rc.equivalent_thevenin(model)
    assert equivalent.activation_K == 3000.0
