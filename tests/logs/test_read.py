import subprocess
import sys
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from needs import measured_file
from ohmward.errors import InputError, OhmwardError
from ohmward.logs import FileHints, examine, read_log


def csv(names, *columns):
    rows = zip(*columns, strict=True)
    return ",".join(names) + "\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)


def texts(log):
    return " | ".join(str(note) for note in log.notes)


def test_a_plain_log(write_text, pulses):
    log = read_log(write_text(csv(["time_s", "current_A", "voltage_V"], *pulses), "robot.csv"))
    assert log.name == "robot"
    for values, expected in zip((log.time_s, log.current_A, log.voltage_V), pulses, strict=True):
        np.testing.assert_array_equal(values, expected)
    assert log.temperature_degC is None
    assert "positive current charges the battery, as the data show" in texts(log)


def test_a_file_in_which_positive_discharges_is_turned_around(write_text, pulses):
    time_s, current_A, voltage_V = pulses
    log = read_log(write_text(csv(["t", "I [mA]", "U [mV]"], 1000 * time_s, -1000 * current_A, 1000 * voltage_V)),
                   units={"time": "ms"})  # fmt: skip
    np.testing.assert_allclose(log.time_s, time_s, rtol=1e-12)
    np.testing.assert_allclose(log.current_A, current_A, rtol=1e-12)
    np.testing.assert_allclose(log.voltage_V, voltage_V, rtol=1e-12)
    assert "positive current discharges the battery, as the data show" in texts(log)


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_names_units_order_delimiter_and_sign_do_not_matter(tmp_path, pulses, data):
    time_s, current_A, voltage_V = (x[:200] for x in pulses)
    sign = data.draw(st.sampled_from([1.0, -1.0]))
    time = data.draw(
        st.sampled_from([("time_s", 1.0), ("Time [ms]", 1e-3), ("Test Time (min)", 60.0), ("t/h", 3600.0)])
    )
    current = data.draw(
        st.sampled_from([("current_A", 1.0), ("I (mA)", 1e-3), ("Current / A", 1.0), ("battI_mA", 1e-3)])
    )
    voltage = data.draw(st.sampled_from([("voltage_V", 1.0), ("U/mV", 1e-3), ("Battery Voltage [V]", 1.0)]))
    columns = [(name, values / scale) for (name, scale), values in zip(
        (time, current, voltage), (time_s, sign * current_A, voltage_V), strict=True)]  # fmt: skip
    columns.append(("soc", np.linspace(1.0, 0.5, 200)))
    columns = data.draw(st.permutations(columns))
    mark = data.draw(st.sampled_from([",", ";", "\t"]))
    path = tmp_path / "log.csv"
    names, values = zip(*columns, strict=True)
    path.write_text(
        "\n".join([mark.join(names), *(mark.join(map(repr, row)) for row in np.transpose(values).tolist())])
    )
    log = read_log(path, columns={"current": current[0]})
    np.testing.assert_allclose(log.time_s, time_s, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(log.current_A, current_A, rtol=1e-12)
    np.testing.assert_allclose(log.voltage_V, voltage_V, rtol=1e-12)
    np.testing.assert_array_equal(log.extra["soc"], np.linspace(1.0, 0.5, 200))


def test_a_sign_that_cannot_be_told_must_be_given(write_text):
    path = write_text(csv(["time_s", "current_A", "voltage_V"], range(9), [1.0] * 9, [12.0] * 9))
    with pytest.raises(InputError, match="--current-sign charge or --current-sign discharge"):
        read_log(path)
    np.testing.assert_array_equal(read_log(path, current_sign="charge").current_A, 1.0)
    np.testing.assert_array_equal(read_log(path, current_sign="discharge").current_A, -1.0)
    with pytest.raises(InputError, match="must be 'auto', 'charge' or 'discharge', not 'up'"):
        read_log(path, current_sign="up")  # type: ignore[arg-type]


def test_a_given_sign_against_the_data_is_kept_with_a_warning(write_text, pulses):
    log = read_log(write_text(csv(["time_s", "current_A", "voltage_V"], *pulses)), current_sign="discharge")
    np.testing.assert_array_equal(log.current_A, -pulses[1])
    assert "warning: positive current discharges the battery (given), but the data say the opposite" in texts(log)


def test_the_sign_of_a_current_that_is_zero_does_not_matter(write_text):
    log = read_log(write_text(csv(["time_s", "current_A", "voltage_V"], range(9), [0] * 9, [12.0] * 9)))
    assert "its sign does not matter" in texts(log)


BDF = ["Test Time / s", "Current / A", "Voltage / V"]


@pytest.mark.parametrize("names", [BDF, ["test_time_second", "current_ampere", "voltage_volt"]])
def test_bdf_defines_the_sign(write_text, names):
    for name in ("cell.bdf.csv", "cell.csv"):
        log = read_log(write_text(csv(names, range(9), [1.0] * 9, [12.0] * 9), name))
        assert log.name == "cell"
        assert "by definition of BDF" in texts(log)


def test_bdf_against_the_data_warns(write_text, pulses):
    log = read_log(write_text(csv(BDF, pulses[0], -pulses[1], pulses[2]), "cell.bdf.csv"))
    np.testing.assert_array_equal(log.current_A, -pulses[1])
    assert "but the data say the opposite" in texts(log)


def test_names_of_bdf_in_another_file_yield_to_the_data(write_text, pulses):
    log = read_log(write_text(csv(BDF, pulses[0], -pulses[1], pulses[2]), "cell.csv"))
    np.testing.assert_array_equal(log.current_A, pulses[1])


@pytest.mark.parametrize("cells", [1, 2, 14])
def test_milliamperes_under_a_name_without_a_unit_are_a_warning(write_text, pulses, cells):
    """The pulses as those of a cell of some 20 mohm, and of the pack of as many."""
    time_s, current_A, voltage_V = pulses
    pack_V = cells * (3.7 + (voltage_V - np.median(voltage_V)))
    doubt = f"dV/dI = {0.02 * cells:.2g} mohm, less than cells have: if these are mA, say --unit current=mA"
    amperes = csv(["time_s", "current", "voltage"], time_s, current_A, pack_V)
    milliamperes = csv(["time_s", "current", "voltage"], time_s, 1e3 * current_A, pack_V)
    assert doubt in texts(read_log(write_text(milliamperes)))
    assert doubt not in texts(read_log(write_text(milliamperes.replace("current", "current_mA", 1))))
    assert "less than cells have" not in texts(read_log(write_text(amperes)))


@pytest.mark.parametrize(
    ("time", "seconds", "current", "amperes"),
    [
        ("Test Time / h", 3600.0, "Current / A", 1.0),
        ("test_time_millisecond", 1e-3, "current_milliampere", 1e-3),
        ("Test Time / min", 60.0, "Current / mA", 1e-3),
    ],
)
def test_bdf_in_other_units_is_read(write_text, pulses, time, seconds, current, amperes):
    rows = pulses[0] / seconds, pulses[1] / amperes, pulses[2]
    log = read_log(write_text(csv([time, current, "Voltage / V"], *rows), "cell.bdf.csv"))
    np.testing.assert_allclose(log.time_s, pulses[0], atol=1e-9)
    np.testing.assert_allclose(log.current_A, pulses[1], atol=1e-9)


def test_bdf_without_its_columns_is_refused(write_text):
    with pytest.raises(InputError, match=r"BDF requires .*missing: 'Test Time / s'; it has: 'time', 'Current / A'"):
        read_log(write_text("time,Current / A,Voltage / V\n0,1,12\n", "cell.bdf.csv"))


def test_where_and_recording_choose_one_of_several(write_text, pulses):
    time_s, current_A, voltage_V = (np.tile(x, 2) for x in pulses)
    run = np.repeat([7, 8], 600)
    path = write_text(csv(["time_s", "current_A", "voltage_V", "run"], time_s, current_A, voltage_V + run, run))
    with pytest.raises(InputError, match="'run' \\(7, 8\\); choose one, for example --where run=7"):
        read_log(path)
    for where in ({"run": 8}, {"run": "8"}, {"recording": 2}):
        log = read_log(path, where=where)
        np.testing.assert_array_equal(log.voltage_V, pulses[2] + 8)
        assert "recording" not in log.extra


def test_only_the_columns_asked_for_are_kept(write_text, pulses):
    path = write_text(csv(["time_s", "current_A", "voltage_V", "a", "b"], *pulses, pulses[0], pulses[1]))
    assert list(read_log(path).extra) == ["a", "b"]
    assert list(read_log(path, extra=["b"]).extra) == ["b"]
    assert list(read_log(path, extra=[]).extra) == []
    with pytest.raises(InputError, match="no column 'c' to keep"):
        read_log(path, extra=["c"])


def test_wall_clock_beside_elapsed_time_gives_the_start(write_text, pulses):
    path = write_text(csv(["time_s", "current_A", "voltage_V", "unix_time_s"], *pulses, pulses[0] + 1.7e9))
    log = read_log(path)
    assert log.start_unix_s == 1.7e9
    assert not log.extra


def test_the_start_is_that_of_the_first_row_that_stays(write_text):
    rows = "2017-03-25T07:00:00Z,,,20\n2017-03-25T07:00:05Z,1,12,\n2017-03-25T07:00:06Z,1,12,\n"
    log = read_log(write_text("time,current,voltage,temperature\n" + rows), current_sign="charge")
    np.testing.assert_array_equal(log.time_s, [0.0, 1.0])
    assert log.start_unix_s == 1_490_425_205.0


def test_unsigned_nanoseconds_with_a_late_row(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    time_ns = (
        np.array([1, 0, 2, 3, 4, 5, 6, 7, 8, 9] * 3, dtype=np.uint64) + np.repeat(np.arange(3), 10).astype("u8") * 10
    )
    path = tmp_path / "log.parquet"
    columns = {"timestamp_ns": np.uint64(17 * 10**17) + time_ns * 10**9, "current": np.ones(30), "voltage": np.ones(30)}
    parquet.write_table(pyarrow.table(columns), path)
    with pytest.raises(InputError, match="3 of 30 rows are late"):
        read_log(path, current_sign="charge")
    log = read_log(path, current_sign="charge", sort_time=True)
    np.testing.assert_array_equal(log.time_s, np.arange(30.0))
    assert log.start_unix_s == 1.7e9


def test_parquet_with_dates_dictionaries_booleans_and_nulls(tmp_path, pulses):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    time_s, current_A, voltage_V = pulses
    path = tmp_path / "log.parquet"
    table = {
        "timestamp": pyarrow.array((time_s * 1e3).astype("M8[ms]") + np.timedelta64(1_600_000_000, "s")),
        "current_mA": pyarrow.array((1000 * current_A).astype(np.int32)),
        "voltage": pyarrow.array([*voltage_V.tolist()[:-1], None], pyarrow.float32()),
        "mode": pyarrow.array(["a"] * 600).dictionary_encode(),
        "charging": pyarrow.array([True] * 600),
        "count": pyarrow.array(np.arange(600, dtype=np.uint64)),
    }
    parquet.write_table(pyarrow.table(table), path)
    log = read_log(path, where={"mode": "a"})
    np.testing.assert_allclose(log.time_s, time_s, atol=1e-9)
    np.testing.assert_array_equal(log.current_A, current_A)
    np.testing.assert_allclose(log.voltage_V[:-1], voltage_V[:-1], rtol=1e-6)
    assert np.isnan(log.voltage_V[-1])
    assert log.start_unix_s == 1.6e9
    assert set(log.extra) == {"charging", "count"}
    assert "voltage: no number in 1 of 600 values" in texts(log)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"PAR1 and then nothing", "not a readable Parquet file"),
        (bytes(range(256)) * 9, "not a text table"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "not a text table"),
        (b"time_s,current_A,voltage_V\n", "no rows below it"),
        (b"time_s,current_A,voltage_V\n0,1\n2,3\n", "line 2: 2 cells where the header has 3"),
        (b"time_s,current_A,voltage_V\n0,1,12\n1,high,12\n", r"line 3, column 'current_A': 'high' is not a number"),
        (b"time_s,current_A,voltage_V\n0,0x1F,12\n1,0xFF,12\n", "'0x1F' is not a number; it looks hexadecimal"),
        (b"time_s,current_A,voltage_V\nnow,1,12\n", r"line 2, column 'time_s': 'now' is not a time"),
        (b"time_s,current_A,voltage_V\n0,,12\n1,,12\n", "column 'current_A' has no value"),
        (b"time_s,current_A,voltage_V\n,1,12\n,1,12\n", "column 'time_s' has no value"),
        (b"time_s,current_A,voltage_V\n0,1,12\n", "do not show whether a positive current"),
        (b"time_s,current_A,voltage_V\n5,1,12\n6,1,12\n0,1,12\n1,1,12\n", "several recordings"),
        (b"time_s,left_current,right_current,voltage\n0,1,1,12\n", "both 'left_current' and 'right_current'"),
    ],
)
def test_malformed_files_are_refused(tmp_path, content, message):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_log(path)


def test_stamps_to_the_minute_keep_resistance_and_charge(write_text, pulses):
    """Ten minutes of pulses at 1 Hz that begin in the middle of a minute."""
    time_s, current_A, voltage_V = pulses
    minutes = ((time_s + 25) // 60).astype(int)
    rows = [f"2026-05-01 10:{m:02},{i},{v:.4f}" for m, i, v in zip(minutes, current_A, voltage_V, strict=True)]
    log = read_log(write_text("\n".join(["Date,Current (A),Voltage (V)", *rows])), extra=())
    np.testing.assert_allclose(log.time_s, time_s, atol=1e-6)
    assert log.throughput_Ah() == pytest.approx(np.abs(current_A).sum() / 3600.0)
    assert examine(log).survey.sign.resistance_ohm == pytest.approx(0.02, rel=0.02)
    assert any(note.level == "warning" and "11 stamps" in note.text for note in log.notes)


@pytest.mark.parametrize("shift_s", [0.0, 0.2])
@pytest.mark.parametrize("extra", [None, ()])
def test_two_batteries_in_one_table_are_chosen_by_their_column(write_text, pulses, extra, shift_s):
    """Whether the column is wanted or not, and with stamps of their own or the same."""
    time_s, current_A, voltage_V = pulses
    rows = [
        f"{t + shift_s * k},{name},{i},{v - k:.4f}"
        for t, i, v in zip(time_s, current_A, voltage_V, strict=True)
        for k, name in enumerate(("left", "right"))
    ]
    path = write_text("\n".join(["time_s,battery,current_A,voltage_V", *rows]))
    with pytest.raises(InputError, match=r"they differ in 'battery'.* --where battery=left or --where battery=right"):
        read_log(path, extra=extra)
    log = read_log(path, extra=extra, where={"battery": "right"})
    np.testing.assert_allclose(log.voltage_V, voltage_V - 1.0, atol=1e-3)


def test_missing_files_and_folders_are_refused(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        read_log(tmp_path / "nothing.csv")
    with pytest.raises(InputError, match="is a folder"):
        read_log(tmp_path)


def test_one_sample_is_a_log(write_text):
    log = read_log(write_text("time_s,current_A,voltage_V\n3,1,12\n"), current_sign="charge")
    assert (len(log), log.duration_s) == (1, 0.0)
    assert "1 sample, 0 s, one sample" in log.describe()


def test_parquet_without_pyarrow_names_the_fix(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    path = tmp_path / "log.parquet"
    path.write_bytes(b"PAR1")
    with pytest.raises(OhmwardError, match="needs pyarrow, which is not installed: pip install pyarrow"):
        read_log(path)


def test_importing_logs_imports_numpy_only():
    program = "import sys, ohmward.logs; print(sorted({'pyarrow', 'scipy', 'pandas'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_measured_lead_acid_telemetry():
    """Voltage and temperature on rows of their own, dates, late rows, positive current discharges."""
    log = read_log(measured_file("bboxx_vrla_12v_17ah/telemetry_2017-03-25_2017-03-29.csv"))
    assert len(log) == 5833
    assert log.start_unix_s == pytest.approx(1_490_425_206.9)
    assert log.temperature_degC is not None and np.isfinite(log.temperature_degC).all()
    assert "19 rows out of order: sorted by time" in texts(log)
    first_discharge = log.between(4264.0, 24_000.0)
    assert -17.0 < first_discharge.charge_Ah()[-1] < -16.0


@pytest.mark.parametrize("script", [1, 3])
def test_measured_lfp_charge_matches_the_cycler(script):
    """The cycler's own Ah counters and the integral of the current differ by its gain error of 1.2 % at most."""
    where: dict[str, float | str] = {"temp_C": 25, "script": script}
    log = read_log(measured_file("plett_a123_lfp/a123_dyn.parquet"), where=where)
    counted = np.ptp(log.extra["chg_Ah"]) - np.ptp(log.extra["dis_Ah"])
    throughput = np.ptp(log.extra["chg_Ah"]) + np.ptp(log.extra["dis_Ah"])
    assert abs(log.charge_Ah()[-1] - counted) < 0.012 * throughput


@pytest.mark.parametrize(
    ("name", "cell", "degC"),
    [
        ("Temp", "0", "0"),
        ("temperature [K]", "0", "-273.15"),
        ("temperature [degF]", "0", "-17.7778"),
        ("temperature [degF]", "32", "0"),
        ("temperature [K]", "273.15", "0"),
        ("temperature_degC", "-127.0", "-127"),
        ("temperature_degC", "-40", "-40"),
        ("temperature_degC", "85.0", "85"),
        ("temperature_degC", "6553.5", "6553.5"),
    ],
)
def test_a_temperature_of_no_sensor_is_left_out_with_a_warning(write_text, pulses, name, cell, degC):
    constant = [cell] * 599 + [""]
    path = write_text(csv(["time_s", "current_A", "voltage_V", name], *pulses, constant))
    log = read_log(path)
    assert log.temperature_degC is None
    assert f"warning: temperature {degC} degC throughout" in texts(log)
    told = read_log(path, hints=FileHints(temperature_degC=5.0))
    assert told.temperature_degC is not None
    assert (told.temperature_degC == 5.0).all()


def test_rows_that_are_no_measurement_do_not_hide_the_sign(write_text, pulses):
    time_s, current_A, voltage_V = pulses
    voltage_V = voltage_V.copy()
    voltage_V[[95, 210, 333, 334]] = 65.535
    log = read_log(write_text(csv(["time_s", "current_A", "voltage_V"], time_s, current_A, voltage_V)))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(log.voltage_V)), [95, 210, 333, 334])
    assert examine(log).survey.sign.resistance_ohm == pytest.approx(0.02, rel=0.02)
    assert "warning: 4 voltages of 65.535 V left out: no measurement, far from the rows around" in texts(log)


@pytest.mark.parametrize("cells", [["25.0"] * 600, ["-20"] * 600, ["0"] * 599 + ["0.1"]])
def test_the_set_point_of_a_chamber_and_a_cold_that_changes_stay(write_text, pulses, cells):
    log = read_log(write_text(csv(["time_s", "current_A", "voltage_V", "temperature_degC"], *pulses, cells)))
    assert log.temperature_degC is not None


def cycler_text(columns: dict[str, list]) -> str:
    """Three cycles of four steps, the time counted in each step from zero; further columns before the rows."""
    rows = [
        (cycle, step, 5 * k, current, 3.6 + 0.03 * current)
        for cycle in (1, 2, 3)
        for step, (current, count) in enumerate([(0, 30), (-2, 100), (0, 50), (1.5, 120)])
        for k in range(count)
    ]
    cells = [[*row, *(values[k] for values in columns.values())] for k, row in enumerate(rows)]
    names = ["Cycle", "Step", "Time", "Current(A)", "Voltage(V)", *columns]
    return "\n".join(",".join(map(str, row)) for row in (names, *cells))


def test_a_time_that_starts_again_with_each_step_is_joined(write_text):
    log = read_log(write_text(cycler_text({})))
    np.testing.assert_allclose(log.time_s, 5.0 * np.arange(900))
    assert [note.level for note in log.notes if "starts again 11 times, with each step" in note.text] == ["warning"]


@pytest.mark.parametrize("name", ["Date", "Absolute Time", "Test Time"])
def test_another_time_than_that_of_the_step_is_taken(write_text, name):
    """With a pause of a minute between the steps, which the time of the step does not know."""
    paused = [5 * k + 60 * (k // 100) for k in range(900)]
    dates = [str(np.datetime64("2026-04-07T08:30:00") + s).replace("T", " ") for s in paused]
    log = read_log(write_text(cycler_text({name: dates if name == "Date" else paused})))
    np.testing.assert_allclose(log.time_s, paused)


def test_the_time_that_is_named_is_taken(write_text):
    path = write_text(cycler_text({"Test Time": list(range(900))}))
    assert read_log(path, columns={"time": "Time"}).duration_s == 4495.0


@pytest.mark.parametrize("names", ["Date,Heure", "Fecha,Hora", "Data,Ora", "Datum,Tijd", "日付,時刻", "Date,UTC"])
def test_the_time_of_day_stands_beside_the_date_in_any_language(write_text, names):
    times = [f"2026-05-21,14:{k // 60:02d}:{k % 60:02d}" for k in range(600)]
    rows = "".join(f"{time},{-5 * (k // 30 % 2)},{12.8 - 0.05 * (k // 30 % 2)}\n" for k, time in enumerate(times))
    log = read_log(write_text(f"{names},Courant (A),Tension (V)\n{rows}"))
    np.testing.assert_array_equal(log.time_s, np.arange(600.0))
    assert log.begin_unix_s == 1_779_372_000.0


@pytest.mark.parametrize(
    ("head", "form", "dated"),
    [
        ("hour,min,sec", "%H,%M,%S", False),
        ("Year,Month,Day,Hour,Minute,Second", "%Y,%m,%d,%H,%M,%S", True),
        ("yr,mon,day,hr,min,sec", "%y,%m,%d,%H,%M,%S", True),
    ],
)
def test_a_time_in_parts_is_joined(write_text, pulses, head, form, dated):
    """Over midnight."""
    time_s, current_A, voltage_V = pulses
    begin = datetime(2026, 3, 28, 23, 59, tzinfo=UTC)
    dates = [(begin + timedelta(seconds=float(t))).strftime(form) for t in time_s]
    rows = [f"{date},{i},{u}" for date, i, u in zip(dates, current_A, voltage_V, strict=True)]
    log = read_log(write_text("\n".join([f"{head},current_A,voltage_V", *rows])))
    np.testing.assert_allclose(log.time_s - log.time_s[0], time_s - time_s[0], atol=1e-6)
    assert log.start_unix_s == (begin.timestamp() if dated else None)


def test_a_folder_with_a_file_for_each_quantity_says_so(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,current_A\n0,1\n1,1\n")
    (tmp_path / "b.csv").write_text("time_s,voltage_V\n0,3.7\n1,3.7\n")
    with pytest.raises(InputError, match="join them by their times in one table"):
        read_log(tmp_path)


def test_a_folder_whose_files_are_not_one_log_names_the_file_and_what_takes_several(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,current_A,voltage_V\n0,1,3.7\n1,1,3.7\n")
    (tmp_path / "b.csv").write_text("")
    with pytest.raises(InputError, match=r"not one log: b.csv: the file is empty.*`ohmward fleet`"):
        read_log(tmp_path)
    (tmp_path / "b.csv").write_text("time_s,i,u\n0,1,3.7\n1,1,3.7\n")
    with pytest.raises(InputError, match=r"not one log: b.csv has other columns than a.csv \('current_A', 'i'"):
        read_log(tmp_path)
