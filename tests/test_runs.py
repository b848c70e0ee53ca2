"""Runs of a condition: half-open, in order, at both ends too; windows of time."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.runs import runs, window_starts


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ([], []),
        ([False, False], []),
        ([True], [(0, 1)]),
        ([True, True, False, True], [(0, 2), (3, 4)]),
        ([False, True, False], [(1, 2)]),
    ],
)
def test_runs_are_half_open(condition, expected):
    assert runs(np.array(condition, dtype=bool)) == expected


@given(st.lists(st.booleans(), max_size=30))
def test_runs_cover_what_is_true_and_do_not_touch(condition):
    found = runs(np.array(condition, dtype=bool))
    covered = np.zeros(len(condition), dtype=bool)
    for first, stop in found:
        assert all(condition[first:stop]) and stop > first
        covered[first:stop] = True
    assert covered.tolist() == condition
    assert all(stop < first for (_, stop), (first, _) in pairwise(found))


@given(
    st.lists(st.sampled_from((0.0, 0.5, 1.0, 3.0, 10.0)), min_size=1, max_size=30),
    st.sampled_from((-2.0, 0.0, 0.5)),
    st.sampled_from((1.0, 4.0)),
)
def test_windows_start_where_the_number_of_the_window_changes(steps_s, earlier_s, window_s):
    time_s = 7.0 + np.cumsum(steps_s)
    begin_s = time_s[0] - abs(earlier_s)
    number = (time_s - begin_s) // window_s
    expected = np.flatnonzero(np.diff(number, prepend=-np.inf))
    np.testing.assert_array_equal(window_starts(time_s, window_s, begin_s), expected)
