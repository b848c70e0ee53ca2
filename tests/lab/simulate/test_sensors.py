from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward_lab.simulate.sensors import Sensor, low_cost_sensors, on_the_bench

COUNT = 40_000
TIME = np.arange(COUNT, dtype=float)
IDEAL = Sensor(low=-20.0, high=20.0, resolution=1e-9, noise_std=0.0)


def read(sensor, true, seed=0):
    return sensor.measure(np.broadcast_to(np.asarray(true, dtype=float), COUNT), TIME, np.random.default_rng(seed))


def test_an_ideal_sensor_shows_the_truth():
    true = 10.0 * np.sin(TIME / 100.0)
    np.testing.assert_allclose(read(IDEAL, true), true, atol=1e-9)


def test_offset_and_gain_are_a_straight_line():
    sensor = replace(IDEAL, offset=0.05, gain_error=-0.01)
    np.testing.assert_allclose(read(sensor, 4.0 + 0.0 * TIME), 0.99 * 4.0 + 0.05, atol=1e-9)


def test_noise_has_its_standard_deviation():
    error = read(replace(IDEAL, noise_std=0.03), 1.0) - 1.0
    assert error.mean() == pytest.approx(0.0, abs=5 * 0.03 / np.sqrt(COUNT))
    assert error.std() == pytest.approx(0.03, rel=0.02)
    assert np.corrcoef(error[1:], error[:-1])[0, 1] == pytest.approx(0.0, abs=5 / np.sqrt(COUNT))


def test_the_converter_rounds_and_ends():
    ramp = np.linspace(-30.0, 30.0, COUNT)
    shown = read(replace(IDEAL, resolution=0.5), ramp)
    assert set(np.unique(shown)) == set(np.arange(-20.0, 20.5, 0.5))
    inside = abs(ramp) < 20.0
    assert abs(shown - ramp)[inside].max() <= 0.25 + 1e-9
    assert (shown - ramp)[inside].std() == pytest.approx(0.5 / np.sqrt(12.0), rel=0.01)


def test_missing_and_spikes_have_their_shares():
    assert np.isnan(read(replace(IDEAL, missing_share=0.1), 1.0)).mean() == pytest.approx(0.1, abs=0.01)
    spiky = read(replace(IDEAL, spike_share=0.05, spike_std=2.0), 1.0) - 1.0
    hit = abs(spiky) > 1e-6
    assert hit.mean() == pytest.approx(0.05, abs=0.006)
    assert spiky[hit].std() == pytest.approx(2.0, rel=0.1)


def test_the_offset_walks_with_the_square_root_of_time():
    sensor = replace(IDEAL, offset_walk_std=0.1)
    time = np.array([0.0, 1800.0, 3600.0, 4 * 3600.0])
    walks = np.array([sensor.measure(np.zeros(4), time, np.random.default_rng(seed)) for seed in range(3000)])
    np.testing.assert_allclose(walks.std(axis=0), 0.1 * np.sqrt([0.0, 0.5, 1.0, 4.0]), rtol=0.05)


def test_each_robot_has_its_own_sensors_and_the_bench_trims_them():
    one, other = (low_cost_sensors(np.random.default_rng(seed)) for seed in (1, 2))
    assert one != other
    assert 0.03 <= abs(one.current.offset) <= 0.06
    bench = on_the_bench(one)
    assert bench.current.offset == 0.001
    assert bench.current.gain_error == one.current.gain_error
    assert bench.voltage.gain_error == one.voltage.gain_error
    assert np.isfinite(read(bench.voltage, 13.0)).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"resolution": 0.0}, "sensor.resolution must be > 0"),
        ({"noise_std": -0.1}, "sensor.noise_std must be >= 0"),
        ({"missing_share": 1.5}, "sensor.missing_share must be between 0 and 1"),
        ({"high": -30.0}, "sensor.high - sensor.low must be > 0"),
    ],
)
def test_impossible_sensors_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(IDEAL, **change)
