"""The RC model: exact steps, charge and energy that balance, limits, reductions."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from ohmward.battery.models import thevenin
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward_lab.published import rc, rc_circuit
from published.rc_examples import CAPACITY_AH, EVEN, UNEVEN, model_of, rates, rates_with_voltage

circuits = st.builds(
    rc.Circuit,
    st.floats(3000.0, 30_000.0),
    st.floats(10.0, 500.0),
    st.floats(0.005, 0.5),
    st.floats(0.005, 0.05),
    st.floats(0.001, 0.1),
)
volts = st.floats(-1.0, 1.0)
amperes = st.floats(-20.0, 20.0)
seconds = st.floats(0.0, 600.0)


def by_matrix_exponential(A, B, x, current_A, dt_s):
    """State after a step of dx/dt = A x + B i, by SciPy."""
    n = len(x)
    M = np.zeros((n + 1, n + 1))
    M[:n, :n], M[:n, n] = A, B
    return (expm(dt_s * M) @ np.append(x, current_A))[:n]


@given(circuits, volts, volts, amperes, seconds)
def test_step_is_the_matrix_exponential(p, bulk_V, surface_V, current_A, dt_s):
    x = np.array([bulk_V, surface_V])
    expected = by_matrix_exponential(*rates(p), x, current_A, dt_s)
    np.testing.assert_allclose(rc_circuit.next_state(x, current_A, p, dt_s), expected, rtol=0, atol=1e-10)


@given(circuits, volts, volts, volts, amperes, seconds)
def test_step_with_voltage_is_the_matrix_exponential(p, bulk_V, surface_V, terminal_V, current_A, dt_s):
    """The matrices are [P]'s with V as third state; that V is output plus a decaying disturbance is ours."""
    x = np.array([bulk_V, surface_V, terminal_V])
    if rc_circuit.disturbance_rate(p) > 0:
        return
    expected = by_matrix_exponential(*rates_with_voltage(p), x, current_A, dt_s)
    found = rc_circuit.next_state_with_voltage(x, current_A, current_A, current_A, p, dt_s)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_voltage_rate_of_a_circuit_with_equal_resistors_is_that_of_the_thesis():
    """[T] (3.6), corrected: (1 / 2 R_e) (1/C_b - 1/C_s) (V - V_cb) + [1 / 2 C_s + (R_t / 2 R_e) (1/C_s - 1/C_b)] i."""
    C_b, C_s, R_e, _, R_t = EVEN
    A, B = rates_with_voltage(EVEN)
    a = (1 / C_b - 1 / C_s) / (2 * R_e)
    np.testing.assert_allclose(A[2], [-a, 0.0, a], rtol=1e-12)
    np.testing.assert_allclose(B[2], 1 / (2 * C_s) + R_t / (2 * R_e) * (1 / C_s - 1 / C_b), rtol=1e-12)


@given(circuits, volts, volts, amperes, seconds)
def test_charge_is_conserved(p, bulk_V, surface_V, current_A, dt_s):
    x = np.array([bulk_V, surface_V])
    capacitances = np.array(p[:2])
    gained = capacitances @ (rc_circuit.next_state(x, current_A, p, dt_s) - x)
    assert gained == pytest.approx(current_A * dt_s, abs=1e-7)


def test_energy_is_stored_or_lost():
    """Terminal energy = stored energy + heat in the three resistors, over small steps."""
    p, current_A, dt_s = UNEVEN, -5.0, 0.01
    x, terminal_J, heat_J = np.array([12.6, 12.4]), 0.0, 0.0
    stored_J = 0.5 * np.array(p[:2]) @ x**2
    for _ in range(2000):
        middle = rc_circuit.next_state(x, current_A, p, dt_s / 2)
        bulk_A = p.c_bulk_F * (rates(p)[0] @ middle + rates(p)[1] * current_A)[0]
        surface_A = current_A - bulk_A
        terminal_J += rc_circuit.voltage(middle, current_A, p)[0] * current_A * dt_s
        heat = p.r_bulk_ohm * bulk_A**2 + p.r_surface_ohm * surface_A**2 + p.r_terminal_ohm * current_A**2
        heat_J += heat * dt_s
        x = rc_circuit.next_state(x, current_A, p, dt_s)
    assert heat_J > 0
    assert terminal_J - heat_J == pytest.approx(0.5 * np.array(p[:2]) @ x**2 - stored_J, rel=1e-6)


@given(circuits, volts, volts, amperes, seconds, seconds)
def test_two_steps_are_one(p, bulk_V, surface_V, current_A, first_s, second_s):
    x = np.array([bulk_V, surface_V])
    halfway = rc_circuit.next_state(x, current_A, p, first_s)
    at_once = rc_circuit.next_state(x, current_A, p, first_s + second_s)
    np.testing.assert_allclose(rc_circuit.next_state(halfway, current_A, p, second_s), at_once, rtol=0, atol=1e-10)


def test_rest_brings_both_capacitors_to_the_mean_of_their_charge():
    x = rc_circuit.next_state(np.array([12.0, 13.0]), 0.0, UNEVEN, 1e6)
    np.testing.assert_allclose(x, np.array(UNEVEN[:2]) @ [12.0, 13.0] / sum(UNEVEN[:2]), rtol=1e-12)


def test_lasting_current_sees_both_resistances():
    """After many time constants the voltage rises with the charge alone, R_0 + R_1 above the mean of the capacitors."""
    x = rc_circuit.next_state(np.array([12.5, 12.5]), 2.0, UNEVEN, 2000.0)
    mean_V = np.array(UNEVEN[:2]) @ x / sum(UNEVEN[:2])
    above_V = rc_circuit.voltage(x, 2.0, UNEVEN)[0] - mean_V
    assert above_V == pytest.approx(2.0 * (rc.instant_resistance(UNEVEN) + rc.slow_resistance(UNEVEN)), rel=1e-9)


def test_no_time_changes_nothing_but_the_voltage_of_a_new_current():
    x = np.array([12.5, 12.3, 12.4])
    after = rc_circuit.next_state_with_voltage(x, 1.0, 2.0, 3.0, EVEN, 0.0)
    np.testing.assert_allclose(after - x, [0.0, 0.0, 2.0 * rc.instant_resistance(EVEN)], atol=1e-12)


def test_voltage_as_a_state_is_the_output_when_it_starts_there():
    rng = np.random.default_rng(2)
    x, before_A = np.array([12.5, 12.4]), 1.0
    with_voltage = np.array([*x, rc_circuit.voltage(x, before_A, UNEVEN)[0]])
    for current_A in rng.normal(0, 5, 50):
        mean_A = 0.5 * (before_A + current_A)
        x = rc_circuit.next_state(x, mean_A, UNEVEN, 0.7)
        with_voltage = rc_circuit.next_state_with_voltage(with_voltage, before_A, mean_A, current_A, UNEVEN, 0.7)
        before_A = current_A
    np.testing.assert_allclose(with_voltage, [*x, rc_circuit.voltage(x, before_A, UNEVEN)[0]], rtol=0, atol=1e-12)


def test_disturbance_does_not_grow_where_the_surface_is_the_slower():
    slow_surface = rc.Circuit(300.0, 17_000.0, 0.03, 0.03, 0.02)
    assert rc_circuit.disturbance_rate(slow_surface) > 0
    after = rc_circuit.next_state_with_voltage(np.array([12.5, 12.5, 12.6]), 0.0, 0.0, 0.0, slow_surface, 1e4)
    np.testing.assert_allclose(after, [12.5, 12.5, 12.6], atol=1e-12)


@pytest.mark.parametrize("circuit", [EVEN, UNEVEN])
def test_transition_is_the_step(circuit):
    F, B = rc_circuit.transition(circuit, 3.0)
    x = np.array([12.5, 12.1])
    np.testing.assert_allclose(F @ x + B * 4.0, rc_circuit.next_state(x, 4.0, circuit, 3.0), atol=1e-12)


@pytest.mark.parametrize("circuit", [EVEN, UNEVEN])
def test_equivalent_thevenin_circuit_has_the_same_voltage(circuit):
    model = model_of(circuit)
    p = rc.equivalent_thevenin(model)
    x, y = rc_circuit.at_rest(model, 0.8), np.array([0.8, 0.0, 0.0])
    for current_A in np.random.default_rng(3).normal(-1, 4, 200):
        u = CircuitInput(current_A, 25.0)
        x, y = rc_circuit.next_state(x, current_A, model, 2.0), thevenin.next_state(y, u, p, 2.0)
        assert rc_circuit.voltage(x, current_A, model)[0] == pytest.approx(thevenin.voltage(y, u, p)[0], abs=1e-12)


def test_equal_resistors_divide_by_two_without_a_division():
    assert rc.divider(EVEN) == (0.5, 0.5)
    np.testing.assert_allclose(rc.divider(UNEVEN), [5 / 7, 2 / 7])


def test_capacitance_holds_the_capacity_between_full_and_empty():
    assert rc_circuit.capacitance_for(10.0, OcvCurve((11.5, 12.0, 13.0))) == pytest.approx(36_000.0 / 1.5)
    model = model_of(EVEN)
    full, empty = rc_circuit.at_rest(model, 1.0), rc_circuit.at_rest(model, 0.0)
    assert np.array(EVEN[:2]) @ (full - empty) == pytest.approx(3600.0 * CAPACITY_AH)


def test_flat_curve_has_no_capacitance():
    with pytest.raises(InputError, match=r"ocv\.voltage_V must rise from SoC 0 to 1 .* rises by 0 V"):
        rc_circuit.capacitance_for(10.0, OcvCurve((12.0, 12.0)))


@pytest.mark.parametrize("name", [*rc.Circuit._fields, "capacity_Ah"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_parameters_must_be_positive(name, value):
    with pytest.raises(InputError, match=rf"rc\.{name} must be"):
        replace(model_of(EVEN), **{name: value})


def test_surface_must_be_the_faster_branch():
    with pytest.raises(InputError, match=r"r_surface_ohm \* c_surface_F .* exchange the two branches"):
        replace(model_of(EVEN), c_bulk_F=300.0, c_surface_F=17_000.0)


def test_traced_step_is_the_step():
    def step(x, current_A, dt_s):
        return rc_circuit.next_state_with_voltage(x, 0.0, current_A, current_A, UNEVEN, dt_s)

    x = np.array([12.5, 12.4, 12.6])
    kernel = Kernel(step, x, 1.0, 1.0)
    np.testing.assert_allclose(kernel(x, -3.0, 0.8), step(x, -3.0, 0.8), rtol=0, atol=1e-13)


def test_resistances_may_fall_towards_the_cold_as_a_fit_may_find_them():
    model = replace(model_of(UNEVEN), activation_K=-200.0)
    cold, warm = (rc_circuit.circuit_at(model, model.ocv.reference_degC + K).r_bulk_ohm for K in (-20.0, 20.0))
    assert cold < UNEVEN.r_bulk_ohm < warm
    with pytest.raises(InputError, match=r"rc.activation_K must be"):
        replace(model, activation_K=np.nan)
