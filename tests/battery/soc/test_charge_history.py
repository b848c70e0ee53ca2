"""Events of a log in the memory of an estimator, in whatever order they come."""

import numpy as np
import pytest

from ohmward.battery.soc.charge_history import ChargeMemory
from ohmward.battery.soc.sample import SocEstimate, SocFlag


def estimates(soc, diverged=()):
    """Estimates (T,) with these states of charge, sure of themselves, and divergences at these rows."""
    nothing = np.full(len(soc), np.nan)
    flags = np.zeros(len(soc))
    flags[list(diverged)] = SocFlag.DIVERGED
    found = SocEstimate(*[nothing] * len(SocEstimate._fields))
    return found._replace(soc=np.array(soc), soc_std=np.full(len(soc), 0.002), flags=flags)


@pytest.mark.parametrize(
    ("soc", "diverged", "full_s", "diverged_s"),
    [
        ([0.5, 0.5, 0.5, 0.5], [], np.nan, np.nan),
        ([0.5, 0.5, 1.0, 0.9], [], 30.0, np.nan),
        ([0.5, 0.5, 1.0, 0.9], [1], 30.0, 20.0),
        ([0.5, 1.0, 0.9, 0.8], [2], 20.0, 30.0),
    ],
)
def test_the_last_of_each_event_is_kept(soc, diverged, full_s, diverged_s):
    time_s = np.array([10.0, 20.0, 30.0, 40.0])
    memory = ChargeMemory().after_log(time_s, estimates(soc, diverged))
    assert memory.start_s == 10.0
    assert memory[1:3] == pytest.approx((full_s, diverged_s), nan_ok=True)
    one_by_one = ChargeMemory()
    for k, at_s in enumerate(time_s):
        one_by_one = one_by_one.after(at_s, SocEstimate(*(column[k] for column in estimates(soc, diverged))))
    assert memory == pytest.approx(one_by_one, nan_ok=True)


def test_a_clock_that_was_set_back_makes_no_divergence():
    first = ChargeMemory().after_log(np.array([100.0, 200.0]), estimates([0.5, 0.5]))
    second = first.after_log(np.array([0.0, 50.0]), estimates([0.5, 1.0]))
    assert np.isnan(second.diverged_s)
    assert (second.start_s, second.full_s, second.anchor_s) == (0.0, 50.0, 50.0)
