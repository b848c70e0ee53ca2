"""What cannot be is an error, and nothing is lost without a word."""

import re

import numpy as np
import pytest

from logs.formats.known import LOG, lines, rows_of
from ohmward.errors import InputError
from ohmward.logs import read_drive, read_log

NAMES = ("time", "current_A", "voltage_V")
S = {"time": "s"}


def log_text(time, names=NAMES):
    return lines(names, rows_of(LOG, lambda t, i, u, c, at: (time(t), i, u)))


@pytest.mark.parametrize(
    ("scale", "message", "unit"),
    [
        (1e3, "which names no unit, gives a sample every 1e", "ms"),
        (1e2, "which names no unit, gives a sample every 100 s", "ms"),
        (1e6, "which names no unit, gives a sample every 1e", "us"),
        (1e9, "which names no unit, gives a sample every 1e|gives a log of", "ns"),
        (1e-6, "which names no unit, gives a sample every 1e-06 s", "h"),
        (1 / 3600, "which names no unit, gives a sample every 0.000278 s", "h"),
        (1 / 360, "which names no unit, gives a sample every 0.00278 s", "min"),
        (1 / 60, "which names no unit, gives a sample every 0.0167 s", "min"),
        (1 / 6, "which names no unit, gives a sample every 0.167 s", "min"),
    ],
)
def test_an_interval_that_no_log_has_asks_for_the_unit(write_text, scale, message, unit):
    with pytest.raises(InputError, match=message) as refused:
        read_log(write_text(log_text(lambda t: scale * t + 5.2)))
    assert f"--unit time={unit}" in str(refused.value)


def test_a_unit_that_is_told_is_believed(write_text):
    path = write_text(log_text(lambda t: 1e3 * t))
    assert read_log(path, units={"time": "ms"}).duration_s == 299.0
    assert read_log(path, units={"time": "s"}).duration_s == 299e3


@pytest.mark.parametrize("interval_s", [0.001, 0.01, 0.02, 1 / 30, 0.1, 0.2, 1.0, 5.0, 60.0, 300.0, 900.0])
def test_intervals_that_people_choose_are_read(write_text, interval_s):
    assert read_log(write_text(log_text(lambda t: interval_s * t))).dt_s[0] == pytest.approx(interval_s)


def test_a_charge_that_no_battery_holds_asks_for_the_unit(write_text):
    """Twenty milliseconds a row, a discharge of an hour: as seconds it would be a thousand hours."""
    k = np.arange(180_000)
    rows = [f"{20 * n},{-5.0 if n % 100 else -1.0},{13.0 - 1e-6 * n + (0 if n % 100 else 0.1)}" for n in k]
    with pytest.raises(InputError, match=r"gives a charge of .* Ah one way .* --unit time=ms"):
        read_log(write_text("time,current_A,voltage_V\n" + "\n".join(rows)))


@pytest.mark.parametrize(("name", "unit", "size"), [("voltage", "mV", 1), ("Volt", "mV", 1), ("voltage", "uV", 1000)])
def test_a_voltage_that_no_battery_has_asks_for_the_unit(write_text, name, unit, size):
    rows = [f"{k},{size * (13_200 - 100 * (k % 20 < 10))},{-4_000 * (k % 20 < 10)}" for k in range(200)]
    path = write_text("\n".join([f"time_s,{name},current", *rows]))
    with pytest.raises(InputError, match=rf"'{name}' is usually 1.?31.* V, more than .* --unit voltage={unit}"):
        read_log(path)
    assert read_log(path, units={"voltage": unit, "current": "mA"}).voltage_V.max() == pytest.approx(13.2)
    assert read_log(path, units={"voltage": "V", "current": "mA"}).voltage_V.max() == size * 13_200.0


@pytest.mark.parametrize(("interval", "doubted"), [(1.0, False), (5.0, False), (20.0, True), (60.0, True)])
def test_seconds_that_may_be_milliseconds_are_doubted(write_text, interval, doubted):
    """A battery logged every 20 s, or at 50 Hz in milliseconds: only who made the log knows."""
    log = read_log(write_text(log_text(lambda t: interval * t)))
    text = f"one sample every {interval:g} s: if these are ms, say --unit time=ms"
    assert any(note.level == "warning" and text in note.text for note in log.notes) == doubted
    assert not any(text in note.text for note in read_log(write_text(log_text(lambda t: interval * t)), units=S).notes)


@pytest.mark.parametrize(
    ("interval", "unit"),
    [(0.02, ""), (1e-3, ""), (1.0, ""), (20.0, "ms"), (50.0, "ms"), (1 / 1200, "min"), (1e-5, "h")],
)
def test_intervals_that_no_drive_has_ask_for_the_unit(write_text, interval, unit):
    path = write_text("time,left_wheel_speed_rad_s\n" + "\n".join(f"{interval * k:.7g},1.5" for k in range(100)))
    if unit:
        with pytest.raises(InputError, match=rf"a drive with a sample every {interval:.3g} s; .*--unit time={unit} "):
            read_drive(path, ("left",), 1)
    else:
        assert read_drive(path, ("left",), 1).time_s[1] == pytest.approx(interval)
    assert read_drive(path, ("left",), 1, units={"time": "ms"}).time_s[1] == pytest.approx(interval / 1e3)


def test_a_duration_of_centuries_is_refused_whatever_the_unit(write_text):
    with pytest.raises(InputError, match=r"gives a log of [\d,]+ years"):
        read_log(write_text(log_text(lambda t: t / 10, ("time_d", *NAMES[1:])).replace("29.9,", "40000,")))


def test_one_column_cannot_be_two_quantities(write_text):
    path = write_text(log_text(lambda t: t))
    with pytest.raises(InputError, match="'current_A' cannot be both the current and the voltage"):
        read_log(path, columns={"current": "current_A", "voltage": "current_A"})


def test_a_stray_quote_loses_no_row(write_text):
    text = log_text(lambda t: t).replace("\n100.0,", '\n"100.0,').replace("\n200.0,", '\n200.0",')
    log = read_log(write_text(text))
    np.testing.assert_array_equal(log.voltage_V, LOG.voltage_V)
    assert any("a quote that nothing closes in 2 lines (first in line 102)" in str(note) for note in log.notes)


def test_columns_that_are_not_wanted_may_tell_recordings_apart(write_text):
    rows = rows_of(LOG, lambda t, i, u, c, at: (t % 100, i, u, int(t // 100)))
    path = write_text(lines((*NAMES, "script"), rows))
    for extra in (None, ()):
        with pytest.raises(InputError, match=r"they differ in 'script' .*--where script=0"):
            read_log(path, extra=extra)


def test_t1_and_t2_are_temperatures(write_text):
    rows = rows_of(LOG, lambda t, i, u, c, at: (at.strftime("%Y/%m/%d %H:%M:%S"), i, u, c, c))
    log = read_log(write_text(lines(("Date", "current_A", "voltage_V", "T1", "T2"), rows)))
    assert log.duration_s == 299.0


@pytest.mark.parametrize("name", ["pos_left", "angle_l"])
def test_positions_are_never_taken_for_speeds(write_text, name):
    rows = rows_of(LOG, lambda t, i, u, c, at: (t, round(6 * t), round(6 * t)))
    path = write_text(lines(("time_s", name, "other"), rows))
    columns = {"left_wheel_speed": name, "right_wheel_speed": "other"}
    with pytest.raises(InputError, match=r"--counts-per-turn 4096 .*--unit wheel_speed=rad"):
        read_drive(path, ("left", "right"), 2, columns=columns)
    drive = read_drive(path, ("left", "right"), 2, columns=columns, counts_per_turn=6)
    np.testing.assert_allclose(drive.wheel_speed_rad_s[1:, :], 2 * np.pi)


def test_day_or_month_first_is_left_open_where_nothing_tells(write_text):
    rows = rows_of(LOG, lambda t, i, u, c, at: (f"03/05/2026 {at:%H:%M:%S}", i, u))
    log = read_log(write_text(lines(NAMES, rows)))
    assert log.start_unix_s is None
    assert any(
        "may name the day or the month first" in str(note) and "--time-format" in str(note) for note in log.notes
    )


def test_a_long_table_of_centuries_is_refused(write_text):
    rows = "2026-01-01T00:00:00Z,current,1\n2026-01-01T00:00:00Z,voltage,12\n9999-12-31T00:00:00Z,voltage,12\n"
    with pytest.raises(InputError, match=r"gives a log of 7,97\d years"):
        read_log(write_text(f"time,name,value\n{rows}"))


def long_table(labels=("",), later_s=0.0):
    """A row for each value of batteries, whose currents differ by a factor and which are logged one after the other."""
    rows = [
        f"{t + k * later_s},{name},{value},{label}"
        for t, i, u in zip(LOG.time_s, LOG.current_A, LOG.voltage_V, strict=True)
        for k, label in enumerate(labels, start=1)
        for name, value in (("current", k * i), ("voltage", u))
    ]
    return "\n".join(["time,name,value,robot", *rows, ""])


@pytest.mark.parametrize("later_s", [0.0, 0.25])
def test_robots_in_a_long_table_are_told_apart_by_a_label(write_text, later_s):
    path = write_text(long_table(["r1", "r2"], later_s))
    with pytest.raises(
        InputError, match="they differ in 'robot'; choose one with --where robot=r1 or --where robot=r2"
    ):
        read_log(path)
    np.testing.assert_array_equal(read_log(path, where={"robot": "r2"}).current_A, 2 * LOG.current_A)


def test_a_long_table_has_units_in_a_column_and_several_times(write_text):
    """As exports of Foxglove and Car Scanner do."""
    rows = [
        f"{t},{1e9 + t},{name},{value:.0f},{unit}"
        for t, i, u in zip(LOG.time_s, LOG.current_A, LOG.voltage_V, strict=True)
        for name, value, unit in (("battery current", 1e3 * i, "mA"), ("battery voltage", 1e3 * u, "mV"))
    ]
    log = read_log(write_text("\n".join(["elapsed time,receive time,PID,VALUE,UNITS", *rows, ""])))
    np.testing.assert_allclose(log.current_A, LOG.current_A, atol=5e-4)
    np.testing.assert_allclose(log.voltage_V, LOG.voltage_V, atol=5e-4)


def written_late(seconds, often=()):
    """A table of Home Assistant in which each voltage is written these seconds after its current, some again."""
    rows = [
        f"sensor.bms_{name},{value},{t + late}"
        for k, (t, i, u) in enumerate(zip(LOG.time_s, LOG.current_A, LOG.voltage_V, strict=True))
        for name, value, late in (
            ("current", i, 0.0),
            ("voltage", u, seconds),
            *((("voltage", u - 0.1, 2 * seconds),) if k in often else ()),
        )
    ]
    return "\n".join(["entity_id,state,last_changed", *rows, ""])


def test_values_written_one_after_the_other_are_of_one_sample(write_text):
    """Else each step of the current would stand beside the voltage before it."""
    log = read_log(write_text(written_late(0.05)))
    np.testing.assert_allclose(log.time_s, LOG.time_s - LOG.time_s[0], atol=1e-6)
    np.testing.assert_array_equal([log.current_A, log.voltage_V], [LOG.current_A, LOG.voltage_V])


def test_a_name_that_returns_at_once_begins_another_sample(write_text):
    log = read_log(write_text(written_late(0.05, often=(5,))), current_sign="charge")
    assert len(log) == len(LOG.time_s) + 2
    assert not [note for note in log.notes if "another at the same time" in str(note)]


def test_of_equal_columns_beside_a_long_table_the_first_is_kept(write_text):
    rows = [f"{line.rpartition(',')[0]},{k // 2},{k // 2}" for k, line in enumerate(long_table().splitlines()[1:])]
    text = "\n".join(["time,name,value,second,first", *rows, ""])
    assert list(read_log(write_text(text), current_sign="charge").extra) == ["second"]


@pytest.mark.parametrize("times", [1, 3])
def test_values_that_a_long_table_has_twice_are_counted(write_text, times):
    """Also where a column numbers the rows, which are of one robot."""
    rows = [f"{t},voltage,{13.9 + k / 10:.1f}," for t in LOG.time_s for k in range(1, times)]
    text = long_table() + "\n".join([*rows, f"{LOG.time_s[7]},voltage,15.9,", ""])
    numbered = [f"{line.rpartition(',')[0]},{k}" for k, line in enumerate(text.splitlines()[1:])]
    log = read_log(write_text("\n".join(["time,name,value,id", *numbered, ""])), current_sign="charge")
    lost = f"{(times - 1) * len(LOG.time_s) + 1} value"
    assert any(lost in str(note) and "that has another at the same time" in str(note) for note in log.notes)


def test_negative_numbers_of_64_bits_without_their_sign_are_no_missing_values(write_text):
    """As the `Amperage` that ioreg of macOS prints."""
    rows = [f"{k},{-(k % 9) % (1 << 64)},{13.0 - 0.02 * (k % 9)}" for k in range(90)]
    with pytest.raises(InputError, match=r"'current_A' has 80 numbers near 2\^64: .* without their sign"):
        read_log(write_text("\n".join(["time_s,current_A,voltage_V", *rows])))


def test_one_time_for_all_rows_is_no_clock(write_text):
    rows = [f"5,{-1.0 * (k % 9 < 4)},{13.0 - 0.02 * (k % 9 < 4)}" for k in range(90)]
    with pytest.raises(InputError, match=r"column 'time_s' is 5 in all 90 rows; .*--sample-time 1"):
        read_log(write_text("\n".join(["time_s,current_A,voltage_V", *rows])))


@pytest.mark.parametrize(
    ("scale", "zero", "advice"), [(1.0, 273.15, "kelvins. use --unit temperature=K"), (10.0, 2731.5, "")]
)
def test_a_temperature_that_no_battery_has_is_left_out(write_text, scale, zero, advice):
    rows = [
        f"{k},{-1.0 * (k % 20 < 10)},{13.0 - 0.02 * (k % 20 < 10)},{zero + scale * (21.0 + 0.01 * k):.1f}"
        for k in range(90)
    ]
    path = write_text("\n".join(["time_s,current_A,voltage_V,temperature", *rows]))
    log = read_log(path)
    assert log.temperature_degC is None
    (note,) = (note.text for note in log.notes if note.level == "warning")
    assert re.search(f"temperature left out: it reads .*{advice}", note)


def test_a_date_in_the_future_is_named_and_kept(write_text):
    rows = "".join(f"2091-03-01T00:00:{k:02d}Z,{k % 3},{12 + k % 3 / 10}\n" for k in range(60))
    log = read_log(write_text(f"time,current_A,voltage_V\n{rows}"), current_sign="charge")
    assert log.begin_unix_s is not None
    named = [note.text for note in log.notes if "in the future by the clock of this computer" in note.text]
    assert named[0].startswith("the first date is 2091-03-01T00:00:00")


def day(time_unit=1.0, current_unit=1.0, interval_s=1.0, ohm=0.14):
    """Half an hour of a battery of seven cells, 29 loads and charges, its numbers multiplied by the given factors."""
    time_s = interval_s * np.arange(1800.0)
    current_A = np.repeat(np.resize([-9.0, -0.5, 2.0, -3.0, 0.0], 30), 60)
    voltage_V = 28.0 + ohm * current_A + 0.001 * np.random.default_rng(2).normal(size=time_s.size)
    return zip(time_unit * time_s, current_unit * current_A, voltage_V, strict=True)


@pytest.mark.parametrize(
    ("names", "factors", "option"),
    [
        (("time_s", "current_A", "voltage_V"), {"time_unit": 1e3}, "--unit time=ms"),
        (("time_s", "current_A", "voltage_V"), {"current_unit": 1e3}, "--unit current=mA"),
        (("time_s", "current_mA", "voltage_V"), {"current_unit": 1.0}, "--unit current=A"),
        (("time_s", "current_mA", "voltage_V"), {"current_unit": 1e6}, "--unit current=uA"),
        (("time_s", "current_A", "voltage_V"), {}, ""),
        (("time_s", "current_A", "voltage_V"), {"interval_s": 30.0}, ""),
        (("time_s", "current_A", "voltage_V"), {"ohm": 0.0015}, ""),
        (("time_s", "current_mA", "voltage_V"), {"current_unit": 1e3, "ohm": 0.5}, ""),
    ],
)
def test_a_unit_in_a_name_that_the_resistance_contradicts_is_warned_of(write_text, names, factors, option):
    log = read_log(write_text(lines(names, ([f"{value:.6f}" for value in row] for row in day(**factors)))))
    options = [" ".join(note.options) for note in log.notes if note.options]
    assert options == ([option] if option else [])
