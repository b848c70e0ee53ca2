"""Rates by due times: all that is asked for comes, on average, and what is late is not due again."""

import numpy as np
import pytest

from ohmward.onboard.feed import Rate


def passed(times_s, interval_s):
    rate = Rate(interval_s)
    return [time_s for time_s in times_s if rate.passes(time_s)]


@pytest.mark.parametrize(
    ("hertz", "interval_s", "expected_hertz"),
    [(30.0, 0.02, 30.0), (50.0, 0.02, 50.0), (80.0, 0.02, 48.0), (100.0, 0.02, 50.0), (1000.0, 0.02, 50.0)],
)
@pytest.mark.parametrize("jitter_s", [0.0, 0.002])
def test_the_rate_is_that_of_the_times_up_to_the_limit(hertz, interval_s, expected_hertz, jitter_s):
    count = int(20.0 * hertz)
    jitter = jitter_s * np.random.default_rng(1).uniform(-0.5, 0.5, count)
    times = np.sort(np.arange(count) / hertz + jitter)
    assert len(passed(times, interval_s)) / 20.0 == pytest.approx(expected_hertz, rel=0.05)


def test_times_that_alternate_with_older_ones_do_not_raise_the_rate():
    """Those of a second sensor, whose clock is 0.3 s behind."""
    times = [t for k in range(500) for t in (0.02 * k, 0.02 * k - 0.3)]
    assert len(passed(times, 0.5)) == pytest.approx(20, abs=1)


def test_after_a_silence_and_after_a_clock_was_set_it_goes_on_at_once():
    assert passed([0.0, 0.2, 1.0, 61.0, 61.2, 5.0, 5.2], 1.0) == [0.0, 1.0, 61.0, 5.0]
