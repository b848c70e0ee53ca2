"""Motion of a drive for its energy: an omni-directional robot travels to the side as well."""

import numpy as np
import pytest

from ohmward.energy.drive_record import measured_motion, observe_motion, record_drive
from ohmward.logs import DriveLog, Log
from ohmward.traction import RLMA, ROBOTINO, hard_terrain
from traction.odometry.examples import DT_S, one_side_spins

TIME_S = np.arange(0.0, 20.0, 0.02)
NAN = np.nan


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
def test_travel_in_every_direction_is_driving(direction):
    speed_m_s = 0.3 * (TIME_S > 5.0)
    motion = np.column_stack([*(speed_m_s * d for d in direction), 0.0 * TIME_S])
    wheels = motion @ ROBOTINO.rolling[: ROBOTINO.driven].T / ROBOTINO.wheel.radius_m
    rng = np.random.default_rng(1)
    current_A = 0.3 * np.sign(wheels) + 0.01 * rng.standard_normal(wheels.shape)
    log = DriveLog("drive", TIME_S, wheels + 0.02 * rng.standard_normal(wheels.shape), current_A)
    found = observe_motion(ROBOTINO, log, hard_terrain("dry asphalt"), TIME_S)
    assert np.sum(found.speed_m_s) * 0.02 == pytest.approx(0.3 * 15.0, rel=0.1)
    battery = Log("drive", TIME_S, np.where(speed_m_s > 0.0, -2.0, -0.5), np.full(TIME_S.size, 24.0))
    record = record_drive(battery, found, "carpet")
    driven = [one.stretch for one in record.driven if one.stretch.terrain == "carpet"]
    assert sum(stretch.time_s for stretch in driven) == pytest.approx(15.0, abs=2.0)
    assert record.balance is not None and record.balance.energy.balance.rolling > 1.0


def test_without_motor_currents_wheels_and_gyro_tell_a_side_that_slips():
    """A skid-steered robot at 0.8 m/s, one side of which spins twice."""
    settings, samples, _ = one_side_spins(0, False, np.random.default_rng(4))
    robot, time_s = settings.robot, DT_S * np.arange(len(samples.robot.dt_s))
    wheels, unknown_A = samples.robot.wheel_speed_rad_s, np.full((time_s.size, robot.driven), np.nan)
    drive = DriveLog("drive", time_s, wheels, unknown_A, yaw_rate_rad_s=samples.robot.yaw_rate_rad_s)
    found = observe_motion(robot, drive, hard_terrain("dry asphalt"), time_s)
    assert np.sqrt(np.mean((found.speed_m_s - 0.8) ** 2)) < 0.03


def test_nothing_is_driven_where_the_wheels_were_not_recorded():
    """Wheels from 0 to 5 s and from 65 to 70 s at 0.5 m/s, the battery for two minutes."""
    time_s = np.concatenate([np.arange(0.0, 5.0, 0.02), np.arange(65.0, 70.0, 0.02)])
    wheels = np.full((time_s.size, 4), 0.5 / RLMA.wheel.radius_m)
    current_A = 0.3 + 0.01 * np.random.default_rng(1).standard_normal((time_s.size, 2))
    drive = DriveLog("drive", time_s, wheels, current_A)
    battery = Log("battery", np.arange(0.0, 120.0), np.full(120, -1.0), np.full(120, 24.0))
    record = record_drive(battery, observe_motion(RLMA, drive, hard_terrain("dry asphalt"), battery.time_s), "grass")
    assert sum(d.stretch.distance_m for d in record.driven) < 0.5 * 10.0
    assert all(d.stop_s <= 70.0 for d in record.driven)


def test_the_balance_takes_no_power_from_a_battery_that_was_not_recorded():
    time_s = np.arange(0.0, 60.0, 0.02)
    wheels = np.full((time_s.size, 4), 0.5 / RLMA.wheel.radius_m)
    current_A = 0.3 + 0.01 * np.random.default_rng(1).standard_normal((time_s.size, 2))
    drive = DriveLog("drive", time_s, wheels, current_A)
    battery = Log("battery", np.arange(0.0, 21.0), np.full(21, -1.0), np.full(21, 24.0))
    record = record_drive(battery, observe_motion(RLMA, drive, hard_terrain("dry asphalt"), battery.time_s), "grass")
    assert record.balance is not None
    assert record.balance.energy.balance.battery == pytest.approx(24.0 * 20.0)


@pytest.mark.parametrize(
    ("columns", "unit", "speed_m_s", "grade_rad", "warnings"),
    [
        ({"speed_m_s": [0.5, 1e4], "grade_rad": [0.1, 0.2]}, None, [0.5, NAN], [0.1, 0.2], 1),
        ({"speed_kmh": [1.8, 3.6], "Pitch_deg": [18.0, 0.0]}, None, [0.5, 1.0], [np.pi / 10, 0.0], 0),
        ({"gnss": [1.8, 3.6], "grade_rad": [0.1, 5.0]}, "km/h", [0.5, 1.0], [0.1, NAN], 1),
    ],
)
def test_columns_of_speed_and_slope_have_units_and_limits(columns, unit, speed_m_s, grade_rad, warnings):
    log = Log("drive", np.arange(2.0), -np.ones(2), np.full(2, 24.0), extra=columns)
    found = measured_motion(log, next(iter(columns)), unit)
    np.testing.assert_allclose(found.speed_m_s, speed_m_s)
    assert found.grade_rad is not None
    np.testing.assert_allclose(found.grade_rad, grade_rad)
    assert [note.level for note in found.notes[1:]] == ["warning"] * warnings
