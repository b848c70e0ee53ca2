import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward_lab.simulate.profile import EDGE_S, Profile, join, steps


def test_phases_hold_their_current_and_end_in_time():
    profile = steps([(10.0, -2.0), (20.0, 0.0), (5.0, 3.0)], ambient_degC=7.0)
    np.testing.assert_allclose(
        np.interp([0.0, 9.9, 10.1, 29.9, 30.1, 35.0], profile.time_s, profile.current_A), [-2, -2, 0, 0, 3, 3]
    )
    assert profile.time_s[-1] == 35.0
    assert set(profile.ambient_degC) == {7.0}
    assert np.interp(10.0 + EDGE_S / 2, profile.time_s, profile.current_A) == pytest.approx(-1.0)


def test_joined_profiles_follow_each_other():
    one = Profile(np.array([0.0, 5.0]), np.array([1.0, 2.0]), np.zeros(2))
    joined = join([one, one])
    np.testing.assert_allclose(joined.time_s, [0.0, 5.0, 5.0 + EDGE_S, 10.0 + EDGE_S])
    np.testing.assert_allclose(joined.current_A, [1.0, 2.0, 1.0, 2.0])


@pytest.mark.parametrize("phases", [[], [(1.0, 1.0), (0.0, 2.0)]])
def test_phases_without_duration_are_refused(phases):
    with pytest.raises(InputError, match=r"longer than 0\.05 s"):
        steps(phases)
