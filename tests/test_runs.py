"""Runs of a condition: half-open, in order, at both ends too; windows of time; lines over missing values."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.runs import between, interpolated, repeats, runs, where_known, window_starts


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


def test_lines_lie_between_samples_that_are_near_and_nowhere_else():
    time_s = np.arange(0.0, 32.0)
    values = np.full(32, np.nan)
    values[[1, 6, 30]] = [1.0, 6.0, 30.0]
    nan = np.nan
    assert between(time_s, values)[[0, 3, 20, 31]] == pytest.approx([nan, 3.0, 20.0, nan], nan_ok=True)
    near = between(time_s, values, 10.0)
    assert np.flatnonzero(np.isfinite(near)).tolist() == [1, 2, 3, 4, 5, 6, 30]
    assert near[:7] == pytest.approx(np.r_[nan, 1.0:7.0], nan_ok=True)
    at_s = np.array([0.5, 1.0, 2.5, 6.0, 6.5, 30.0, 30.5])
    assert interpolated(at_s, time_s, values, 10.0) == pytest.approx([nan, 1, 2.5, 6, nan, 30, nan], nan_ok=True)
    assert np.isnan(interpolated(at_s, time_s, np.full(32, nan))).all()


def test_a_missing_value_repeats_nothing():
    values = np.array([1.0, 1.0, np.nan, np.nan, 2.0, 2.0, -0.0, 0.0])
    assert repeats(values).tolist() == [False, True, False, False, False, True, False, True]


def test_columns_without_gaps_are_not_copied():
    whole, holed = np.arange(4.0), np.array([0.0, np.nan, 2.0, np.inf])
    assert all(found is values for found, values in zip(where_known(whole, whole), (whole, whole), strict=True))
    assert [found.tolist() for found in where_known(whole, holed)] == [[0.0, 2.0], [0.0, 2.0]]
