"""DataFrames of pandas as logs, and logs as DataFrames."""

import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ohmward.errors import InputError, OhmwardError
from ohmward.logs import DriveLog, Log, read_drive, read_log, write_log
from ohmward.logs.frame import open_frame, plain_array
from ohmward.logs.log import as_logs

pd = pytest.importorskip("pandas")

FOUR = ("front_left", "front_right", "rear_left", "rear_right")
NEW_YEAR = datetime(2026, 1, 1, tzinfo=UTC)
START = 1_490_425_206.5  # 2017-03-25T07:00:06.5Z


@pytest.fixture
def frame(pulses):
    time_s, current_A, voltage_V = pulses
    return pd.DataFrame({"time_s": time_s, "current_A": current_A, "voltage_V": voltage_V})


def texts(log):
    return " | ".join(str(note) for note in log.notes)


def times_of(index, frame):
    log = read_log(frame.drop(columns="time_s").set_index(index))
    return log.time_s, log.start_unix_s


def test_a_frame_and_the_file_of_it_make_the_same_log(frame, tmp_path):
    frame["temperature_K"] = 298.15
    frame["mode"] = "drive"
    frame["on"] = True
    frame.to_csv(tmp_path / "log.csv", index=False)
    log, of_file = read_log(frame), read_log(tmp_path / "log.csv")
    for name in ("time_s", "current_A", "voltage_V", "temperature_degC"):
        np.testing.assert_array_equal(getattr(log, name), getattr(of_file, name))
    assert texts(log).replace("text columns left out: 'mode'", "text columns left out: 'mode', 'on'") == texts(of_file)
    np.testing.assert_array_equal(log.extra["on"], 1.0)
    np.testing.assert_array_equal(Log.from_pandas(frame).current_A, of_file.current_A)


@pytest.mark.parametrize("resolution", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
def test_an_index_of_dates_of_any_resolution_and_zone_is_the_time(frame, resolution, zone):
    start = pd.Timestamp(START, unit="s").floor("s" if resolution == "s" else "ms")
    index = pd.date_range(start, periods=600, freq="1s", unit=resolution).tz_localize("UTC")
    index = index.tz_localize(None) if zone is None else index.tz_convert(zone)
    time_s, start_unix_s = times_of(index, frame)
    np.testing.assert_allclose(time_s, np.arange(600.0), atol=1e-9)
    assert start_unix_s == pytest.approx(START, abs=0.5 if resolution == "s" else 1e-6)


@pytest.mark.parametrize("made", [pd.DatetimeIndex, pd.Series, list])
@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_dates_given_to_a_log_are_not_taken_for_seconds(made, zone):
    dates = made(pd.date_range("2026-01-31 12:00", periods=3, freq="1s").tz_localize("UTC").tz_convert(zone))
    log = Log("x", dates, np.ones(3), np.full(3, 12.0))
    np.testing.assert_allclose(log.time_s, [0.0, 1.0, 2.0])
    assert log.start_unix_s == datetime(2026, 1, 31, 12, tzinfo=UTC).timestamp()
    assert DriveLog("x", dates, np.zeros((3, 2)), np.zeros((3, 2))).duration_s == pytest.approx(2.0)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_an_index_of_durations_keeps_its_zero(frame, unit):
    time_s, start_unix_s = times_of(pd.to_timedelta(np.arange(3.0, 603.0), unit="s").as_unit(unit), frame)
    np.testing.assert_array_equal(time_s, np.arange(3.0, 603.0))
    assert start_unix_s is None


@pytest.mark.parametrize("name", [None, "time_s", "t", "elapsed"])
def test_an_index_of_seconds_is_the_time(frame, name):
    np.testing.assert_array_equal(times_of(pd.Index(np.arange(600.0), name=name), frame)[0], np.arange(600.0))


def test_an_index_in_another_unit_says_so_by_its_name(frame):
    np.testing.assert_allclose(times_of(pd.Index(range(600), name="t_ms"), frame)[0], np.arange(600) / 1000)


def test_the_index_that_counts_the_rows_is_no_column(frame):
    part = frame[frame["time_s"] >= 100.0]
    assert list(read_log(part).extra) == []
    np.testing.assert_array_equal(read_log(part).time_s, np.arange(100.0, 600.0))


def test_the_index_yields_to_the_column_that_is_named(frame):
    log = read_log(frame.set_index(pd.date_range("2026-01-31", periods=600, freq="1h")), columns={"time": "time_s"})
    np.testing.assert_array_equal(log.time_s, np.arange(600.0))


@pytest.mark.parametrize(
    "column",
    [
        lambda s: pd.Series(pd.date_range("2017-03-25 07:00:06.5", periods=600, freq="1s", tz="Asia/Tokyo")),
        lambda s: pd.Series([NEW_YEAR + timedelta(seconds=k) for k in range(600)], dtype=object),
        lambda s: pd.Series([timedelta(seconds=k) for k in range(600)]),
        lambda s: pd.Series([f"2026-01-31T00:{k // 60:02d}:{k % 60:02d}Z" for k in range(600)]),
        lambda s: pd.array(range(600), dtype="Int64"),
        lambda s: s.astype("float64[pyarrow]"),
    ],
    ids=["zone", "datetimes", "timedeltas", "text", "Int64", "pyarrow"],
)  # fmt: skip
def test_a_column_of_times_of_any_type(frame, column):
    log = read_log(frame.drop(columns="time_s").assign(time=column(frame["time_s"])))
    np.testing.assert_allclose(log.time_s, np.arange(600.0), rtol=1e-15)


def test_none_nan_and_na_are_missing(frame):
    frame = frame.astype({"current_A": "Float64", "voltage_V": object})
    frame.loc[3, "current_A"] = pd.NA
    frame.loc[4, "voltage_V"] = None
    frame.loc[5, "voltage_V"] = np.nan
    log = read_log(frame)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(log.current_A)), [3])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(log.voltage_V)), [4, 5])


def test_columns_units_rows_and_extras_are_chosen_as_in_a_file(frame):
    frame = pd.concat([frame.assign(run=k, other=k) for k in (1, 2)], ignore_index=True)
    frame = frame.rename(columns={"current_A": "I_motor"})
    chosen: dict[str, Any] = {
        "columns": {"current": "I_motor"},
        "units": {"current": "mA"},
        "where": {"run": 2},
        "extra": ["other"],
    }
    log = read_log(frame, **chosen)
    np.testing.assert_array_equal(log.extra["other"], 2.0)
    assert len(log) == 600 and "rows with run = 2: 600 of 1200" in texts(log)
    with pytest.raises(InputError, match=r"'run' \(1, 2\)"):
        read_log(frame, columns={"current": "I_motor"})


def test_a_log_goes_to_pandas_and_comes_back(pulses, tmp_path):
    time_s, current_A, voltage_V = pulses
    log = Log("robot", time_s, current_A, voltage_V, 20 + 0 * time_s, {"soc": time_s / 600}, start_unix_s=1.7e9)
    frame = log.to_pandas()
    assert frame.index.name == "time_s"
    assert list(frame) == ["current_A", "voltage_V", "temperature_degC", "unix_time_s", "soc"]
    again = Log.from_pandas(frame)
    write_log(log, tmp_path / "robot.csv")
    for copy in (again, read_log(tmp_path / "robot.csv")):
        for name in ("time_s", "current_A", "voltage_V", "temperature_degC"):
            np.testing.assert_array_equal(getattr(copy, name), getattr(log, name))
        np.testing.assert_array_equal(copy.extra["soc"], log.extra["soc"])
        assert (copy.name, copy.start_unix_s) == ("robot", 1.7e9)


def test_a_drive_goes_to_pandas_and_comes_back():
    time_s = np.arange(5) * 0.1
    speed = np.outer(np.arange(1.0, 6.0), [1, 2, 3, 4])
    log = DriveLog("d", time_s, speed, speed[:, :2], pitch_rad=0 * time_s, extra={"speed_true_m_s": time_s})
    for places in (FOUR, None):
        copy = DriveLog.from_pandas(log.to_pandas(places), FOUR, 2)
        for name in ("time_s", "wheel_speed_rad_s", "motor_current_A", "pitch_rad"):
            np.testing.assert_array_equal(getattr(copy, name), getattr(log, name))
        assert list(copy.extra) == ["speed_true_m_s"]
    with pytest.raises(InputError, match="places must name the 4 wheels of the log, got 2"):
        log.to_pandas(FOUR[:2])


def test_a_drive_with_dates_and_the_wheels_of_a_robot():
    index = pd.date_range("2026-01-31", periods=3, freq="20ms", tz="UTC")
    frame = pd.DataFrame({"v_l": [1.0, 2.0, None], "v_r": [1.0, pd.NA, 3.0]}, index=index)
    robot = SimpleNamespace(
        places=[SimpleNamespace(name="left"), SimpleNamespace(name="right")],
        driven=2,
        wheel=SimpleNamespace(radius_m=0.5),
        motor=SimpleNamespace(gear_ratio=16.0),
    )
    log = read_drive(frame, robot)
    np.testing.assert_allclose(log.time_s, [0.0, 0.02, 0.04])
    np.testing.assert_array_equal(log.wheel_speed_rad_s, [[2.0, 2.0], [4.0, np.nan], [np.nan, 6.0]])
    np.testing.assert_array_equal(read_drive(frame, robot, radius_m=1.0).wheel_speed_rad_s[0], 1.0)


@pytest.mark.parametrize(
    ("robot", "driven"), [(FOUR, None), (FOUR, 5), ("left", 1), (None, 2), (4, 2)]
)  # fmt: skip
def test_wheels_that_are_not_told_are_asked_for(robot, driven):
    with pytest.raises(InputError, match=r"needs a Robot, .*or the names of its wheels, driven ones first.*driven="):
        read_drive(pd.DataFrame({"t": [0.0], "wl": [1.0]}), robot, driven)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.iloc[:0], "no rows"),
        (lambda f: f.rename(columns={"voltage_V": "current_A"}), "more than one column is named 'current_A'"),
        (lambda f: f.set_index(["time_s", "current_A"]), r"several levels .*reset_index\(\)"),
        (lambda f: f.assign(voltage_V="high"), "DataFrame, row 1, column 'voltage_V': 'high' is not a number"),
        (lambda f: f.drop(columns="voltage_V"), "DataFrame: no column for the voltage found; .* record both"),
        (lambda f: f.iloc[::-1], "newest row stands first"),
    ],
)
def test_frames_that_are_no_log_are_refused(frame, change, message):
    with pytest.raises(InputError, match=message):
        read_log(change(frame))


@pytest.mark.parametrize("source", [None, 7, [1.0], np.zeros(3), object()])
@pytest.mark.parametrize("read", [read_log, lambda source: read_drive(source, FOUR, 2)])
def test_what_is_neither_a_path_nor_a_frame_is_refused(source, read):
    with pytest.raises(
        InputError, match=rf"must be the path .* a DataFrame, or a dict of columns, not .*{type(source).__name__}"
    ):
        read(source)


@pytest.mark.parametrize(
    "as_columns",
    [
        lambda f: {name: f[name].to_numpy() for name in f},
        lambda f: {name: f[name].tolist() for name in f},
        lambda f: f.to_records(index=False),
    ],
)
def test_a_dict_of_arrays_and_an_array_with_named_fields_are_read_as_a_frame_is(frame, as_columns):
    log, of_frame = read_log(as_columns(frame)), read_log(frame)
    for name in ("time_s", "current_A", "voltage_V"):
        np.testing.assert_array_equal(getattr(log, name), getattr(of_frame, name))


@pytest.mark.parametrize(("current_A", "shape"), [([1.0], r"\(1,\)"), (2 * [[1.0, 2.0]], r"\(2, 2\)"), (1.0, r"\(\)")])
def test_columns_of_several_lengths_are_refused(current_A, shape):
    columns = {"time_s": [0.0, 1.0], "current_A": current_A, "voltage_V": [3.0, 3.1]}
    with pytest.raises(InputError, match=rf"one dimension and one length; they have: .*'current_A' {shape}"):
        read_log(columns)


def test_a_series_is_refused(frame):
    with pytest.raises(InputError, match="a DataFrame, or a dict of columns, not"):
        read_log(frame["current_A"])


def test_reading_a_file_and_making_a_log_do_not_import_pandas(tmp_path):
    path = str(tmp_path / "x.csv")
    program = (
        "import sys, numpy as np; from ohmward.logs import Log, read_log, write_log\n"
        f"t = np.arange(9.0); write_log(Log('x', t, 0 * t, 12 + 0 * t), {path!r}); read_log({path!r})\n"
        "print('pandas' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_without_pandas_the_error_names_it(pulses, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(OhmwardError, match="pip install pandas"):
        Log("x", *pulses).to_pandas()


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1, None, 3.5], [1.0, np.nan, 3.5]),
        (pd.Series([1, None], dtype="Int64"), [1.0, np.nan]),
        (pd.Series([True, False]), [1.0, 0.0]),
        (pd.array([1.5, pd.NA], dtype="Float64"), [1.5, np.nan]),
        ([[1, None], [2, 3]], [[1.0, np.nan], [2.0, 3.0]]),
        ([pd.Timestamp("2026-01-31T12:00", tz="Europe/Berlin"), pd.NaT], np.array(["2026-01-31T11:00", "NaT"], "M8")),
        (pd.Series(["a", None, pd.NA]), ["a", "", ""]),
        (pd.Categorical(["a", "b"]), ["a", "b"]),
    ],
)  # fmt: skip
def test_values_of_any_kind_become_plain_arrays(values, expected):
    np.testing.assert_array_equal(plain_array(values), np.asarray(expected))


def _arrow(frame):
    return pytest.importorskip("pyarrow").Table.from_pandas(frame)


def _polars(frame):
    return pytest.importorskip("polars").from_pandas(frame)


def _duckdb(frame):
    duckdb = pytest.importorskip("duckdb")
    return duckdb.connect().from_arrow(pytest.importorskip("pyarrow").Table.from_pandas(frame))


KINDS: dict[str, Callable[[Any], Any]] = {
    "Arrow": _arrow,
    "Arrow, chunks": lambda frame: pytest.importorskip("pyarrow").concat_tables(
        [_arrow(frame[k : k + 100]) for k in range(0, len(frame), 100)]
    ),
    "polars": _polars,
    "polars, lazy": lambda frame: _polars(frame).lazy(),
    "DuckDB": _duckdb,
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_frame_of_others_than_pandas_makes_the_same_log(kind, frame):
    """With dates of a time zone, missing values, a text and whole numbers among its columns."""
    frame["current_A"] = frame["current_A"].where(frame.index % 50 != 7)
    frame["count"] = np.arange(len(frame))
    frame["mode"] = "drive"
    frame["when"] = pd.date_range("2026-03-28 09:15", periods=len(frame), freq="1s", tz="Europe/Berlin")
    columns = {"time": "when"}
    log, same = (read_log(source, columns=columns) for source in (KINDS[kind](frame), frame))
    for name, values in same.measured().items():
        np.testing.assert_array_equal(log.measured()[name], values)
    np.testing.assert_array_equal(log.extra["count"], same.extra["count"])
    assert (log.start_unix_s, list(log.extra)) == (same.start_unix_s, list(same.extra))


@pytest.mark.parametrize("kind", ["Arrow", "polars", "DuckDB"])
def test_a_drive_in_a_frame_of_others_than_pandas(kind, frame):
    wheels = pd.DataFrame({"time_s": frame["time_s"], "wl_rad_s": 1.0, "wr_rad_s": 2.0})
    log = read_drive(KINDS[kind](wheels), ("left", "right"), 2)
    np.testing.assert_array_equal(log.wheel_speed_rad_s[0], [1.0, 2.0])


def test_a_frame_of_others_than_pandas_without_rows_or_with_a_name_twice_is_refused(frame):
    arrow = pytest.importorskip("pyarrow")
    with pytest.raises(InputError, match="has no rows"):
        read_log(KINDS["Arrow"](frame[:0]))
    with pytest.raises(InputError, match="more than one column is named 'a'"):
        read_log(arrow.table([[1.0], [2.0]], names=["a", "a"]))


@pytest.mark.parametrize("kind", ["float16", "float32"])
def test_a_time_in_short_floats_is_read(frame, kind):
    """Those of 16 bits end at 65,504: no Unix time fits."""
    short = frame.iloc[:60].astype({"time_s": kind}).rename(columns={"time_s": "time"})
    log = read_log(short, current_sign="charge")
    np.testing.assert_array_equal(log.time_s, frame["time_s"][:60])


def test_several_frames_are_told_apart_by_their_names():
    rows = {"time_s": np.arange(9.0), "current_A": -np.arange(9.0), "voltage_V": 12.0 - 0.1 * np.arange(9.0)}
    frames = [pd.DataFrame(rows) for _ in range(3)]
    frames[1].attrs["name"] = "morning"
    assert [log.name for log in as_logs(frames)] == ["DataFrame 1", "morning", "DataFrame 2"]
    assert [log.name for log in as_logs(frames[:2])] == ["DataFrame", "morning"]


def test_texts_with_decimal_commas_are_numbers():
    """As `read_csv` of pandas leaves them where no `decimal` is given; a text that is no number stays one."""
    frame = pd.DataFrame({"t": ["0,0", "0,5", "1,0"], "I": ["1,25", "", "-1,5"], "serial": ["007", "007", "008"]})
    table = open_frame(frame).load(["t", "I", "serial"])
    np.testing.assert_array_equal(table.columns["t"], [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(table.columns["I"], [1.25, np.nan, -1.5])
    assert table.columns["serial"].tolist() == ["007", "007", "008"]
