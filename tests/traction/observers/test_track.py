"""Observers over whole drives, live, and through a restart."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from ohmward.errors import InputError
from ohmward.logs import DriveLog
from ohmward.traction import RLMA, ROBOTINO, scene
from ohmward.traction.observers import Estimate, Noise, Sample, SlipEstimator, SpeedObserver, observe
from ohmward.traction.observers.track import first_of, motion_of, samples_of
from ohmward.traction.robot import wheel_speeds
from traction.observers.examples import FLOOR

OBSERVER = SpeedObserver(scene(RLMA, FLOOR), method="ekf")


def drive(steps=40, wheel_speed=2.0, **others):
    time_s = 0.01 * np.arange(steps)
    speed = np.full((steps, 4), math.nan)
    speed[:, :2] = wheel_speed
    return DriveLog("drive", time_s, speed, np.zeros((steps, 2)), **others)


def rows(samples):
    return [Sample(*(values[k] for values in samples)) for k in range(len(samples.dt_s))]


def test_a_drive_at_constant_speed():
    track = observe(OBSERVER, drive(200))
    assert track.estimates.speed_m_s[-1] == pytest.approx(2.0 * RLMA.wheel.radius_m, abs=0.02)
    assert track.estimates.slip_speed_m_s.shape == (200, 2)
    assert set(Estimate._fields) == set(track.estimates._fields)
    assert track.seconds > 0


def test_live_samples_and_a_log_give_the_same():
    log = drive()
    whole = observe(OBSERVER, log).estimates
    live = SlipEstimator(OBSERVER)
    single = [live.update(sample) for sample in rows(samples_of(log, OBSERVER))]
    assert_array_equal([e.speed_m_s for e in single], whole.speed_m_s)
    assert_array_equal([e.slip_speed_std_m_s for e in single], whole.slip_speed_std_m_s)
    assert live.time_s == pytest.approx(log.time_s[-1])


def test_a_log_in_two_parts_is_the_log():
    log = drive()
    estimator = SlipEstimator(OBSERVER)
    parts = [estimator.run(log.select(slice(0, 25))), estimator.run(log.select(slice(25, None)))]
    assert_array_equal(
        np.concatenate([part.estimates.speed_std_m_s for part in parts]), observe(OBSERVER, log).estimates.speed_std_m_s
    )


def test_a_restart_from_a_snapshot_goes_on_to_the_bit():
    log = drive()
    before = SlipEstimator(OBSERVER)
    before.run(log.select(slice(0, 25)))
    after = SlipEstimator(SpeedObserver(scene(RLMA, FLOOR), method="ekf"))
    after.restore(json.loads(json.dumps(before.snapshot(), allow_nan=False)))
    rest = log.select(slice(25, None))
    assert_array_equal(after.run(rest).estimates.speed_m_s, before.run(rest).estimates.speed_m_s)


def test_a_snapshot_of_other_settings_is_refused():
    before = SlipEstimator(OBSERVER)
    with pytest.raises(InputError, match="before the first sample"):
        before.snapshot()
    before.run(drive())
    with pytest.raises(InputError, match="another kind, model or settings"):
        SlipEstimator(SpeedObserver(scene(RLMA, FLOOR), method="ekf", gap_s=0.2)).restore(before.snapshot())


def test_a_log_of_a_robot_with_other_wheels_is_refused():
    with pytest.raises(InputError, match="has 4 wheels and 2 motors, robot 'Robotino' has 3 and 3"):
        observe(SpeedObserver(scene(ROBOTINO, FLOOR)), drive())


def test_a_sensor_that_the_log_lacks_is_nan():
    log = drive(yaw_rate_rad_s=np.full(40, 0.1), speed_m_s=np.full(40, 0.2))
    samples = samples_of(log, OBSERVER)
    assert_array_equal(samples.yaw_rate_rad_s, log.yaw_rate_rad_s)
    assert_array_equal(samples.speed_m_s, log.speed_m_s)
    assert np.isnan(samples.pitch_rad).all() and np.isnan(samples.speed_age_s).all()
    assert_array_equal(samples.dt_s, np.diff(log.time_s, prepend=0.0))


def test_it_starts_from_the_first_speed_that_is_measured():
    log = drive(wheel_speed=np.array([[math.nan, 5.0]] * 3 + [[7.0, 6.0]] * 37))
    first = first_of(samples_of(log, OBSERVER))
    assert_array_equal(first.wheel_speed_rad_s, [7.0, 5.0, math.nan, math.nan])


def test_flags_are_counted():
    log = drive(wheel_speed=np.array([[math.nan, 2.0]] * 3 + [[2.0, 2.0]] * 37))
    assert observe(OBSERVER, log).counts()["no_encoder"] == 3


def test_a_robot_that_turns_on_the_spot_is_not_stuck():
    turning = drive(300, wheel_speed=np.array([[-2.0, 2.0]]))
    rate = 2.0 * RLMA.wheel.radius_m / RLMA.places[0].y_m
    gyro = SpeedObserver(scene(RLMA, FLOOR), method="ekf", noise=Noise(gyro_std_rad_s=0.01, speed_std_m_s=0.01))
    whole = {"yaw_rate_rad_s": np.full(300, rate), "speed_m_s": np.zeros(300)}
    assert not observe(gyro, replace(turning, **whole)).estimates.immobilised.any()


def test_the_motion_of_an_omni_robot_has_three_parts():
    true = np.array([0.1, -0.2, 0.3])
    wheels = np.tile(wheel_speeds(ROBOTINO, true), (200, 1))
    log = DriveLog("omni", 0.01 * np.arange(200), wheels, np.zeros((200, 3)))
    estimates = observe(SpeedObserver(scene(ROBOTINO, FLOOR), method="ekf"), log).estimates
    motion = motion_of(ROBOTINO, estimates)
    assert motion[:, 0] == pytest.approx(estimates.speed_m_s, abs=1e-9)
    assert motion[:, 2] == pytest.approx(estimates.yaw_rate_rad_s, abs=1e-9)
    assert motion[-1] == pytest.approx(true, abs=0.02)
