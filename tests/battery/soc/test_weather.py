"""A battery whose temperature nobody measures: the band is that of any weather."""

from dataclasses import replace

import numpy as np
import pytest

from battery.anchor_examples import day, label
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.models.thevenin import CircuitInput, log_ratio_by_weather
from ohmward.battery.soc.augmented_thevenin import AugmentedThevenin
from ohmward.battery.soc.clean_sample import WEATHER_STD_K, first_input
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.score import score

NCA = generic_battery("nca", 3.0)
#: Known to the percent at 25 degC.
TESTED = replace(NCA, noise=replace(NCA.noise, resistance_std=0.02, activation_std_K=300.0, model_std_V=(0.004, 0.004)))
UNMEASURED = first_input(SocSample(0.0, -1.0, 3.7, float("nan")))


def system(battery=TESTED):
    return AugmentedThevenin(battery.thevenin, battery.noise, battery.sensor)


def test_a_first_sample_without_a_temperature_may_be_of_any_weather():
    assert UNMEASURED.unknown_K == WEATHER_STD_K
    assert first_input(SocSample(0.0, -1.0, 3.7, 10.0)).unknown_K == 0.0


def test_the_resistance_is_then_as_uncertain_as_the_cold_makes_it():
    p, here = TESTED.thevenin, UNMEASURED.temperature_degC
    kelvin = 273.15 + here
    colder = max(p.activation_K, p.pair_activation_K or 0.0) * (1 / (kelvin - WEATHER_STD_K) - 1 / kelvin)
    assert log_ratio_by_weather(UNMEASURED, p) == pytest.approx(colder)
    assert log_ratio_by_weather(CircuitInput(-1.0, here), p) == 0.0
    k = system().state_names.index("ohmic_log_ratio")
    variance = system().start(0.5, 0.1, UNMEASURED).cov[k, k]
    assert variance == pytest.approx(TESTED.noise.resistance_std**2 + colder**2)


def test_a_temperature_that_comes_later_ends_it():
    estimator = SocEstimator(TESTED, filter="ekf")
    estimator.update(0.0, -1.0, 3.7, None)
    assert estimator.state.unknown_K == WEATHER_STD_K
    estimator.update(1.0, -1.0, 3.7, 20.0)
    assert estimator.state.unknown_K == 0.0
    estimator.update(2.0, -1.0, 3.7, None)
    assert (estimator.state.unknown_K, estimator.state.temperature_degC) == (0.0, 20.0)


def test_a_drive_in_the_cold_is_covered_without_a_thermometer():
    drive = [(0.2, 0.0), *(2 * [(0.4, -0.5), (0.2, -0.1), (0.3, 0.0)]), (0.5, 0.3)]
    log, truth = day("nca", 0.9, drive, degC=0.0)
    blind = SocEstimator(label("nca"), initial_soc=0.9).run(replace(log, temperature_degC=None))
    band = score(blind.soc, truth, blind.soc_std)
    assert band is not None and band.coverage_95 > 0.95


def test_the_band_names_what_is_missing():
    log, _ = day("nca", 0.9, [(0.2, 0.0), (0.5, -0.5)])
    blind = SocEstimator(NCA, initial_soc=0.5, initial_soc_std=0.2).run(replace(log, temperature_degC=None))
    measured = SocEstimator(NCA, initial_soc=0.5, initial_soc_std=0.2).run(log)
    words = "temperature of the battery not measured"
    assert any(words in cause.text for cause in blind.explain().causes)
    assert not any(words in cause.text for cause in measured.explain().causes)
    assert np.mean(blind.soc_std) > np.mean(measured.soc_std)
