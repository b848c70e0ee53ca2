import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.logs.selection import find_restarts, require_one_instance, settle_equal_times, sort_rows
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
    merged = settle_equal_times(sort_rows(table(time_s, row=np.arange(2000.0)), "time"), "time", ())
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
        (
            np.random.default_rng(3).permutation(np.arange(1000.0)),
            r"f.csv: the time falls from line to line 4\d\d times: the rows are shuffled; .*--sort-time",
        ),
        (
            np.random.default_rng(3).integers(20, 25, 1000),
            r"f.csv: the time falls from line to line 4\d\d times: it has 5 values in 1,000 rows; is 'time' the time\? "
            r"Name another with --column time=NAME, or .*--sample-time 1, else sort the rows with --sort-time",
        ),
        ([*range(100, 200), *range(100)], r"f.csv holds several recordings: .*--sort-time \(sort_time=True\)"),
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
    rows = table([0.0, 1.0, 1.0, 1.0, 2.0], a=[0, 1, 2, np.nan, 4], b=[np.nan, np.nan, 7, 8, np.nan])
    merged = settle_equal_times(rows, "time", ())
    np.testing.assert_array_equal(merged.columns["time"], [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(merged.columns["a"], [0.0, 2.0, 4.0])
    np.testing.assert_array_equal(merged.columns["b"], [np.nan, 8.0, np.nan])
    assert merged.notes[0].text.startswith("2 of 5 rows (40 %) with the time of the row before")


@given(st.lists(st.integers(0, 5), min_size=1, max_size=30), st.data())
def test_merging_agrees_with_a_dictionary(times, data):
    times = sorted(times)
    values = data.draw(st.lists(st.just(np.nan) | st.floats(-1, 1), min_size=len(times), max_size=len(times)))
    expected: dict[int, float] = {}
    for time, value in zip(times, values, strict=True):
        if time not in expected or not np.isnan(value):
            expected[time] = value
    merged = settle_equal_times(table(times, x=values), "time", ())
    np.testing.assert_array_equal(merged.columns["time"], list(expected))
    np.testing.assert_array_equal(merged.columns["x"], list(expected.values()))


def settled(stamps, values=None):
    """The settled table of rows of these stamps, every one a measurement of its own unless `values` says otherwise."""
    values = np.arange(len(stamps)) if values is None else values
    return settle_equal_times(table(stamps, x=values), "time", {"x"})


@pytest.mark.parametrize("interval_s", [0.1, 1.0, 5.0])
def test_rows_of_coarse_stamps_are_spread_evenly_and_none_is_lost(interval_s):
    """To the minute or the second, whatever the rate, from the middle of an interval to the middle of one."""
    true_s = np.arange(7 * interval_s, 200 * interval_s, interval_s)
    coarse = 12 * interval_s
    spread = settled(np.floor(true_s / coarse + 1e-9) * coarse)
    np.testing.assert_allclose(spread.columns["time"], true_s, atol=1e-6)
    assert spread.notes[0].level == "warning"
    assert "17 stamps" in spread.notes[0].text


def test_a_pause_between_coarse_stamps_is_not_filled():
    """Before a pause the rows stand at the start of their minute, after it at the end of theirs."""
    true_s = np.concatenate([np.arange(0.0, 625.0, 5.0), np.arange(1240.0, 1800.0, 5.0)])
    spread = settled(np.floor(true_s / 60.0) * 60.0)
    np.testing.assert_allclose(spread.columns["time"], true_s, atol=1e-9)


def test_spread_rows_stay_within_their_stamps_and_increase():
    """Rows at irregular times: each is at most one interval off."""
    true_s = np.cumsum(np.random.default_rng(1).uniform(2.0, 25.0, 400))
    stamps = np.floor(true_s / 60.0) * 60.0
    time_s = settled(stamps).columns["time"]
    assert (np.diff(time_s) > 0).all()
    np.testing.assert_array_equal(np.floor(time_s / 60.0) * 60.0, stamps)


def test_one_odd_stamp_does_not_squeeze_the_rows():
    stamps = np.repeat(np.arange(200.0) * 60.0, 12)
    time_s = settled(np.append(stamps, stamps[-1] + 1.0)).columns["time"]
    np.testing.assert_allclose(time_s[:-13], np.arange(2388) * 5.0)


def test_a_few_rows_measured_twice_are_dropped_with_a_warning():
    stamps = np.sort([*range(98), 40, 60])
    merged = settled(stamps)
    assert merged.line.size == 98
    assert merged.notes[0].level == "warning"
    assert merged.notes[0].text.startswith("2 of 100 rows (2 %) with the time of the row before")


def test_rows_written_twice_lose_nothing_and_are_merged():
    """The same values, or other channels of the same moment."""
    doubled = settled(np.repeat(np.arange(50.0), 2), np.repeat(np.arange(50.0), 2))
    assert (doubled.line.size, doubled.notes[0].level) == (50, "info")
    parts = table([0.0, 0.0, 1.0, 1.0], x=[1, np.nan, 2, np.nan], y=[np.nan, 3, np.nan, 4])
    merged = settle_equal_times(parts, "time", {"x", "y"})
    np.testing.assert_array_equal(merged.columns["y"], [3.0, 4.0])
    assert merged.notes[0].level == "info"


def instances(labels, shift_s=0.0, name="which", offset=5.0):
    """A row of each instance every second, its voltage `offset` above the one before it, `shift_s` after it."""
    count = len(labels)
    k = np.tile(np.arange(count), 30)
    time_s = np.repeat(np.arange(30.0), count) + shift_s * k
    rows = table(time_s, voltage=20.0 + offset * k + 0.01 * np.sin(time_s))
    return rows.with_columns({name: np.array(labels, object if isinstance(labels[0], str) else float)[k]})


@pytest.mark.parametrize("shift_s", [0.0, 0.03])
@pytest.mark.parametrize("labels", [(0, 1), (3, 1, 7), ("left", "right"), ("front pack", "b", "c")])
def test_batteries_side_by_side_are_refused_with_the_choice(labels, shift_s):
    with pytest.raises(InputError, match="they differ in 'which'") as error:
        require_one_instance(instances(labels, shift_s), "time", {"voltage"})
    assert all(f"which={label}" in str(error.value) for label in labels)


@pytest.mark.parametrize("shift_s", [0.0, 0.03])
def test_batteries_that_read_alike_are_told_by_the_name_of_the_column(shift_s):
    alike = instances((0, 1), shift_s, "Battery ID", offset=0.0)
    with pytest.raises(InputError, match="'Battery ID=0' or --where 'Battery ID=1'"):
        require_one_instance(alike, "time", {"voltage"})
    require_one_instance(instances((0, 1), shift_s, "heartbeat", offset=0.0), "time", {"voltage"})


def test_named_batteries_under_coarse_stamps_are_refused_with_the_choice():
    rows = instances(("left", "right"), name="battery")
    coarse = rows.with_columns({"time": rows.columns["time"] // 10 * 10})
    with pytest.raises(InputError, match="battery=left or --where battery=right"):
        require_one_instance(coarse, "time", {"voltage"})


@pytest.mark.parametrize("count", [2, 3])
def test_batteries_that_no_column_tells_apart_are_refused(count):
    rows = instances(tuple(range(count)))
    del rows.columns["which"]
    with pytest.raises(InputError, match=f"{count} rows stand at each time and differ as those of {count} batteries"):
        require_one_instance(rows, "time", {"voltage"})


@pytest.mark.parametrize("count", [2, 5])
def test_rows_of_one_battery_under_coarse_stamps_are_no_instances(count):
    k = np.arange(60.0 * count)
    require_one_instance(table(k // count, voltage=20.0 + np.sin(k) + 0.1 * k), "time", {"voltage"})


def test_a_battery_that_is_logged_rarely_is_found():
    rows = instances(("main", "aux"))
    rare = (rows.columns["which"] == "main") | (np.arange(60) % 20 == 1)
    with pytest.raises(InputError, match="which=main or --where which=aux"):
        require_one_instance(rows.pick(rare), "time", {"voltage"})


def test_steps_that_end_where_the_next_begins_are_no_instances():
    """The last row of a step of a cycler and the first of the next share their time."""
    step = np.repeat(np.arange(6.0), 10)
    time_s = np.arange(60.0) - step
    rows = table(time_s, current=step, step=step)
    require_one_instance(rows, "time", {"current"})
    assert settle_equal_times(rows, "time", {"current"}).line.size == 55


def test_seconds_beside_stamps_to_the_minute_are_no_instances():
    seconds = np.tile([0.0, 30.0], 40)
    rows = table(np.repeat(np.arange(40.0) * 60.0, 2), current=np.where(seconds > 0, 5.0, 0.0), second=seconds)
    require_one_instance(rows, "time", {"current"})
