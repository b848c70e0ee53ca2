"""The filter against filters written otherwise, and what it recovers from."""

import math
from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from battery.examples import LFP, NMC, PLAIN, STRAIGHT, drive, row, samples, scan, simulate
from ohmward.battery.models.noise import PATH_S, BatteryNoise, CurrentSensor
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.coulomb import CoulombCounting
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.errors import InputError
from ohmward.filters.belief import Belief, unpack
from ohmward.trace import linearize

METHODS = ["ekf", "ukf"]
NOISE = BatteryNoise()
STEADY = CurrentSensor(offset_std_A=0.0, offset_walk_A=0.0, gain_std=0.0)


def test_reduces_to_a_kalman_filter_written_by_hand():
    """Straight OCV: SoC and the pairs are a linear model, and its Kalman filter is ten lines."""
    truth = simulate(STRAIGHT, drive(np.random.default_rng(2), 400), 0.6)
    columns = samples(truth, noise=PLAIN)
    settings = TheveninFilter(STRAIGHT, PLAIN, STEADY)
    _, estimates = scan(settings, columns, 0.6)

    start = unpack(settings.init(row(columns, 0), 0.6).belief)
    x, P = start.mean[:3].copy(), start.cov[:3, :3].copy()
    H, before = np.array([1.0, 1.0, 1.0]), columns.current_A[0]
    for k, (dt_s, i, v, _) in enumerate(zip(*columns, strict=True)):
        a = np.exp(-dt_s / np.array(STRAIGHT.tau_s))
        F, B = np.diag([1.0, *a]), np.array([dt_s / 7200.0, *((1 - a) * [0.01, 0.02])])
        path_A = np.sqrt(0.5) * (i - before) * dt_s / (dt_s + PATH_S)
        walks = (1 - a**2) * np.square([0.01 * 0.01, 0.01 * 0.02])
        Q = np.diag([0.05**2 * dt_s / 7200.0**2, *walks]) + np.diag((B * path_A) ** 2)
        x, P, before = F @ x + B * 0.5 * (i + before), F @ P @ F.T + Q, i
        K = P @ H / (H @ P @ H + 0.005**2)
        x, P = x + K * (v - 3.0 - H @ x - 0.02 * i), P - np.outer(K, H @ P)
        assert estimates.soc[k] == pytest.approx(x[0], abs=1e-10)
        assert estimates.soc_std[k] == pytest.approx(np.sqrt(P[0, 0]), rel=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_is_the_filter_of_filterpy(method):
    """The same functions, Q and R in a filter that others wrote, step by step from the same belief.

    The capacity follows a voltage only as far as it shows more than earlier ones, see `count_once`.
    """
    settings = TheveninFilter(NMC, NOISE, method=method)
    columns = samples(simulate(NMC, drive(np.random.default_rng(3), 120), 0.6), 0.02, NOISE)
    state = settings.init(row(columns, 0), 0.6)
    for k in range(120):
        sample = row(columns, k)
        mean, cov = peer_step(settings, state, sample)
        state, _ = settings.step(state, sample)
        ours = unpack(state.belief)
        others = np.arange(mean.size) != settings.system.gain_index
        assert ours.mean[others] == pytest.approx(mean[others], abs=1e-9)
        assert ours.cov[others] == pytest.approx(cov[others], abs=1e-10)
        assert ours.mean == pytest.approx(mean, abs=1e-6)


def peer_step(settings, state, sample):
    """Mean and covariance that FilterPy has after the sample."""
    clean, (mean, cov) = settings.sanitize(state, sample), unpack(state.belief)
    Q, y = settings.system.process_noise(mean, clean).astype(float), np.array([sample.voltage_V])

    def f(x, _dt=None):
        return settings.system.next_state(x, clean)

    def output(x, P):
        error = settings.voltage_error(Belief(x, P), clean)
        return lambda x: settings.system.voltage(x, clean, error), np.array([[float(error.variance * error.weight)]])

    if settings.method == "ekf":
        peer = ExtendedKalmanFilter(len(mean), 1)
        F = linearize(f, mean)[1]
        peer.x, peer.P = f(mean).astype(float), F @ cov @ F.T + Q
        h, peer.R = output(peer.x, peer.P)
        peer.update(y, lambda x: linearize(h, x)[1], h)
        return peer.x, peer.P
    points = MerweScaledSigmaPoints(len(mean), 0.85, 2.0, 0.0)
    peer = UnscentedKalmanFilter(len(mean), 1, 1.0, None, f, points)
    peer.x, peer.P, peer.Q = mean.copy(), cov.copy(), Q
    peer.predict()
    peer.sigmas_f = points.sigma_points(peer.x, peer.P)  # redrawn, as ours
    peer.hx, peer.R = output(peer.x, peer.P)
    peer.update(y)
    return peer.x, peer.P


@pytest.mark.parametrize("method", METHODS)
def test_on_a_straight_cell_both_methods_agree(method):
    """The gain times the charge is bilinear, so they agree to second order only."""
    columns = samples(simulate(STRAIGHT, drive(np.random.default_rng(4), 1500), 0.6), 0.03, NOISE)
    _, ekf = scan(TheveninFilter(STRAIGHT, NOISE), columns)
    _, other = scan(TheveninFilter(STRAIGHT, NOISE, method=method), columns)
    assert other.soc == pytest.approx(ekf.soc, abs=1e-4)
    assert other.soc_std == pytest.approx(ekf.soc_std, rel=5e-3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("offset_A", [-0.1, 0.05])
def test_rest_shows_the_offset_of_the_current_sensor(method, offset_A):
    truth = simulate(LFP, drive(np.random.default_rng(5), 3000), 0.8)
    _, estimates = scan(
        TheveninFilter(LFP, NOISE, method=method, idle_current_A=0.0), samples(truth, offset_A, NOISE), 0.8
    )
    assert estimates.current_offset_A[-1] == pytest.approx(offset_A, abs=0.008)
    assert np.mean(estimates.flags.astype(int) & SocFlag.REST > 0) == pytest.approx(1 / 8, abs=0.07)


def test_rest_at_the_declared_idle_current_is_no_offset():
    truth = simulate(LFP, np.full(600, -0.4), 0.8)
    _, estimates = scan(TheveninFilter(LFP, NOISE, idle_current_A=-0.4), samples(truth, 0.03, NOISE), 0.8)
    assert estimates.current_offset_A[-1] == pytest.approx(0.03, abs=0.008)


def test_without_a_declared_rest_it_learns_no_offset_from_one():
    truth = simulate(LFP, np.zeros(600), 0.5)
    _, estimates = scan(TheveninFilter(LFP, NOISE), samples(truth, 0.05, NOISE), 0.5)
    assert not np.any(estimates.flags.astype(int) & SocFlag.REST)


def test_a_small_true_current_is_no_rest_once_the_offset_is_known():
    current = np.concatenate([np.zeros(900), np.full(900, -0.25)])
    columns = samples(simulate(LFP, current, 0.8), 0.05, NOISE)
    _, estimates = scan(TheveninFilter(LFP, NOISE, idle_current_A=0.0), columns, 0.8)
    resting = estimates.flags.astype(int) & SocFlag.REST > 0
    assert resting[100:900].mean() > 0.75
    assert not resting[901:].any()
    assert estimates.current_offset_A[-1] == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("true", "given"), [(0.9, 0.4), (0.4, 0.8), (0.75, 0.25)])
def test_a_wrong_start_is_recovered(method, true, given):
    truth = simulate(NMC, drive(np.random.default_rng(6), 1800, mean_A=-0.2), true)
    _, estimates = scan(TheveninFilter(NMC, NOISE, method=method), samples(truth, 0.03, NOISE), given)
    assert abs(estimates.soc[-1] - truth.soc[-1]) < 0.01


def test_a_wrong_start_that_no_first_voltage_corrects_is_recovered():
    truth = simulate(NMC, drive(np.random.default_rng(6), 7200, mean_A=-0.1), 0.9)
    columns = samples(truth, 0.03, NOISE)
    columns.voltage_V[0] = math.nan
    _, estimates = scan(TheveninFilter(NMC, NOISE), columns, 0.5, 0.01)
    assert estimates.soc[0] == pytest.approx(0.5, abs=0.01)
    assert abs(estimates.soc[-1] - truth.soc[-1]) < 0.02


@pytest.mark.parametrize("current_A", [1.0, math.nan])
@pytest.mark.parametrize("dt_s", [0.0, 1.0, 100.0, 5000.0])
def test_process_noise_is_never_negative(current_A, dt_s):
    settings = TheveninFilter(LFP, NOISE)
    state = settings.init(SocSample(0.0, -1.0, 3.3, 25.0))
    for _ in range(3):
        sample = SocSample(dt_s, current_A, 3.3, 25.0)
        Q = settings.system.process_noise(unpack(state.belief).mean, settings.sanitize(state, sample))
        assert np.all(np.diag(Q) >= 0.0)
        state, _ = settings.step(state, sample)


@pytest.mark.parametrize("method", METHODS)
def test_on_the_plateau_sigma_does_not_collapse(method):
    truth = simulate(LFP, drive(np.random.default_rng(7), 7200, mean_A=-0.02), 0.5)
    _, estimates = scan(TheveninFilter(LFP, NOISE, method=method), samples(truth, 0.04, NOISE), 0.5, 0.05)
    error = estimates.soc - truth.soc
    assert estimates.soc_std.min() > 0.02
    assert np.mean(np.abs(error) < 1.96 * estimates.soc_std) > 0.95


def test_a_worn_battery_shows_in_its_capacity_and_resistance():
    worn = replace(NMC, capacity_Ah=1.6, r0_discharge_ohm=(0.09, 0.075, 0.075), r0_charge_ohm=(0.0825, 0.075, 0.075))
    worn = replace(worn, r_ohm=((0.0225, 0.015, 0.015), (0.045, 0.03, 0.03)))
    hours = np.tile(np.repeat([-0.8, 0.8], 3600), 5)
    truth = simulate(worn, hours, 0.95, hysteresis=0.0)
    noise = replace(NOISE, capacity_std=0.2, resistance_std=0.5)
    _, estimates = scan(TheveninFilter(NMC, noise, idle_current_A=None), samples(truth, 0.0, NOISE))
    assert estimates.soh_capacity[-1] == pytest.approx(0.8, abs=estimates.soh_capacity_std[-1])
    assert estimates.soh_capacity_std[-1] < 0.06
    assert estimates.resistance_ratio[-1] == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize("method", METHODS)
def test_the_voltage_never_hurts(method):
    truth = simulate(LFP, drive(np.random.default_rng(8), 3000), 0.8)
    columns = samples(truth, 0.03, NOISE)
    _, filtered = scan(TheveninFilter(LFP, NOISE, method=method), columns, 0.8)
    _, counted = scan(CoulombCounting(LFP, NOISE), columns, 0.8)
    assert np.all(filtered.soc_std <= counted.soc_std * 1.001)


def test_knowing_the_rest_never_hurts():
    truth = simulate(LFP, drive(np.random.default_rng(8), 3000), 0.8)
    columns = samples(truth, 0.03, NOISE)
    _, told = scan(TheveninFilter(LFP, NOISE, idle_current_A=0.0), columns, 0.8)
    _, untold = scan(TheveninFilter(LFP, NOISE), columns, 0.8)
    assert told.soc_std[-1] < untold.soc_std[-1]


@pytest.mark.parametrize("method", METHODS)
def test_a_pack_in_series_has_the_soc_of_its_cell(method):
    columns = samples(simulate(NMC, drive(np.random.default_rng(9), 600), 0.7), 0.02, NOISE)
    pack = columns._replace(voltage_V=7 * columns.voltage_V)
    noise = replace(NOISE, voltage_std_V=7 * NOISE.voltage_std_V, model_std_V=tuple(7 * v for v in NOISE.model_std_V))
    _, cell = scan(TheveninFilter(NMC, NOISE, method=method), columns)
    _, series = scan(TheveninFilter(NMC.in_series(7), noise, method=method), pack)
    assert series.soc == pytest.approx(cell.soc, abs=2e-6)
    assert series.soc_std == pytest.approx(cell.soc_std, rel=1e-4)
    assert series.voltage_V == pytest.approx(7 * cell.voltage_V, abs=1e-5)


def test_matching_finds_that_the_voltage_is_noisier_than_assumed():
    noisy = replace(NOISE, voltage_std_V=0.1)
    columns = samples(simulate(NMC, drive(np.random.default_rng(10), 2000), 0.7), 0.0, noisy)
    last, _ = scan(TheveninFilter(NMC, NOISE, matching=True), columns)
    assert np.sqrt(last.noise.residual[0, 0]) == pytest.approx(0.1, rel=0.25)
    assert last.noise.samples == 100.0


def test_estimates_stay_within_empty_and_full():
    """The cell is full, the sensor goes on counting up."""
    full = OcvCurve(tuple(3.3 + 0.001 * np.arange(11)))
    truth = simulate(replace(LFP, ocv=full), np.full(2400, 1e-6), 0.99)
    columns = samples(truth, 1.0)
    _, estimates = scan(TheveninFilter(replace(LFP, ocv=full), NOISE), columns, 0.99)
    assert estimates.soc.max() == 1.0
    assert np.any(estimates.flags.astype(int) & SocFlag.SOC_LIMITED)


def test_names_of_the_belief():
    assert TheveninFilter(NMC).state_names == (
        *("soc", "v1_V", "v2_V", "hysteresis"),
        *("offset_A", "charge_gain", "ohmic_log_ratio", "pair_log_ratio", "model_error"),
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"method": "pf"}, "method must be one of ekf, ukf, got 'pf'"),
        ({"gap_s": 0.0}, "gap_s must be > 0, got 0"),
        ({"gate": -1.0}, "gate must be > 0, got -1"),
        ({"window": 0.5}, "window must be >= 1, got 0.5"),
        ({"rest_hold_s": -1.0}, "rest_hold_s must be >= 0, got -1"),
        ({"reset_after_s": -1.0}, "reset_after_s must be >= 0, got -1"),
        ({"idle_current_A": math.inf}, "idle_current_A must be finite, got inf"),
    ],
)
def test_refuses(settings, message):
    with pytest.raises(InputError, match=message):
        TheveninFilter(NMC, **settings)


PARABOLA = replace(STRAIGHT, ocv=OcvCurve(tuple(3.0 + 0.5 * np.linspace(0.0, 1.0, 201) ** 2)))
JAGGED_V = PARABOLA.ocv.voltage_V + 1e-3 * (np.arange(201) % 2)
UNEVEN = replace(STRAIGHT, ocv=OcvCurve(tuple(np.maximum.accumulate(JAGGED_V))))


def test_the_tangent_of_a_parabola_leaves_out_what_a_second_order_filter_adds():
    mean_V, variance_V2 = tangent_error(PARABOLA, 0.05)
    assert mean_V == pytest.approx(0.5 * 1.0 * 0.05**2, rel=1e-3)
    assert variance_V2 == pytest.approx(2.0 * mean_V**2, rel=1e-3)
    assert tangent_error(STRAIGHT, 0.05) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_unevenness_of_a_measured_curve_is_no_curvature():
    """A millivolt up and down from point to point has a second derivative of tens of volts."""
    slope = 0.5  # of the smooth curve
    assert tangent_error(UNEVEN, 0.05, slope)[0] == pytest.approx(tangent_error(PARABOLA, 0.05, slope)[0], abs=1e-3)


def tangent_error(model, std, slope=None):
    system = TheveninFilter(model, PLAIN).system
    u, circuit = CircuitInput(0.0, 25.0), np.zeros(model.pairs + 2)
    slope = float(system.ocv_slope(np.array([0.5]), circuit, u)[0]) if slope is None else slope
    return tuple(map(float, system.tangent_error(0.5, slope, std, circuit, u)))


def test_a_reset_begins_the_errors_of_the_curve_anew():
    """They have taken up a voltage that contradicts the model; what they say of the next one is false."""
    noise = replace(NOISE, level_std_V=0.01, voltage_gain_std=0.005, hysteresis_std=0.5)
    settings = TheveninFilter(LFP, noise, STEADY)
    nothing = SocSample(0.0, 0.0, 3.3, 25.0)
    names = settings.state_names
    errors = ("model_error", "axis_error", "level_error", "voltage_gain_error", "hysteresis_log_ratio")
    of_curve = [names.index(name) for name in errors]
    others = [k for k in range(len(names)) if k not in of_curve]
    start = unpack(settings.init(nothing, 0.5).belief)
    root = np.random.default_rng(1).standard_normal(start.cov.shape)
    after = settings.with_new_curve_errors(Belief(start.mean + 4.0, root @ root.T))
    assert after.mean[of_curve] == pytest.approx(0.0) and after.mean[others] == pytest.approx(start.mean[others] + 4.0)
    assert after.cov[np.ix_(of_curve, of_curve)] == pytest.approx(np.diag([1.0, 1.0, 1.0, 1.0, 0.25]))
    assert after.cov[np.ix_(others, of_curve)] == pytest.approx(0.0)
    assert after.cov[np.ix_(others, others)] == pytest.approx((root @ root.T)[np.ix_(others, others)])
    assert after.cov[of_curve, of_curve] == pytest.approx(start.cov[of_curve, of_curve])  # as at a start
