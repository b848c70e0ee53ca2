from dataclasses import replace

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from battery.examples import NMC, STRAIGHT
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import (
    CircuitInput,
    StateOfHealth,
    Thevenin,
    next_hysteresis,
    next_state,
    ohmic_drop,
    ohmic_resistance,
    open_circuit,
    pair_decays,
    pair_resistances,
    scaled_hysteresis,
    voltage,
)
from ohmward.errors import InputError
from ohmward.trace import linearize

HYSTERETIC = replace(STRAIGHT, ocv=OcvCurve((3.0, 4.0), (0.05, 0.05)), hysteresis_rate=30.0)
X = np.array([0.5, 0.03, -0.02, 0.4])
currents = st.floats(-10.0, 10.0)
steps = st.floats(0.0, 2000.0)


def test_one_hour_at_1C_empties_the_cell():
    x = np.array([1.0, 0.0, 0.0, 0.0])
    for _ in range(60):
        x = next_state(x, CircuitInput(-2.0, 25.0), STRAIGHT, 60.0)
    assert x[0] == pytest.approx(0.0, abs=1e-12)


def test_charging_stores_its_share_and_discharging_takes_all():
    lossy = replace(STRAIGHT, coulombic_efficiency=0.9)
    charged = next_state(X, CircuitInput(2.0, 25.0), lossy, 360.0)
    discharged = next_state(X, CircuitInput(-2.0, 25.0), lossy, 360.0)
    assert charged[0] - X[0] == pytest.approx(0.9 * 0.1, abs=1e-15)
    assert discharged[0] - X[0] == pytest.approx(-0.1, abs=1e-15)


def test_a_smaller_capacity_moves_faster():
    moved = next_state(X, CircuitInput(-2.0, 25.0), STRAIGHT, 360.0, StateOfHealth(soh_capacity=0.8))[0] - X[0]
    assert moved == pytest.approx(-0.125, abs=1e-15)


@pytest.mark.parametrize("current_A", [-3.0, 1.5, 0.0])
def test_the_step_solves_the_differential_equation(current_A):
    p, dt_s = HYSTERETIC, 50.0

    def rate(_, x):
        _, *v, h = x
        pairs = [(r * current_A - vj) / tau for r, vj, tau in zip((0.01, 0.02), v, p.tau_s, strict=True)]
        toward = np.sign(current_A) - h
        return [current_A / p.capacity_As, *pairs, p.hysteresis_rate * abs(current_A) / p.capacity_As * toward]

    solution = solve_ivp(rate, (0.0, dt_s), X, rtol=1e-11, atol=1e-13)
    assert next_state(X, CircuitInput(current_A, 25.0), p, dt_s) == pytest.approx(solution.y[:, -1], abs=1e-9)


@given(currents, steps, steps)
def test_two_steps_are_one(current_A, first_s, second_s):
    u = CircuitInput(current_A, 25.0)
    twice = next_state(next_state(X, u, HYSTERETIC, first_s), u, HYSTERETIC, second_s)
    assert twice == pytest.approx(next_state(X, u, HYSTERETIC, first_s + second_s), abs=1e-12)


def test_no_time_changes_nothing():
    assert np.array_equal(next_state(X, CircuitInput(-5.0, 10.0), NMC, 0.0), X)


def test_long_current_brings_the_pairs_to_ohms_law():
    x = next_state(X, CircuitInput(-2.0, 25.0), STRAIGHT, 1e5)
    assert x[1:3] == pytest.approx([-0.02, -0.04], rel=1e-12)
    expected = 3.0 + x[0] - 2.0 * (0.02 + 0.01 + 0.02)
    assert voltage(x, CircuitInput(-2.0, 25.0), STRAIGHT)[0] == pytest.approx(expected, rel=1e-12)


def test_resistance_share_scales_what_the_current_adds():
    u, worn = CircuitInput(-2.0, 25.0), StateOfHealth(resistance_ratio=1.5)
    x = next_state(np.array([0.5, 0.0, 0.0, 0.0]), u, STRAIGHT, 1e5, worn)
    added_V = voltage(x, u, STRAIGHT, worn)[0] - open_circuit(x, u, STRAIGHT)
    assert added_V == pytest.approx(1.5 * -2.0 * 0.05, rel=1e-12)


@given(st.floats(-1.0, 1.0), currents, steps)
def test_hysteresis_stays_between_its_branches_and_goes_toward_one(h, current_A, dt_s):
    after = next_hysteresis(h, current_A, dt_s, HYSTERETIC)
    assert -1.0 <= after <= 1.0
    assert (after - h) * np.sign(current_A) >= 0.0


def test_hysteresis_on_the_net_charge_saturates_on_both_branches():
    p = replace(HYSTERETIC, net_charge_hysteresis=True)
    turn_s = p.capacity_As / p.hysteresis_rate / 2.0
    assert next_hysteresis(0.0, -2.0, 0.5 * turn_s, p) == pytest.approx(-0.5, rel=1e-12)
    assert next_hysteresis(-0.5, -2.0, turn_s, p) == -1.0
    assert next_hysteresis(-1.0, 2.0, 1.5 * turn_s, p) == pytest.approx(0.5, rel=1e-12)
    assert next_hysteresis(0.5, 2.0, turn_s, p) == 1.0


def test_hysteresis_on_the_net_charge_stays_on_its_branch_in_a_drive_with_regeneration():
    """Charged by 0.8 of every discharge, a cell keeps its discharge branch but for the last stroke."""
    p, h = replace(HYSTERETIC, net_charge_hysteresis=True), 0.0
    for _ in range(200):
        h = next_hysteresis(next_hysteresis(h, -2.0, 10.0, p), 2.0, 8.0, p)
    assert h == pytest.approx(-1.0 + 16.0 * p.hysteresis_rate / p.capacity_As, rel=1e-12)


@pytest.mark.parametrize("branch", [-1.0, 0.0, 1.0])
def test_an_error_of_the_hysteresis_leaves_the_tested_branch(branch):
    p = replace(HYSTERETIC, tested_branch=branch)
    assert scaled_hysteresis(branch, 3.0, p) == branch
    assert scaled_hysteresis(1.0, 3.0, p) - scaled_hysteresis(-1.0, 3.0, p) == pytest.approx(3.0 * 2.0, rel=1e-12)
    assert scaled_hysteresis(0.4, 1.0, p) == pytest.approx(0.4, rel=1e-12)


def test_hysteresis_grows_in_the_cold():
    p = replace(HYSTERETIC, hysteresis_activation_K=1700.0)
    x, cold = np.array([0.5, 0.0, 0.0, -1.0]), CircuitInput(0.0, 5.0)
    factor = np.exp(1700.0 * (1 / 278.15 - 1 / 298.15))
    assert open_circuit(x, cold, p) == pytest.approx(3.5 - factor * 0.05, rel=1e-12)
    assert open_circuit(x, cold, HYSTERETIC) == pytest.approx(3.5 - 0.05, rel=1e-12)


@given(st.floats(-1.0, 1.0), st.floats(0.1, 10.0), st.floats(1.0, 1000.0), st.floats(0.1, 10.0))
def test_hysteresis_follows_charge_not_time(h, current_A, dt_s, faster):
    slow = next_hysteresis(h, current_A, dt_s, HYSTERETIC)
    assert next_hysteresis(h, faster * current_A, dt_s / faster, HYSTERETIC) == pytest.approx(slow, abs=1e-12)


def test_hysteresis_is_developed_after_its_charge():
    dt_s = HYSTERETIC.capacity_As / HYSTERETIC.hysteresis_rate / 2.0
    assert next_hysteresis(0.0, -2.0, dt_s, HYSTERETIC) == pytest.approx(-(1 - np.exp(-1)), rel=1e-12)
    rested = open_circuit(np.array([0.5, 0.0, 0.0, -1.0]), CircuitInput(0.0, 25.0), HYSTERETIC)
    assert rested == pytest.approx(3.5 - 0.05, rel=1e-12)


def test_cold_resists_after_arrhenius():
    cold = NMC.arrhenius_factor(0.0)
    assert cold == pytest.approx(np.exp(2500.0 * (1 / 273.15 - 1 / 298.15)), rel=1e-12)
    assert NMC.arrhenius_factor(25.0) == 1.0
    assert ohmic_resistance(0.5, CircuitInput(-1.0, 0.0), NMC) == pytest.approx(0.05 * cold, rel=1e-12)
    assert pair_resistances(0.5, CircuitInput(-1.0, 0.0), NMC) == pytest.approx([0.01 * cold, 0.02 * cold], rel=1e-12)


def test_pairs_and_time_constants_have_activations_of_their_own():
    p = replace(NMC, pair_activation_K=5000.0, tau_activation_K=1500.0)
    u, inverse_K = CircuitInput(-1.0, 0.0), 1 / 273.15 - 1 / 298.15
    transfer, slower = np.exp(5000.0 * inverse_K), np.exp(1500.0 * inverse_K)
    assert ohmic_resistance(0.5, u, p) == ohmic_resistance(0.5, u, NMC)
    assert pair_resistances(0.5, u, p) == pytest.approx([0.01 * transfer, 0.02 * transfer], rel=1e-12)
    assert pair_decays(u, p, 5.0) == pytest.approx(np.exp(-5.0 / (slower * np.array(p.tau_s))), rel=1e-12)
    assert pair_decays(CircuitInput(-1.0, 25.0), p, 5.0) == pair_decays(u, NMC, 5.0)
    x = next_state(np.array([0.5, 0.0, 0.0, 0.0]), u, p, 5.0)
    assert x[1] == pytest.approx(-0.01 * transfer * (1 - np.exp(-5.0 / (slower * p.tau_s[0]))), rel=1e-12)


def test_charge_transfer_bends_the_ohmic_drop():
    """Butler-Volmer, two electrodes of exchange current i_0: i = 2 i_0 sinh(v / V_t), so that R_0 = V_t / (2 i_0)."""
    drop_V, V_t = np.array([-0.6, -0.05, 0.05, 0.6]), 0.1
    p, exchange_A = replace(NMC, transfer_V=V_t), V_t / (2 * 0.05)
    r0_ohm = ohmic_resistance(0.5, CircuitInput(drop_V, 25.0), NMC)  # differs by direction, 0.05 in discharge
    i_A = 2 * exchange_A * np.sinh(drop_V / V_t) * (0.05 / r0_ohm)
    assert ohmic_drop(0.5, CircuitInput(i_A, 25.0), p) == pytest.approx(drop_V, rel=2e-5)
    assert ohmic_drop(0.5, CircuitInput(1e-6, 25.0), p) == pytest.approx(ohmic_drop(0.5, CircuitInput(1e-6, 25.0), NMC))
    aged = ohmic_drop(0.5, CircuitInput(-2.0, 25.0), p, StateOfHealth(resistance_ratio=1.5))
    assert aged == pytest.approx(ohmic_drop(0.5, CircuitInput(-3.0, 25.0), p), rel=1e-12)
    pack = ohmic_drop(0.5, CircuitInput(-8.0, 0.0), p.in_series(4))
    assert pack == pytest.approx(4 * ohmic_drop(0.5, CircuitInput(-8.0, 0.0), p), rel=1e-12)


def test_without_charge_transfer_the_drop_is_straight():
    u = CircuitInput(-7.0, -10.0)
    assert ohmic_drop(0.4, u, NMC) == ohmic_resistance(0.4, u, NMC) * (1.0 * u.current_A)
    with pytest.raises(InputError, match=r"thevenin\.transfer_V"):
        replace(NMC, transfer_V=0.0)


def test_the_bent_drop_has_the_slope_of_r0_at_rest():
    p = replace(NMC, transfer_V=0.1)
    value, slope = linearize(lambda i: np.array([ohmic_drop(0.5, CircuitInput(i[0], 25.0), p)]), np.array([0.0]))
    assert value[0] == 0.0
    assert slope[0, 0] == pytest.approx(ohmic_resistance(0.5, CircuitInput(0.0, 25.0), NMC), rel=1e-4)


def test_the_activation_of_the_pairs_grows_towards_empty():
    p = replace(NMC, pair_activation_K=3000.0, empty_activation_K=10000.0)
    inverse_K = 1 / 273.15 - 1 / 298.15
    for soc, activation_K in ((0.0, 13000.0), (0.175, 8000.0), (0.35, 3000.0), (0.9, 3000.0), (-0.1, 13000.0)):
        warm = pair_resistances(soc, CircuitInput(-1.0, 25.0), p)
        cold = pair_resistances(soc, CircuitInput(-1.0, 0.0), p)
        assert warm == pair_resistances(soc, CircuitInput(-1.0, 25.0), NMC)
        assert cold == pytest.approx(np.exp(activation_K * inverse_K) * np.array(warm), rel=1e-12)
        assert ohmic_resistance(soc, CircuitInput(-1.0, 0.0), p) == ohmic_resistance(soc, CircuitInput(-1.0, 0.0), NMC)


def test_an_activation_is_finite():
    with pytest.raises(InputError, match=r"thevenin\.activation_K"):
        replace(NMC, activation_K=np.nan)
    with pytest.raises(InputError, match=r"thevenin\.pair_activation_K"):
        replace(NMC, pair_activation_K=np.inf)
    with pytest.raises(InputError, match=r"thevenin\.tau_activation_K"):
        replace(NMC, tau_activation_K=np.nan)
    with pytest.raises(InputError, match=r"thevenin\.empty_activation_K"):
        replace(NMC, empty_activation_K=np.nan)


def test_resistance_depends_on_soc_and_on_the_direction():
    assert ohmic_resistance(0.25, CircuitInput(-1.0, 25.0), NMC) == pytest.approx(0.055, rel=1e-12)
    assert ohmic_resistance(0.25, CircuitInput(1.0, 25.0), NMC) == pytest.approx(0.0525, rel=1e-12)
    assert ohmic_resistance(-0.5, CircuitInput(-1.0, 25.0), NMC) == pytest.approx(0.06, rel=1e-12)
    assert ohmic_resistance(1.5, CircuitInput(-1.0, 25.0), NMC) == pytest.approx(0.05, rel=1e-12)


@given(st.lists(currents, min_size=1, max_size=30))
def test_charge_is_conserved(profile):
    x = X
    for current_A in profile:
        x = next_state(x, CircuitInput(current_A, 25.0), HYSTERETIC, 7.0)
    assert x[0] - X[0] == pytest.approx(7.0 * sum(profile) / HYSTERETIC.capacity_As, abs=1e-12)


@given(st.floats(0.0, 1.0), currents, st.floats(-20.0, 50.0), st.integers(1, 16))
def test_a_pack_is_its_cells(soc, current_A, temperature_degC, cells):
    pack, u = NMC.in_series(cells), CircuitInput(current_A, temperature_degC)
    x = np.array([soc, 0.0, 0.0, 0.3])
    y = x.copy()
    for _ in range(3):
        x, y = next_state(x, u, NMC, 20.0), next_state(y, u, pack, 20.0)
    assert y[0] == x[0]
    assert voltage(y, u, pack)[0] == pytest.approx(cells * voltage(x, u, NMC)[0], rel=1e-12)


def test_strings_in_parallel_share_the_current():
    pack, u = NMC.in_parallel(3), CircuitInput(-1.5, 10.0)
    x = next_state(np.array([0.6, 0.0, 0.0, 0.0]), u, NMC, 60.0)
    shared = u._replace(current_A=3 * u.current_A)
    assert next_state(np.array([0.6, 0.0, 0.0, 0.0]), shared, pack, 60.0) == pytest.approx(x, rel=1e-12)
    assert voltage(x, shared, pack) == pytest.approx(voltage(x, u, NMC), rel=1e-12)


def test_a_worn_circuit_has_the_state_of_health_that_it_is_worn_to():
    worn, u, health = NMC.worn(0.8, 1.5), CircuitInput(-1.5, 10.0), StateOfHealth(0.8, 1.5)
    x = next_state(np.array([0.6, 0.0, 0.0, 0.0]), u, NMC, 60.0, health)
    assert next_state(np.array([0.6, 0.0, 0.0, 0.0]), u, worn, 60.0)[:-1] == pytest.approx(x[:-1], rel=1e-12)
    assert voltage(x, u, worn) == pytest.approx(voltage(x, u, NMC, health), rel=1e-12)


def test_derivatives_are_those_of_casadi():
    """An independent differentiation of the same equations, written out by hand."""
    p, i, dt_s = HYSTERETIC, -2.0, 5.0
    s, v1, v2, h = x = casadi.vertsplit(casadi.SX.sym("x", 4))
    a, kept = np.exp(-dt_s / np.array(p.tau_s)), np.exp(-p.hysteresis_rate * abs(i) * dt_s / p.capacity_As)
    after = casadi.vertcat(
        s + i * dt_s / p.capacity_As,
        a[0] * v1 + (1 - a[0]) * 0.01 * i,
        a[1] * v2 + (1 - a[1]) * 0.02 * i,
        kept * h - (1 - kept),
    )
    output = 3.0 + s + 0.05 * h + v1 + v2 + 0.02 * i
    functions = casadi.Function("f", [casadi.vertcat(*x)], [after, casadi.jacobian(after, casadi.vertcat(*x)), output])
    value, F, y = (np.array(m) for m in functions(X))
    ours, J = linearize(lambda x: next_state(x, CircuitInput(i, 25.0), p, dt_s), X)
    assert ours == pytest.approx(value.ravel(), abs=1e-14)
    assert pytest.approx(F, abs=1e-14) == J
    y_hat, H = linearize(lambda x: voltage(x, CircuitInput(i, 25.0), p), X)
    assert y_hat[0] == pytest.approx(y.item(), abs=1e-14)
    assert pytest.approx(np.array([[1.0, 1.0, 1.0, 0.05]]), abs=1e-12) == H


def test_derivatives_with_tables_are_differences():
    u, eps, x = CircuitInput(-2.0, 5.0), 1e-6, np.array([0.234, *X[1:]])
    _, H = linearize(lambda x: voltage(x, u, NMC), x)
    _, F = linearize(lambda x: next_state(x, u, NMC, 5.0), x)
    for k, e in enumerate(eps * np.eye(4)):
        dh = (voltage(x + e, u, NMC) - voltage(x - e, u, NMC)) / (2 * eps)
        df = (next_state(x + e, u, NMC, 5.0) - next_state(x - e, u, NMC, 5.0)) / (2 * eps)
        assert H[:, k] == pytest.approx(dh, abs=1e-8)
        assert F[:, k] == pytest.approx(df, abs=1e-8)


def test_names_of_the_state():
    assert NMC.state_names == ("soc", "v1_V", "v2_V", "hysteresis")
    assert NMC.pairs == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"capacity_Ah": 0.0}, r"thevenin.capacity_Ah must be > 0, got 0"),
        ({"r0_discharge_ohm": (0.1,)}, r"r0_discharge_ohm needs at least 2 points .* got 1"),
        ({"r0_charge_ohm": (0.1, 0.1, 0.1)}, r"r0_charge_ohm must have 2 values .* got 3"),
        ({"r0_charge_ohm": (0.1, -0.1)}, r"r0_charge_ohm must be >= 0, got -0.1"),
        ({"r_ohm": ((0.1, 0.1),)}, r"tau_s must have 1 values .* got 2"),
        ({"r_ohm": ((0.1, 0.1), (0.1,))}, r"r2_ohm must have 2 values"),
        ({"r_ohm": ((0.1, 0.1), (0.1, np.nan))}, r"r2_ohm must be finite, got nan"),
        ({"tau_s": (10.0, 0.0)}, r"tau_s must be > 0, got 0"),
        ({"tau_s": (10.0, 10.0)}, r"tau_s must increase .* got \[10.0, 10.0\]"),
        ({"hysteresis_rate": -1.0}, r"hysteresis_rate must be >= 0, got -1"),
        ({"coulombic_efficiency": 1.2}, r"coulombic_efficiency must be between 0.5 and 1, got 1.2"),
    ],
)
def test_refuses(change, message):
    with pytest.raises(InputError, match=message):
        replace(STRAIGHT, **change)


def test_refuses_a_pack_without_cells():
    with pytest.raises(InputError, match="cells in series must be at least 1, got 0"):
        STRAIGHT.in_series(0)


def test_a_circuit_without_pairs_is_a_resistor():
    bare = Thevenin(2.0, STRAIGHT.ocv, (0.02, 0.02), (0.02, 0.02), (), ())
    x = next_state(np.array([0.5, 0.0]), CircuitInput(-2.0, 25.0), bare, 360.0)
    assert voltage(x, CircuitInput(-2.0, 25.0), bare)[0] == pytest.approx(3.4 - 0.04, rel=1e-12)
