import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.logs.order import find_restarts, merge_equal_times, sort_rows
from ohmward.logs.table import Table


def table(time_s, **columns):
    arrays = {"time": np.asarray(time_s, float), **{n: np.asarray(v, float) for n, v in columns.items()}}
    return Table("f.csv", arrays, np.arange(2, 2 + len(time_s)), "line")


def test_a_late_row_is_sorted_and_noted():
    time_s = np.arange(100.0)
    time_s[[40, 41]] = [41.0, 40.4]
    ordered = sort_rows(table(time_s, x=time_s), "time")
    np.testing.assert_array_equal(ordered.columns["x"], np.sort(time_s))
    assert [note.text for note in ordered.notes] == ["1 row out of order: sorted by time"]


def test_sorting_keeps_the_order_of_equal_times():
    """Of equal times the last row counts, so sorting must not exchange them."""
    time_s = np.repeat(np.arange(100.0), 20)
    time_s[[990, 991]] = [50.0, 49.5]
    merged = merge_equal_times(sort_rows(table(time_s, row=np.arange(2000.0)), "time"), "time")
    last = {time: row for row, time in enumerate(time_s)}
    np.testing.assert_array_equal(merged.columns["row"], [last[time] for time in sorted(last)])


def test_rows_in_order_are_left_alone():
    rows = table([0.0, 1.0, 1.0, 5.0])
    assert sort_rows(rows, "time") is rows


@pytest.mark.parametrize(
    ("time_s", "message"),
    [
        ([*range(50), *range(50)], r"f.csv holds several recordings: the time falls from 49 s to 0 s at line 52"),
        ([*range(50), *range(45, 95)], r"runs backwards at line 52 \(first from 49.000000 s to 45.000000 s; 4 of 100"),
        (
            [5, 4, 4, 3, 2, 0],
            r"f.csv: the time falls from line to line 4 times: the newest row stands first; .*--sort-time",
        ),
        ([3, 1, 4, 2, 0, 5], r"f.csv: the time falls from line to line 3 times: the rows are shuffled; .*--sort-time"),
        ([0, 2, 1, 4, 3, 6, 5], r"runs backwards at line 4, 6, 8 .*--sort-time \(sort_time=True\).*recording=1"),
    ],
)
def test_clocks_that_cannot_be_trusted_are_refused(time_s, message):
    with pytest.raises(InputError, match=message):
        sort_rows(table(time_s), "time")


def test_sorting_on_request():
    time_s = [*range(50), *range(45, 95)]
    ordered = sort_rows(table(time_s), "time", sort_time=True)
    np.testing.assert_array_equal(ordered.columns["time"], np.sort(time_s))
    assert ordered.notes[0].level == "warning"


def test_restarts_are_falls_beyond_lateness():
    np.testing.assert_array_equal(find_restarts(np.array([0.0, 1.0, 2.0, 1.5, 3.0, 0.0, 1.0])), [5])
    assert find_restarts(np.arange(3.0)).size == 0


def test_equal_times_keep_the_last_value_of_each_column():
    merged = merge_equal_times(
        table([0.0, 1.0, 1.0, 1.0, 2.0], a=[0, 1, 2, np.nan, 4], b=[np.nan, np.nan, 7, 8, np.nan]), "time"
    )
    np.testing.assert_array_equal(merged.columns["time"], [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(merged.columns["a"], [0.0, 2.0, 4.0])
    np.testing.assert_array_equal(merged.columns["b"], [np.nan, 8.0, np.nan])
    assert merged.notes[0].text.startswith("2 rows with the time of the row before")


@given(st.lists(st.integers(0, 5), min_size=1, max_size=30), st.data())
def test_merging_agrees_with_a_dictionary(times, data):
    times = sorted(times)
    values = data.draw(st.lists(st.just(np.nan) | st.floats(-1, 1), min_size=len(times), max_size=len(times)))
    expected: dict[int, float] = {}
    for time, value in zip(times, values, strict=True):
        if time not in expected or not np.isnan(value):
            expected[time] = value
    merged = merge_equal_times(table(times, x=values), "time")
    np.testing.assert_array_equal(merged.columns["time"], list(expected))
    np.testing.assert_array_equal(merged.columns["x"], list(expected.values()))
