from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward_lab.simulate.robot_sensors import (
    Board,
    RobotSensors,
    RobotTruth,
    Sensor,
    measure,
    record,
    sample_board,
    stack,
    wheel_speed,
)

EXACT = Sensor(low=-100.0, high=100.0, resolution=1e-9, noise_std=0.0)
IDEAL = RobotSensors(motor_current=EXACT, gyro=EXACT, accelerometer=EXACT)


def turning(duration_s=1.0, speed_rad_s=4.0, dt_s=0.005) -> RobotTruth:
    """Wheels that turn evenly, the rear ones half as fast, under a torque of 1 and 2 N m."""
    time_s = np.arange(0.0, duration_s + 1e-9, dt_s)
    none = np.zeros((time_s.size, 4))
    speed = none + speed_rad_s * np.array([1.0, 1.0, 0.5, 0.5])
    fields = dict.fromkeys(RobotTruth._fields, none)
    fields |= {
        "time_s": time_s,
        "heading_rad": 0.0 * time_s,
        "grade_rad": 0.0 * time_s,
        "wheel_angle_rad": speed * time_s[:, None],
        "wheel_speed_rad_s": speed,
        "torque_N_m": none + np.array([1.0, 2.0, 0.0, 0.0]),
        "gyro_rad_s": np.tile([0.1, 0.2, 0.3], (time_s.size, 1)),
        "specific_force_m_s2": np.tile([1.0, 2.0, 9.81], (time_s.size, 1)),
    }
    return RobotTruth(**fields)


def at(truth, index):
    return RobotTruth(*(values[index] for values in truth))


def rng():
    return np.random.default_rng(1)


def test_ideal_sensors_show_the_truth():
    reading = measure(at(turning(), 100), IDEAL, rng())
    assert reading.motor_current_A == pytest.approx(np.array([1.0, 2.0]) / IDEAL.torque_constant_N_m_per_A)
    assert reading.gyro_rad_s == pytest.approx([0.1, 0.2, 0.3])
    assert reading.specific_force_m_s2 == pytest.approx([1.0, 2.0, 9.81])


def test_an_encoder_counts_whole_steps_and_forgets_none():
    sensors = replace(IDEAL, counts_per_turn=90)
    counts = np.array([r.encoder_count for r in record(turning(), sensors, rng())])
    true = turning().wheel_angle_rad[::2] * 90 / (2 * np.pi)
    assert counts.dtype.kind == "i"
    assert np.all((true - counts >= 0) & (true - counts < 1))


def test_an_encoder_counts_down_when_the_wheel_turns_back():
    reading = measure(at(turning(speed_rad_s=-4.0), 200), replace(IDEAL, counts_per_turn=100), rng())
    assert reading.encoder_count[0] == np.floor(-4.0 * 100 / (2 * np.pi))


def test_wheel_speed_comes_out_to_within_a_count():
    sensors = replace(IDEAL, counts_per_turn=1000, interval_s=0.1)
    readings = record(turning(), sensors, rng())
    speed = wheel_speed(readings[2], readings[7], sensors)
    assert speed == pytest.approx([4.0, 4.0, 2.0, 2.0], abs=2 * np.pi / 1000 / 0.5)


def test_only_the_wheels_with_an_encoder_or_motor_are_read():
    reading = measure(at(turning(), 50), replace(IDEAL, encoder_wheels=(0, 2), motor_wheels=(1,)), rng())
    assert reading.encoder_count.shape == (2,)
    assert reading.encoder_count[0] > 1.9 * reading.encoder_count[1]
    assert reading.motor_current_A == pytest.approx([2.0 / IDEAL.torque_constant_N_m_per_A])


def test_readings_come_at_the_interval():
    times = [r.time_s for r in record(turning(), replace(IDEAL, interval_s=0.02), rng())]
    assert times == pytest.approx(np.arange(0.0, 1.001, 0.02))


def test_a_late_link_delivers_in_time_and_keeps_the_time_of_the_sample():
    sensors, board, truth = replace(IDEAL, delay_s=0.03), Board(), turning()
    seen = []
    for k in range(truth.time_s.size):
        board, arrived = sample_board(board, at(truth, k), sensors, rng())
        seen += [(truth.time_s[k], r.time_s) for r in arrived]
    now, taken = np.array(seen).T
    assert now - taken == pytest.approx(np.full(now.size, 0.03))
    assert len(board.under_way) == 3


def test_jitter_lets_readings_overtake_but_delivers_each_once():
    readings = record(turning(), replace(IDEAL, jitter_s=0.05), rng())
    times = [r.time_s for r in readings]
    assert times != sorted(times)
    assert len(set(times)) == len(times)
    assert all(r.time_s <= r.arrival_s <= r.time_s + 0.05 for r in readings)


def test_a_lossy_link_loses_its_share():
    readings = record(turning(10.0), replace(IDEAL, drop_share=0.3), rng())
    assert len(readings) / 1001 == pytest.approx(0.7, abs=5 * np.sqrt(0.21 / 1001))
    assert record(turning(), replace(IDEAL, drop_share=1.0), rng()) == []


def test_the_current_has_the_noise_it_states():
    sensors = replace(IDEAL, motor_current=replace(EXACT, noise_std=0.2))
    current = np.array([r.motor_current_A for r in record(turning(20.0), sensors, rng())])
    assert current.std(axis=0) == pytest.approx([0.2, 0.2], rel=5 / np.sqrt(2 * 2001))
    assert abs(np.corrcoef(current.T)[0, 1]) < 5 / np.sqrt(2001)


def test_the_same_generator_gives_the_same_readings():
    sensors = RobotSensors(jitter_s=0.02, drop_share=0.1)
    one, other = (record(turning(), sensors, rng()) for _ in range(2))
    assert [r.arrival_s for r in one] == [r.arrival_s for r in other]
    assert np.array_equal([r.gyro_rad_s for r in one], [r.gyro_rad_s for r in other])


def test_wheel_speed_needs_time_to_pass():
    reading = measure(at(turning(), 3), IDEAL, rng())
    with pytest.raises(InputError, match="after must be taken later than before"):
        wheel_speed(reading, reading, IDEAL)


class Inner(NamedTuple):
    a: Any
    b: Any


class Outer(NamedTuple):
    x: Any
    inner: Inner
    nothing: Any


def test_records_come_back_with_time_in_front():
    back = stack([Outer(np.array([k, k + 1.0, np.nan]), Inner(float(k), np.full((2, 2), k)), None) for k in range(5)])
    assert back.nothing is None
    assert back.x.shape == (5, 3)
    np.testing.assert_array_equal(back.x[3], [3.0, 4.0, np.nan])
    np.testing.assert_array_equal(back.inner.a, np.arange(5.0))
    np.testing.assert_array_equal(back.inner.b[4], np.full((2, 2), 4.0))
