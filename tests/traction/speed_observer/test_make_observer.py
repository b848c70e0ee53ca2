"""An observer that fits what a log has, with noise that is measured where it can be."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import DriveLog
from ohmward.traction import RLMA, SkidSteer, hard_terrain
from ohmward.traction.odometry.pose_filter import pose_filter
from ohmward.traction.odometry.slip import SlipByOdometry
from ohmward.traction.robot.packaged import generic_robot
from ohmward.traction.speed_observer.estimator import observe
from ohmward.traction.speed_observer.make_observer import (
    correlation,
    default_observer,
    encoder_std_rad_s,
    make_observer,
    quantum,
    speed_std_m_s,
    yaw_rate_of_wheels,
)

TERRAIN = hard_terrain("dry asphalt")
TIME = 0.01 * np.arange(1000)
RNG = np.random.default_rng(2)
SKID = replace(RLMA, chassis=SkidSteer(0.314, 0.314, 0.30))


def drive(robot=RLMA, currents=True, passive=False, **body):
    speed = 0.3 + 0.1 * np.sin(TIME)
    wheels = np.repeat((speed / robot.wheel.radius_m)[:, None], 4, axis=1) + 0.03 * RNG.standard_normal((TIME.size, 4))
    if not passive:
        wheels[:, robot.driven :] = math.nan
    current = np.full((TIME.size, robot.driven), 0.5 if currents else math.nan)
    return DriveLog("drive", TIME, wheels, current, **body)


def chosen(log, robot=RLMA, name="ukf"):
    return make_observer(robot, log, TERRAIN, name)


@pytest.mark.parametrize(
    "name, method, matching",
    [("ekf", "ekf", False), ("aekf", "ekf", True), ("ukf", "ukf", False), ("aukf", "ukf", True)],
)
def test_filters_by_name(name, method, matching):
    observer = chosen(drive(), name=name).observer
    assert (observer.method, observer.matching) == (method, matching)


def test_an_unknown_filter_is_refused():
    with pytest.raises(InputError, match="filter must be one of ekf, aekf, ukf, aukf, got 'kf'"):
        chosen(drive(), name="kf")


def test_a_log_without_driven_wheels_is_refused():
    log = drive(passive=True)
    speeds = np.array(log.wheel_speed_rad_s)
    speeds[:, :2] = math.nan
    with pytest.raises(InputError, match="log 'drive' has no speed of a driven wheel"):
        chosen(replace(log, wheel_speed_rad_s=speeds))


@pytest.mark.parametrize("steps", [1, 2, 3])
@pytest.mark.parametrize("robot", [RLMA, SKID])
def test_logs_that_are_nearly_empty(robot, steps):
    log = drive(robot, speed_m_s=np.zeros(TIME.size), yaw_rate_rad_s=np.zeros(TIME.size)).select(slice(0, steps))
    assert np.isfinite(observe(chosen(log, robot, "ekf").observer, log).estimates.speed_std_m_s).all()


@pytest.mark.parametrize(
    "robot, currents, gyro, words",
    [
        (RLMA, False, False, ["no motor currents and no gyro"]),
        (RLMA, False, True, ["no motor currents: wheels and gyro"]),
        (SKID, True, True, ["skid-steered"]),
        (SKID, False, False, ["skid-steered", "no motor currents and no gyro"]),
    ],
)
def test_a_log_without_a_known_force_is_observed_by_wheels_and_gyro(robot, currents, gyro, words):
    found = chosen(drive(robot, currents, yaw_rate_rad_s=np.zeros(TIME.size) if gyro else None), robot)
    assert isinstance(found.observer, SlipByOdometry)
    assert len(found.notes) == len(words) and all(w in note.text for w, note in zip(words, found.notes, strict=True))


def test_the_current_of_every_motor_is_needed():
    log = drive()
    halved = replace(log, motor_current_A=log.motor_current_A * [1.0, math.nan])
    (note,) = chosen(halved).notes
    assert "not all motor currents" in note.text


def test_the_yaw_rate_of_wheels_that_roll_is_that_of_the_body():
    turn = np.sin(TIME)
    sides = 0.6 + np.outer(turn, SKID.rolling[:, -1])
    np.testing.assert_allclose(yaw_rate_of_wheels(SKID, sides / SKID.wheel.radius_m), turn, atol=1e-12)


def test_only_the_sensors_of_the_log_exist():
    bare = chosen(drive()).observer.noise
    assert (bare.gyro_std_rad_s, bare.passive_std_rad_s, bare.speed_std_m_s, bare.pitch_std_rad) == (None,) * 4
    ones = np.ones(TIME.size)
    full = drive(passive=True, yaw_rate_rad_s=0 * ones, speed_m_s=0.3 * ones, pitch_rad=0 * ones)
    noise = chosen(full).observer.noise
    assert None not in (noise.gyro_std_rad_s, noise.passive_std_rad_s, noise.speed_std_m_s, noise.pitch_std_rad)


def test_the_quantisation_of_counts_is_found():
    counts = np.floor(4096 * np.cumsum(2.0 + np.sin(TIME)) * 0.01 / (2 * math.pi))
    speed = np.diff(counts) * 2 * math.pi / 4096 / 0.01
    assert quantum(speed) == pytest.approx(2 * math.pi / 4096 / 0.01)
    exact = 2 * math.pi / 4096 / 0.01 / math.sqrt(6)  # two uniform errors of one step
    assert exact <= encoder_std_rad_s(speed[:, None]) <= 2.0 * exact


def test_errors_that_last_make_a_speed_worth_less():
    rng = np.random.default_rng(4)
    white, lasting = 0.1 * rng.standard_normal(TIME.size), np.zeros(TIME.size)
    for k in range(1, TIME.size):
        lasting[k] = 0.8 * lasting[k - 1] + 0.6 * white[k]
    assert correlation(white, 1.0) == pytest.approx(0.0, abs=0.1)
    assert correlation(lasting, 1.0) == pytest.approx(0.8, abs=0.1)
    log = drive()
    speed = 0.3 + 0.1 * np.sin(TIME)
    plain, worse = (speed_std_m_s(RLMA, replace(log, speed_m_s=speed + error)) for error in (white, lasting))
    assert plain == pytest.approx(0.1, rel=0.25)
    assert worse == pytest.approx(0.3, rel=0.4)


def test_a_speed_that_knows_its_own_std_is_believed():
    log = drive(speed_m_s=np.full(TIME.size, 0.3), speed_std_m_s=np.full(TIME.size, 0.01))
    assert speed_std_m_s(RLMA, log) == pytest.approx(0.01)


@pytest.mark.parametrize("name", ["ekf", "aukf"])
def test_a_load_on_wheels_that_scrub_does_not_make_them_spin(name):
    """Motors that drag the wheels sideways turn harder than any grip that the file's mass allows: no wheel slips."""
    calm = drive(SKID)
    loaded = replace(calm, motor_current_A=np.full_like(calm.motor_current_A, 30.0))
    observers = (chosen(loaded, SKID, name).observer, default_observer(SKID, filter=name))
    for observer in observers:
        found, without = (observe(observer, log).estimates for log in (loaded, calm))
        np.testing.assert_array_equal(found.speed_m_s, without.speed_m_s)
        assert not found.slipping.any()


def test_a_car_has_the_same_observer_live_as_in_a_log():
    robot = generic_robot(40.0, 0.1, 0.5, 0.4, layout="car")
    log = DriveLog("car", TIME, np.ones((TIME.size, 3)), np.ones((TIME.size, robot.driven)))
    assert chosen(log, robot).observer == default_observer(robot) == SlipByOdometry(pose_filter(robot))


def test_slow_logs_have_no_gaps():
    log = drive()
    slow = replace(log, time_s=20 * log.time_s)
    assert chosen(log).observer.gap_s == 0.1
    assert chosen(slow).observer.gap_s == pytest.approx(0.5)


def test_the_radius_is_a_state_where_a_speed_from_outside_shows_it():
    speed = np.full(TIME.size, 0.3)
    assert chosen(drive(speed_m_s=speed)).observer.states.radius
    assert not chosen(drive()).observer.states.radius


def test_the_first_speed_is_known_as_well_as_the_radius():
    fast = drive()
    fast = replace(fast, wheel_speed_rad_s=100 * fast.wheel_speed_rad_s)
    assert chosen(fast).observer.noise.initial_speed_std_m_s == pytest.approx(0.3, rel=0.2)
