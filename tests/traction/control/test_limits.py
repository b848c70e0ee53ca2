import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.traction import RLMA
from ohmward.traction.control import Limits


@given(st.floats(-1e6, 1e6), st.floats(-3, 3), st.floats(0, 1))
def test_size_and_rate_are_kept(demanded, before, dt_s):
    limits = Limits(3.0, 50.0)
    torque = limits.apply(demanded, before, dt_s)
    assert abs(torque) <= 3.0
    assert abs(torque - before) <= 50.0 * dt_s + 1e-12


def test_a_torque_within_them_passes():
    assert Limits(3.0, 50.0).apply(np.array([1.0, -1.0]), 0.9, 0.1).tolist() == [1.0, -1.0]


def test_limits_of_current():
    limits = Limits.of_current(RLMA.motor, current_A=10.0, rate_A_per_s=1000.0)
    assert (limits.torque_Nm, limits.rate_Nm_per_s) == (pytest.approx(5.17), pytest.approx(517.0))


def test_no_limit_is_no_limit_of_zero():
    with pytest.raises(InputError, match=r"limits.torque_Nm must be > 0"):
        Limits(0.0)
