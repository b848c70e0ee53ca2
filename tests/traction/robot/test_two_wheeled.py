"""Two driven wheels and casters: loads, motion, file, and an observer of its logs."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import DriveLog, read_drive, write_table
from ohmward.traction import (
    Motor,
    Robot,
    TwoWheeled,
    Wheel,
    hard_terrain,
    load_robot,
    save_robot,
    scene,
)
from ohmward.traction.calibration import CalibrationDrive, calibrate
from ohmward.traction.robot.robot import GRAVITY, motion_from_wheels
from ohmward.traction.speed_observer.estimator import SlipEstimator, observe
from ohmward.traction.speed_observer.make_observer import make_observer
from traction.examples import plant

CHASSIS = TwoWheeled(axle_m=0.05, track_m=0.30, casters_m=(-0.15,))
ROBOT = Robot("vacuum", 8.0, 0.15, CHASSIS, Wheel(0.05, 0.03, 2e-4), Motor(0.4, 0.5))
FLOOR = hard_terrain("dry asphalt")


def test_the_loads_balance_about_the_centre_of_gravity():
    loads = ROBOT.mass_kg * GRAVITY * ROBOT.loads[:, 0]
    assert loads.sum() == pytest.approx(8.0 * GRAVITY)
    assert loads[0] == loads[1] == pytest.approx(0.75 / 2 * 8.0 * GRAVITY)  # lever of 0.15 of 0.20 m
    assert loads[2] == pytest.approx(0.25 * 8.0 * GRAVITY)


def test_casters_roll_along_and_are_not_driven():
    assert [p.name for p in ROBOT.places] == ["left", "right", "caster_1"]
    assert (ROBOT.driven, ROBOT.chassis.freedoms) == (2, ("v_m_s", "yaw_rate_rad_s"))
    motion = np.array([0.4, 0.7])
    speeds = ROBOT.rolling @ motion / ROBOT.wheel.radius_m
    assert speeds == pytest.approx(np.array([0.4 - 0.105, 0.4 + 0.105, 0.4]) / 0.05)
    np.testing.assert_allclose(motion_from_wheels(ROBOT, speeds[:2]), motion, rtol=1e-12)


@pytest.mark.parametrize("casters_m", [(), (0.05,), (0.2,), (0.3, 0.1)])
def test_a_robot_that_tips_over_is_refused(casters_m):
    with pytest.raises(InputError, match="or the robot tips over"):
        TwoWheeled(0.05, 0.30, casters_m)


def test_the_robot_file_has_it(tmp_path):
    save_robot(ROBOT, tmp_path / "robot.toml")
    assert 'kind = "two-wheel"' in (tmp_path / "robot.toml").read_text(encoding="utf-8")
    assert load_robot(tmp_path / "robot.toml") == ROBOT


def driven(current_A, seconds=6.0):
    """Our own dynamics, from rest; encoders of 100 Hz and a gyro."""
    rng, t = np.random.default_rng(4), np.arange(0.0, seconds, 0.01)
    _, truth = plant(scene(ROBOT, FLOOR)).scan(np.zeros(4), np.tile(current_A, (t.size, 1)))
    wheels = np.full((t.size, 3), np.nan)
    wheels[:, :2] = truth[:, 2:] + 0.05 * rng.standard_normal((t.size, 2))
    gyro = truth[:, 1] + 0.01 * rng.standard_normal(t.size)
    return DriveLog("two", t, wheels, np.tile(current_A, (t.size, 1)), gyro), truth[:, :2]


@pytest.mark.usefixtures("in_python")
def test_its_speed_is_observed():
    log, truth = driven((0.35, 0.36))
    found = observe(make_observer(ROBOT, log, FLOOR).observer, log).estimates
    error = found.speed_m_s - truth[:, 0]
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert np.mean(np.abs(error) <= 1.96 * found.speed_std_m_s) > 0.9
    live = SlipEstimator(ROBOT)
    now = [live.update(*sample) for sample in zip(log.time_s, log.wheel_speed_rad_s, log.motor_current_A, strict=True)]
    assert now[-1].speed_m_s == pytest.approx(truth[-1, 0], rel=0.05)


def test_its_log_is_read_and_its_track_calibrated(tmp_path):
    t = np.arange(0.0, 8.0, 0.05)
    parts = [(0.4, 0.0), (0.3, 0.8), (0.2, -0.6), (0.0, 1.0)]
    for k, (v, w) in enumerate(parts):
        sides = {"left": (v - 0.16 * w) / 0.051, "right": (v + 0.16 * w) / 0.051}
        columns = {f"{side}_wheel_speed_rad_s": np.full(t.size, speed) for side, speed in sides.items()}
        write_table({"time_s": t, **columns}, tmp_path / f"{k}.csv")
    logs = [read_drive(tmp_path / f"{k}.csv", ROBOT) for k in range(len(parts))]
    drives = [CalibrationDrive(log, np.tile(part, (t.size, 1))) for log, part in zip(logs, parts, strict=True)]
    found = calibrate(drives, ROBOT, parts=("radius", "track")).robot
    assert found.wheel.radius_m == pytest.approx(0.051, rel=1e-9)
    assert isinstance(found.chassis, TwoWheeled)
    assert found.chassis.track_m == pytest.approx(0.32, rel=1e-9)
