import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward_lab.simulate.robot_day import Telemetry


@given(
    st.floats(0.1, 10.0), st.floats(0.0, 5.0), st.floats(0.0, 60.0), st.floats(0.0, 300.0), st.integers(0, 2**32 - 1)
)
def test_times_increase_strictly_and_stay_inside(interval_s, jitter_std_s, per_hour, mean_s, seed):
    times = Telemetry(interval_s, jitter_std_s, per_hour, mean_s).times(200.0, np.random.default_rng(seed))
    assert times.size >= 1
    assert times[0] >= 0.0
    assert times[-1] <= 200.0
    assert np.all(np.diff(times) > 0.0)


def test_jitter_has_its_size_and_does_not_add_up():
    times = Telemetry(1.0, 0.05, 0.0).times(20_000.0, np.random.default_rng(0))
    late = times - np.arange(20_000.0)
    assert late[1:].std() == pytest.approx(0.05, rel=0.03)
    assert abs(late).max() <= 0.4


def test_dropouts_take_rate_times_length_of_the_time():
    rng = np.random.default_rng(1)
    lost = [1.0 - Telemetry(1.0, 0.0, 4.0, 30.0).times(36_000.0, rng).size / 36_000.0 for _ in range(20)]
    expected = 1.0 - np.exp(-4.0 * 30.0 / 3600.0)
    assert np.mean(lost) == pytest.approx(expected, rel=0.15)


def test_the_first_sample_arrives_even_over_a_dead_link():
    dead = Telemetry(1.0, 0.0, dropouts_per_hour=1e5, dropout_mean_s=1e5)
    assert dead.times(50.0, np.random.default_rng(0))[0] == 0.0


def test_without_faults_it_is_a_raster():
    np.testing.assert_array_equal(
        Telemetry(0.5, 0.0, 0.0).times(5.0, np.random.default_rng(0)), np.arange(0.0, 5.0, 0.5)
    )


def test_no_interval_is_refused():
    with pytest.raises(InputError, match=r"telemetry\.interval_s must be > 0, got 0"):
        Telemetry(interval_s=0.0)
