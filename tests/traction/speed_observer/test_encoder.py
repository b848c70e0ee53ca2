import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction.speed_observer.encoders import wheel_speeds


def test_a_turn_in_a_second():
    speeds = wheel_speeds(np.array([[0, 0], [4096, -4096]]), np.array([0.0, 1.0]), 4096)
    assert np.isnan(speeds[0]).all()
    assert speeds[1] == pytest.approx([2 * np.pi, -2 * np.pi])


@pytest.mark.parametrize("bits", [16, 32])
def test_the_counter_overflows_in_both_directions(bits):
    true = np.array([[0, 0], [300, -300], [700, -900]])
    shown = np.mod(true + 2**bits - 350, 2**bits)
    signed = np.mod(true + 2 ** (bits - 1) - 350, 2**bits) - 2 ** (bits - 1)
    time_s = np.array([0.0, 0.1, 0.2])
    expected = wheel_speeds(true, time_s, 1000)
    np.testing.assert_array_equal(wheel_speeds(shown, time_s, 1000, bits), expected)
    np.testing.assert_array_equal(wheel_speeds(signed, time_s, 1000, bits), expected)


def test_no_speed_where_time_stands_or_goes_back():
    speeds = wheel_speeds(np.array([[0], [10], [20], [30]]), np.array([0.0, 0.1, 0.1, 0.05]), 100)
    assert np.isfinite(speeds[:, 0]).tolist() == [False, True, False, False]


def test_the_noise_of_quantisation():
    rng = np.random.default_rng(0)
    angle = np.cumsum(np.full(20000, 0.05) + 1e-3 * rng.standard_normal(20000))
    counts = np.floor(angle * 4096 / (2 * np.pi)).astype(int)[:, None]
    error = np.diff(angle) / 0.01 - wheel_speeds(counts, 0.01 * np.arange(20000), 4096)[1:, 0]
    step = 2 * np.pi / 4096 / 0.01
    assert np.std(error) == pytest.approx(step / np.sqrt(6), rel=0.03)  # two uniform errors of one step


def test_a_counter_that_never_wraps_around():
    speeds = wheel_speeds(np.array([[0], [-400]]), np.array([0.0, 1.0]), 100, bits=62)
    assert speeds[1, 0] == pytest.approx(-4 * 2 * np.pi)


def test_what_is_refused():
    with pytest.raises(InputError, match=r"counts must be \(T, wheels\)"):
        wheel_speeds(np.zeros(3, dtype=int), np.zeros(3), 100)
    with pytest.raises(InputError, match="bits must be between 8 and 62, got 4"):
        wheel_speeds(np.zeros((2, 1), dtype=int), np.arange(2.0), 100, bits=4)
