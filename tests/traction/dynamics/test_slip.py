import numpy as np
import pytest

from ohmward.trace import Kernel
from ohmward.traction.dynamics.slip import driving_slip_ratio, slip_ratio, travel_direction


@pytest.mark.parametrize(
    "rim, travel, ratio",
    [
        (1.0, 0.88, 0.12),
        (0.82, 1.0, -0.18),
        (1.0, 0.0, 1.0),
        (0.0, 1.0, -1.0),
        (-1.0, -0.88, -0.12),
        (-0.82, -1.0, 0.18),
        (1.0, -1.0, 2.0),
        (0.5, 0.5, 0.0),
    ],
)
def test_the_ratio_by_hand(rim, travel, ratio):
    assert slip_ratio(rim, travel) == pytest.approx(ratio, abs=1e-15)


@pytest.mark.parametrize("rim, travel", [(1.0, 0.88), (0.82, 1.0), (0.3, 0.29)])
def test_reverse_mirrors_everything_but_driving_and_braking(rim, travel):
    assert slip_ratio(-rim, -travel) == -slip_ratio(rim, travel)
    assert driving_slip_ratio(-rim, -travel) == driving_slip_ratio(rim, travel) == slip_ratio(rim, travel)


def test_direction_is_that_of_the_faster():
    assert [travel_direction(*pair) for pair in [(1, -0.5), (-1, 0.5), (0.5, -1), (0, 0)]] == [1, -1, -1, 1]


def test_too_slow_is_undefined_and_just_above_is_not():
    assert np.isnan(slip_ratio(0.0, 0.0))
    assert np.isnan(slip_ratio(0.019, -0.019))
    assert slip_ratio(0.02, 0.01) == 0.5
    assert slip_ratio(0.005, 0.004, floor_m_s=0.001) == pytest.approx(0.2)


def test_nan_in_nan_out():
    assert np.isnan(slip_ratio(np.nan, 1.0))
    assert np.isnan(slip_ratio(1.0, np.nan))


def test_arrays_and_traced_values_give_the_same():
    rim, travel = np.array([1.0, 0.5, 0.001, -0.3]), np.array([0.9, 1.0, 0.0, -0.4])
    kernel = Kernel(lambda a, b: (slip_ratio(a, b), driving_slip_ratio(a, b)), 0.0, 0.0)
    one_by_one = np.array([kernel(a, b) for a, b in zip(rim, travel, strict=True)]).T
    np.testing.assert_array_equal(one_by_one, [slip_ratio(rim, travel), driving_slip_ratio(rim, travel)])
