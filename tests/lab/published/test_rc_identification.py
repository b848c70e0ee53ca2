"""The RC model from a log: exact recovery, the rule, slow sampling, and long charges."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.models.ocv import OcvCurve
from ohmward.errors import InputError
from ohmward.logs import Log
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc_identification import (
    FIRST_S,
    filtered,
    find_response,
    find_time_constant,
    fit_voltage,
    identify_rc,
    outside_long_charges,
)
from published.rc_examples import CAPACITY_AH, EVEN, UNEVEN, log_of, model_of, simulate

LINE = model_of(EVEN).ocv
four_numbers = rc.four_numbers


def pulses(circuit, dt_s=0.02, count=4):
    """Log of pulses of 5 A for 2 s from rest, each followed by 20 s of rest."""
    time_s = np.arange(0, count * 22.0, dt_s)
    current_A = np.where(time_s % 22.0 >= 20.0, -5.0, 0.0)
    x, voltage_V = rc_circuit.at_rest(model_of(circuit), 0.9), []
    for k, i in enumerate(current_A):
        x = rc_circuit.next_state(x, i, circuit, dt_s if k else 0.0)
        voltage_V.append(rc_circuit.voltage(x, i, circuit)[0])
    return Log("pulses", time_s, current_A, np.array(voltage_V))


@pytest.mark.parametrize("ocv", [LINE, None], ids=["with curve", "without curve"])
def test_recovers_a_circuit_with_equal_resistors_exactly(ocv):
    run = simulate(EVEN, 2000)
    found = identify_rc(log_of(run.samples), ocv, CAPACITY_AH, start_soc=1.0)
    np.testing.assert_allclose(found.model.circuit, EVEN, rtol=1e-4)
    np.testing.assert_allclose(found.model.ocv.voltage_V, LINE.voltage_V, atol=1e-5)
    assert found.fit is not None
    assert found.fit.rms_V < 1e-6


def test_recovers_the_four_numbers_of_any_circuit():
    run = simulate(UNEVEN, 2000)
    found = identify_rc(log_of(run.samples), None, CAPACITY_AH, start_soc=1.0)
    np.testing.assert_allclose(four_numbers(found.model), four_numbers(UNEVEN), rtol=1e-4)


def test_noise_leaves_the_parameters_and_is_measured():
    run = simulate(EVEN, 4000, voltage_std_V=0.003)
    found = identify_rc(log_of(run.samples), LINE, CAPACITY_AH)
    np.testing.assert_allclose(found.model.circuit, EVEN, rtol=0.05)
    assert found.noise.voltage_std_V == pytest.approx(0.003, rel=0.1)
    assert max(found.noise.model_std_V) < 0.01


def test_irregular_sampling_and_missing_voltages_do_not_matter():
    rng = np.random.default_rng(4)
    run = simulate(EVEN, 3000, dt_s=rng.uniform(0.2, 3.0, 3000))
    voltage_V = run.samples.voltage_V.copy()
    voltage_V[rng.random(3000) < 0.2] = np.nan
    found = identify_rc(log_of(run.samples._replace(voltage_V=voltage_V)), LINE, CAPACITY_AH, start_soc=1.0)
    np.testing.assert_allclose(four_numbers(found.model), four_numbers(EVEN), rtol=0.02)


def test_curve_with_bends_is_not_taken_for_a_relaxation():
    """A curve whose slope changes fourfold: with it the resistances come out, without it they do not."""
    soc = np.linspace(0.0, 1.0, 21)
    curve = OcvCurve(tuple(11.8 + 0.3 * soc + 1.2 * soc**4))
    run = simulate(EVEN, 8000, 3)
    bent_V = curve.mean_V(run.soc, 25.0) - np.interp(run.soc, [0, 1], LINE.voltage_V)
    log = log_of(run.samples._replace(voltage_V=run.samples.voltage_V + bent_V))
    found = identify_rc(log, curve, CAPACITY_AH, start_soc=1.0)
    np.testing.assert_allclose(four_numbers(found.model)[1:], four_numbers(EVEN)[1:], rtol=0.01)


def test_rule_finds_resistance_and_time_constant_in_the_first_half_second():
    """A surface capacitor of 3 F: tau = 0.18 s, as fast as [P] looks for it."""
    fast = rc.Circuit(17_000.0, 3.0, 0.03, 0.03, 0.02)
    response = find_response(outside_long_charges(pulses(fast), CAPACITY_AH), CAPACITY_AH)
    tau = find_time_constant(response)
    assert response.window_s == FIRST_S
    assert response.edges == 7
    assert response.r_total_ohm == pytest.approx(rc.instant_resistance(fast), rel=0.05)
    assert tau.found
    assert tau.tau_s == pytest.approx(1 / rc.relaxation_rate(fast), rel=0.1)
    found = identify_rc(pulses(fast), LINE, CAPACITY_AH)
    assert found.rule.c_surface_F == pytest.approx(tau.tau_s / (2 * found.rule.r_surface_ohm))


def test_logger_that_writes_both_currents_at_one_moment_is_understood():
    """As telemetry does: at the edge two rows with the old and the new current and one voltage in between."""
    log = pulses(EVEN, dt_s=1.0)
    at = np.flatnonzero(np.diff(log.current_A))[0] + 1
    time_s = np.insert(log.time_s, at, log.time_s[at] - 1e-3)
    current_A = np.insert(log.current_A, at, log.current_A[at - 1])
    voltage_V = np.insert(log.voltage_V, at, 0.5 * (log.voltage_V[at - 1] + log.voltage_V[at]))
    voltage_V[at + 1] = voltage_V[at]
    two_rows = Log("two rows", time_s[: at + 15], current_A[: at + 15], voltage_V[: at + 15])
    response = find_response(outside_long_charges(two_rows, CAPACITY_AH), CAPACITY_AH)
    assert response.r_total_ohm == pytest.approx(rc.instant_resistance(EVEN), rel=0.2)


def test_long_charges_are_left_out():
    """A charge that no linear model follows stands between two discharges; each keeps its own start."""
    first, second = simulate(EVEN, 3000, 1), simulate(EVEN, 3000, 2)
    charge_A, charge_V = np.full(600, 6.0), np.full(600, 14.4)
    current_A = np.concatenate([first.samples.current_A, charge_A, second.samples.current_A])
    voltage_V = np.concatenate([first.samples.voltage_V, charge_V, second.samples.voltage_V])
    log = Log("cycles", np.arange(6600.0), current_A, voltage_V)
    samples = outside_long_charges(log, CAPACITY_AH)
    assert set(samples.part) == {0, 1}
    assert 14.4 not in samples.voltage_V
    found = identify_rc(log, None, CAPACITY_AH, start_soc=1.0)
    np.testing.assert_allclose(four_numbers(found.model), four_numbers(EVEN), rtol=0.02)


def test_each_part_starts_from_rest():
    samples = outside_long_charges(log_of(simulate(EVEN, 100).samples), CAPACITY_AH)
    parts = samples._replace(part=np.repeat([0, 1], 50), mean_A=np.ones(100))
    alone = samples._replace(mean_A=np.ones(100))
    np.testing.assert_allclose(filtered(parts, 10.0)[50:], filtered(alone, 10.0)[:50], atol=1e-12)


def test_start_that_is_given_counts_more_than_the_first_voltage():
    run = simulate(EVEN, 3000)
    voltage_V = run.samples.voltage_V.copy()
    voltage_V[0] -= 0.5
    found = identify_rc(log_of(run.samples._replace(voltage_V=voltage_V)), LINE, CAPACITY_AH, start_soc=1.0)
    assert np.median(found.noise.model_std_V) < 0.05


def test_braking_is_no_long_charge():
    run = simulate(EVEN, 2000)
    assert run.samples.current_A.max() > 3.0
    assert len(outside_long_charges(log_of(run.samples), CAPACITY_AH).time_s) == 2000


def test_model_error_is_large_where_the_log_has_not_been():
    found = identify_rc(log_of(simulate(EVEN, 3000, voltage_std_V=0.003).samples), LINE, CAPACITY_AH)
    along = np.array(found.noise.model_std_V)
    assert along[0] == along.max() == along[1]


def test_a_straight_line_is_in_doubt_beyond_its_log():
    """By 30 % of its slope; a curve that is known is not."""
    run = simulate(EVEN, 3000, voltage_std_V=0.003)
    log, lowest = log_of(run.samples), run.soc.min()
    assert lowest > 0.3
    line = identify_rc(log, None, CAPACITY_AH, start_soc=1.0)
    slope_V = line.model.ocv.voltage_V[-1] - line.model.ocv.voltage_V[0]
    along = np.array(line.noise.model_std_V)
    assert along[0] == pytest.approx(0.3 * slope_V * lowest, rel=0.05)
    assert np.all(np.diff(along[:4]) < 0)
    assert max(identify_rc(log, LINE, CAPACITY_AH).noise.model_std_V) < 0.02


def test_no_relaxation_in_the_log_is_modelled_as_resistance():
    run = simulate(EVEN, 2000)
    resistor_V = 12.0 + 0.05 * run.samples.current_A + np.cumsum(run.samples.current_A * run.samples.dt_s) / 20_000.0
    found = identify_rc(log_of(run.samples._replace(voltage_V=resistor_V)), LINE, CAPACITY_AH, start_soc=1.0)
    C, r0, r1, _ = four_numbers(found.model)
    assert r0 + r1 == pytest.approx(0.05, rel=0.05)
    assert pytest.approx(sum(EVEN[:2]), rel=0.05) == C


def test_log_that_shows_no_battery_leaves_the_rule():
    """Voltage that does not depend on current beyond the edges: the fit is refused."""
    samples = outside_long_charges(log_of(simulate(EVEN, 500).samples), CAPACITY_AH)
    assert fit_voltage(samples._replace(voltage_V=12.0 - 0.05 * samples.current_A)) is None


@pytest.mark.parametrize("circuit", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("dt_s", [0.1, 1.0], ids=["10 Hz", "1 Hz"])
def test_an_hour_of_driving_shows_the_four_numbers_within_1_percent(circuit, dt_s):
    """With 2 mV and 20 mA of noise; the rule has R_0 within 2 %, and no time constant, which is slower than 500 ms."""
    run = simulate(circuit, int(3600 / dt_s), 6, dt_s=dt_s, voltage_std_V=0.002, current_std_A=0.02, soc=0.9)
    found = identify_rc(log_of(run.samples), None, CAPACITY_AH, start_soc=0.9)
    np.testing.assert_allclose(four_numbers(found.model), four_numbers(circuit), rtol=0.01)
    assert rc.instant_resistance(found.rule) == pytest.approx(rc.instant_resistance(circuit), rel=0.02)
    assert not found.tau.found


def test_samples_slower_than_the_relaxation_leave_the_resistances():
    """A minute between samples: R_0 and R_1 together are right."""
    run = simulate(EVEN, 600, 0, dt_s=60.0, voltage_std_V=0.002, current_std_A=0.02)
    found = identify_rc(log_of(run.samples), None, CAPACITY_AH, start_soc=1.0)
    assert rc.dc_resistance(found.model) == pytest.approx(rc.dc_resistance(EVEN), rel=0.15)


def test_without_a_curve_its_bend_is_not_taken_for_a_slow_relaxation():
    """A curve that bends, a drive of C/2, no curve given: R_1 and tau come out as with the curve."""
    soc = np.linspace(0.0, 1.0, 21)
    curve = OcvCurve(tuple(11.8 + 0.9 * soc + 0.3 * soc**3))
    run = simulate(EVEN, 5000, 3, voltage_std_V=0.002)
    bent_V = curve.mean_V(run.soc, 25.0) - np.interp(run.soc, [0, 1], LINE.voltage_V)
    log = log_of(run.samples._replace(voltage_V=run.samples.voltage_V + bent_V))
    found = identify_rc(log, None, CAPACITY_AH, start_soc=1.0)
    np.testing.assert_allclose(four_numbers(found.model)[1:], four_numbers(EVEN)[1:], rtol=0.1)


def test_a_relaxation_that_explains_next_to_nothing_is_none():
    """White noise of the size of the drop: an exponential always explains a little of it."""
    run = simulate(EVEN, 400, 1, dt_s=60.0, voltage_std_V=0.3)
    found = identify_rc(log_of(run.samples), LINE, CAPACITY_AH, start_soc=1.0)
    assert found.fit is not None
    assert found.fit.r1_ohm == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda log: replace(log, current_A=np.zeros(len(log))), "current is never other than zero"),
        (lambda log: replace(log, current_A=0.2 * np.sin(log.time_s / 50)), r"no edge of current above C/20 = 0\.3 A"),
        (lambda log: replace(log, current_A=-log.current_A), "turn the sign of the current"),
        (lambda log: replace(log, current_A=np.full(len(log), 3.0)), "nothing but a long charge"),
    ],
)
def test_useless_logs_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        identify_rc(change(log_of(simulate(EVEN, 1000).samples)), LINE, CAPACITY_AH)


def test_straight_line_needs_a_start_and_a_range():
    log = log_of(simulate(EVEN, 200).samples)
    with pytest.raises(InputError, match="identify_rc needs ocv, or start_soc"):
        identify_rc(log, None, CAPACITY_AH)
    with pytest.raises(InputError, match=r"moves SoC by .* %, does not show .* give the battery's OCV curve"):
        identify_rc(log, None, CAPACITY_AH, start_soc=1.0)
