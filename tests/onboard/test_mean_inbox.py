import math
from itertools import pairwise

import pytest

from ohmward.onboard.estimation import LONGEST_S, USUAL_S, MeanInbox, MeanSample


def test_a_message_with_everything_is_a_sample():
    inbox = MeanInbox(("i", "v"))
    assert inbox.put(1.0, {"i": -2.0, "v": 12.0, "other": 5.0}) == MeanSample(1.0, {"i": -2.0, "v": 12.0})


def test_a_sample_waits_for_what_comes_apart_and_holds_means():
    inbox = MeanInbox(("i", "v"))
    assert [inbox.put(0.1 * k, {"i": float(k)}) for k in range(4)] == [None] * 4
    assert inbox.put(0.35, {"v": 12.0}) == MeanSample(0.35, {"i": 1.5, "v": 12.0})


def test_charge_is_counted_whole_whatever_the_rates():
    """The means over the steps times their lengths are the integral of what was sent."""
    inbox = MeanInbox(("i", "v"))
    currents = [math.sin(0.37 * k) for k in range(1000)]
    samples = []
    for k, current_A in enumerate(currents):
        values = {"i": current_A} | ({"v": 12.0} if k % 10 == 9 else {})
        if sample := inbox.put(1e-3 * k, values):
            samples.append(sample)
    assert len(samples) == 100
    assert sum(10 * sample.values["i"] for sample in samples) == pytest.approx(sum(currents))


def test_a_signal_that_has_died_is_not_waited_for():
    inbox = MeanInbox(("i", "v"))
    inbox.put(0.0, {"i": 0.0, "v": 12.0})
    times = [sample.time_s for k in range(1, 400) if (sample := inbox.put(0.1 * k, {"i": 1.0}))]
    waits = [b - a for a, b in pairwise(times)]
    assert max(waits) <= LONGEST_S + 0.11
    assert all(wait == pytest.approx(0.1) for a, wait in zip(times, waits, strict=False) if a > USUAL_S + LONGEST_S)
    assert inbox.put(40.0, {"v": 12.1}) is None  # the current still reports, and belongs to it
    assert inbox.put(40.05, {"i": 1.0}) == MeanSample(40.05, {"v": 12.1, "i": 1.0})


def test_what_is_no_number_was_not_measured():
    inbox = MeanInbox(("i", "v"))
    assert inbox.put(0.0, {"i": math.nan, "v": math.inf}) is None
    assert inbox.flush() is None
    inbox.put(0.0, {"i": 1.0, "v": math.nan})
    assert inbox.flush() == MeanSample(0.0, {"i": 1.0})
