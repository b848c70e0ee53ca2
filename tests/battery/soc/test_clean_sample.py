import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.battery.soc.clean_sample import HOLD_S, first_input, sanitize
from ohmward.battery.soc.sample import SocFlag, SocSample

NAN, INF = math.nan, math.inf
anything = st.floats(allow_nan=True, allow_infinity=True)


def read_after_2A(sample, limit_A=40.0, unknown_s=0.0):
    return sanitize(sample, -2.0, 21.0, 600.0, limit_A, unknown_s)


def test_a_good_sample_stays_as_it_is():
    reading = read_after_2A(SocSample(1.0, -3.0, 3.7, 25.0))
    assert reading.dt_s == 1.0
    assert reading.mean == (-2.5, 25.0)
    assert reading.now == (-3.0, 25.0)
    assert (reading.change_A, reading.known, reading.measured, reading.unknown_s) == (-1.0, 1.0, 1.0, 0.0)
    assert reading.flags == 0


@pytest.mark.parametrize("current_A", [NAN, INF, -INF, 41.0, -1000.0])
def test_a_current_that_cannot_be_is_the_last_one_which_fades(current_A):
    reading = read_after_2A(SocSample(1.0, current_A, 3.7, 25.0), unknown_s=5.0)
    assert reading.flags == SocFlag.NO_CURRENT
    assert reading.now.current_A == pytest.approx(-2.0 * math.exp(-1.0 / HOLD_S), rel=1e-12)
    assert (reading.known, reading.measured, reading.unknown_s) == (0.0, 0.0, 6.0)


def test_without_a_limit_every_finite_current_is_believed():
    assert sanitize(SocSample(1.0, 1000.0, 3.7, 25.0), 0.0, 25.0, 600.0).flags == 0


@pytest.mark.parametrize("dt_s", [-1.0, NAN, INF, -INF, 2e9])
def test_a_bad_step_in_time_is_none(dt_s):
    reading = read_after_2A(SocSample(dt_s, -3.0, 3.7, 25.0))
    assert (reading.dt_s, reading.flags) == (0.0, SocFlag.BAD_TIME)


def test_a_repeated_sample_is_no_fault():
    assert read_after_2A(SocSample(0.0, -3.0, 3.7, 25.0)).flags == 0


def test_the_line_between_two_currents_is_believed_for_the_length_of_a_gap():
    reading = read_after_2A(SocSample(3600.0, -4.0, 3.7, 25.0))
    assert reading.flags == SocFlag.GAP
    assert reading.mean.current_A * reading.dt_s == pytest.approx(-3.0 * 600.0, rel=1e-12)
    assert (reading.known, reading.measured, reading.unknown_s) == (0.0, 1.0, 3600.0)
    assert read_after_2A(SocSample(600.0, -4.0, 3.7, 25.0)).known == 1.0


@pytest.mark.parametrize("temperature_degC", [NAN, -127.0, 850.0, INF, -INF])
def test_a_temperature_that_cannot_be_is_the_last_one(temperature_degC):
    reading = read_after_2A(SocSample(1.0, -3.0, 3.7, temperature_degC))
    assert reading.now.temperature_degC == reading.mean.temperature_degC == 21.0


@given(anything, anything, anything)
def test_every_number_is_finite(dt_s, current_A, temperature_degC):
    reading = read_after_2A(SocSample(dt_s, current_A, 3.7, temperature_degC))
    values = [*reading.mean, *reading.now, *(x for x in reading if not isinstance(x, tuple))]
    assert all(math.isfinite(x) for x in values)
    assert abs(reading.now.current_A) <= 40.0
    assert reading.dt_s >= 0.0


def test_the_first_sample_gives_an_input_whatever_it_holds():
    assert first_input(SocSample(0.0, 3.0, 3.7, 10.0), 40.0) == (3.0, 10.0)
    assert first_input(SocSample(0.0, NAN, 3.7, NAN), 40.0) == (0.0, 25.0)
    assert first_input(SocSample(0.0, 900.0, 3.7, -127.0), 40.0) == (0.0, 25.0)
