"""The band that a battery file promises, against the doubts that are in the file."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.battery import Knowledge
from ohmward.battery.chemistries import generic_battery, start_noise
from ohmward.battery.learning.parameters import parameters_of, prior_covariance
from ohmward.battery.models.noise import CurrentSensor
from ohmward.battery.soc.band_forecast import (
    END_SOC,
    START_SOC,
    forecast,
    forecasts_after_tests,
    working_day,
)
from ohmward.battery.soc.thevenin_filter import TheveninFilter

NMC = generic_battery("nmc", 12.0, 4)
LFP = generic_battery("lfp", 12.0, 4)
#: The same with an OCV curve from a test.
CURVE = replace(start_noise("lfp", 4, ocv_known=True), soc_axis_std=0.0)
NMC_KNOWN, LFP_KNOWN = replace(NMC, noise=CURVE), replace(LFP, noise=CURVE)


def test_the_day_draws_what_it_says():
    day = working_day(TheveninFilter(NMC.thevenin, NMC.noise, NMC.sensor), 5.0)
    drawn = -np.sum(day.current_A * day.dt_s) / NMC.thevenin.capacity_As
    assert drawn == pytest.approx(START_SOC - END_SOC, rel=0.05)
    assert np.all(day.temperature_degC == 5.0)
    assert np.mean(day.current_A == 0.0) == pytest.approx(1 / 6, abs=0.05)  # the last hour is not a whole one


def test_an_unknown_start_is_no_better_than_a_known_one():
    for band in forecast(LFP):
        assert 0.0 < band.known_start <= band.unknown_start


def test_the_band_of_a_learnt_file_is_that_of_its_filter():
    """Its curve is pinned to the charge below full, so an unknown capacity opens the band on the way down."""
    p = parameters_of(NMC_KNOWN)
    learnt = replace(NMC_KNOWN, knowledge=Knowledge.of(p.names, prior_covariance(NMC_KNOWN), (), 0.1))
    assert forecast(learnt, [25.0]) == forecast(replace(learnt.pinned, knowledge=None), [25.0])
    assert forecast(learnt, [25.0]) != forecast(NMC_KNOWN, [25.0])


def test_a_flat_curve_promises_less_than_a_steep_one():
    assert forecast(NMC_KNOWN, [25.0])[0].unknown_start < forecast(LFP_KNOWN, [25.0])[0].unknown_start


def test_a_better_sensor_is_worth_more_where_the_sensor_is_bad():
    sensor = CurrentSensor(0.05, offset_std_A=1.0, offset_walk_A=0.05, gain_std=0.02)
    bad = replace(LFP, noise=replace(CURVE, capacity_std=0.01), sensor=sensor)
    first = forecasts_after_tests(bad, [25.0])[0]
    assert first.test in ("with a better current sensor", "with a declared rest current")
    assert first.bands[0].known_start < forecast(bad, [25.0])[0].known_start


def test_a_curve_that_nobody_measured_calls_for_the_slow_test():
    first, *_ = forecasts_after_tests(NMC, [25.0])
    assert first.test == "after a slow discharge and a slow charge"
    assert first.bands[0].known_start < 0.5 * forecast(NMC, [25.0])[0].known_start


def test_a_capacity_that_is_unsure_calls_for_a_discharge():
    sensor = CurrentSensor(0.01, offset_std_A=0.001, offset_walk_A=0.0, gain_std=0.001)
    unsure = replace(LFP, noise=replace(CURVE, capacity_std=0.3), sensor=sensor)
    gains = {one.test: one.bands[0].known_start for one in forecasts_after_tests(unsure, [25.0])}
    discharge = gains["after a discharge from full to empty"]
    assert discharge == pytest.approx(gains["after a slow discharge and a slow charge"], rel=0.2)
    assert all(discharge < band for test, band in gains.items() if "discharge" not in test)
