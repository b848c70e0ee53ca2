"""The band that a battery file promises, against the doubts that are in the file."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.rc import RcModel
from ohmward.battery.models.sensor import CurrentSensor
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


def test_the_day_draws_what_it_says():
    assert NMC.thevenin is not None
    day = working_day(TheveninFilter(NMC.thevenin, NMC.noise, NMC.sensor), 5.0)
    drawn = -np.sum(day.current_A * day.dt_s) / NMC.thevenin.capacity_As
    assert drawn == pytest.approx(START_SOC - END_SOC, rel=0.05)
    assert np.all(day.temperature_degC == 5.0)
    assert np.mean(day.current_A == 0.0) == pytest.approx(1 / 6, abs=0.05)  # the last hour is not a whole one


def test_an_unknown_start_is_no_better_than_a_known_one():
    for band in forecast(LFP):
        assert 0.0 < band.known_start <= band.unknown_start


def test_a_flat_curve_promises_less_than_a_steep_one():
    assert forecast(NMC, [25.0])[0].unknown_start < forecast(LFP, [25.0])[0].unknown_start


def test_a_better_sensor_is_worth_more_where_the_sensor_is_bad():
    bad = replace(LFP, sensor=CurrentSensor(0.05, offset_std_A=1.0, offset_walk_A=0.05, gain_std=0.02))
    first, *_ = forecasts_after_tests(bad, [25.0])
    assert first.test in ("with a better current sensor", "with a declared rest current")
    assert first.bands[0].known_start < forecast(bad, [25.0])[0].known_start


def test_a_capacity_that_nobody_measured_calls_for_a_full_discharge():
    unsure = replace(
        LFP,
        noise=replace(LFP.noise, capacity_std=0.3),
        sensor=CurrentSensor(0.01, offset_std_A=0.001, offset_walk_A=0.0, gain_std=0.001),
    )
    first, *_ = forecasts_after_tests(unsure, [25.0])
    assert first.test == "after a discharge from full to empty"


def test_without_a_thevenin_model_there_is_no_band():
    rc = RcModel(9000.0, 900.0, 0.010, 0.010, 0.006, OcvCurve((12.0, 13.6)), 12.0)
    assert forecast(Battery("rc", 12.0, rc=rc)) == ()
