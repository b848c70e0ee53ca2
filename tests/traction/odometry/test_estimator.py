"""Odometry live, over logs, with a speed observer, and through a restart."""

import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ohmward import DriveLog, InputError, SlipEstimator
from ohmward.filters.belief import unpack
from ohmward.filters.consistency import BAND_95
from ohmward.traction import RLMA, Odometry, hard_terrain
from ohmward.traction.odometry.model import TURN_SCALE
from ohmward.traction.odometry.sample import OdometryFlag
from ohmward.traction.robot.packaged import generic_robot
from ohmward.traction.speed_observer.make_observer import make_observer


def log(steps=300, **others):
    time_s = 0.02 * np.arange(steps)
    wheels = 3.0 + np.outer(np.sin(time_s), [-1, 1, -1, 1])
    current_A = np.full((steps, 2), 0.5)
    return DriveLog("drive", time_s, wheels, current_A, yaw_rate_rad_s=0.8 * np.sin(time_s) + 0.01, **others)


def test_live_samples_give_what_a_log_gives_and_go_on_after_a_restart():
    drive = log()
    run = Odometry(RLMA).run(drive)
    live = Odometry(RLMA)
    gyro = np.asarray(drive.yaw_rate_rad_s)
    for k in range(len(drive)):
        now = live.update(drive.time_s[k], drive.wheel_speed_rad_s[k], gyro[k])
        if k == 100:
            live = Odometry.restore(live.settings, json.loads(json.dumps(live.snapshot())))
    assert_allclose([now.x_m, now.y_m, now.yaw_rad], [run.x_m[-1], run.y_m[-1], run.yaw_rad[-1]], rtol=1e-9)
    assert_allclose(now.pose_cov, run.pose_cov[-1], rtol=1e-9)
    assert "Odometry(RLMA, at (" in repr(live)


def test_an_observer_takes_the_slip_out():
    """Driven wheels spin for a second; the passive ones tell the observer, and the odometry alone too."""
    drive = log()
    wheels = np.array(drive.wheel_speed_rad_s)
    wheels[:] = 3.0
    wheels[100:150, :2] = 9.0
    spin = DriveLog("spin", drive.time_s, wheels, drive.motor_current_A, yaw_rate_rad_s=np.zeros(300))
    observer = make_observer(RLMA, spin, hard_terrain("dry asphalt"), "ekf").observer
    slip = SlipEstimator(observer).run(spin)
    way_m = 3.0 * RLMA.wheel.radius_m * spin.time_s[-1]
    with_observer = Odometry(RLMA).run(spin, observed=slip.estimates)
    alone = Odometry(RLMA).run(spin)
    without = wheels.copy()
    without[:, 2:] = np.nan
    blind = Odometry(RLMA).run(DriveLog("blind", spin.time_s, without, spin.motor_current_A))
    assert with_observer.x_m[-1] == pytest.approx(way_m, abs=0.1)
    assert alone.x_m[-1] == pytest.approx(way_m, rel=1e-9)
    assert blind.x_m[-1] > way_m + 0.3
    live, slips = Odometry(RLMA), SlipEstimator(observer)
    for k in range(300):
        observed = slips.update(spin.time_s[k], wheels[k], spin.motor_current_A[k], 0.0)
        now = live.update(spin.time_s[k], wheels[k], 0.0, observed=observed)
    assert now.x_m == pytest.approx(with_observer.x_m[-1], abs=1e-3)


def drive_without_currents(step_s, encoder_std_rad_s, speed_every_s=None):
    """Stop and go for two minutes by wheels and a gyro with an offset of 0.01 rad/s, and the turn that it makes."""
    rng = np.random.default_rng(4)
    time_s = np.arange(0.0, 120.0, step_s)
    drives = (time_s > 5.0) & (time_s % 30.0 < 24.0)
    speed_m_s, yaw_rad_s = 0.5 * drives, 0.4 * np.sin(0.2 * time_s) * drives
    wheels = np.full((time_s.size, len(RLMA.places)), np.nan)
    motion = np.column_stack([speed_m_s, yaw_rad_s])
    wheels[:, : RLMA.driven] = motion @ RLMA.rolling[: RLMA.driven].T / RLMA.wheel.radius_m
    wheels += encoder_std_rad_s * rng.standard_normal(wheels.shape)
    gyro = yaw_rad_s + 0.01 + 0.003 * rng.standard_normal(time_s.size)
    outside = np.full(time_s.size, np.nan)
    if speed_every_s:
        every = round(speed_every_s / step_s)
        outside[::every] = speed_m_s[::every]
    nothing = np.full((time_s.size, RLMA.driven), np.nan)
    drive = DriveLog("no currents", time_s, wheels, nothing, yaw_rate_rad_s=gyro, speed_m_s=outside)
    return drive, float(np.sum(yaw_rad_s) * step_s)


@pytest.mark.parametrize("step_s, encoder_std_rad_s", [(0.02, 0.0), (0.02, 0.05), (0.2, 0.0)])
@pytest.mark.parametrize("speed_every_s", [None, 1.0])
def test_an_observer_without_motor_currents_adds_nothing(step_s, encoder_std_rad_s, speed_every_s):
    """Its wide bands would keep wheels and gyro from being compared, and the gyro's offset from being learnt."""
    drive, turned_rad = drive_without_currents(step_s, encoder_std_rad_s, speed_every_s)
    observed = SlipEstimator(RLMA, filter="ekf", lowering="machine").run(drive).estimates
    run, alone = (Odometry(RLMA, "machine").run(drive, given) for given in (observed, None))
    assert_allclose(run.x_m, alone.x_m, atol=1e-12)
    assert_allclose(run.pose_cov, alone.pose_cov, atol=1e-15)
    assert run.gyro_offset_rad_s[-1] == pytest.approx(0.01, abs=0.003)
    assert run.yaw_rad[-1] == pytest.approx(turned_rad, abs=0.2)
    assert np.sqrt(run.pose_cov[-1, 2, 2]) < 0.2


def test_live_an_observer_without_motor_currents_adds_nothing_either():
    drive, _ = drive_without_currents(0.05, 0.0, speed_every_s=1.0)
    slip, live, alone = SlipEstimator(RLMA, filter="ekf"), Odometry(RLMA), Odometry(RLMA)
    for k in range(400):
        speeds, gyro, outside = drive.wheel_speed_rad_s[k], drive.yaw_rate_rad_s[k], drive.speed_m_s[k]
        observed = slip.update(drive.time_s[k], speeds, None, gyro, speed_m_s=outside)
        now = live.update(drive.time_s[k], speeds, gyro, speed_m_s=outside, observed=observed)
        expected = alone.update(drive.time_s[k], speeds, gyro, speed_m_s=outside)
    for value, other in zip(now, expected, strict=True):
        assert_allclose(value, other, atol=1e-12)


def test_wheels_and_gyro_go_on_where_the_motor_currents_stop():
    """The observer knows the motion for half of the drive; without currents its slip is anything again."""
    drive = log()
    currents = np.array(drive.motor_current_A)
    currents[150:] = np.nan
    halved = DriveLog("halved", drive.time_s, drive.wheel_speed_rad_s, currents, yaw_rate_rad_s=drive.yaw_rate_rad_s)
    run = Odometry(RLMA).run(halved, SlipEstimator(RLMA, filter="ekf").run(halved).estimates)
    alone = Odometry(RLMA).run(halved)
    assert run.x_m[-1] - run.x_m[200] == pytest.approx(alone.x_m[-1] - alone.x_m[200], abs=0.02)


def test_bad_samples_are_flagged_and_bad_calls_refused():
    odometry = Odometry("rlma")
    assert odometry.update(0.0, [1.0, 1.0], 0.0).flags == 0
    assert odometry.update(0.02, [math.nan, 1.0]).flags == 0  # slower than the samples: the last ones hold
    assert odometry.update(7200.0, None).flags & OdometryFlag.BAD_TIME
    with pytest.raises(InputError, match="increment must have the shape"):
        odometry.update(0.1, [1.0, 1.0], increment=[1.0])
    with pytest.raises(InputError, match="has 2 wheels and 2 motors, robot 'RLMA' has 4"):
        Odometry(RLMA).run(DriveLog("other", np.arange(3.0), np.ones((3, 2)), np.ones((3, 2))))
    slip = SlipEstimator(RLMA, filter="ekf").run(log(50))
    with pytest.raises(InputError, match="observed must have the 300 samples"):
        Odometry(RLMA).run(log(), observed=slip.estimates)


@pytest.mark.parametrize("rate_hz", [5, 20])
def test_the_band_holds_the_speed_though_counts_give_the_mean_since_the_last(rate_hz):
    t, count_rad = np.arange(0.0, 30.0, 1.0 / rate_hz), 2.0 * np.pi / 4096
    way_m, speed_m_s = 0.5 * t - 0.5 * np.cos(0.8 * t), 0.5 + 0.4 * np.sin(0.8 * t)
    angle_rad = np.round(way_m / 0.08 / count_rad) * count_rad
    wheels = np.full((t.size, 3), np.nan)
    wheels[1:, :2] = rate_hz * np.diff(angle_rad)[:, None]
    log = DriveLog(
        "counts", t, wheels, np.full((t.size, 2), np.nan), 0.003 * np.random.default_rng(1).normal(size=t.size)
    )
    found = Odometry(generic_robot(15.0, 0.08, 0.36, 0.4)).run(log).estimates
    inside = np.abs(found.speed_m_s - speed_m_s) <= BAND_95 * np.sqrt(found.twist_cov[:, 0, 0])
    assert inside[10:].mean() > 0.95


def test_a_robot_that_turns_on_while_its_wheels_stand_does_not_spoil_the_scale_of_the_turn():
    """Fixed wheels show 1.5 times the turn; where they start and stop, the robot follows within 0.8 s."""
    t = np.arange(0.0, 40.0, 0.2)
    phase, way = t % 8.0, np.where(t // 8.0 % 2.0, -1.5, 1.5)
    going = np.where(phase < 4.0, phase / 0.8, 1.0 - (phase - 4.0) / 0.8).clip(0.0, 1.0)
    side_m_s = 0.58 * way * (phase < 4.0)
    wheels = (0.8 + np.outer(side_m_s, [-1.0, 1.0, -1.0, 1.0])) / 0.3
    gyro = way * going / 1.5 + 0.003 * np.random.default_rng(0).standard_normal(t.size)
    odometry = Odometry(generic_robot(280.0, 0.3, 1.16, 0.9, layout="skid-steer"))
    odometry.run(DriveLog("turns", t, wheels, np.full(wheels.shape, np.nan), gyro))
    belief = unpack(odometry.state.belief)
    std = np.sqrt(belief.cov[TURN_SCALE, TURN_SCALE])
    assert belief.mean[TURN_SCALE] == pytest.approx(1.0 / 1.5 - 1.0, abs=2.0 * std)
    assert std < 0.2


def test_a_robot_that_is_carried_while_its_wheels_stand_is_not_where_they_say():
    t = np.arange(0.0, 40.0, 0.05)
    carried, speed_m_s = (t > 20.0) & (t < 30.0), np.where(t < 10.0, 0.0, 0.5)
    wheels = np.full((t.size, 3), np.nan)
    wheels[:, :2] = np.where(carried, 0.0, speed_m_s / 0.08)[:, None]
    gyro = np.where(carried, 0.4, 0.0) + 0.003 * np.random.default_rng(1).normal(size=t.size)
    log = DriveLog("carried", t, wheels, np.full((t.size, 2), np.nan), gyro)
    found = Odometry(generic_robot(15.0, 0.08, 0.36, 0.4)).run(log).estimates
    inside = np.abs(found.speed_m_s - speed_m_s) <= BAND_95 * np.sqrt(found.twist_cov[:, 0, 0])
    assert inside[carried][40:].all() and inside[~carried].mean() > 0.95
    yaw = np.cumsum(np.where(carried, 0.4, 0.0)) * 0.05
    pose = np.array([np.sum(speed_m_s * np.cos(yaw)), np.sum(speed_m_s * np.sin(yaw))]) * 0.05
    error = np.array([found.x_m[-1], found.y_m[-1]]) - pose
    assert error @ np.linalg.solve(found.pose_cov[-1, :2, :2], error) < 6.0
    assert found.position_std_m[t > 19.0][0] < 0.5 and abs(found.yaw_rad[-1] - yaw[-1]) < 0.05
