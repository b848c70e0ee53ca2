"""The filter of the textbooks: a Kalman filter where the curve is straight, and no more than that elsewhere."""

import math
from functools import partial

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from battery.examples import NMC, STRAIGHT, drive, row, samples, simulate
from kernels import assert_compiled_is_plain
from ohmward.battery.models.noise import PAIR_CURRENT_C, BatteryNoise, CurrentSensor
from ohmward.battery.models.thevenin import ohmic_resistance
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.errors import InputError
from ohmward.filters import unscented
from ohmward.filters.belief import unpack

NOISE = BatteryNoise()
SENSOR = CurrentSensor()
FIRST = SocSample(0.0, 0.0, 3.7, 25.0)
both = pytest.mark.parametrize("method", ["ekf", "ukf"])


def filterpy_of(dt_s):
    """The same filter on the straight cell, by hand."""
    peer = KalmanFilter(dim_x=3, dim_z=1, dim_u=1)
    a = np.exp(-dt_s / np.array(STRAIGHT.tau_s))
    r = np.array([0.01, 0.02])
    peer.F = np.diag([1.0, *a])
    peer.B = np.array([[dt_s / STRAIGHT.capacity_As], *((1 - a) * r)[:, None]])
    peer.H = np.array([[1.0, 1.0, 1.0]])
    peer.Q = np.diag([(SENSOR.noise_std_A / STRAIGHT.capacity_As) ** 2 * dt_s, *(PAIR_CURRENT_C * r * 2.0) ** 2])
    peer.R = np.array([[NOISE.voltage_std_V**2 + max(NOISE.model_std_V) ** 2]])
    peer.x, peer.P = np.array([[0.5], [0.0], [0.0]]), np.diag([0.1**2, 1e-6, 1e-6])
    return peer


@both
def test_on_a_straight_curve_it_is_filterpys_kalman_filter(method):
    filter_, rng = TextbookFilter(STRAIGHT, NOISE, method=method), np.random.default_rng(1)
    state, peer, before = filter_.start(FIRST, 0.5, 0.1), filterpy_of(2.0), 0.0
    for _ in range(50):
        current, voltage = rng.normal(-1.0, 0.5), rng.normal(3.6, 0.05)
        state, estimate = filter_.step(state, SocSample(2.0, current, voltage, 25.0))
        peer.predict(u=np.array([[0.5 * (current + before)]]))
        peer.update(voltage - 3.0 - 0.02 * current)
        before = current
        belief = unpack(state.belief)
        np.testing.assert_allclose(belief.mean, peer.x.ravel(), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(belief.cov, peer.P, rtol=1e-7, atol=1e-14)
        assert estimate.innovation_V == pytest.approx(peer.y.item(), abs=1e-10)
        assert estimate.soc_std == pytest.approx(math.sqrt(peer.P[0, 0]))


@both
def test_it_finds_the_soc_of_the_cell_it_believes_in(method):
    truth = simulate(NMC, drive(np.random.default_rng(2), 3000), 0.9)
    columns = samples(truth, 0.0, NOISE)
    estimator = SocEstimator(TextbookFilter(NMC, NOISE, method=method), 0.7, 0.2)
    for k in range(len(truth.time_s)):
        estimate = estimator.update(truth.time_s[k], columns.current_A[k], columns.voltage_V[k])
    assert estimate.soc == pytest.approx(truth.soc[-1], abs=0.02)


@both
def test_compiled_is_with_floats(method):
    columns = samples(simulate(NMC, drive(np.random.default_rng(3), 60), 0.9), 0.0, NOISE)
    filter_ = TextbookFilter(NMC, NOISE, method=method)
    assert_compiled_is_plain(filter_, filter_.init(row(columns, 0), 0.8), (row(columns, k) for k in range(40)))


@both
def test_bad_samples_do_not_stop_it(method):
    filter_ = TextbookFilter(NMC, NOISE, method=method)
    state = filter_.init(FIRST, 0.5)
    bad = [
        SocSample(1.0, math.nan, 3.7, math.nan),
        SocSample(1.0, -1.0, math.nan, 25.0),
        SocSample(-5.0, -1.0, 3.7, 25.0),
        SocSample(math.inf, -1.0, 3.7, 25.0),
        SocSample(math.nan, math.inf, -math.inf, 25.0),
    ]
    for sample in bad:
        state, estimate = filter_.step(state, sample)
        assert math.isfinite(estimate.soc) and math.isfinite(estimate.soc_std)
    assert int(estimate.flags) & SocFlag.NO_VOLTAGE


def test_another_method_is_refused():
    with pytest.raises(InputError, match="method must be one of ekf, ukf, got 'kf'"):
        TextbookFilter(NMC, method="kf")


def voltage(drop_V, x):
    return np.array([NMC.ocv.mean_V(x[0], 25.0) + x[1] + x[2] + drop_V])


def test_the_unscented_filter_is_that_of_all_sigma_points():
    filter_, rng = TextbookFilter(NMC, NOISE, method="ukf"), np.random.default_rng(5)
    state = filter_.start(FIRST, 0.4, 0.2)
    R = np.array([[NOISE.voltage_std_V**2 + max(NOISE.model_std_V) ** 2]])
    for _ in range(30):
        current, y = rng.normal(-1.0, 1.0), np.array([rng.normal(3.6, 0.1)])
        prior = filter_.predict(unpack(state.belief), 0.5 * (current + state.current_A), 1.0)
        drop_V = ohmic_resistance(prior.mean[0], filter_.input(current), NMC) * current
        expected = unscented.correct(prior, y, partial(voltage, drop_V), R)
        state, estimate = filter_.step(state, SocSample(1.0, current, y[0], 25.0))
        np.testing.assert_allclose(state.belief.mean, expected.belief.mean, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(unpack(state.belief).cov, expected.belief.cov, rtol=1e-9, atol=1e-15)
        assert estimate.innovation_V == pytest.approx(expected.innovation.value[0], abs=1e-12)
        assert estimate.voltage_std_V == pytest.approx(math.sqrt(expected.innovation.cov[0, 0]), rel=1e-12)


@both
def test_without_a_voltage_it_is_the_prediction_to_the_bit(method):
    filter_ = TextbookFilter(NMC, NOISE, method=method)
    state = filter_.start(FIRST, 0.5, 0.1)
    prior = filter_.predict(unpack(state.belief), -0.5, 2.0)
    after, _ = filter_.step(state, SocSample(2.0, -1.0, math.nan, 25.0))
    np.testing.assert_array_equal(after.belief.mean, prior.mean)
    np.testing.assert_array_equal(unpack(after.belief).cov, prior.cov)
