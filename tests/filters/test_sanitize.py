import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.filters.sanitize import between, every, hold, is_step, sanitize_step, some, within
from ohmward.trace import Kernel

NAN, INF = math.nan, math.inf
anything = st.floats(allow_nan=True, allow_infinity=True)


def test_a_credible_step_stays_as_it_is():
    assert sanitize_step(1.5, longest_s=3600.0, gap_s=10.0) == (1.5, True, False)
    assert sanitize_step(0.0, longest_s=3600.0, gap_s=10.0) == (0.0, True, False)


@pytest.mark.parametrize("dt_s", [-1.0, NAN, INF, -INF, 3601.0])
def test_a_step_that_no_clock_shows_is_zero(dt_s):
    assert sanitize_step(dt_s, longest_s=3600.0, gap_s=10.0) == (0.0, False, False)


def test_a_step_longer_than_a_gap_is_one_and_keeps_its_length():
    assert sanitize_step(11.0, longest_s=3600.0, gap_s=10.0) == (11.0, True, True)
    assert not sanitize_step(10.0, longest_s=3600.0, gap_s=10.0).gap


@given(anything)
def test_no_number_passes_that_is_none_or_too_large(value):
    expected = math.isfinite(value) and abs(value) <= 40.0
    assert bool(within(value, 40.0)) == expected
    assert bool(between(value, -40.0, 40.0)) == expected
    assert bool(is_step(value, 40.0)) == (expected and value >= 0.0)


def test_a_value_that_is_not_credible_is_the_last_one_which_fades():
    assert hold(3.0, True, -2.0, 1.0, 30.0) == 3.0
    assert hold(NAN, False, -2.0) == -2.0
    assert hold(NAN, False, -2.0, 15.0, 30.0) == pytest.approx(-2.0 * math.exp(-0.5), rel=1e-14)


def test_conditions_are_combined():
    assert every([True, True]) and not every([True, False])
    assert some([False, True]) and not some([False, False])


def test_the_traced_program_gives_the_same_to_the_bit():
    def step(last, sample):
        time = sanitize_step(sample[0], 3600.0, 10.0)
        credible = every([within(sample[1], 5.0), time.credible])
        value = hold(sample[1], credible, last, time.dt_s, 2.0)
        return value, value

    samples = [np.array([dt_s, value]) for dt_s in (0.5, -1.0, NAN, 20.0) for value in (2.0, 7.0, NAN)]
    _, traced = Kernel(step, 1.0, samples[0]).scan(1.0, np.array(samples))
    last = 1.0
    for sample, found in zip(samples, traced, strict=True):
        last, expected = step(last, sample)
        assert found == expected
