"""Currents of 16 bits that wrapped, and those that did not."""

import numpy as np
import pytest

from ohmward.signals.current_size import check_wrapped


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
