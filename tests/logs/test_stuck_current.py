"""A current sensor that stands still while the robot drives on: its values are left out, and the log says so."""

import numpy as np
import pytest

from ohmward.logs.clean import without_repeated_rows, without_stuck_current
from ohmward.logs.log import read_log

DEAD = slice(1200, 3600)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def driven(rng, noise_V=0.003, step_V=0.001, load_s=20):
    """Time, current and voltage (T,) of loads that change every 20 s, by a resistance and a pair of 100 s."""
    time_s = np.arange(3600.0)
    current_A = np.repeat(rng.choice([-0.5, -2.0, -6.0, 1.0], size=3600 // load_s), load_s)
    slow_V = np.zeros(3600)
    for k in range(1, 3600):
        slow_V[k] = slow_V[k - 1] + (0.03 * current_A[k] - slow_V[k - 1]) / 100.0
    voltage_V = 13.2 + 0.05 * current_A + slow_V + noise_V * rng.standard_normal(3600)
    return time_s, current_A + 0.02 * rng.standard_normal(3600), np.round(voltage_V / step_V) * step_V


@pytest.mark.parametrize("held_A", (0.0, -2.013))
def test_values_that_stand_still_under_load_are_left_out_and_counted(rng, held_A):
    time_s, current_A, voltage_V = driven(rng)
    current_A[DEAD] = held_A
    found_A, (note,) = without_stuck_current(time_s, current_A, voltage_V)
    assert np.isnan(found_A[1201:3600]).all() and np.isfinite(found_A[:1200]).all()
    assert note.level == "warning"
    assert f"the current of {held_A:g} A is stuck" in note.text and "from 1201 s to 3599 s" in note.text


@pytest.mark.parametrize(("held_A", "left_out"), ((-6.013, True), (0.0, False)))
def test_one_load_that_comes_and_goes_is_enough_beside_a_current_that_never_is_so_still(rng, held_A, left_out):
    """A sensor that rounds small currents to 0 is that still."""
    time_s, current_A, voltage_V = driven(rng)
    part = slice(1200, 1300)
    current_A[part], voltage_V[part] = (
        held_A,
        13.0 - 0.4 * ((time_s[part] // 40) % 2) + 0.003 * rng.standard_normal(100),
    )
    found_A, notes = without_stuck_current(time_s, current_A, voltage_V)
    assert len(notes) == left_out == np.isnan(found_A[1201:1300]).all()


def test_rows_that_a_logger_repeats_are_left_out(rng):
    time_s, current_A, voltage_V = driven(rng)
    current_A[DEAD], voltage_V[DEAD] = current_A[1199], voltage_V[1199]
    found_A, found_V, (note,) = without_repeated_rows(time_s, current_A, voltage_V)
    assert np.isnan(found_A[1200:3600]).all() and np.isnan(found_V[1200:3600]).all()
    assert np.isfinite(found_A[:1200]).all() and np.isfinite(found_V[:1200]).all()
    assert "repeated to the last digit from 1200 s to 3599 s, which elsewhere flicker" in note.text


@pytest.mark.parametrize("digits", (0, 1))
def test_rows_of_few_digits_repeat_without_a_fault(rng, digits):
    time_s, current_A, voltage_V = driven(rng)
    current_A[DEAD], voltage_V[DEAD] = 5.0, 13.4
    _, _, notes = without_repeated_rows(time_s, np.round(current_A, digits), np.round(voltage_V, digits))
    assert not notes


def test_so_do_those_of_a_test_at_constant_current(rng):
    time_s, current_A, voltage_V = driven(rng)
    current_A[DEAD], voltage_V[DEAD] = -1.0, np.round(13.3 - 2e-6 * np.arange(2400), 3)
    current_A[600:1200] = -1.0
    voltage_V[600:1200] = np.round(13.4 - 1e-4 * np.arange(600), 3)
    assert not without_repeated_rows(time_s, current_A, voltage_V)[2]


def test_so_do_those_of_a_simulated_rest_in_equilibrium():
    """Without noise the voltage changes wherever current flows or has flowed."""
    time_s = np.arange(3600.0)
    current_A = np.where(time_s < 1200, 0.0, np.where(time_s % 600 < 300, -6.0, 0.0))
    voltage_V = 13.2 + 0.05 * current_A - 1e-5 * np.maximum(time_s - 1200.0, 0.0)
    assert not without_repeated_rows(time_s, current_A, voltage_V)[2]


def test_a_log_that_is_read_says_so(rng, tmp_path):
    time_s, current_A, voltage_V = driven(rng)
    current_A[DEAD] = 0.0
    path = tmp_path / "day.csv"
    header = "time_s,current_A,voltage_V"
    np.savetxt(path, np.c_[time_s, current_A, voltage_V], delimiter=",", header=header, comments="", fmt="%.4f")
    log = read_log(path)
    assert np.isnan(log.current_A).sum() == 2399
    assert any("is stuck" in note.text for note in log.notes)


@pytest.mark.parametrize(("noise_V", "step_V"), ((0.0, 0.001), (0.0004, 0.001), (0.003, 0.0), (0.02, 0.01)))
def test_a_rest_is_no_fault_however_its_last_digit_flickers(rng, noise_V, step_V):
    time_s, current_A, voltage_V = driven(rng, noise_V, step_V or 1e-9)
    still_V = 13.2 + 0.1 * np.exp(-np.arange(2400) / 300.0) + noise_V * rng.standard_normal(2400)
    current_A[DEAD], voltage_V[DEAD] = 0.0, np.round(still_V / (step_V or 1e-9)) * (step_V or 1e-9)
    found_A, notes = without_stuck_current(time_s, current_A, voltage_V)
    assert found_A is current_A and not notes


def test_a_steady_charge_is_no_fault(rng):
    time_s, current_A, voltage_V = driven(rng)
    current_A[DEAD] = 5.0
    voltage_V[DEAD] = 13.4 + 1e-4 * np.arange(2400) + 0.003 * rng.standard_normal(2400)
    assert not without_stuck_current(time_s, current_A, voltage_V)[1]


def test_a_current_of_few_digits_is_no_fault(rng):
    time_s, current_A, voltage_V = driven(rng)
    assert not without_stuck_current(time_s, np.round(current_A), voltage_V)[1]


def test_neither_is_one_beside_a_voltage_of_few_digits(rng):
    time_s, current_A, voltage_V = driven(rng, load_s=120)
    assert not without_stuck_current(time_s, np.round(current_A, 1), np.round(voltage_V, 1))[1]


def test_a_load_shows_in_a_voltage_of_few_digits_too(rng):
    time_s, current_A, voltage_V = driven(rng)
    current_A[DEAD] = 0.0
    found_A, notes = without_stuck_current(time_s, current_A, np.round(voltage_V, 1))
    assert len(notes) == 1 and np.isnan(found_A[1201:3600]).all()
