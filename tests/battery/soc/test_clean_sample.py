import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.clean_sample import (
    HOLD_S,
    LONGEST_PAUSE_S,
    WAITS_S,
    WEATHER_STD_K,
    SampleLimits,
    first_input,
    sanitize,
    sanitize_bare,
)
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocFlag, SocSample

NAN, INF = math.nan, math.inf
anything = st.floats(allow_nan=True, allow_infinity=True)


BEFORE = CircuitInput(-2.0, 21.0)


def cleaned(sample, unknown_s=0.0):
    return sanitize(sample, BEFORE, SampleLimits(600.0, 40.0, 3.0, 4.2), unknown_s)


def test_a_good_sample_stays_as_it_is():
    clean = cleaned(SocSample(1.0, -3.0, 3.7, 25.0))
    assert clean.dt_s == 1.0
    assert clean.mean == (-2.5, 25.0, 0.0)
    assert clean.now == (-3.0, 25.0, 0.0)
    assert (clean.change_A, clean.current_known, clean.current_measured, clean.unknown_s) == (-1.0, True, True, 0.0)
    assert (clean.voltage_V, clean.voltage_measured) == (3.7, True)
    assert clean.flags == 0


@pytest.mark.parametrize("current_A", [NAN, INF, -INF, 41.0, -1000.0])
@pytest.mark.parametrize(("unknown_s", "last_A"), [(5.0, -2.0), (WAITS_S, -2.0 * math.exp(-1.0 / HOLD_S))])
def test_a_current_that_cannot_be_is_the_last_one_which_fades_after_a_while(current_A, unknown_s, last_A):
    clean = cleaned(SocSample(1.0, current_A, 3.7, 25.0), unknown_s=unknown_s)
    assert clean.flags == SocFlag.NO_CURRENT
    assert clean.now.current_A == pytest.approx(last_A, rel=1e-12)
    assert (clean.current_known, clean.current_measured, clean.unknown_s) == (False, False, unknown_s + 1.0)


def test_without_a_limit_every_finite_current_is_believed():
    assert sanitize(SocSample(1.0, 1000.0, 3.7, 25.0), BEFORE, SampleLimits(600.0)).flags == 0


@pytest.mark.parametrize("dt_s", [-1.0, NAN, INF, -INF, 2e9])
def test_a_bad_step_in_time_is_none(dt_s):
    clean = cleaned(SocSample(dt_s, -3.0, 3.7, 25.0))
    assert (clean.dt_s, clean.flags) == (0.0, SocFlag.BAD_TIME)


def test_a_repeated_sample_is_no_fault():
    assert cleaned(SocSample(0.0, -3.0, 3.7, 25.0)).flags == 0


def test_the_line_between_two_currents_is_believed_for_the_length_of_a_gap():
    clean = cleaned(SocSample(3600.0, -4.0, 3.7, 25.0))
    assert clean.flags == SocFlag.GAP
    assert clean.mean.current_A * clean.dt_s == pytest.approx(-3.0 * 600.0, rel=1e-12)
    assert (clean.current_known, clean.current_measured, clean.unknown_s) == (False, True, 3600.0)
    assert cleaned(SocSample(600.0, -4.0, 3.7, 25.0)).current_known


@pytest.mark.parametrize("temperature_degC", [NAN, -127.0, 850.0, INF, -INF])
def test_a_temperature_that_cannot_be_is_the_last_one(temperature_degC):
    clean = cleaned(SocSample(1.0, -3.0, 3.7, temperature_degC))
    assert clean.now.temperature_degC == clean.mean.temperature_degC == 21.0


@pytest.mark.parametrize("voltage_V", [NAN, INF, 0.0, -3.7, 8.5, 1.4, 6.0])
def test_a_voltage_that_cannot_be_is_none(voltage_V):
    clean = cleaned(SocSample(1.0, -3.0, voltage_V, 25.0))
    assert (clean.voltage_V, clean.voltage_measured, clean.flags) == (0.0, False, SocFlag.NO_VOLTAGE)


@pytest.mark.parametrize("voltage_V", [1.6, 5.8])
def test_a_voltage_under_load_and_charge_is_measured(voltage_V):
    assert cleaned(SocSample(1.0, -3.0, voltage_V, 25.0)).voltage_measured


@pytest.mark.parametrize("voltage_V", [5.0, 20.0])
def test_the_estimator_takes_no_voltage_of_another_battery(voltage_V):
    """Four LFP cells show neither 5 nor 20 V."""
    estimator = SocEstimator(generic_battery("lfp", 12.0, 4))
    before = estimator.update(0.0, -1.0, 13.1)
    after = estimator.update(1.0, -1.0, voltage_V)
    assert after.flags == SocFlag.NO_VOLTAGE
    assert after.soc == pytest.approx(before.soc, abs=1e-3)


@given(anything, anything, anything, anything)
def test_a_bare_sample_is_the_same_without_fading_and_gaps(dt_s, current_A, voltage_V, temperature_degC):
    sample = SocSample(dt_s, current_A, voltage_V, temperature_degC)
    bare = sanitize_bare(sample, BEFORE.current_A, 4.2)
    clean = sanitize(sample, BEFORE, SampleLimits(LONGEST_PAUSE_S, highest_ocv_V=4.2))
    assert (bare.dt_s, bare.voltage_V, bare.measured) == (clean.dt_s, clean.voltage_V, clean.voltage_measured)
    assert bare.current_A == (current_A if clean.current_measured else BEFORE.current_A)
    assert bare.mean_A == 0.5 * (bare.current_A + BEFORE.current_A)


@given(anything, anything, anything, anything)
def test_every_number_is_finite(dt_s, current_A, voltage_V, temperature_degC):
    clean = cleaned(SocSample(dt_s, current_A, voltage_V, temperature_degC))
    values = [*clean.mean, *clean.now, *(x for x in clean if not isinstance(x, tuple))]
    assert all(math.isfinite(x) for x in values)
    assert abs(clean.now.current_A) <= 40.0
    assert clean.dt_s >= 0.0


def test_the_first_sample_gives_an_input_whatever_it_holds():
    assert first_input(SocSample(0.0, 3.0, 3.7, 10.0), 40.0) == (3.0, 10.0, 0.0)
    assert first_input(SocSample(0.0, NAN, 3.7, NAN), 40.0) == (0.0, 25.0, WEATHER_STD_K)
    assert first_input(SocSample(0.0, 900.0, 3.7, -127.0), 40.0) == (0.0, 25.0, WEATHER_STD_K)
