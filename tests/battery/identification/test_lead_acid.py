"""Lead-acid: acid that diffuses for hours, charges that make gas; on the simulated battery, whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from ohmward.battery.identification import identify
from ohmward.battery.identification.circuit_prior import prior_for
from ohmward.battery.identification.circuit_solve import error_factor
from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import make_estimator
from ohmward.battery.soc.score import score
from ohmward.simulate.bench_profiles import bench_times, low_rate_test
from ohmward.simulate.cells import BATTERIES
from ohmward.simulate.plant import resting_state, simulate
from ohmward.simulate.robot_day import make_robot_day, record, run_pulse_test
from ohmward.simulate.sensors import low_cost_sensors, on_the_bench

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


@pytest.mark.slow
def test_gas_in_a_low_rate_charge_is_not_taken_for_open_circuit_voltage(pulses, bench):
    """Near full the charge of this battery lies 1 V above its open-circuit voltage."""
    profile = low_rate_test(BATTERY, 20.0)
    low = simulate(BATTERY, profile, bench_times(profile), resting_state(BATTERY, 1.0, 20.0, hysteresis=1.0))
    found = identified(pulses, record(BATTERY, "low rate", low, *bench))
    assert ocv_error_V(found) < 0.02
    assert found.thevenin.ocv.voltage_V[-1] == pytest.approx(BATTERY.circuit.ocv.voltage_V[-1], abs=0.03)
    assert found.rc is not None


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


def test_charges_count_little_and_those_that_gas_hardly_at_all():
    none = np.zeros(3)
    current_A = np.array([-1.0, 1.0, 1.0])
    soc = np.array([0.9, 0.5, 0.9])
    samples = FitSamples("x", none, none, current_A, current_A, soc, soc, none, none, True, none)
    assert error_factor(prior_for("lead-acid", False), samples).tolist() == [2.0, 6.0, 100.0]
    assert error_factor(prior_for("nmc", False), samples).tolist() == [1.0, 1.0, 1.0]


def test_the_error_of_the_overpotential_is_largest_where_the_battery_gases(battery):
    share = np.array(battery.noise.overpotential_share)
    assert share.shape == (21,)
    assert share[-1] > share[10]
    assert battery.noise.model_soc_length == 0.5
