"""Observers over whole drives, live, and through a restart."""

import json
import math
import pickle
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ohmward.errors import InputError
from ohmward.logs import DriveLog
from ohmward.traction import RLMA, ROBOTINO, scene
from ohmward.traction.motion.sample import RobotSample, samples_of
from ohmward.traction.odometry.estimator import Odometry
from ohmward.traction.robot.packaged import generic_robot
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipFlag
from ohmward.traction.speed_observer.estimator import SlipEstimator, motion_of, observe
from ohmward.traction.speed_observer.make_observer import default_observer
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import KNOWN_GROUND
from traction.speed_observer.examples import FLOOR

OBSERVER = SpeedObserver(scene(RLMA, FLOOR), method="ekf")


def drive(steps=40, wheel_speed=2.0, **others):
    time_s = 0.01 * np.arange(steps)
    speed = np.full((steps, 4), math.nan)
    speed[:, :2] = wheel_speed
    return DriveLog("drive", time_s, speed, np.zeros((steps, 2)), **others)


def test_a_gyro_that_repeats_a_number_turns_nothing_once_it_is_found():
    time_s = 0.01 * np.arange(1000)
    turn = 0.5 * np.sin(time_s)
    speed = np.column_stack([np.full(time_s.size, 0.5), turn]) @ RLMA.rolling.T / RLMA.wheel.radius_m
    log = drive(time_s.size, speed[:, :2], yaw_rate_rad_s=np.full(time_s.size, 0.01))
    observer = replace(OBSERVER, noise=ObserverNoise(gyro_std_rad_s=0.01))
    e = observe(observer, log).estimates
    assert np.abs(e.yaw_rate_rad_s - turn)[time_s > 4.0].max() < 0.05
    assert (e.flags.astype(int)[time_s > 4.0] & SlipFlag.GYRO_REJECTED).all()


def rows(samples):
    return [RobotSample(*(values[k] for values in samples)) for k in range(len(samples.dt_s))]


def test_a_drive_at_constant_speed():
    track = observe(OBSERVER, drive(200))
    assert track.estimates.speed_m_s[-1] == pytest.approx(2.0 * RLMA.wheel.radius_m, abs=0.02)
    assert track.estimates.slip_speed_m_s.shape == (200, 2)
    assert set(SlipEstimate._fields) == set(track.estimates._fields)
    assert track.seconds > 0


def faulty_drive(steps=400):
    """Wheels that spin, every sensor, steps of 5 to 15 ms; every value is missing now and then, one step is a gap."""
    rng = np.random.default_rng(3)
    time_s = np.cumsum(rng.uniform(0.005, 0.015, steps))
    time_s[steps // 2 :] += 3.0
    speed = np.full((steps, 4), math.nan)
    speed[:, :2] = (3 + np.sin(3 * time_s))[:, None] + 0.05 * rng.standard_normal((steps, 2))
    speed[100:130, 0] += 8.0
    current = 0.4 + np.cos(3 * time_s)[:, None] + 0.1 * rng.standard_normal((steps, 2))
    others = {
        "yaw_rate_rad_s": 0.02 * rng.standard_normal(steps),
        "pitch_rad": 0.03 + 0.01 * rng.standard_normal(steps),
        "acceleration_m_s2": 0.3 + 0.1 * rng.standard_normal(steps),
        "speed_m_s": 0.36 + 0.05 * rng.standard_normal(steps),
    }
    speed[:, :2][rng.random((steps, 2)) < 0.1] = math.nan
    current[rng.random((steps, 2)) < 0.1] = math.nan
    for values in others.values():
        values[rng.random(steps) < 0.5] = math.nan
    return DriveLog("faulty", time_s, speed, current, **others)


EVERYTHING = ObserverNoise(gyro_std_rad_s=0.02, pitch_std_rad=0.01, speed_std_m_s=0.05)
OBSERVERS = {
    "default": SpeedObserver(scene(RLMA, FLOOR)),
    "ekf": OBSERVER,
    "aukf of known ground": SpeedObserver(scene(RLMA, FLOOR), KNOWN_GROUND, matching=True),
    "every sensor": SpeedObserver(scene(RLMA, FLOOR), method="ekf", noise=EVERYTHING),
}
#: A rounding error of the slip times the slope of the traction over it, some 1e3 N s/m; else it is 1e-9.
ROUNDING = {"traction_N": 1e-6}
each = pytest.mark.parametrize("observer", OBSERVERS.values(), ids=OBSERVERS.keys())


def live_estimates(estimator, log):
    estimates = map(estimator.step, rows(samples_of(log, estimator.observer.scene.robot)))
    return SlipEstimate(*map(np.array, zip(*estimates, strict=True)))


@each
@pytest.mark.parametrize("lowering", ["python", "machine"])
def test_live_samples_and_a_log_give_the_same(observer, lowering):
    log, live = faulty_drive(80), SlipEstimator(observer, lowering)
    whole = SlipEstimator(observer, lowering).run(log)
    for found, expected in zip(live_estimates(live, log), whole.estimates, strict=True):
        assert_array_equal(found, expected)
    assert live.time_s == pytest.approx(log.time_s[-1] - log.time_s[0])


@each
def test_machine_code_is_python_live_and_from_a_log_that_has_every_fault(observer):
    log = faulty_drive()
    in_python, in_machine_code = (SlipEstimator(observer, lowering) for lowering in ("python", "machine"))
    expected, found = in_python.run(log), in_machine_code.run(log)
    assert {"gap", "no_current", "no_encoder", "ground_changed"} <= expected.counts().keys()
    assert found.counts() == expected.counts()
    for name in SlipEstimate._fields:
        f, e = getattr(found.estimates, name), getattr(expected.estimates, name)
        assert_allclose(f, e, rtol=1e-9, atol=ROUNDING.get(name, 1e-9), err_msg=name)
    for name, value in in_python.snapshot()["state"].items():
        assert in_machine_code.snapshot()["state"][name] == pytest.approx(value, rel=1e-9, abs=1e-9), name
    rest = faulty_drive(60)
    pairs = zip(live_estimates(in_machine_code, rest), live_estimates(in_python, rest), strict=True)
    for name, (f, e) in zip(SlipEstimate._fields, pairs, strict=True):
        assert_allclose(f, e, rtol=1e-9, atol=ROUNDING.get(name, 1e-9), err_msg=name)


@pytest.mark.parametrize("lowering", ["python", "machine"])
def test_a_sample_of_another_robot_is_refused_and_the_state_stays(lowering):
    live, sample = SlipEstimator(OBSERVER, lowering), rows(samples_of(drive(), OBSERVER.scene.robot))[0]
    live.step(sample)
    before = live.snapshot()
    with pytest.raises(InputError, match=r"wheel_speed_rad_s must have the shape \(4,\) .* got \(3,\)"):
        live.step(sample._replace(wheel_speed_rad_s=np.zeros(3)))
    assert live.snapshot() == before
    live.step(sample)


def test_the_clock_stands_where_a_step_cannot_be_true():
    live, sample = SlipEstimator(OBSERVER), rows(samples_of(drive(), OBSERVER.scene.robot))[0]
    for dt_s in (0.5, math.nan, math.inf, -1.0, 1e9, 0.25):
        live.step(sample._replace(dt_s=dt_s))
    assert live.time_s == 0.75
    json.dumps(live.snapshot(), allow_nan=False)


@pytest.mark.parametrize("lowering", ["python", "machine"])
def test_a_live_restart_goes_on_to_the_bit(lowering):
    samples = rows(samples_of(faulty_drive(60), OBSERVER.scene.robot))
    before = SlipEstimator(OBSERVER, lowering)
    for sample in samples[:30]:
        before.step(sample)
    taken = json.loads(json.dumps(before.snapshot(), allow_nan=False))
    after = SlipEstimator.restore(OBSERVER, taken, lowering=lowering)
    for sample in samples[30:]:
        for found, expected in zip(after.step(sample), before.step(sample), strict=True):
            assert_array_equal(found, expected)
    assert after.snapshot() == before.snapshot()


MECANUM = generic_robot(30.0, 0.1, 0.5, 0.5, layout="mecanum")
SCRUBBING = generic_robot(30.0, 0.1, 0.5, 0.5, layout="skid-steer")


def unforced(robot, steps=60, hz=20.0):
    """A robot without motor currents that speeds up and turns, with a gyro that has an offset."""
    rng = np.random.default_rng(4)
    time_s = np.arange(steps) / hz
    motion = np.zeros((steps, robot.freedoms))
    motion[:, 0] = np.minimum(time_s, 1.0)
    motion[:, -1] = 0.2 * np.sin(time_s)
    wheels = (robot.rolling @ motion.T).T / robot.wheel.radius_m
    gyro = motion[:, -1] + 0.01 + 0.003 * rng.standard_normal(steps)
    nothing = np.full((steps, robot.driven), math.nan)
    return DriveLog("unforced", time_s, wheels, nothing, yaw_rate_rad_s=gyro)


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize("robot", [RLMA, MECANUM, SCRUBBING], ids=["differential", "mecanum", "skid-steer"])
def test_without_motor_currents_speed_and_slip_are_those_of_the_odometry(robot):
    log = unforced(robot)
    if robot is SCRUBBING:
        log = replace(log, motor_current_A=np.ones_like(log.motor_current_A))  # they drag the wheels sideways
    run, path = SlipEstimator(robot, filter="ekf").run(log), Odometry(robot).run(log)
    live, pose = SlipEstimator(robot, filter="ekf"), Odometry(robot)
    for k, (wheels, gyro) in enumerate(zip(log.wheel_speed_rad_s, log.yaw_rate_rad_s, strict=True)):
        now = live.update(log.time_s[k], wheels, log.motor_current_A[k], gyro)
        expected = pose.update(log.time_s[k], wheels, gyro)
        assert now.speed_m_s == expected.speed_m_s
        assert now.speed_std_m_s == math.sqrt(expected.twist_cov[0, 0])
        assert_array_equal(now.slip_speed_m_s, expected.slip_speed_m_s)
    assert_allclose(run.estimates.speed_m_s, path.estimates.speed_m_s, rtol=1e-12)
    assert live.last is now
    assert abs(now.speed_m_s - 1.0) < 0.01


def test_the_first_motor_current_ends_the_estimate_by_the_odometry():
    log = unforced(RLMA)
    log = replace(log, motor_current_A=np.where(log.time_s[:, None] < 1.5, math.nan, [0.5, 0.5]))
    run, alone = (
        SlipEstimator(RLMA, filter="ekf").run(log),
        SlipEstimator(default_observer(RLMA, filter="ekf")).run(log),
    )
    same = run.estimates.speed_std_m_s == alone.estimates.speed_std_m_s
    assert_array_equal(same, log.time_s >= 1.5)


@pytest.mark.usefixtures("in_python")
def test_without_motor_currents_a_restart_and_a_copy_go_on_to_the_bit():
    samples = rows(samples_of(unforced(RLMA), RLMA))
    before = SlipEstimator(RLMA, filter="ekf")
    for sample in samples[:30]:
        before.step(sample)
    taken = json.loads(json.dumps(before.snapshot(), allow_nan=False))
    others = [SlipEstimator.restore(RLMA, taken, filter="ekf"), copy(before), pickle.loads(pickle.dumps(before))]
    for sample in samples[30:]:
        expected = before.step(sample)
        for other in others:
            for found, value in zip(other.step(sample), expected, strict=True):
                assert_array_equal(found, value)


def test_an_unknown_radius_widens_the_sigmas_of_speed_and_slip():
    sure, unsure = (
        SpeedObserver(scene(RLMA, FLOOR), KNOWN_GROUND, noise=ObserverNoise(radius_std=s)) for s in (1e-12, 0.02)
    )
    assert not unsure.states.radius
    narrow, wide = (observe(observer, drive()).estimates for observer in (sure, unsure))
    more = 0.02 * RLMA.wheel.radius_m * np.abs(narrow.wheel_speed_rad_s)
    assert_allclose(wide.slip_speed_std_m_s, np.hypot(narrow.slip_speed_std_m_s, more), rtol=1e-12)
    assert_allclose(wide.speed_std_m_s, np.hypot(narrow.speed_std_m_s, more.max(axis=1)), rtol=1e-12)


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
    alike = SpeedObserver(scene(RLMA, FLOOR), method="ekf")
    after = SlipEstimator.restore(alike, json.loads(json.dumps(before.snapshot(), allow_nan=False)))
    rest = log.select(slice(25, None))
    assert_array_equal(after.run(rest).estimates.speed_m_s, before.run(rest).estimates.speed_m_s)


def test_a_snapshot_of_other_settings_is_refused():
    before = SlipEstimator(OBSERVER)
    with pytest.raises(InputError, match="before the first sample"):
        before.snapshot()
    before.run(drive())
    with pytest.raises(InputError, match="another kind, model or settings"):
        SlipEstimator.restore(SpeedObserver(scene(RLMA, FLOOR), method="ekf", gap_s=0.2), before.snapshot())


def test_a_log_of_a_robot_with_other_wheels_is_refused():
    with pytest.raises(InputError, match="has 4 wheels and 2 motors, robot 'Robotino' has 3 and 3"):
        observe(SpeedObserver(scene(ROBOTINO, FLOOR)), drive())


def test_a_sensor_that_the_log_lacks_is_nan():
    log = drive(yaw_rate_rad_s=np.full(40, 0.1), speed_m_s=np.full(40, 0.2))
    samples = samples_of(log, OBSERVER.scene.robot)
    assert_array_equal(samples.yaw_rate_rad_s, log.yaw_rate_rad_s)
    assert_array_equal(samples.speed_m_s, log.speed_m_s)
    assert np.isnan(samples.pitch_rad).all() and np.isnan(samples.speed_age_s).all()
    assert_array_equal(samples.dt_s, np.diff(log.time_s, prepend=0.0))


def test_a_wheel_counts_from_the_first_speed_that_it_shows():
    log = drive(wheel_speed=np.array([[math.nan, math.nan]] * 3 + [[math.nan, 7.0]] * 2 + [[7.0, 7.0]] * 35))
    estimates = observe(OBSERVER, log).estimates
    assert estimates.speed_m_s[:3] == pytest.approx(0.0, abs=1e-6)
    assert estimates.speed_m_s[5:] == pytest.approx(7.0 * RLMA.wheel.radius_m, abs=0.02)
    assert not (estimates.flags[5:].astype(int) & ~SlipFlag.STANDSTILL).any()


def test_flags_are_counted():
    log = drive(wheel_speed=np.array([[math.nan, 2.0]] * 3 + [[2.0, 2.0]] * 37))
    assert observe(OBSERVER, log).counts()["no_encoder"] == 3


def test_a_robot_that_turns_on_the_spot_is_not_stuck():
    turning = drive(300, wheel_speed=np.array([[-2.0, 2.0]]))
    rate = 2.0 * RLMA.wheel.radius_m / RLMA.places[0].y_m
    gyro = SpeedObserver(scene(RLMA, FLOOR), method="ekf", noise=ObserverNoise(gyro_std_rad_s=0.01, speed_std_m_s=0.01))
    whole = {"yaw_rate_rad_s": np.full(300, rate), "speed_m_s": np.zeros(300)}
    assert not observe(gyro, replace(turning, **whole)).estimates.immobilised.any()


def test_the_motion_of_an_omni_robot_has_three_parts():
    true = np.array([0.1, -0.2, 0.3])
    wheels = np.tile(ROBOTINO.rolling @ true / ROBOTINO.wheel.radius_m, (200, 1))
    log = DriveLog("omni", 0.01 * np.arange(200), wheels, np.zeros((200, 3)))
    estimates = observe(SpeedObserver(scene(ROBOTINO, FLOOR), method="ekf"), log).estimates
    motion = motion_of(ROBOTINO, estimates)
    assert motion[:, 0] == pytest.approx(estimates.speed_m_s, abs=1e-9)
    assert motion[:, 2] == pytest.approx(estimates.yaw_rate_rad_s, abs=1e-9)
    assert motion[-1] == pytest.approx(true, abs=0.02)


@pytest.mark.parametrize("with_pitch", [False, True])
def test_a_long_slope_stays_in_the_band_of_the_grade(with_pitch, grade_rad=0.1):
    """Half a metre a second uphill for six minutes: the force may be a slope or a resistance; only a pitch tells."""
    rng = np.random.default_rng(1)
    time_s = 0.02 * np.arange(20_000)
    speed_m_s = 0.5 * np.clip(time_s / 3.0, 0.0, 1.0)
    uphill = time_s > 40.0
    force_N = RLMA.mass_kg * (np.gradient(speed_m_s, time_s) + GRAVITY * math.sin(grade_rad) * uphill)
    current_A = RLMA.wheel.radius_m * force_N / RLMA.driven / RLMA.motor.wheel_constant_Nm_per_A
    wheels = speed_m_s[:, None] / RLMA.wheel.radius_m + 0.005 * rng.standard_normal((20_000, 4))
    log = DriveLog(
        "uphill",
        time_s,
        wheels,
        current_A[:, None] + 0.05 * rng.standard_normal((20_000, 2)),
        yaw_rate_rad_s=0.002 * rng.standard_normal(20_000),
        pitch_rad=grade_rad * uphill + 0.003 * rng.standard_normal(20_000) if with_pitch else None,
    )
    run = SlipEstimator(RLMA).run(log)
    late = time_s > 70.0
    error = np.abs(run.grade_rad - grade_rad)[late]
    assert np.all(error < 2.5 * run.grade_std_rad[late])
    assert run.grade_std_rad[-1] < (0.005 if with_pitch else 0.07)
