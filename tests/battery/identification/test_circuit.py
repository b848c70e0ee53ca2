"""The fit of the circuit on simulated records: exact without noise, honest with it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from battery.identification.examples import LFP_OCV, NMC_OCV, cell, play, pulse_log, steps
from ohmward.battery.chemistries import HysteresisPrior, Normal, chemistry_prior
from ohmward.battery.identification.circuit_fit import circuit_of, curve_notes, fit_circuit
from ohmward.battery.identification.circuit_solve import (
    RESISTANCE_GRID,
    CircuitProblem,
    Rates,
    RecordColumns,
    block,
    circuit_unknowns,
    last_direction,
    ocv_precision,
    solve,
)
from ohmward.battery.identification.circuit_uncertainty import (
    confidence_intervals,
    held_out_V,
    not_identified,
    pulses_floor_V,
)
from ohmward.battery.identification.fit_samples import simulate, thin
from ohmward.battery.identification.record import make_records
from ohmward.battery.identification.soc_axis import anchor_soc
from ohmward.battery.models.ocv import hat
from ohmward.battery.posterior import OCV_KNOTS

FLAT = np.ones(RESISTANCE_GRID.size)
# The prior of the slowest pair is centred on the true one where a test is about exactness.
PRIOR = chemistry_prior("")._replace(slow_tau_s=800.0, curve=chemistry_prior("").measured_curve)


def problem_of(*logs, ocv=NMC_OCV, capacity_Ah=2.0, prior=PRIOR, fit_activation=False, degC=()):
    records = [r for log in logs for r in make_records(log, capacity_Ah)]
    parts = [part for r in records for part in thin(r, anchor_soc(r, capacity_Ah, ocv).soc)]
    for k, T in enumerate(degC):
        parts[k] = parts[k]._replace(temperature_degC=np.full(parts[k].soc.size, T))
    return CircuitProblem(tuple(parts), ocv, capacity_Ah, prior, FLAT, 25.0, fit_activation)


@pytest.fixture(scope="module")
def exact():
    """A pulse test without noise, its SoC known, and the cell it came from."""
    return problem_of(pulse_log(cell(), count=5, rest_s=1800.0)), cell()


def test_design_times_truth_is_the_simulated_voltage(exact):
    problem, p = exact
    unknowns, rates = circuit_unknowns(2, 1, False), Rates(p.tau_s, p.hysteresis_rate)
    x = np.zeros(unknowns.size)
    for j, ohm in enumerate((0.030, 0.030, 0.010, 0.025)):
        x[block(j)] = ohm
    (s,) = problem.samples
    voltage_V = NMC_OCV.mean_V(s.soc, 25.0) + RecordColumns(s, NMC_OCV, 2.0, 25.0).at(rates, unknowns, 0) @ x
    assert voltage_V == pytest.approx(s.voltage_V, abs=3e-4)


def test_linear_unknowns_without_noise(exact):
    problem, p = exact
    s = solve(problem, Rates(p.tau_s, p.hysteresis_rate))
    for j, ohm in enumerate((0.030, 0.030, 0.010, 0.025)):
        assert s.x[block(j)] == pytest.approx(ohm, rel=0.02)
    assert np.abs(s.x[s.unknowns.group("ocv")]).max() < 1e-3
    assert np.nanmax(np.abs(s.residual_V[0])) < 5e-4


def test_time_constants_without_noise(exact):
    problem, p = exact
    found = fit_circuit(problem, 2).solution
    assert found.rates.tau_s == pytest.approx(p.tau_s, rel=1e-4)


@pytest.mark.parametrize("pairs, tau_s", [(0, ()), (1, (60.0,)), (3, (6.0, 60.0, 800.0))])
def test_other_numbers_of_pairs(pairs, tau_s):
    p = cell(tau_s=tau_s)
    found = fit_circuit(problem_of(pulse_log(p, count=4, rest_s=1500.0)), pairs).solution
    assert found.rates.tau_s == pytest.approx(tau_s, rel=0.1)
    assert found.x[block(0)][4:-1] == pytest.approx(0.030, rel=0.03)


def test_resistance_along_soc_is_followed():
    ohm = 0.03 + 0.04 * np.exp(-8 * RESISTANCE_GRID)
    p = cell()
    p = type(p)(2.0, NMC_OCV, tuple(ohm), tuple(ohm), p.r_ohm, p.tau_s)
    s = solve(problem_of(pulse_log(p, count=10, rest_s=900.0)), Rates(p.tau_s, 20.0))
    assert s.x[block(0)][3:] == pytest.approx(ohm[3:], rel=0.06)


def test_hysteresis_scale_and_rate():
    p = cell(LFP_OCV, hysteresis_rate=40.0)
    problem = problem_of(
        pulse_log(p, count=6, rest_s=1800.0),
        ocv=LFP_OCV,
        prior=PRIOR._replace(hysteresis=HysteresisPrior(Normal(1.0, 0.3))),
    )
    found = fit_circuit(problem, 2).solution
    assert found.x[found.unknowns.group("hysteresis")] == pytest.approx(1.0, abs=0.1)
    assert found.rates.hysteresis_rate == pytest.approx(40.0, rel=0.25)


def test_a_wrong_first_ocv_curve_is_corrected():
    error_V = 0.006 * np.sin(2 * np.pi * np.linspace(0, 1, 201))
    wrong = type(NMC_OCV)(tuple(np.asarray(NMC_OCV.voltage_V) + error_V))
    problem = problem_of(pulse_log(cell(), count=10, rest_s=3600.0), ocv=wrong)
    fit = fit_circuit(problem, 2)
    corrected = circuit_of(fit.solution, 1.0).ocv
    soc = np.linspace(0.1, 0.95, 50)
    left_V = np.asarray(corrected.mean_V(soc, 25.0)) - np.asarray(NMC_OCV.mean_V(soc, 25.0))
    assert np.sqrt(np.mean(left_V**2)) < 0.0015 < 0.004 < np.sqrt(np.mean(error_V**2))


def test_an_outlier_hardly_counts():
    log = pulse_log(cell(), count=4, rest_s=900.0)
    voltage_V = log.voltage_V.copy()
    voltage_V[200:210] += 2.0
    spoiled = type(log)(log.name, log.time_s, log.current_A, voltage_V)
    s = solve(problem_of(spoiled), Rates((20.0, 800.0), 20.0))
    assert s.x[block(0)][4:-2] == pytest.approx(0.030, rel=0.1)


def test_voltages_not_measured_are_left_out():
    log = pulse_log(cell(), count=4, rest_s=900.0)
    voltage_V = log.voltage_V.copy()
    voltage_V[300:400] = np.nan
    s = solve(problem_of(type(log)(log.name, log.time_s, log.current_A, voltage_V)), Rates((20.0, 800.0), 20.0))
    assert np.isfinite(s.x).all() and np.isnan(s.residual_V[0]).any()
    assert s.x[block(0)][4:-1] == pytest.approx(0.030, rel=0.03)


def test_design_simulates_what_the_model_does_in_the_cold():
    """The columns of the fit against the open-loop simulation, with three activations and a temperature that falls."""
    p = replace(cell(), activation_K=1500.0, pair_activation_K=4500.0, tau_activation_K=1000.0)
    problem = problem_of(pulse_log(cell(), count=3, rest_s=900.0))
    samples = problem.samples[0]
    samples = samples._replace(temperature_degC=np.linspace(25.0, -10.0, samples.soc.size))
    unknowns = circuit_unknowns(2, 1, False)
    x = np.zeros(unknowns.size)
    for j, row in enumerate((p.r0_discharge_ohm, p.r0_charge_ohm, *p.r_ohm)):
        x[block(j)] = np.interp(RESISTANCE_GRID, np.linspace(0, 1, len(row)), row)
    rates = Rates(p.tau_s, 20.0, 1500.0, 4500.0, 1000.0)
    columns = RecordColumns(samples, p.ocv, p.capacity_Ah, p.reference_degC).at(rates, unknowns, 0)
    expected_V = simulate(samples, p) - np.asarray(p.ocv.mean_V(samples.soc, samples.temperature_degC))
    assert columns @ x == pytest.approx(expected_V, abs=1e-9)


def test_columns_that_are_kept_for_a_derivative_are_those_made_anew():
    problem = problem_of(pulse_log(cell(LFP_OCV), count=3, rest_s=900.0), ocv=LFP_OCV)
    (samples,), unknowns = problem.samples, circuit_unknowns(2, 1, True, True)
    samples = samples._replace(temperature_degC=np.linspace(25.0, -10.0, samples.soc.size))
    of_record = samples, LFP_OCV, 2.0, 25.0
    columns = RecordColumns(*of_record)
    first = Rates((20.0, 800.0), 20.0, 1500.0, 4500.0, 1000.0, 0.4, 700.0, False, 300.0)
    changes: dict[str, Any] = {"tau_s": (20.0, 900.0), "transfer_V": None, "net_charge_hysteresis": True}
    for field in Rates._fields:
        for rates in (first, first._replace(**{field: changes.get(field, 30.0)})):
            again = RecordColumns(*of_record).at(rates, unknowns, 0)
            np.testing.assert_array_equal(columns.at(rates, unknowns, 0), again)


def test_activation_from_two_temperatures():
    warm, cold = cell(), cell()
    factor = np.exp(2500.0 * (1 / 278.15 - 1 / 298.15))
    cold = type(cold)(
        2.0,
        NMC_OCV,
        tuple(factor * r for r in cold.r0_discharge_ohm),
        tuple(factor * r for r in cold.r0_charge_ohm),
        tuple(tuple(factor * r for r in row) for row in cold.r_ohm),
        cold.tau_s,
    )
    logs = [pulse_log(p, count=3, rest_s=1200.0) for p in (warm, cold)]
    found = fit_circuit(problem_of(*logs, degC=(25.0, 5.0), fit_activation=True), 2).solution
    assert found.rates.activation_K == pytest.approx(2500.0, rel=0.03)
    assert found.x[block(0)][5:-1] == pytest.approx(0.030, rel=0.03)


def test_intervals_cover_the_truth():
    """95 % intervals over seeds; samples closer than 60 s count as one, so white noise is covered more often."""
    truth = {
        "r0_discharge_ohm": 0.030,
        "r0_charge_ohm": 0.030,
        "r1_ohm": 0.010,
        "r2_ohm": 0.025,
        "tau1_s": 20.0,
        "tau2_s": 800.0,
    }
    inside = []
    for seed in range(4):
        fit = fit_circuit(problem_of(pulse_log(cell(), count=3, rest_s=1200.0, std_V=0.002, seed=seed)), 2)
        for c in confidence_intervals(fit):
            inside.append(c.low <= truth[c.name.split(" ")[0]] <= c.high)
    assert np.mean(inside) > 0.9


def test_intervals_grow_away_from_the_data():
    time_s, current_A = steps([(900, 0, 30), (30, -2, 1), (600, 0, 10)] + [(1200, -1, 5), (900, 0, 10)] * 2)
    problem = problem_of(play(cell(), time_s, current_A, soc=1.0))
    fit = fit_circuit(problem, 1)
    intervals = {c.name: c for c in confidence_intervals(fit)}
    near, far = intervals["r0_discharge_ohm at soc 0.9"], intervals["r0_discharge_ohm at soc 0.1"]
    assert far.high - far.low > 3 * (near.high - near.low)
    said = not_identified(fit)
    assert any("resistances at SoC 0 to 0.6" in sentence and "no current flowed there" in sentence for sentence in said)
    assert any("r0_charge_ohm: the logs hold no charge" in sentence for sentence in said)


def test_a_block_of_soc_is_predicted_by_a_fit_to_all_others():
    log = pulse_log(cell(), count=10, rest_s=900.0, std_V=0.002)
    problem = problem_of(log)
    s = solve(problem, Rates(cell().tau_s, 20.0))
    columns, measured = s.rows.columns, s.rows.residual + s.rows.columns @ s.x
    block_rows = (problem.joined("soc") >= 0.3) & (problem.joined("soc") < 0.4)
    A, y = columns[~block_rows], measured[~block_rows]
    x = np.linalg.solve(s.prior.precision + A.T @ A, s.prior.information + A.T @ y)
    error = (measured - columns @ x)[block_rows]
    expected_V = np.linalg.norm(error) / np.linalg.norm(s.rows.scale[block_rows])
    assert held_out_V(s)[2] == pytest.approx(expected_V, rel=1e-3)


@pytest.mark.parametrize("down_to, off_V, low, high", [(0.0, 0.0, 0.4, 0.5), (0.8, 0.0, 0.75, 0.9), (0.0, 0.05, 1, 1)])
def test_a_pulse_test_that_predicts_itself_in_many_places_narrows_the_floor(down_to, off_V, low, high):
    log = pulse_log(cell(), count=10, rest_s=900.0, std_V=0.0005)
    soc = 1.0 + log.charge_Ah() / 2.0
    bent = replace(log, voltage_V=log.voltage_V + off_V * np.sin(20.0 * np.pi * soc)).select(soc > down_to)
    problem = problem_of(bent)
    floor_V = pulses_floor_V(solve(problem, Rates(cell().tau_s, 20.0)))
    assert low <= floor_V / (problem.volts * PRIOR.pulses_V) <= high


def test_hat_is_linear_interpolation():
    x = np.linspace(-0.1, 1.1, 57)
    values = np.sin(9 * OCV_KNOTS)
    assert hat(x, OCV_KNOTS) @ values == pytest.approx(np.interp(x, OCV_KNOTS, values))


def test_ocv_prior_has_the_stated_spread():
    covariance = np.linalg.inv(ocv_precision(PRIOR.curve, NMC_OCV, 1.0))
    k = int(np.argmin(np.abs(OCV_KNOTS - 0.5)))
    slope = np.gradient(np.asarray(NMC_OCV.mean_V(OCV_KNOTS, 25.0)), OCV_KNOTS)[k]
    assert np.sqrt(covariance[k, k]) == pytest.approx(np.hypot(0.004, 0.01 * slope), rel=1e-6)
    assert covariance[k, k + 1] / np.sqrt(covariance[k, k] * covariance[k + 1, k + 1]) == pytest.approx(
        np.exp((OCV_KNOTS[k] - OCV_KNOTS[k + 1]) / 0.05)
    )


def test_last_direction_is_remembered_in_rest():
    assert last_direction(np.array([0, 0, 2, 0, 0, -1, 0, 0.01])).tolist() == [0, 0, 1, 1, 1, -1, -1, -1]


def test_a_curve_that_runs_backwards_is_warned_of(exact):
    """As logs with a wrong capacity give: a rise between two knots that is taken back between the next."""
    problem, p = exact
    solution = solve(problem, Rates(p.tau_s, p.hysteresis_rate))
    assert curve_notes(solution) == ()
    stairs_V = np.where((OCV_KNOTS > 0.2) & (OCV_KNOTS < 0.8), 0.05 * (np.arange(OCV_KNOTS.size) % 2), 0.0)
    x = solution.x.copy()
    x[solution.unknowns.group("ocv")] += stairs_V
    (note,) = curve_notes(replace(solution, x=x))
    assert str(note).startswith("warning: ") and "Is 2 Ah what the tests at low rate move" in str(note)
