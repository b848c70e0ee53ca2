"""Resistance from the fast parts of current and voltage: exact for a resistor, whatever the rest of the cell does."""

import math

import numpy as np
import pytest

from ohmward.energy.sag import NO_SAG, Sag, sag_along
from ohmward.logs import Log

T = np.arange(1800.0)
RNG = np.random.default_rng(3)
CURRENT_A = -2.0 - np.repeat(RNG.uniform(0.0, 6.0, 90), 20)
OHM = 0.3


def sag_of(current_A, voltage_V, dt_s=1.0) -> Sag:
    sag = Sag()
    for current, voltage in zip(current_A, voltage_V, strict=True):
        sag = sag.with_sample(dt_s, float(current), float(voltage))
    return sag


def test_a_resistor_is_found_exactly():
    ohm = sag_of(CURRENT_A, 26.0 + OHM * CURRENT_A).ohm
    assert ohm.mean == pytest.approx(OHM, rel=1e-12) and ohm.std < 1e-6


def test_an_open_circuit_voltage_that_falls_and_a_slow_pair_have_no_part_in_it():
    slow_V, along = 0.0, []
    for current in CURRENT_A:
        slow_V += (1.0 - math.exp(-1.0 / 1500.0)) * (0.5 * current - slow_V)
        along.append(slow_V)
    ohm = sag_of(CURRENT_A, 26.0 - 0.001 * T + OHM * CURRENT_A + np.array(along)).ohm
    assert ohm.mean == pytest.approx(OHM, rel=0.03)


def test_noise_is_within_its_standard_deviation():
    z = []
    for seed in range(40):
        noise = 0.2 * np.random.default_rng(seed).standard_normal(T.size)
        ohm = sag_of(CURRENT_A, 26.0 + OHM * CURRENT_A + noise).ohm
        z.append((ohm.mean - OHM) / ohm.std)
    assert abs(np.mean(z)) < 0.5 and np.std(z) < 1.0  # careful: residuals are taken to hold on


def test_nothing_is_said_before_the_current_has_changed():
    assert Sag().ohm == NO_SAG
    assert sag_of(np.full(50, -2.0), np.full(50, 25.4)).ohm == NO_SAG
    assert sag_of(CURRENT_A, np.full(T.size, 25.4)).ohm == NO_SAG  # a voltage that is stuck


def test_what_was_not_measured_is_left_out():
    voltage_V = 26.0 + OHM * CURRENT_A
    voltage_V[200:260] = math.nan
    assert sag_of(CURRENT_A, voltage_V).ohm.mean == pytest.approx(OHM, rel=1e-12)


def test_the_means_begin_anew_after_a_gap():
    sag = sag_of(CURRENT_A, 26.0 + OHM * CURRENT_A)
    after = sag.with_sample(3600.0, -1.0, 20.0)  # another state of charge
    assert after.ohm == sag.ohm and (after.mean_A, after.mean_V) == (-1.0, 20.0)


def test_a_log_says_the_same_as_its_samples():
    log = Log("drive", T, CURRENT_A, 26.0 + OHM * CURRENT_A)
    assert sag_along(log).ohm.mean == pytest.approx(OHM, rel=1e-12)


def test_noise_of_the_current_is_no_load():
    """Least squares would give three quarters of the resistance for loads like the noise, and nearly zero at rest."""
    rng = np.random.default_rng(5)
    loads_A = -1.0 + 0.02 * (CURRENT_A - CURRENT_A.mean())
    noise_A, noise_V = 0.02 * rng.standard_normal(T.size), 0.001 * rng.standard_normal(T.size)
    assert sag_of(-1.0 + noise_A, 25.7 + noise_V).ohm == NO_SAG
    ohm = sag_of(loads_A + noise_A, 26.0 + OHM * loads_A + noise_V).ohm
    assert ohm.mean == pytest.approx(OHM, rel=0.05) and ohm.std < 0.5 * OHM


def test_some_seconds_give_no_resistance():
    voltage_V = 26.0 + OHM * CURRENT_A
    assert sag_of(CURRENT_A[:50], voltage_V[:50]).ohm == NO_SAG
    assert sag_of(CURRENT_A[:200], voltage_V[:200]).ohm.mean == pytest.approx(OHM)


def test_rest_before_a_load_makes_nothing_more_certain():
    """Ten seconds of load after an hour of rest, by a pair of which they show a part only."""
    load_A = np.where(np.arange(3610) < 3600, 0.0, -5.0)
    slow_V, along = 0.0, []
    for current in load_A:
        slow_V += (1.0 - math.exp(-1.0 / 5.0)) * (0.2 * current - slow_V)
        along.append(slow_V)
    ohm = sag_of(load_A, 26.0 + 0.1 * load_A + np.array(along)).ohm
    assert ohm.mean == pytest.approx(0.3, abs=2 * ohm.std)
