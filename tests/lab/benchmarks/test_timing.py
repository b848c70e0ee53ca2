"""Words and verdicts of the speed page."""

import math
from functools import partial
from itertools import groupby

import pytest

from scripts import script

timing = script("timing")


@pytest.mark.parametrize(
    "seconds, words",
    [(1.5, "1.5 s"), (0.0123, "12.3 ms"), (4.56e-6, "4.56 us"), (1.2345e-7, "123 ns"), (0.0, "0 ns"), (math.nan, "")],
)
def test_a_duration_has_three_digits(seconds, words):
    assert timing.duration(seconds) == words


def test_the_spread_is_in_the_unit_of_the_median():
    assert timing.spread(timing.Times(1.1e-6, 0.95e-6, 2.4e-6)) == "0.95 to 2.4 us"


def test_goals_are_met_at_their_bar_and_missed_beyond():
    goals = [
        timing.Goal("a step", 130e-9, 130e-9),
        timing.Goal("a step", 131e-9, 130e-9),
        timing.Goal("faster", 599.0, 600.0, "x", most=False),
        timing.Goal("of the peak", 0.55, 0.55, "%", most=False),
        timing.Goal("memory", 2.5, 2.0, "GB"),
    ]
    assert timing.goal_rows(goals) == [
        ("a step", "130 ns", "at most 130 ns", "met"),
        ("a step", "131 ns", "at most 130 ns", "**missed**"),
        ("faster", "599 x", "at least 600 x", "**missed**"),
        ("of the peak", "55%", "at least 55%", "met"),
        ("memory", "2.5 GB", "at most 2 GB", "**missed**"),
    ]


def test_calls_are_measured_in_turns_after_one_each():
    called: list[str] = []
    runs = {name: partial(called.append, name) for name in "ab"}
    times = timing.measure(runs, 3)
    assert set(times) == {"a", "b"} and all(t.least <= t.median <= t.most for t in times.values())
    assert "".join(key for key, _ in groupby(called)) == "ab" * 4
