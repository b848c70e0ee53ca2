import time
from datetime import UTC, datetime

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs.clock import read_clock
from ohmward.logs.columns import Column
from ohmward.logs.dates import format_of
from ohmward.logs.table import Table
from ohmward.logs.units import UNITS

START = 1_490_425_206.5  # 2017-03-25T07:00:06.5Z


def clock(values, unit=None, name="time", **others):
    columns = {name: np.asarray(values), **{n: np.asarray(v) for n, v in others.items()}}
    table = Table("f.csv", columns, np.arange(2, 2 + len(columns[name])), "line")
    return read_clock(table, Column(name, UNITS[unit] if unit else None))


def text(*cells):
    return np.array(cells, dtype=object)


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        ([START, START + 1.5], None),
        ([START * 1e3, START * 1e3 + 1500], None),
        ([START * 1e6, START * 1e6 + 1.5e6], None),
        (np.array([1_490_425_206_500_000_000, 1_490_425_208_000_000_000]), None),
        (np.array([1_490_425_206_500_000_000, 1_490_425_208_000_000_000]), "ns"),
        (text("2017-03-25T07:00:06.5Z", "2017-03-25T07:00:08Z"), None),
        (text("2017-03-25 07:00:06.500", "2017-03-25 07:00:08.000"), None),
        (text("2017-03-25T09:00:06.5+02:00", "2017-03-25T09:00:08+02:00"), None),
        (np.array(["2017-03-25T07:00:06.5", "2017-03-25T07:00:08"], dtype="M8[ns]"), None),
    ],
)
def test_wall_clocks_start_at_zero_and_remember_when(values, unit):
    read = clock(values, unit)
    np.testing.assert_allclose(read.time_s, [0.0, 1.5], atol=1e-6)
    assert read.start_unix_s == pytest.approx(START, abs=1e-6)


def test_dates_without_a_zone_are_utc_wherever_the_computer_stands(monkeypatch):
    monkeypatch.setenv("TZ", "America/Bogota")
    time.tzset()
    try:
        assert clock(text("2017-03-25 07:00:06.500")).start_unix_s == START
    finally:
        monkeypatch.undo()
        time.tzset()


def test_nanoseconds_keep_their_digits():
    start = 1_700_000_000_000_000_000
    np.testing.assert_allclose(clock(np.array([start, start + 1])).time_s, [0.0, 1e-9], rtol=1e-12)


def test_ros_seconds_and_nanoseconds_are_added():
    read = clock([1_490_425_206, 1_490_425_208], "s", "stamp.sec", **{"stamp.nanosec": [500_000_000, 0]})
    np.testing.assert_allclose(read.time_s, [0.0, 1.5], rtol=1e-12)


@pytest.mark.parametrize(
    ("values", "unit", "time_s"),
    [
        ([5.0, 6.0], "s", [5.0, 6.0]),
        ([5.0, 6.0], None, [5.0, 6.0]),
        ([0.0, 250.0], "ms", [0.0, 0.25]),
        ([1.0, 1.5], "h", [3600.0, 5400.0]),
        (text("0:00:01.5", "27:00:00"), None, [1.5, 97200.0]),
    ],
)
def test_elapsed_times_keep_their_zero(values, unit, time_s):
    read = clock(values, unit)
    np.testing.assert_allclose(read.time_s, time_s, rtol=1e-15)
    assert read.start_unix_s is None


def test_assumptions_are_noted():
    assert "names no unit: assumed to be seconds" in clock([0.0, 1.0]).notes[0].text
    assert "UTC assumed" in clock(text("2017-03-25 07:00:06", "2017-03-25 07:00:07")).notes[0].text
    assert "Unix time in ms" in clock([START * 1e3]).notes[0].text
    assert "UTC" not in clock(text("2017-03-25T07:00:06Z")).notes[0].text


@pytest.mark.parametrize("begin_s", [-1e25, -2e9, 1e25])
def test_a_jump_from_no_date_is_that_of_no_clock_which_was_set(begin_s):
    table = Table("f.csv", {"time": np.array([begin_s, begin_s, 1.77e9, 1.77e9 + 1])}, np.arange(4), "row")
    assert not [note for note in read_clock(table, Column("time", None)).notes if "the clock jumps" in note.text]


def test_missing_times_are_nan():
    np.testing.assert_array_equal(clock(text("", "2017-03-25", "")).time_s, [np.nan, 0.0, np.nan])
    np.testing.assert_array_equal(clock(np.array(["NaT", "2017-03-25"], dtype="M8[ns]")).time_s, [np.nan, 0.0])


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (
            ("2017-03-25", "yesterday"),
            r"f.csv, line 3, column 'time': 'yesterday' is not a time like '2017-03-25'; write seconds or ISO",
        ),
        (("25.13.2017",), r"line 2, column 'time': '25.13.2017' is not a time"),
        (("2017-03-25", "12.5"), r"line 3, column 'time': '12.5' is not a time like '2017-03-25'"),
        (("0:00:01", "half past"), r"line 3.*'half past' is not a time"),
        (("0", "1", "x"), r"line 4, column 'time': 'x' is not a number"),
    ],
)
def test_unreadable_times_are_named(cells, message):
    with pytest.raises(InputError, match=message):
        clock(text(*cells))


@pytest.mark.parametrize("epoch", ["1970-01-01T00:00:20", "1980-01-06T00:00:07", "2000-01-01T12:00:00"])
@pytest.mark.parametrize("unit", ["dates", "s", "ms"])
def test_a_clock_that_was_set_after_the_start_is_joined(epoch, unit):
    scale = {"dates": 1.0, "s": 1.0, "ms": 1e3}[unit]
    begin = (np.datetime64(epoch, "s") - np.datetime64(0, "s")) / np.timedelta64(1, "s")
    seconds = np.concatenate([begin + 5.0 * np.arange(30), START - 0.5 + 5.0 * np.arange(100)])
    values = seconds.astype("M8[s]") if unit == "dates" else scale * seconds
    read = clock(values)
    np.testing.assert_allclose(np.diff(read.time_s), 5.0, atol=1e-6)
    assert read.start_unix_s + read.time_s[30] == pytest.approx(START - 0.5)
    assert [note.level for note in read.notes if "set after the start" in note.text] == ["warning"]


@pytest.mark.parametrize("cells", [("1970-01-02T00:00:20", "1970-01-02T00:00:30"), ("1999-12-31", "2000-01-01")])
def test_the_date_of_a_clock_that_was_never_set_is_left_out(cells):
    read = clock(text(*cells))
    assert read.start_unix_s is None and "the date is left out" in read.notes[-1].text
    np.testing.assert_array_equal(read.time_s, np.array(cells, dtype="M8[s]").astype(float))


@pytest.mark.parametrize("seconds", [[START - 1e8, START - 1e8 + 5.0, START, START + 5.0], [0.0, 5.0, 4e7, 4e7 + 5.0]])
def test_a_pause_of_years_is_no_clock_that_was_set(seconds):
    assert np.diff(clock(np.array(seconds)).time_s).max() > 3e7


def test_minutes_and_seconds_are_told_from_hours_and_minutes_by_what_no_day_has():
    np.testing.assert_array_equal(clock(text("00:00", "00:30", "25:00")).time_s, [0.0, 30.0, 1500.0])
    np.testing.assert_array_equal(clock(text("14:03", "14:04", "14:06")).time_s, 60.0 * np.array([843, 844, 846]))
    with pytest.raises(InputError, match=r"minutes and seconds\? say --time-format '%H:%M' or --time-format '%M:%S'"):
        clock(text("00:00", "00:01", "00:02"))


def test_days_alone_are_no_time_of_several_rows():
    with pytest.raises(InputError, match="'Date' names the day alone"):
        clock(text("2026-05-21", "2026-05-21"), name="Date")
    for unit in ("M8[D]", "M8[ns]"):
        with pytest.raises(InputError, match="'Date' names the day alone"):
            clock(np.array(["2026-05-21", "2026-05-21"], unit), name="Date")
    np.testing.assert_array_equal(clock(np.array(["2026-05-21", "2026-05-22"], "M8[ns]")).time_s, [0.0, 86400.0])
    np.testing.assert_array_equal(clock(text("2026-05-21", "2026-05-22"), name="Date").time_s, [0.0, 86400.0])


@pytest.mark.parametrize(
    ("cell", "written"),
    [
        ("10.03.2026 08:00:00", "%d.%m.%Y %H:%M:%S"),
        ("3/4/26 8:05", "%d/%m/%y %H:%M"),
        ("2026-03-10 08:00:00.25", "%Y-%m-%d %H:%M:%S.%f"),
        ("03/11/2026 08:30:00:250", "%d/%m/%Y %H:%M:%S:%f"),
        ("noon", "%d.%m.%Y %H:%M:%S"),
    ],
)
def test_advice_on_a_date_is_in_its_own_notation(cell, written):
    assert format_of(cell) == written


def test_a_date_that_may_be_read_in_two_ways_comes_with_a_format_that_works():
    (note,) = clock(text("10/03/2026 08:00:00", "10/03/2026 08:00:01")).notes
    assert "--time-format '%d/%m/%Y %H:%M:%S'" in str(note)


@pytest.mark.parametrize("cell", ["10.03.2026 08:00:00", "10.03.26 08:00", "10.3.2026 08.00.00"])
def test_between_points_the_day_is_first(cell):
    assert clock(text(cell, cell)).start_unix_s == datetime(2026, 3, 10, 8, tzinfo=UTC).timestamp()


def test_a_date_without_a_year_is_left_out_and_named():
    read = clock(text("Mar 28 09:15:00", "Mar 28 09:15:02"))
    assert read.start_unix_s is None
    assert "Mar 28 09:15:00 names no year, so the date is left out" in str(read.notes)


@pytest.mark.parametrize(
    ("cell", "utc"),
    [
        ("2026-03-28 10:15:00 CET", "2026-03-28T09:15:00"),
        ("2026-03-28 11:15:00 CEST", "2026-03-28T09:15:00"),
        ("03/28/2026 02:15 PM PDT", "2026-03-28T21:15:00"),
        ("2026-03-28 18:45:00 +9:30", "2026-03-28T09:15:00"),
        ("2026-03-28 05:45:00 -0330 NDT", "2026-03-28T09:15:00"),
    ],
)
def test_a_zone_behind_the_time_is_subtracted(cell, utc):
    assert clock(text(cell)).start_unix_s == np.datetime64(utc).astype(int)


def test_a_zone_that_may_be_one_of_several_is_asked_for():
    with pytest.raises(InputError, match="'IST', which may be one of several; say which with --timezone"):
        clock(text("2026-03-28 14:45:00 IST"))


@pytest.mark.parametrize(
    ("counts", "unit", "step"),
    [(2**32, "ms", 100), (2**32, "us", 20_000), (2**32 / 1e6, "s", 0.02), (2**32 / 1e3, None, 1.0), (2**16, "s", 1)],
)
def test_a_counter_that_begins_again_at_the_end_of_its_range_goes_on(counts, unit, step):
    times = counts - 10 * step + step * np.arange(50)
    read = clock(times % counts, unit)
    np.testing.assert_allclose(np.diff(read.time_s), step * UNITS[unit or "s"].scale, rtol=1e-6)
    assert ["a counter that begins again after" in note.text for note in read.notes][-1]


@pytest.mark.parametrize("last", [4_290_000_000, 4_294_967_295 - 5_000, 70_000])
def test_a_logger_that_was_restarted_is_no_counter_at_the_end_of_its_range(last):
    times = np.concatenate([last - 1000 * np.arange(50)[::-1], 1000 * np.arange(50)])
    assert clock(times, "ms").time_s[50] == 0.0


def test_times_of_day_go_over_midnight_beside_an_empty_cell():
    found = clock(text("23:59:58", "", "23:59:59", "00:00:01"))
    np.testing.assert_array_equal(found.time_s, [86398.0, np.nan, 86399.0, 86401.0])
