from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.battery.models.temperature import KELVIN
from ohmward.battery.models.thevenin import CircuitInput, pair_resistances
from ohmward.errors import InputError
from ohmward_lab.simulate import BATTERIES, Profile, resting_state, simulate
from ohmward_lab.simulate.plant import Demand, current_at, fine_times, step
from ohmward_lab.simulate.profile import steps
from simulate.examples import simple_battery

BUSY_DAY = [(3000.0, -6.0), (1200.0, 0.0), (2400.0, 4.0), (600.0, -10.0), (1800.0, 0.0)]


def constant(current_A: float, duration_s: float, ambient_degC: float = 25.0) -> Profile:
    return Profile(np.array([0.0, duration_s]), np.full(2, current_A), np.full(2, ambient_degC))


def run_fine(battery, profile, state, max_step_s=1.0):
    return simulate(battery, profile, fine_times(profile.time_s, max_step_s), state, max_step_s)


def test_one_C_for_one_hour_empties():
    start = resting_state(simple_battery(), 1.0)
    sim = simulate(simple_battery(), constant(-10.0, 3600.0), np.array([0.0, 1800.0, 3600.0]), start)
    np.testing.assert_allclose(sim.truth.soc, [1.0, 0.5, 0.0], atol=1e-12)


def test_voltage_at_constant_current_is_the_closed_form():
    battery = simple_battery(heat_capacity_J_per_K=1e12)
    t, i = np.arange(0.0, 1800.0, 7.0), -8.0
    sim = simulate(battery, constant(i, 1800.0), t, resting_state(battery, 0.9))
    pairs = sum(r * (1 - np.exp(-t / tau)) for r, tau in zip((0.01, 0.02, 0.03), (5.0, 50.0, 500.0), strict=True))
    hysteresis = -0.02 * (1 - np.exp(-20.0 * 8.0 * t / 36000.0))
    expected = 12.9 + i * t / 36000.0 + hysteresis + i * (0.02 + pairs) + 0.2 * np.arcsinh(i / 20.0)
    np.testing.assert_allclose(sim.truth.voltage_V, expected, atol=1e-9)


def test_a_cold_battery_resists_more():
    simple = simple_battery()
    battery = replace(simple, circuit=replace(simple.circuit, activation_K=3000.0))
    i, warm = -8.0, np.exp(3000.0 * (1 / 263.15 - 1 / 298.15))
    start = resting_state(battery, 0.5, temperature_degC=-10.0)
    truth = simulate(battery, constant(i, 1.0, -10.0), np.array([0.0]), start).truth
    expected = 12.5 - 35.0 * 1e-3 + warm * 0.02 * i + 0.2 * np.arcsinh(warm * i / 20.0)
    assert truth.voltage_V[0] == pytest.approx(expected, abs=1e-12)


def test_energy_in_is_energy_stored_plus_heat():
    battery = simple_battery()
    start = resting_state(battery, 0.8, temperature_degC=15.0)
    sim = run_fine(battery, steps(BUSY_DAY), start)
    assert sim.truth.temperature_degC.max() > 20.0
    assert balance_error_J(battery, start, sim) == pytest.approx(0.0, abs=2e-4 * sim.state.heat_J)


@pytest.mark.parametrize("chemistry", sorted(BATTERIES))
def test_the_balance_nearly_closes_where_resistances_change(chemistry):
    battery = BATTERIES[chemistry]
    start = resting_state(battery, 0.9)
    scale = battery.circuit.capacity_Ah / 12.0
    sim = run_fine(battery, steps([(duration, scale * current) for duration, current in BUSY_DAY]), start)
    assert balance_error_J(battery, start, sim) == pytest.approx(0.0, abs=0.03 * sim.state.heat_J)


def test_gas_takes_the_energy_that_is_not_stored():
    simple = simple_battery(full_width=0.05)
    battery = replace(simple, circuit=replace(simple.circuit, coulombic_efficiency=0.9))
    start = resting_state(battery, 0.8)
    sim = run_fine(battery, constant(8.0, 3600.0), start)
    assert sim.truth.soc[-1] < 1.0
    assert balance_error_J(battery, start, sim) == pytest.approx(0.0, abs=2e-4 * sim.state.heat_J)


def stored_energy_J(state, battery):
    """Chemical energy (enthalpy) above that of the empty battery plus that of the RC pairs' capacitors."""
    p, (soc, *v, _) = battery.circuit, state.x
    middle = soc * (np.arange(4000) + 0.5) / 4000
    mean_V, warmer_V = (p.ocv.mean_V(middle, p.reference_degC + warmer_K) for warmer_K in (0.0, 1.0))
    chemical = p.capacity_As * soc * np.mean(mean_V - (p.reference_degC + KELVIN) * (warmer_V - mean_V))
    pairs = pair_resistances(soc, CircuitInput(state.current_A, state.temperature_degC), p)
    return float(chemical + sum(0.5 * tau / r * vj * vj for vj, tau, r in zip(v, p.tau_s, pairs, strict=True)))


def balance_error_J(battery, start, sim):
    power = sim.truth.voltage_V * sim.truth.current_A
    given = float(np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(sim.time_s)))
    return given - (stored_energy_J(sim.state, battery) - stored_energy_J(start, battery)) - sim.state.heat_J


def test_soc_is_the_integral_of_the_current_shown():
    sim = run_fine(simple_battery(), steps(BUSY_DAY), resting_state(simple_battery(), 0.7))
    i = sim.truth.current_A
    charge = np.concatenate([[0.0], np.cumsum(0.5 * (i[1:] + i[:-1]) * np.diff(sim.time_s))])
    np.testing.assert_allclose(sim.truth.soc, 0.7 + charge / 36000.0, atol=1e-12)


def test_lead_acid_stores_95_percent_far_from_full_and_nothing_at_full():
    battery = BATTERIES["lead-acid"]
    middle = simulate(battery, constant(2.0, 3600.0), np.array([3600.0]), resting_state(battery, 0.3))
    assert middle.truth.soc[0] - 0.3 == pytest.approx(0.95 * 2.0 / 12.0, rel=1e-6)
    full = simulate(battery, constant(2.0, 3600.0), np.array([3600.0]), resting_state(battery, 1.0))
    assert full.truth.soc[0] == 1.0
    assert full.truth.current_A[0] > 0.1


@pytest.mark.parametrize("chemistry", sorted(BATTERIES))
@pytest.mark.parametrize("rate", [1.0, 0.1])
def test_charged_and_emptied_by_force_it_keeps_its_limits(chemistry, rate):
    battery = BATTERIES[chemistry]
    current = rate * battery.circuit.capacity_Ah
    hours = 1.3 * 3600.0 / rate
    profile = steps([(hours, current), (hours, -current), (600.0, -0.01 * current)])
    truth = simulate(battery, profile, np.arange(0.0, profile.time_s[-1], 5.0), resting_state(battery, 0.5)).truth
    assert 0.0 <= truth.soc.min() < 0.02
    assert 0.97 < truth.soc.max() <= 1.0
    assert truth.voltage_V.max() == pytest.approx(battery.voltage_max_V, abs=0.01)
    assert truth.voltage_V.min() == pytest.approx(battery.voltage_min_V, abs=0.01)


@given(st.floats(-3.0, 3.0), st.sampled_from(sorted(BATTERIES)), st.floats(-20.0, 50.0))
def test_current_at_inverts_the_instantaneous_overpotential(overpotential_V, chemistry, temperature_degC):
    battery = BATTERIES[chemistry]
    u = CircuitInput(np.sign(overpotential_V), temperature_degC)
    i = current_at(overpotential_V, u, 0.5, battery)
    p = battery.circuit
    warm = np.exp(p.activation_K * (1 / (temperature_degC + 273.15) - 1 / 298.15))
    r0 = warm * np.interp(0.5, np.linspace(0, 1, 21), p.r0_charge_ohm if overpotential_V > 0 else p.r0_discharge_ohm)
    back = r0 * i + battery.transfer_V * np.arcsinh(warm * i / battery.exchange_A)
    assert back == pytest.approx(overpotential_V, rel=1e-6, abs=1e-9)


def test_heat_settles_where_cooling_takes_it_away():
    battery = simple_battery(heat_capacity_J_per_K=10.0, transfer_V=0.0)
    flat = replace(battery.circuit, ocv=replace(battery.circuit.ocv, hysteresis_V=(), temperature_V_per_K=()))
    battery = replace(battery, circuit=flat)
    truth = simulate(battery, constant(-5.0, 5000.0, 10.0), np.array([5000.0]), resting_state(battery, 1.0)).truth
    assert truth.temperature_degC[0] == pytest.approx(10.0 + 25.0 * (0.02 + 0.01 + 0.02 + 0.03) / 0.5, abs=1e-3)


def test_an_idle_battery_cools_exponentially():
    battery = simple_battery()
    t = np.array([0.0, 1000.0, 2000.0, 6000.0])
    truth = simulate(battery, constant(0.0, 6000.0, 5.0), t, resting_state(battery, 0.5, 35.0)).truth
    np.testing.assert_allclose(truth.temperature_degC, 5.0 + 30.0 * np.exp(-t / 2000.0), atol=1e-9)


def test_halving_the_step_quarters_the_error():
    battery = BATTERIES["lfp"]
    time = np.linspace(0.0, 960.0, 13)
    profile = Profile(time, -5.0 + 4.0 * np.sin(np.arange(13.0)), np.full(13, 25.0))
    state = resting_state(battery, 0.6)

    def voltage(max_step_s):
        return simulate(battery, profile, time[1:], state, max_step_s).truth.voltage_V

    reference = voltage(0.25)
    coarse, fine = (abs(voltage(h) - reference).max() for h in (8.0, 4.0))
    assert coarse / fine == pytest.approx(4.0, rel=0.25)


def test_a_step_with_floats_is_the_compiled_step():
    battery = BATTERIES["lead-acid"]
    state = resting_state(battery, 0.55, 18.0)
    profile = constant(-3.0, 1.0, 20.0)
    sim = simulate(battery, profile, np.array([0.0, 1.0]), state)
    first, _ = step(state, Demand(0.0, -3.0, 20.0), battery)
    second, truth = step(first, Demand(1.0, -3.0, 20.0), battery)
    np.testing.assert_allclose(sim.state.x, second.x.astype(float), rtol=1e-13, atol=1e-15)
    for value, shown in zip(truth, sim.truth, strict=True):
        assert shown[1] == pytest.approx(float(value), rel=1e-12)


def test_fine_times_keep_every_time_and_no_step_is_too_long():
    time = np.array([0.0, 0.05, 3.0, 4.0])
    fine = fine_times(time, 1.0)
    assert set(time) <= set(fine)
    np.testing.assert_allclose(fine, [0.0, 0.05, 0.05 + 2.95 / 3, 0.05 + 5.9 / 3, 3.0, 4.0], atol=1e-14)


@pytest.mark.parametrize(
    ("times", "message"),
    [([], "at least one time"), ([0.0, 0.0], "increase"), ([-1.0, 5.0], "within the profile"), ([11.0], "to 10 s")],
)
def test_times_that_cannot_be_simulated_are_refused(times, message):
    with pytest.raises(InputError, match=message):
        simulate(simple_battery(), constant(1.0, 10.0), np.array(times), resting_state(simple_battery(), 0.5))


def test_a_state_of_charge_outside_is_refused():
    with pytest.raises(InputError, match="soc must be between 0 and 1, got 80"):
        resting_state(simple_battery(), 80.0)
