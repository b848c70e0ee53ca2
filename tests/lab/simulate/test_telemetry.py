import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward_lab.simulate.robot_day import telemetry_times


@given(st.floats(1.0, 20_000.0), st.integers(0, 2**32 - 1))
def test_times_increase_strictly_and_stay_inside(duration_s, seed):
    times = telemetry_times(duration_s, np.random.default_rng(seed))
    assert 0.0 <= times[0] <= 0.4
    assert times[-1] <= duration_s
    assert np.all(np.diff(times) > 0.0)


def test_jitter_has_its_size_and_does_not_add_up():
    times = telemetry_times(20_000.0, np.random.default_rng(0))
    late = times - np.round(times)
    assert late[1:].std() == pytest.approx(0.05, rel=0.03)
    assert abs(late).max() <= 0.4


def test_dropouts_take_rate_times_length_of_the_time():
    rng = np.random.default_rng(1)
    lost = [1.0 - telemetry_times(36_000.0, rng).size / 36_000.0 for _ in range(200)]
    assert np.mean(lost) == pytest.approx(1.0 - np.exp(-25.0 / 3600.0), rel=0.1)
