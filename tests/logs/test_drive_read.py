"""From a file to a drive in SI units."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import read_drive
from ohmward.logs.wheel_columns import counter_bits, speed_from_counts

PLACES = ("front_left", "front_right", "rear_left", "rear_right")
TIME = np.arange(5) * 0.1
ONE = np.arange(1.0, 6.0)


@pytest.fixture
def write(tmp_path):
    def write(columns, name="drive.csv"):
        path = tmp_path / name
        with Path(path).open("w", newline="") as stream:
            rows = csv.writer(stream)
            rows.writerow(columns)
            rows.writerows(zip(*columns.values(), strict=True))
        return path

    return write


def drive(path, driven=2, places=PLACES, **kwargs):
    return read_drive(path, places, driven, **kwargs)


def notes(log):
    return " | ".join(map(str, log.notes))


def test_our_own_names_are_read_as_they_are(write):
    columns = {"time_s": TIME} | {f"{p}_wheel_speed_rad_s": ONE * k for k, p in enumerate(PLACES, start=1)}
    columns |= {f"{p}_motor_current_A": -ONE * k for k, p in enumerate(PLACES[:2], start=1)}
    body = {"yaw_rate_rad_s": ONE, "acceleration_m_s2": ONE + 1, "pitch_rad": ONE + 2, "speed_m_s": ONE + 3}
    more = {"speed_std_m_s": ONE + 4, "speed_age_s": ONE + 5, "heading_rad": np.cumsum(ONE), "heading_std_rad": ONE + 6}
    log = drive(write(columns | body | more | {"speed_true_m_s": ONE + 6}))
    assert log.name == "drive"
    assert np.array_equal(log.wheel_speed_rad_s, np.outer(ONE, [1, 2, 3, 4]))
    assert np.array_equal(log.motor_current_A, -np.outer(ONE, [1, 2]))
    for name, values in {**body, **more}.items():
        assert np.array_equal(getattr(log, name), values)
    assert list(log.extra) == ["speed_true_m_s"]
    assert not any(note.level == "warning" for note in log.notes)


@pytest.mark.parametrize(
    "unit, kwargs, factor",
    [
        ("rad/s", {}, 1.0),
        ("rpm", {}, math.pi / 30),
        ("rpm", {"at_motor_shaft": True, "gear_ratio": 16.0}, math.pi / 30 / 16),
        ("m/s", {"radius_m": 0.12}, 1 / 0.12),
        ("km/h", {"radius_m": 0.5}, 2 / 3.6),
        ("m/s", {"radius_m": 0.12, "at_motor_shaft": True, "gear_ratio": 16.0}, 1 / 0.12),
    ],
)
def test_units_of_wheel_speeds(write, unit, kwargs, factor):
    log = drive(write({"t": TIME, "wl": ONE, "wr": -ONE}), units={"wheel_speed": unit}, **kwargs)
    assert log.wheel_speed_rad_s[:, 0] == pytest.approx(factor * ONE)
    assert log.wheel_speed_rad_s[:, 1] == pytest.approx(-factor * ONE)
    assert np.isnan(log.wheel_speed_rad_s[:, 2:]).all()
    assert f"in {unit}" in notes(log)


@pytest.mark.parametrize(("given", "doubted"), [({}, True), ({"right_wheel_speed": "rad/s"}, False)])
def test_a_side_in_another_unit_than_its_name_says_is_asked_for(write, given, doubted):
    time_s = 0.1 * np.arange(100)
    speed = 3.0 + np.sin(time_s)
    log = drive(write({"t": time_s, "rpm_left": speed * 30 / math.pi, "rpm_right": speed}), units=given)
    text = "in rpm, and that in rad/s? then say --unit left_wheel_speed=rpm --unit right_wheel_speed=rad/s"
    assert (text in notes(log)) == doubted


def test_other_units(write):
    columns = {"t_ms": 1000 * TIME, "wl": ONE, "wr": ONE, "i_l (mA)": ONE, "gz_dps": ONE, "pitch_deg": ONE, "ax_g": ONE}
    log = drive(write(columns))
    assert log.time_s == pytest.approx(TIME)
    assert log.motor_current_A[:, 0] == pytest.approx(ONE / 1000)
    assert log.yaw_rate_rad_s == pytest.approx(np.radians(ONE))
    assert log.pitch_rad == pytest.approx(np.radians(ONE))
    assert log.acceleration_m_s2 == pytest.approx(9.80665 * ONE)


def test_a_v_is_the_speed_of_a_rim_and_the_note_says_so(write):
    log = drive(write({"t": TIME, "v_fl": ONE, "v_fr": ONE}), radius_m=0.5)
    assert log.wheel_speed_rad_s[:, 0] == pytest.approx(2 * ONE)
    assert "assumed to be in m/s" in notes(log) and "radius 0.5 m" in notes(log)


def test_electrical_turns_a_minute_need_the_pole_pairs(write):
    speed_rad_s = np.sin(TIME)
    path = write({"t": TIME, "left_erpm": speed_rad_s * 30 / np.pi * 7 * 20, "erpmRight": 0 * TIME})
    with pytest.raises(InputError, match="pole pairs, with --counts-per-turn 7"):
        drive(path)
    log = drive(path, counts_per_turn=7, at_motor_shaft=True, gear_ratio=20)
    assert log.wheel_speed_rad_s[:, 0] == pytest.approx(speed_rad_s, abs=1e-9)


def test_counts_roll_over(write):
    true = np.array([65000, 65400, 66000, 65500, 65000])
    log = drive(write({"t": TIME, "enc_l": true % 65536, "enc_r": true - 65000}), counts_per_turn=100.0)
    expected = 2 * math.pi / 100 * np.diff(true) / 0.1
    assert log.wheel_speed_rad_s[:, 0] == pytest.approx(expected)
    assert log.wheel_speed_rad_s[:, 1] == pytest.approx(expected)
    assert "'enc_l': a counter of 16 bits rolled over 2 times: undone" in notes(log)
    assert "'enc_r'" not in notes(log).replace("from 'enc_l', 'enc_r'", "")


@pytest.mark.parametrize(
    "counts, bits",
    [([250, 3], 8), ([120, -120], 8), ([65000, 10], 16), ([-32000, 32000], 16), ([2**32 - 5, 4], 32), ([0, 9], None),
     ([100, 200], None), ([5], None)],
)  # fmt: skip
def test_the_width_of_a_counter(counts, bits):
    assert counter_bits(np.array(counts, dtype=float)) == bits


def test_counts_at_a_rate_of_their_own():
    counts = np.array([0.0, np.nan, 10.0, np.nan, 30.0])
    speed, _ = speed_from_counts(counts, TIME, 2 * math.pi)
    assert np.array_equal(np.isfinite(speed), [False, False, True, False, True])
    assert speed[[2, 4]] == pytest.approx([50.0, 100.0])


def test_one_current_of_two_wheels_is_shared(write):
    log = drive(write({"t": TIME, "wl": ONE, "wr": ONE, "curL": ONE, "curR": -ONE}), driven=4)
    assert np.array_equal(log.motor_current_A, np.outer(ONE, [0.5, -0.5, 0.5, -0.5]))
    assert "'curL' is the current of 2 wheels: shared evenly" in notes(log)


def test_magnitudes_of_currents_get_the_sign_of_the_wheel(write):
    log = drive(write({"t": TIME, "wl": ONE, "wr": -ONE, "curL": ONE, "curR": ONE}))
    assert np.array_equal(log.motor_current_A, np.outer(ONE, [1, -1]))
    assert "warning: motor currents are never negative" in notes(log)
    braking = drive(write({"t": TIME, "wl": ONE, "wr": -ONE, "curL": -ONE, "curR": ONE}))
    assert np.array_equal(braking.motor_current_A, np.outer(ONE, [-1, 1]))


def test_rates_stay_apart_but_currents_are_bridged(write):
    some = ["1", "", "3", "", "5"]
    other = ["", "2", "", "4", ""]
    log = drive(write({"t": TIME, "wl": some, "wr": some, "curL": other, "curR": other, "wz": other}))
    assert np.array_equal(np.isfinite(log.wheel_speed_rad_s[:, 0]), [True, False, True, False, True])
    assert log.motor_current_A[1:4, 0] == pytest.approx([2.0, 3.0, 4.0])
    assert np.isnan(log.yaw_rate_rad_s[2])
    assert "straight lines in between" in notes(log)


def test_rows_of_the_same_time_are_one(write):
    log = drive(write({"t": [0, 0, 1, 1], "wl": [1, "", 2, ""], "wr": [3, "", 4, ""], "wz": ["", 5, "", 6]}))
    assert np.array_equal(log.time_s, [0, 1])
    assert np.array_equal(log.yaw_rate_rad_s, [5, 6])


def test_missing_currents_are_nan_and_noted(write):
    log = drive(write({"t": TIME, "wl": ONE, "wr": ONE}))
    assert log.motor_current_A.shape == (5, 2) and np.isnan(log.motor_current_A).all()
    assert "warning: no motor current of front_left, front_right" in notes(log)


def test_recordings_are_chosen(write):
    path = write({"exp": [1, 1, 1, 2], "t": [0, 1, 2, 0], "wl": [1, 2, 3, 4], "wr": [1, 2, 3, 4]})
    assert np.array_equal(drive(path, where={"exp": 2}).wheel_speed_rad_s[:, 0], [4])
    assert np.array_equal(drive(path, where={"recording": 2}).wheel_speed_rad_s[:, 0], [4])
    with pytest.raises(InputError, match=r"holds several recordings.*--where exp=1"):
        drive(path)


@pytest.mark.parametrize(
    "columns, kwargs, message",
    [
        ({"t": TIME, "wl": [1, 2, "x", 4, 5], "wr": ONE}, {}, "line 4, column 'wl': 'x' is not a number"),
        ({"t": TIME, "enc_l": ONE, "enc_r": ONE}, {}, "counts the turns.*--counts-per-turn"),
        ({"t": TIME, "v_l": ONE, "v_r": ONE}, {}, "give the wheels' radius"),
        ({"t": TIME, "wl": ONE, "wr": ONE}, {"radius_m": -1.0}, "radius_m must be"),
        ({"wl": ONE, "wr": ONE}, {}, "no column for the time found"),
        ({"t": TIME, "wl": [""] * 5, "wr": [""] * 5}, {}, "no row has the speed"),
    ],
)
def test_refusals(write, columns, kwargs, message):
    with pytest.raises(InputError, match=message):
        drive(write(columns), **kwargs)


@pytest.mark.parametrize("name, kind", [("imu_yaw", "yaw"), ("compass", "heading")])
def test_an_angle_serves_where_there_is_no_gyro(write, name, kind):
    heading = np.radians([350.0, 0.0, 10.0, 5.0, 0.0])
    log = drive(write({"t": TIME, "wl": ONE, "wr": ONE, name: heading}))
    assert log.yaw_rate_rad_s[1:] == pytest.approx(np.radians([100.0, 100.0, -50.0, -50.0]))
    assert f"the yaw rate is the change of the {kind}" in notes(log) and log.heading_rad is None
    both = drive(write({"t": TIME, "wl": ONE, "wr": ONE, "imu_yaw": heading, "gyro_z": ONE}))
    assert np.array_equal(both.yaw_rate_rad_s, ONE) and both.heading_rad is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_heading_that_counts_clockwise_is_turned_round(write, sign):
    rate = np.array([5.0, 10.0, -5.0, 12.0, 8.0])
    heading = np.cumsum(np.r_[0.0, 0.1 * rate[1:]]) + np.array([0.01, -0.01, 0.0, 0.01, -0.01])
    log = drive(write({"t": TIME, "wl": ONE, "wr": ONE, "gyro_z": rate, "heading_rad": sign * heading}))
    assert log.heading_rad == pytest.approx(heading)
    assert ("counts clockwise" in notes(log)) == (sign < 0)


def test_infinite_values_are_missing_and_noted(write):
    log = drive(write({"t": TIME, "wl": ["1", "inf", "3", "4", "-inf"], "wr": ONE}))
    assert np.array_equal(np.isnan(log.wheel_speed_rad_s[:, 0]), [False, True, False, False, True])
    assert "warning: 2 infinite values of 'wl' treated as missing" in notes(log)


def test_a_speed_that_may_be_the_motors_is_doubted(write):
    path = write({"t": TIME, "m1vel": ONE, "m2vel": ONE})
    assert "otherwise add --motor-shaft" in notes(drive(path, gear_ratio=16.0))
    assert "--motor-shaft" not in notes(drive(path))
    assert "if not" not in notes(drive(path, gear_ratio=16.0, at_motor_shaft=True))


def test_the_time_of_ros_is_seconds_and_nanoseconds(write):
    columns = {"header.stamp.sec": [1_700_000_000] * 3, "header.stamp.nanosec": [0, 20_000_000, 40_000_000]}
    path = write(columns | {"wl": ONE[:3], "wr": ONE[:3]})
    for extra in (None, ()):
        log = drive(path, extra=extra)
        assert log.time_s == pytest.approx([0.0, 0.02, 0.04])
        assert not log.extra
