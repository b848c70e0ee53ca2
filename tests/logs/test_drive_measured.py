"""Files of real robots, read as they are: whose names, units and signs nobody here chose."""

import numpy as np
import pytest

from needs import measured_file
from ohmward.errors import InputError
from ohmward.logs import read_drive

FOUR = ("front_left", "front_right", "rear_left", "rear_right")
OMNI = ("wheel_1", "wheel_2", "wheel_3")


def texts(log):
    return " | ".join(map(str, log.notes))


def test_an_omni_robot_with_numbered_motors():
    path = measured_file("robotino_slip_tpu/gray.parquet")
    with pytest.raises(InputError, match=r"several recordings.*--where exp="):
        read_drive(path, OMNI, 3)
    log = read_drive(path, OMNI, 3, gear_ratio=16.0, at_motor_shaft=True, where={"exp": 72}, extra=())
    assert np.median(log.wheel_speed_rad_s, axis=0) == pytest.approx([-3.7, 0.0, 3.7], abs=0.3)
    assert np.median(log.motor_current_A[:, 0]) < 0 < np.median(log.motor_current_A[:, 2])
    assert "read as magnitudes" in texts(log)


def test_a_car_with_the_speed_of_its_rims():
    log = read_drive(measured_file("comma2k19_example/wheel_speed.parquet"), FOUR, 2, radius_m=0.33)
    assert 5.0 < 0.33 * np.median(log.wheel_speed_rad_s) < 40.0
    assert np.isnan(log.motor_current_A).all() and "assumed to be in m/s" in texts(log)


def test_a_skid_steered_robot_with_one_speed_and_current_for_each_side():
    path = measured_file("borealtc_husky_subset/wheel_service.parquet")
    where: dict[str, float | str] = {"terrain": "ASPHALT", "run": 2}
    log = read_drive(path, FOUR, 4, radius_m=0.165, units={"wheel_speed": "m/s"}, where=where)
    assert np.array_equal(log.wheel_speed_rad_s[:, :2], log.wheel_speed_rad_s[:, 2:])
    assert np.array_equal(log.motor_current_A[:, :2], log.motor_current_A[:, 2:])
    assert "shared evenly" in texts(log)


def test_encoders_and_an_imu_by_their_names():
    path = measured_file("norlab_skidsteer/drive_warthog_windows.parquet")
    log = read_drive(path, FOUR, 4, columns={"time": "k"}, where={"window": 100})
    assert log.channels == ("yaw_rate_rad_s", "acceleration_m_s2")
    assert {"cmd_left", "icp_pitch"} <= set(log.extra)
