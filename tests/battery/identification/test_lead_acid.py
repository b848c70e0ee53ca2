"""Lead-acid: acid that diffuses for hours, charges that make gas; on the simulated battery, whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from ohmward.battery.chemistries import chemistry_prior
from ohmward.battery.identification import identify
from ohmward.battery.identification.circuit_solve import error_factor
from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import make_estimator
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.score import score
from ohmward_lab.simulate.cells import BATTERIES
from ohmward_lab.simulate.plant import resting_state, simulate
from ohmward_lab.simulate.profile import bench_times, low_rate_profile, steps
from ohmward_lab.simulate.robot_day import make_robot_day, record, run_pulse_test
from ohmward_lab.simulate.sensors import low_cost_sensors, on_the_bench

BATTERY = BATTERIES["lead-acid"]


def identified(*logs):
    return identify(logs, capacity_Ah=12.0, chemistry="lead-acid", n_series=6)


@pytest.fixture(scope="module")
def bench():
    """The logger of a test bench and its random numbers."""
    rng = np.random.default_rng(100)
    return on_the_bench(low_cost_sensors(rng)), rng


@pytest.fixture(scope="module")
def pulses(bench):
    return record(BATTERY, "pulses", run_pulse_test(BATTERY), *bench)


@pytest.fixture(scope="module")
def battery(pulses):
    return identified(pulses)


def ocv_error_V(found):
    """Largest error of the open-circuit voltage between 10 and 95 % [V]."""
    soc = np.linspace(0.1, 0.95, 18)
    return np.abs(found.thevenin.ocv.mean_V(soc, 25.0) - BATTERY.circuit.ocv.mean_V(soc, 25.0)).max()


def test_the_slow_acid_is_found_in_a_pulse_test(battery):
    """The true one takes two hours; without its pair the rests of an hour would give a curve that is 70 mV low."""
    slow_ohm = battery.thevenin.r_ohm[-1][10]
    true_ohm = BATTERY.circuit.r_ohm[-1][10]
    assert battery.thevenin.pairs == 3
    assert 3600.0 < battery.thevenin.tau_s[-1] < 10000.0
    assert 0.5 * true_ohm < slow_ohm < 1.5 * true_ohm
    assert ocv_error_V(battery) < 0.05


def test_the_axis_is_not_looked_up_on_the_curve_of_its_own_rests(battery):
    (axis,) = [note for note in battery.identification.notes if "SoC starts at" in note]
    assert "SoC starts at 1.000" in axis
    assert "highest charge of a full sweep" in axis


@pytest.mark.slow
def test_gas_in_a_low_rate_charge_is_not_taken_for_open_circuit_voltage(pulses, bench):
    """Near full the charge of this battery lies 1 V above its open-circuit voltage."""
    profile = low_rate_profile(BATTERY.circuit.capacity_Ah, 20.0)
    low = simulate(BATTERY, profile, bench_times(profile), resting_state(BATTERY, 1.0, 20.0, hysteresis=1.0))
    found = identified(pulses, record(BATTERY, "low rate", low, *bench))
    assert ocv_error_V(found) < 0.02
    assert found.thevenin.ocv.voltage_V[-1] == pytest.approx(BATTERY.circuit.ocv.voltage_V[-1], abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("start", [1.0, None])
def test_days_of_work_are_covered(battery, start):
    """Six days with a charge each, by sensors whose errors are drawn: voltage gain 0.1 %, offset 30 to 60 mA."""
    mean_square, coverage = [], []
    for seed in range(1, 7):
        log = make_robot_day("lead-acid", seed).mission
        found = SocEstimator(make_estimator("ekf", battery), start).run(log).estimates
        late = log.time_s - log.time_s[0] >= 3600.0
        scored = score(found.soc[late], log.extra["soc_true"][late], found.soc_std[late])
        assert scored
        mean_square.append(scored.rmse**2)
        coverage.append(scored.coverage_95)
    assert np.sqrt(np.mean(mean_square)) < 0.03
    assert np.mean(coverage) > 0.93


def test_a_full_charge_with_gas_leaves_the_battery_full(battery):
    """After nine hours at up to 14.4 V; a filter that believed the voltage took its end for 65 % less charge."""
    charge = [(3600.0, 0.0), (9 * 3600.0, BATTERY.charge_current_A), (3600.0, 0.0), (1800.0, -2.0)]
    profile = steps(charge, 20.0)
    times = np.arange(0.0, profile.time_s[-1], 2.0)
    log = record(
        BATTERY,
        "full charge",
        simulate(BATTERY, profile, times, resting_state(BATTERY, 0.4, 20.0)),
        low_cost_sensors(np.random.default_rng(3)),
        np.random.default_rng(3),
    )
    found = SocEstimator(make_estimator("ekf", battery), 0.4).run(log).estimates
    error = found.soc - log.extra["soc_true"]
    assert np.nanmax(log.voltage_V) > battery.thevenin.gassing_V + 1.0
    assert np.abs(error).max() < 0.05
    assert np.mean(np.abs(error) < 2 * found.soc_std) > 0.95


def test_a_gassing_voltage_is_not_used(battery):
    """Neither the state of charge nor a flag tells of it; below that voltage the same sample counts."""
    estimator = make_estimator("ekf", battery)
    start = estimator.init(SocSample(0.0, 0.0, 12.6, 20.0), 0.8)

    def after(voltage_V, current_A=1.0):
        return estimator.step(start, SocSample(10.0, current_A, voltage_V, 20.0))[1]

    gas, none = after(14.2), after(np.nan)
    assert gas.soc == pytest.approx(none.soc, abs=1e-12)
    assert gas.flags == 0
    assert np.isnan(gas.innovation_V)
    assert after(13.0).soc != pytest.approx(none.soc, abs=1e-6)


def test_charges_count_little_and_those_that_gas_hardly_at_all():
    none = np.zeros(3)
    current_A = np.array([-1.0, 1.0, 1.0])
    soc = np.array([0.9, 0.5, 0.9])
    samples = FitSamples(none, none, current_A, current_A, soc, soc, none, none, True)
    assert error_factor(chemistry_prior("lead-acid"), samples).tolist() == [2.0, 6.0, 100.0]
    assert error_factor(chemistry_prior("nmc"), samples).tolist() == [1.0, 1.0, 1.0]


def test_the_error_of_the_overpotential_is_largest_where_the_battery_gases(battery):
    share = np.array(battery.noise.overpotential_share)
    assert share.shape == (21,)
    assert share[-1] > share[10]
    assert battery.noise.model_soc_length == 0.5
