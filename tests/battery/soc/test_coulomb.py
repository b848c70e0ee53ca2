from dataclasses import replace

import numpy as np
import pytest

from battery.examples import NMC, STRAIGHT, row, samples, scan, simulate
from kernels import kernel_of
from ohmward.battery.models.noise import BatteryNoise, CurrentSensor
from ohmward.battery.soc.coulomb import CoulombCounting, RestOcv
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.errors import InputError

EXACT = BatteryNoise(capacity_std=0.0)
QUIET = CurrentSensor(noise_std_A=0.0, offset_std_A=0.0, gain_std=0.0)


def constant(current_A, hours, dt_s=10.0, soc=1.0):
    steps = int(3600 * hours / dt_s)
    return simulate(STRAIGHT, np.full(steps + 1, current_A), soc, dt_s)


@pytest.mark.parametrize("dt_s", [0.1, 10.0, 300.0])
def test_one_hour_at_1C_empties_the_cell(dt_s):
    columns = samples(constant(-2.0, 1.0, dt_s))
    state, estimates = scan(CoulombCounting(STRAIGHT, EXACT, QUIET), columns, 1.0, 1e-3)
    assert estimates.soc[-1] - estimates.soc[0] == pytest.approx(-1.0, abs=3e-3)
    assert state.moved == pytest.approx(-1.0, abs=1e-9)


def test_a_ramp_is_counted_exactly():
    columns = SocSample(np.array([0.0, 60.0]), np.array([0.0, -2.0]), np.array([3.8, 3.8]), np.array([25.0, 25.0]))
    state, _ = scan(CoulombCounting(STRAIGHT, EXACT, QUIET), columns, 0.8)
    assert state.moved == pytest.approx(-1.0 * 60.0 / 7200.0, rel=1e-12)


def test_an_offset_adds_up_in_time_and_a_gain_with_charge():
    truth = constant(-1.0, 1.0)
    start = scan(CoulombCounting(STRAIGHT, EXACT, QUIET), samples(truth), 1.0)[1].soc_std[0]
    offset = CoulombCounting(STRAIGHT, EXACT, replace(QUIET, offset_std_A=0.05))
    gain = CoulombCounting(STRAIGHT, replace(EXACT, capacity_std=0.024), replace(QUIET, gain_std=0.018))
    with_offset = scan(offset, samples(truth), 1.0)[1].soc_std
    with_gain = scan(gain, samples(truth), 1.0)[1].soc_std
    assert with_offset[-1] ** 2 - with_offset[0] ** 2 == pytest.approx((0.05 / 2.0) ** 2, rel=1e-3)
    assert with_gain[-1] ** 2 - start**2 == pytest.approx((0.03 * 0.5) ** 2, rel=0.02)


def test_white_noise_adds_up_as_a_random_walk_at_any_rate():
    """The same share of an hour's variance at each rate, for sensor noise of samples 1 s apart."""
    noisy = replace(QUIET, noise_std_A=0.5)
    for dt_s in (0.5, 1.0, 20.0):
        columns, estimator = samples(constant(0.0, 1.0, dt_s, 0.5)), CoulombCounting(STRAIGHT, EXACT, noisy)
        state, _ = scan(estimator, columns, 0.5)
        grown = state.white_variance - estimator.init(row(columns, 0), 0.5).white_variance
        assert grown == pytest.approx(0.5**2 * 3600 / 7200.0**2, rel=1e-6)


def test_the_claimed_sigma_is_the_spread_of_many_sensors():
    rng = np.random.default_rng(1)
    truth = simulate(NMC, np.full(3601, -0.5), 0.8)
    noise, sensor = BatteryNoise(), CurrentSensor(noise_std_A=0.3)
    estimator = CoulombCounting(NMC, noise, sensor)
    one = samples(truth)
    lanes = 300
    offset, gain = (
        sensor.offset_std_A * rng.standard_normal(lanes),
        np.hypot(noise.capacity_std, sensor.gain_std) * rng.standard_normal(lanes),
    )
    current = (1 + gain) * one.current_A[:, None] + offset + sensor.noise_std_A * rng.standard_normal((3601, lanes))
    state = estimator.init(row(one, 0), 0.8)
    kernel = kernel_of(estimator, state, row(one, 0))
    spread = 0.05 * rng.standard_normal(lanes)
    state = state._replace(soc=0.8 + spread, white_variance=0.05**2)
    _, estimates = kernel.scan_lanes(state, one._replace(current_A=current))
    z = (estimates.soc[-1] - truth.soc[-1]) / estimates.soc_std[-1]
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize(("current_A", "soc", "end"), [(-2.0, 0.2, 0.0), (2.0, 0.8, 1.0)])
def test_counting_stops_at_the_ends_and_says_so(current_A, soc, end):
    _, estimates = scan(CoulombCounting(STRAIGHT, EXACT, QUIET), samples(constant(current_A, 0.5, soc=soc)), soc, 1e-3)
    assert estimates.soc[-1] == end
    assert int(estimates.flags[-1]) & SocFlag.SOC_LIMITED


def resting(minutes_before, minutes_rest, soc):
    current = np.concatenate([np.full(60 * minutes_before, -1.0), np.zeros(60 * minutes_rest)])
    return simulate(NMC, current, soc)


def test_a_rest_corrects_the_count_once():
    truth = resting(20, 40, 0.8)
    state, estimates = scan(RestOcv(NMC), samples(truth, 0.02), 0.6, 0.1)
    used = np.flatnonzero(estimates.flags.astype(int) & SocFlag.REST)
    assert used.size == 1
    assert used[0] == pytest.approx(1200 + 900, abs=2)
    assert abs(estimates.soc[used[0]] - truth.soc[used[0]]) < 2 * estimates.soc_std[used[0]]
    assert estimates.soc_std[used[0]] < 0.6 * estimates.soc_std[used[0] - 1]
    assert np.isfinite(estimates.innovation_V[used[0]])
    assert state.rest.used == 1.0


def test_the_correction_is_the_scalar_kalman_update():
    truth = resting(20, 16, 0.8)
    estimator = RestOcv(NMC)
    columns = samples(truth)
    state = estimator.init(row(columns, 0), 0.8)
    for k in range(len(truth.soc)):
        before, (state, estimate) = state, estimator.step(state, row(columns, k))
        if int(estimate.flags) & SocFlag.REST:
            break
    counting, counted = estimator.counting.step(before.counting, row(columns, k))
    eps, at = 1e-6, float(counting.soc)
    slope = (NMC.ocv.mean_V(at + eps, 25.0) - NMC.ocv.mean_V(at - eps, 25.0)) / (2 * eps)
    innovation_V = float(columns.voltage_V[k] - NMC.ocv.mean_V(at, 25.0))
    K = float(counted.soc_std) ** 2 * slope / float(estimate.voltage_std_V) ** 2
    assert float(estimate.soc) == pytest.approx(at + K * innovation_V, abs=1e-8)
    assert float(estimate.soc_std) ** 2 == pytest.approx(float(counted.soc_std) ** 2 * (1 - K * slope), rel=1e-6)


def test_no_rest_while_the_current_is_unknown():
    truth = resting(1, 40, 0.8)
    columns = samples(truth)
    columns.current_A[100:] = np.nan
    _, estimates = scan(RestOcv(NMC), columns, 0.8)
    assert not np.any(estimates.flags.astype(int) & SocFlag.REST)


@pytest.mark.parametrize("kind", [CoulombCounting, RestOcv])
def test_refuses(kind):
    with pytest.raises(InputError, match="gap_s must be > 0, got 0"):
        kind(NMC, gap_s=0.0)
