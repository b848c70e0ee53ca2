"""Currents of 16 bits that wrapped, and those that did not."""

import math

import numpy as np
import pytest

from ohmward.signals.current_size import check_hidden_charge, check_size, check_wrapped, not_in_amperes


def drive(largest_A, seed=0):
    """Loads and charges of a battery up to a current, with rests; 1 C of it is a fifth of that."""
    rng = np.random.default_rng(seed)
    current_A = np.repeat(rng.uniform(-1.0, 0.6, 120) * (rng.random(120) < 0.7), 10) * largest_A
    slow = np.convolve(current_A, np.exp(-np.arange(200) / 20.0) / 20.0)[: current_A.size]
    volts = 26.0 + (2.0 * current_A + slow) / largest_A + 0.003 * rng.standard_normal(current_A.size)
    return current_A, volts


def wrapped(current_A, digit_A):
    """The current as a 16-bit number of its last digit."""
    return np.rint(current_A / digit_A).astype(int).astype(np.int16) * digit_A


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("digit_A", "range_A"), [(1e-3, "65.536"), (1e-2, "655.36"), (1e-1, "6553.6")])
def test_a_current_that_wrapped_is_named_with_its_range(sign, digit_A, range_A):
    current_A, voltage_V = drive(45e3 * digit_A)
    (finding,) = check_wrapped(wrapped(sign * current_A, digit_A), voltage_V)
    assert f"unless {range_A} A are added: a 16-bit number of {1e3 * digit_A:g} mA" in finding.text


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("largest_A", [90.0, 135.0, 180.0])
def test_a_current_that_is_mostly_beyond_the_range_is_named(sign, largest_A):
    current_A, voltage_V = drive(largest_A)
    (finding,) = check_wrapped(wrapped(sign * current_A, 1e-3), voltage_V)
    assert "unless 65.536 A are added" in finding.text


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_flickering_current_that_fills_the_range_has_wrapped(sign):
    """Some steps from discharge to charge exceed the range."""
    rng = np.random.default_rng(0)
    load_A = np.repeat(rng.choice([-38.0, -3.5, 38.0], 200, p=[0.5, 0.45, 0.05]), 20)
    current_A = load_A * (1.0 + 0.12 * rng.standard_normal(load_A.size))
    voltage_V = 15.6 + 0.0016 * current_A + 0.002 * rng.standard_normal(load_A.size)
    (finding,) = check_wrapped(wrapped(sign * current_A, 1e-3), voltage_V)
    assert "unless 65.536 A are added" in finding.text


@pytest.mark.parametrize("late", [1, 2, 5])
def test_a_voltage_that_answers_late_is_no_wrap(late):
    current_A, voltage_V = drive(31.0)
    assert list(check_wrapped(current_A[:-late], voltage_V[late:])) == []


@pytest.mark.parametrize("largest_A", [2.0, 20.0, 31.0, 45.0, 300.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_current_that_did_not_wrap_is_read(largest_A, seed):
    current_A, voltage_V = drive(largest_A, seed)
    assert list(check_wrapped(current_A, voltage_V)) == []
    assert list(check_wrapped(current_A, np.random.default_rng(seed).permutation(voltage_V))) == []


def test_a_number_without_a_sign_wraps_below_zero():
    """A charge that begins and ends once is enough, where every step else is explained."""
    time = np.arange(900)
    current_A = np.where((time > 400) & (time < 600), 5.06, np.where(time // 30 % 2, -7.9, -0.27))
    voltage_V = 26.0 + 0.045 * current_A + 0.003 * np.random.default_rng(0).standard_normal(time.size)
    milliamperes = np.rint(1e3 * (current_A + 0.02 * np.sin(time))).astype(int) % 65536
    (finding,) = check_wrapped(1e-3 * milliamperes, voltage_V)
    assert "unless 65.536 A are added: a 16-bit number of 1 mA without a sign" in finding.text


@pytest.mark.parametrize(
    ("digit_A", "bits", "range_A"), [(1e-3, 16, "65.536"), (1e-1, 16, "6553.6"), (1e-3, 32, "4294967.296")]
)
def test_a_few_loads_and_one_charge_without_a_sign_are_enough(digit_A, bits, range_A):
    """Nine edges, of which only the last of a charge does not cross zero."""
    block = np.arange(300) // 25
    current_A = np.where(block % 3 == 1, -5.2, 0.0) + np.where(block % 6 == 5, 3.1, 0.0)
    unsigned_A = np.mod(np.rint(current_A / digit_A), 2**bits) * digit_A
    (finding,) = check_wrapped(unsigned_A, 13.2 + 0.03 * current_A)
    assert f"unless {range_A} A are added: a {bits}-bit number of {1e3 * digit_A:g} mA without a sign" in finding.text


@pytest.mark.parametrize("largest_A", [40.0, 50.0, 64.0])
def test_a_current_that_has_lost_its_sign_did_not_wrap(largest_A):
    """Charge and discharge of 40 A as sizes: less 65.536 A, the discharges of 50 A would have the right sign."""
    current_A, voltage_V = drive(largest_A)
    assert list(check_wrapped(np.abs(np.round(current_A, 3)), voltage_V)) == []


@pytest.mark.parametrize(("scale", "named"), [(1.0, False), (1e-3, True)])
def test_a_power_in_kilowatts_read_in_watts_is_named_by_its_resistance(scale, named):
    """20 mohm a cell become 20 ohm."""
    current_A, voltage_V = drive(20.0)
    assert (not_in_amperes(scale * current_A, voltage_V) is not None) == named


def charged_past_the_sensor(seed=0):
    """Two hours of loads, two on a charger that the sensor does not see while the robot idles."""
    time_s = 5.0 * np.arange(2880)
    rng = np.random.default_rng(seed)
    load_A = np.where((time_s < 7200.0) & (time_s // 300 % 2 == 0), -6.0, -0.3) + 0.02 * rng.standard_normal(2880)
    flowing_A = load_A + 3.0 * (time_s > 7500.0)
    charge_Ah = np.cumsum(flowing_A) * 5.0 / 3600.0
    return time_s, load_A, flowing_A, 26.0 + 0.5 * charge_Ah + 0.045 * flowing_A


def test_a_charge_that_the_sensor_does_not_show_is_named_with_its_hours():
    time_s, shown_A, flowing_A, voltage_V = charged_past_the_sensor()
    (finding,) = check_hidden_charge(time_s, shown_A, voltage_V)
    assert finding.text.startswith("in the 2.1 h from 1.9 h on the current sensor shows a discharge or none")
    assert list(check_hidden_charge(time_s, flowing_A, voltage_V)) == []


def test_a_rest_after_a_load_hides_no_charge():
    """The voltage relaxes, and small loads dip below it."""
    time_s = 5.0 * np.arange(2880)
    current_A = np.where(time_s < 3600.0, -6.0, np.where(time_s % 1800.0 < 60.0, -0.5, 0.0))
    relaxing_V = -0.4 * np.exp(-np.clip(time_s - 3600.0, 0.0, None) / 1500.0)
    assert list(check_hidden_charge(time_s, current_A, 26.0 + 0.2 * current_A + relaxing_V)) == []


@pytest.mark.parametrize(
    ("measured_ohm", "usual_ohm", "fix"),
    [
        (0.0021, 0.02, "tenths of an ampere? then scale = 0.1"),
        (0.19, 0.02, "another unit? then scale = 10"),
        (2e-5, math.nan, "milliamperes? then scale = 0.001"),
        (0.06, 0.02, None),
        (0.002, math.nan, None),
        (math.nan, 0.02, None),
    ],
)
def test_a_current_of_another_size_is_seen_in_the_resistance(measured_ohm, usual_ohm, fix):
    assert [f.advice for f in check_size(measured_ohm, 0.02, usual_ohm)] == ([fix] if fix else [])
