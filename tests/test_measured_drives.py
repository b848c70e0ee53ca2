"""The benchmarks on measured drives: what they make of the files, and that the car's figures hold."""

import numpy as np
import pytest

from ohmward.logs.drive_log import DriveLog
from scripts import script

real_data, real_car, real_warthog, real_husky, real_sand = map(
    script, ("real_data", "real_car", "real_warthog", "real_husky", "real_sand")
)


def recorded(make):
    """What a benchmark reads, or a skip where its data are absent."""
    try:
        return make()
    except FileNotFoundError as absent:
        pytest.skip(f"{absent} is absent; set OHMWARD_DATA to the folder of the measured data")


def test_a_channel_holds_and_an_event_comes_once():
    at_s = np.array([0.0, 1.0, 2.0, 3.0])
    time_s, values = np.array([0.5, 1.0, 2.25, 3.5]), np.array([5.0, 6.0, 7.0, 8.0])
    assert np.array_equal(real_data.held(time_s, values, at_s), [np.nan, 6, 6, 7], equal_nan=True)
    arrived, age_s = real_data.once(time_s, values, at_s)
    assert np.array_equal(arrived, [np.nan, 6, np.nan, 7], equal_nan=True)
    assert age_s == pytest.approx([0, 0, 0, 0.75])


def test_radius_and_latency_are_found():
    time_s = np.arange(0.0, 30.0, 0.01)
    speed = 12.0 + 4.0 * np.sin(0.5 * time_s)
    gnss = np.where(np.arange(len(time_s)) % 10 == 0, 12.0 + 4.0 * np.sin(0.5 * (time_s - 0.2)), np.nan)
    wheels = np.tile(0.98 * speed / real_car.CAR.wheel.radius_m, (4, 1)).T
    log = DriveLog("car", time_s, wheels, np.full(wheels.shape, np.nan), speed_m_s=gnss, speed_age_s=0 * time_s)
    assert real_car.calibrated(log) == pytest.approx((1 / 0.98, 0.2), rel=1e-3)


def test_the_wheel_in_sand_pulls_when_it_drives_and_drags_when_it_brakes():
    trials = recorded(real_sand.recording)
    assert len(trials.group) == 27 and np.all(trials.data.contact.load_N > 15)
    assert np.all(trials.data.force_N[trials.group > 0.011] > 0)
    assert np.all(trials.data.force_N[trials.group < 0.009] < -5)
    assert np.all(trials.sinkage_m > 0.01)


def test_the_gyro_of_the_skid_steered_robot_is_a_rate():
    windows = recorded(real_warthog.recording)
    turned = windows.gyro_rad_s.mean(axis=1)
    assert np.corrcoef(turned, windows.turn_rad_s)[0, 1] > 0.98


def test_the_turns_of_the_husky_have_the_sign_of_its_gyro():
    runs = [run for run in recorded(lambda: list(real_husky.recordings())) if run.terrain in real_husky.GRIPPING]
    for run in runs:
        seen = np.isfinite(run.turn_rad_s)
        assert run.turn_rad_s[seen] @ run.log.yaw_rate_rad_s[seen] > 0


@pytest.mark.slow
def test_a_car_that_does_not_slip_raises_no_alarm():
    figures = recorded(lambda: list(real_car.rows()))
    assert [f for f in figures if f.met is False] == []
    assert sum(f.met is True for f in figures) >= 12
