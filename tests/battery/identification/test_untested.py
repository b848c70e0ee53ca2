"""What the temperatures of a test show of activations, and what stands in the file where they show nothing."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from battery.identification.examples import cell, pulse_log
from battery.identification.test_circuit import problem_of
from ohmward.battery.chemistries import CHEMISTRIES, chemistry_prior
from ohmward.battery.identification import identify
from ohmward.battery.identification.circuit_fit import circuit_of, fit_circuit
from ohmward.battery.identification.circuit_solve import block
from ohmward.battery.identification.circuit_uncertainty import (
    activation_std_K,
    confidence_intervals,
    hysteresis_std,
    load_temperature,
    ocv_std_V_per_K,
    overpotential_share,
    untested_sentences,
    usual_hysteresis_V,
    with_usual_hysteresis,
)
from ohmward.battery.identification.fit_samples import simulate

TRUE = replace(cell(), activation_K=2200.0, pair_activation_K=4200.0, tau_activation_K=1200.0)


def swept(low_degC, high_degC):
    """One pulse test whose temperature goes through a range three times, with the voltage of a cell that feels it."""
    problem = problem_of(pulse_log(cell(), count=6, rest_s=1800.0))
    (s,) = problem.samples
    share = 0.5 + 0.5 * np.cos(6 * np.pi * s.time_s / s.time_s[-1])
    s = s._replace(temperature_degC=low_degC + (high_degC - low_degC) * share)
    return replace(
        problem,
        samples=(s._replace(voltage_V=simulate(s, TRUE)),),
        fit_activation=load_temperature((s,)).shows_activation,
    )


def test_only_temperatures_at_which_current_flows_count():
    (s,) = problem_of(pulse_log(cell(), count=3, rest_s=900.0)).samples
    flows = s.mean_current_A != 0.0
    warm_at_rest = s._replace(temperature_degC=np.where(flows, 20.0, 45.0))
    assert load_temperature((warm_at_rest,)) == (20.0, 20.0)
    assert str(load_temperature((warm_at_rest,))) == "20 degC"
    warm_in_use = s._replace(temperature_degC=np.where(flows & (s.soc < 0.8), 45.0, 20.0))
    assert load_temperature((warm_in_use,)).shows_activation
    assert str(load_temperature((warm_in_use,))) == "20 to 45 degC"
    warm_day = s._replace(temperature_degC=np.where(flows & (s.soc < 0.8), 26.0, 20.0))
    assert not load_temperature((warm_day,)).shows_activation


def test_a_sweep_inside_one_record_shows_three_activations():
    problem = swept(0.0, 40.0)
    assert problem.fit_activation
    fit = fit_circuit(problem, 2)
    assert fit.solution.rates.activation_K == pytest.approx(TRUE.activation_K, abs=150.0)
    assert fit.solution.rates.pair_activation_K == pytest.approx(TRUE.pair_activation_K, abs=300.0)
    assert fit.solution.rates.tau_activation_K == pytest.approx(TRUE.tau_activation_K, abs=500.0)
    assert 600.0 <= activation_std_K(fit) < problem.prior.activation_std_K
    named = {c.name: c for c in confidence_intervals(fit)}
    assert named["pair_activation_K"].low < 4200.0 < named["pair_activation_K"].high
    assert not any("temperature" in sentence for sentence in untested_sentences(fit, "nmc"))


def test_one_temperature_leaves_the_prior_and_says_so():
    problem = swept(24.0, 26.0)
    assert not problem.fit_activation
    fit = fit_circuit(problem, 2)
    assert fit.solution.rates == problem.usual_rates(fit.solution.rates.tau_s)._replace(
        hysteresis_rate=fit.solution.rates.hysteresis_rate
    )
    assert activation_std_K(fit) == problem.prior.activation_std_K
    hysteresis, activation, curve = untested_sentences(fit, "nmc")
    assert "low-rate discharge and a low-rate charge" in hysteresis
    assert usual_hysteresis_V(problem) > 0.0
    assert activation == (
        "activation: currents flowed at 24 to 26 degC only, so how the resistances change with temperature was assumed "
        "as usual for nmc cells: 2500 K (R0), 3200 K (RC pairs) and 1500 K (time constants), each ± 2940 K; the RC "
        "pairs of an empty battery have a further ± 15680 K (95 %)"
    )
    assert "needs tests at two temperatures" in curve
    assert all("name the chemistry" in sentence for sentence in untested_sentences(fit, ""))


def test_a_measured_temperature_slope_narrows_the_curve():
    problem = swept(24.0, 26.0)
    measured = replace(problem, ocv=replace(problem.ocv, temperature_V_per_K=(1e-4,) * len(problem.ocv.voltage_V)))
    fit = fit_circuit(measured, 1)
    assert ocv_std_V_per_K(fit) < ocv_std_V_per_K(fit_circuit(problem, 1))
    assert not any("open-circuit" in sentence for sentence in untested_sentences(fit, "nmc"))


def test_rests_at_two_temperatures_show_how_the_curve_moves():
    """A cell whose curve falls by 0.4 mV/K, from pulses at 25 and 0 degC; otherwise activations would explain it."""
    slope = -4e-4
    moving = replace(TRUE, ocv=replace(TRUE.ocv, temperature_V_per_K=(slope,) * len(TRUE.ocv.voltage_V)))
    logs = [pulse_log(cell(), count=8, rest_s=3600.0) for _ in range(2)]
    problem = problem_of(*logs, degC=(25.0, 0.0), fit_activation=True)
    samples = tuple(s._replace(voltage_V=simulate(s, moving)) for s in problem.samples)
    problem = replace(problem, samples=samples)
    fit = fit_circuit(problem, 2)
    soc = np.linspace(0.3, 0.9, 13)
    found = np.interp(soc, np.linspace(0, 1, 201), circuit_of(fit.solution, 1.0).ocv.temperature_V_per_K)
    assert found == pytest.approx(slope, rel=0.1)
    assert fit.solution.rates.pair_activation_K == pytest.approx(TRUE.pair_activation_K, abs=300.0)
    usual = problem.volts * problem.prior.ocv_std_V_per_K
    assert 0.5 * usual <= ocv_std_V_per_K(fit) < usual


def test_two_temperatures_show_how_charge_transfer_bends_the_drop():
    """Pulses at 1 C and C/2 of a cell after Butler and Volmer, whose activation a straight drop makes too small."""
    bent = replace(TRUE, transfer_V=0.1)
    logs = [pulse_log(cell(), count=8, rest_s=1800.0) for _ in range(2)]
    problem = problem_of(*logs, degC=(25.0, 0.0), fit_activation=True)
    problem = replace(problem, samples=tuple(s._replace(voltage_V=simulate(s, bent)) for s in problem.samples))
    fit = fit_circuit(problem, 2)
    assert fit.solution.rates.transfer_V == pytest.approx(0.1, rel=0.15)
    assert fit.solution.rates.activation_K == pytest.approx(TRUE.activation_K, abs=100.0)
    assert fit.solution.x[block(0)][5:-1] == pytest.approx(0.030, rel=0.03)
    assert max(float(np.nanmax(np.abs(r))) for r in fit.solution.residual_V) < 2e-3
    named = {c.name: c for c in confidence_intervals(fit)}
    assert named["transfer_V"].low < 0.1 < named["transfer_V"].high


@pytest.mark.parametrize("chemistry", ["nmc", ""])
def test_the_file_holds_the_prior_and_its_width(chemistry):
    log = pulse_log(cell(), count=12, rest_s=1800.0)
    battery = identify(log, capacity_Ah=2.0, chemistry=chemistry, model="thevenin-1rc")
    prior = chemistry_prior(chemistry)
    assert battery.thevenin.activation_K == prior.activation_K.mean
    assert battery.thevenin.pair_activation_K == prior.pair_activation_K.mean
    assert battery.noise.activation_std_K == prior.activation_std_K
    assert battery.noise.ocv_std_V_per_K > 0.0
    assert any(sentence.startswith("activation: ") for sentence in battery.not_identified)


def test_an_unknown_chemistry_is_the_widest():
    for chemistry in CHEMISTRIES.values():
        assert chemistry.prior.activation_std_K < chemistry_prior("").activation_std_K
        for known, unknown in zip(chemistry.prior.activations_K, chemistry_prior("").activations_K, strict=True):
            assert known.std <= unknown.std
            assert abs(known.mean - unknown.mean) <= unknown.std


def test_a_hysteresis_that_was_seen_is_known_within_half_of_itself():
    problem = swept(24.0, 26.0)
    seen = replace(problem, ocv=replace(problem.ocv, hysteresis_V=(0.01,) * len(problem.ocv.voltage_V)))
    fit = fit_circuit(seen, 1)
    assert hysteresis_std(fit) == 0.5
    assert usual_hysteresis_V(seen) == 0.0
    assert with_usual_hysteresis(TRUE, seen) is TRUE
    sentences = untested_sentences(fit, "nmc")
    assert not any("hysteresis" in sentence for sentence in sentences)


def test_a_hysteresis_that_was_not_tested_stays_open():
    """A pulse test from full visits the discharge branch: its voltage stays, and that of the other branch is open."""
    problem = problem_of(pulse_log(cell(), count=20, rest_s=1800.0))
    half_V = usual_hysteresis_V(problem)
    opened = with_usual_hysteresis(TRUE, problem)
    soc = np.linspace(0.1, 0.9, 9)
    discharge_V = opened.ocv.mean_V(soc, 25.0) - opened.ocv.hysteresis_at(soc)
    assert opened.ocv.hysteresis_at(soc) == pytest.approx(half_V)
    assert discharge_V == pytest.approx(TRUE.ocv.mean_V(soc, 25.0), abs=0.2 * half_V)
    assert opened.tested_branch == pytest.approx(-1.0, abs=0.2)
    assert hysteresis_std(fit_circuit(problem, 1)) == 0.5


def test_the_error_of_the_overpotential_is_what_the_fit_leaves_under_current():
    true, problem = cell(), problem_of(pulse_log(cell(), count=9, rest_s=900.0))
    (s,) = problem.samples
    over_V = s.voltage_V - true.ocv.mean_V(s.soc, s.temperature_degC)
    left_V = np.hypot(0.01, np.where(s.soc < 0.5, 0.3 * over_V, 0.0))
    solution: Any = SimpleNamespace(residual_V=(left_V,), problem=problem)
    share = np.array(overpotential_share(solution, true, np.full(21, 0.01), 0.1))
    assert share[:8] == pytest.approx(0.3)
    assert share[13:] == pytest.approx(0.1)
