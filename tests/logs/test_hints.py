"""Facts that the user tells of a file: names, encoding, time, temperature, the part that is wanted."""

from datetime import UTC, datetime

import numpy as np
import pytest

from logs.formats.known import LOG, lines, rows_of
from ohmward.errors import InputError
from ohmward.logs import FileHints, read_drive, read_log

NAMES = ("time", "current_A", "voltage_V")


@pytest.fixture
def dated(write_text):
    rows = rows_of(LOG, lambda t, i, u, c, at: (at.strftime("%Y-%m-%d %H:%M:%S"), i, u))
    return write_text(lines(NAMES, rows))


def test_a_temperature_is_taken_where_the_log_has_none(dated):
    log = read_log(dated, hints=FileHints(temperature_degC=5.0))
    assert log.temperature_degC is not None
    np.testing.assert_array_equal(log.temperature_degC, np.full(300, 5.0))


def test_a_temperature_that_was_measured_wins(write_text):
    rows = rows_of(LOG, lambda t, i, u, c, at: (t, i, u, c))
    log = read_log(write_text(lines((*NAMES, "temp_degC"), rows)), hints=FileHints(temperature_degC=5.0))
    np.testing.assert_array_equal(log.temperature_degC, LOG.temperature_degC)
    assert any("temperature of 5 degC not used" in str(note) for note in log.notes)


@pytest.mark.parametrize(
    ("start", "stop", "samples"),
    [
        ("60", "120", 60),
        ("0:01:00", "0:02:00", 60),
        ("2026-03-28 09:16:00", "2026-03-28T09:17:00Z", 60),
        ("2026-03-28T10:16:00+01:00", None, 240),
        (None, "10", 10),
    ],
)
def test_a_part_is_named_by_seconds_durations_and_dates(dated, start, stop, samples):
    assert len(read_log(dated, hints=FileHints(start=start, stop=stop))) == samples


def test_dates_of_a_part_are_of_the_zone_of_the_log(dated):
    log = read_log(dated, hints=FileHints(timezone="Europe/Berlin", start="2026-03-28 09:16:00"))
    assert len(log) == 240
    assert log.start_unix_s == datetime(2026, 3, 28, 8, 15, tzinfo=UTC).timestamp()


def test_a_log_and_a_drive_keep_the_zone_of_their_dates(tmp_path):
    rows = [f"2026-03-28 09:15:0{k}{{zone}},{k + 1},12.5,3" for k in range(5)]
    for zone, hint, expected in (("Z", None, "UTC"), ("", "Europe/Berlin", "Europe/Berlin"), ("", None, "")):
        path = tmp_path / "log.csv"
        path.write_text("\n".join(["time,current [A],voltage [V],left_wheel_speed [rad/s]", *rows]).format(zone=zone))
        log = read_log(path, current_sign="charge", hints=FileHints(timezone=hint))
        drive = read_drive(path, ("left",), 1, hints=FileHints(timezone=hint))
        assert log.time_zone == drive.time_zone == expected
        assert log.start_unix_s == drive.start_unix_s == 1774689300 - 3600 * (hint is not None)


@pytest.mark.parametrize(
    ("hints", "message"),
    [
        (FileHints(encoding="klingon"), r"--encoding .* got 'klingon'"),
        (FileHints(timezone="Mars/Base"), r"--timezone .* got 'Mars/Base'"),
        (FileHints(timezone="../../etc"), "--timezone"),
        (FileHints(sample_time_s=0.0), "--sample-time .* > 0 s"),
        (FileHints(sample_time_s=1e9), "--sample-time .* at most a day, 86400 s; got 1e"),
        (FileHints(start="noon"), "--from must be seconds of the log"),
        (FileHints(start="20", stop="10"), "--from 20 must be before --to 10"),
        (FileHints(start="9999"), "has no sample in"),
        (FileHints(names=("t", "i")), "--names has 2 names for 3 columns"),
        (FileHints(time_format="%H"), "is not a time"),
    ],
)
def test_hints_that_cannot_be_are_refused(dated, hints, message):
    with pytest.raises(InputError, match=message):
        read_log(dated, hints=hints)


def test_a_date_needs_a_log_with_dates(write_text):
    path = write_text(lines(NAMES, rows_of(LOG, lambda t, i, u, c, at: (t, i, u))))
    with pytest.raises(InputError, match="names no date; give seconds"):
        read_log(path, hints=FileHints(stop="2026-03-28"))


def test_names_take_the_place_of_a_header(write_text):
    rows = rows_of(LOG, lambda t, i, u, c, at: (t, i, u))
    log = read_log(write_text(lines(("a", "b", "c"), rows)), hints=FileHints(names=NAMES))
    np.testing.assert_array_equal(log.voltage_V, LOG.voltage_V)


def test_a_part_of_a_drive(write_text):
    rows = rows_of(LOG, lambda t, i, u, c, at: (t, 1.0 + t / 1000, 1.0))
    path = write_text(lines(("time_s", "left_wheel_speed", "right_wheel_speed"), rows))
    drive = read_drive(path, ("left", "right"), 2, hints=FileHints(start="10", stop="20"))
    np.testing.assert_array_equal(drive.time_s, np.arange(10.0, 20.0))
