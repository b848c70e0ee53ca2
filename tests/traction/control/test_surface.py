"""The surface against the slip ratio, and its rates against differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.traction.control.slip_law import surface
from ohmward.traction.dynamics.slip import slip_ratio

speeds = st.floats(-3.0, 3.0)
slips = st.floats(-0.9, 0.9)


@given(speeds, speeds, slips)
def test_above_the_floor_it_is_the_slip_ratio_times_a_speed(rim, travel, target):
    here = surface(rim, travel, target, 0.2)
    if max(abs(rim), abs(travel)) > 0.2:
        assert here.sigma == pytest.approx(here.reference_speed * (slip_ratio(rim, travel) - target), abs=1e-12)


def test_at_rest_it_asks_for_a_slip_speed():
    assert surface(0.0, 0.0, 0.12, 0.2).sigma == pytest.approx(-0.024)


def test_a_launch_starts_with_so_many_times_the_slip_speed_and_ends_at_the_floor():
    sigmas = [surface(V, V, 0.12, 0.2, launch=3.0).sigma for V in (0.0, 0.1, 0.2, 0.4)]
    assert sigmas == pytest.approx([-0.072, -0.048, -0.024, -0.048])


@given(speeds, speeds, slips, st.sampled_from([1.0, 3.0]))
def test_its_gain_and_drift_are_its_derivatives(rim, travel, target, launch):
    edges = abs(abs(rim) - abs(travel)), abs(abs(rim) - 0.2), abs(abs(travel) - 0.2)
    if min(edges) < 1e-3:
        return
    here, h = surface(rim, travel, target, 0.2, launch), 1e-6
    by_rim = (surface(rim + h, travel, target, 0.2, launch).sigma - here.sigma) / h
    by_travel = (surface(rim, travel + h, target, 0.2, launch).sigma - here.sigma) / h
    assert here.gain == pytest.approx(by_rim, abs=1e-6)
    assert -here.drift == pytest.approx(by_travel, abs=1e-6)


@given(speeds, speeds, slips)
def test_the_gain_never_vanishes(rim, travel, target):
    assert surface(rim, travel, target, 0.2).gain >= 1 - abs(target) - 1e-12


def test_it_works_for_many_wheels_at_once():
    rims, travels = np.array([1.0, -0.5]), np.array([0.9, 0.1])
    many = surface(rims, travels, 0.1, 0.2)
    assert many.sigma == pytest.approx([surface(a, b, 0.1, 0.2).sigma for a, b in zip(rims, travels, strict=True)])
