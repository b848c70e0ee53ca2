"""Runs of a condition: half-open, in order, at both ends too."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.runs import runs


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
