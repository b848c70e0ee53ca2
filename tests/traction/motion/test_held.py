import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA, Odometry
from ohmward.traction.motion.outside_speed import (
    ALARM,
    GARBAGE,
    GARBAGE_S_PER_M,
    HELD_S,
    MET_M_S,
    MET_S,
    SLIDES_S,
    Held,
    OutsideSpeed,
    weigh_held,
)
from ohmward.traction.odometry.sample import OdometryFlag
from ohmward.traction.speed_observer.estimator import SlipEstimator
from ohmward.traction.speed_observer.make_observer import default_observer

DT_S, STD_M_S = 0.05, 0.05
NO_SPEED = OutsideSpeed(False, 0.0, STD_M_S, 0.5, 0.0)


def heard(speed_m_s, rims_m_s=0.5, std_m_s=STD_M_S):
    return OutsideSpeed(True, speed_m_s, std_m_s, rims_m_s, 0.0)


def weighed(rims_m_s, speeds_m_s, start=None):
    """The hypothesis (T,) along rims and outside speeds."""
    found, held = [], start or Held()
    for rim, speed in zip(rims_m_s, speeds_m_s, strict=True):
        held = weigh_held(held, heard(speed, rim) if math.isfinite(speed) else NO_SPEED, rim, DT_S)
        found.append(held)
    return found


def drive(seed, currents_A=math.nan, stuck=True):
    """A log of wheels at 0.4 to 0.8 m/s with a pause, a speed once a second, and the true speed (T,)."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 90.0, DT_S)
    target = rng.uniform(0.4, 0.8) * ((time_s > 3.0) & ~((time_s > 45.0) & (time_s < 49.0)))
    rim = np.zeros(len(time_s))
    for k in range(1, len(rim)):
        rim[k] = rim[k - 1] + np.clip(target[k] - rim[k - 1], -DT_S, DT_S)
    begins_s = rng.uniform(25.0, 35.0)
    held = stuck & (time_s > begins_s) & (time_s < begins_s + 30.0)
    true = np.where(held, 0.0, rim)
    speed = np.where(np.arange(len(rim)) % 20 == 7, true + STD_M_S * rng.standard_normal(len(rim)), np.nan)
    wheels = np.full((len(rim), 4), np.nan)
    wheels[:, :2] = rim[:, None] / RLMA.wheel.radius_m
    gyro = 0.01 + 0.002 * rng.standard_normal(len(rim))
    currents = np.full((len(rim), 2), currents_A) * (rim > 0)[:, None]
    log = DriveLog("twin", time_s, wheels, currents, yaw_rate_rad_s=gyro, speed_m_s=speed)
    return log, true, held


def test_one_speed_weighs_the_hypotheses_by_bayes_rule():
    found = weigh_held(Held(), heard(0.08), 0.5, DT_S)
    met, garbage = 1 - math.exp(-DT_S / MET_S), GARBAGE * GARBAGE_S_PER_M
    held = (1 - GARBAGE) * norm.pdf(0.08, 0.0, math.hypot(STD_M_S, 0.05)) + garbage
    rolls = (1 - GARBAGE) * norm.pdf(0.08, 0.5, math.hypot(STD_M_S, 0.05 * 0.5)) + garbage
    total = met * held + met * GARBAGE_S_PER_M + (1 - 2 * met) * rolls
    assert found.probability == pytest.approx(met * held / total, rel=1e-12)
    assert found.slides == pytest.approx(met * GARBAGE_S_PER_M / total, rel=1e-12)


def test_without_an_outside_speed_it_is_met_and_left_as_the_chain_says():
    found = Held()
    for _ in range(600):
        found = weigh_held(found, NO_SPEED, 0.5, 1.0)
    met, left, stops = (1.0 - math.exp(-1.0 / time_s) for time_s in (MET_S, HELD_S, SLIDES_S))
    chain = np.array(
        [[1 - 2 * met, met, met], [stops * (1 - met), (1 - stops) * (1 - met), met], [left / 2, left / 2, 1 - left]]
    )
    stationary = np.linalg.matrix_power(chain, 5000)[0]
    assert_allclose([found.slides, found.probability], stationary[1:], rtol=1e-4)


def test_wheels_that_change_their_speed_slide_more_often():
    calm, changed = (weigh_held(Held(), NO_SPEED, 0.5, DT_S, change).slides for change in (0.0, 0.3))
    assert calm == pytest.approx(-math.expm1(-DT_S / MET_S), rel=1e-12)
    assert changed == pytest.approx(-math.expm1(-DT_S / MET_S - 0.3 / MET_M_S), rel=1e-12)


def test_a_robot_that_slides_through_zero_is_not_held_for_long():
    """Wheels at 0.8 m/s on ice under a robot that slides back down: ten speeds a second."""
    true = np.clip(0.8 - 0.5 * DT_S * np.arange(100), -1.0, None)
    speeds = np.where(np.arange(100) % 2 == 0, true, np.nan)
    found = weighed(np.full(100, 0.8), speeds)
    held = np.array([h.probability > 0.5 for h in found])
    assert not held[np.abs(true) > 0.25].any()
    assert found[-1].slides > 0.9


def test_a_robot_whose_wheels_stand_stays_as_it_is():
    start = Held(probability=0.97)
    assert weighed(np.zeros(200), np.zeros(200), start)[-1].probability == 0.97


def test_a_robot_that_slides_is_not_told_from_one_of_noisy_outside_speeds():
    """Half a metre a second of noise: the density of any speed is no more than that at two standard deviations."""
    found = weigh_held(Held(), heard(0.5, std_m_s=0.5), 0.5, DT_S)
    met, garbage = 1 - math.exp(-DT_S / MET_S), GARBAGE * GARBAGE_S_PER_M
    held = (1 - GARBAGE) * norm.pdf(0.5, 0.0, math.hypot(0.5, 0.05)) + garbage
    rolls = (1 - GARBAGE) * norm.pdf(0.0, 0.0, math.hypot(0.5, 0.05 * 0.5)) + garbage
    slides = norm.pdf(2 * 0.5, 0.0, 0.5)
    total = met * held + met * slides + (1 - 2 * met) * rolls
    assert found.slides == pytest.approx(met * slides / total, rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_pose_of_a_stuck_robot_stands_and_the_alarm_comes_with_the_second_speed(seed):
    log, true, held = drive(seed)
    e = Odometry(RLMA).run(log).estimates
    way_m, true_m = (float(np.sum(np.abs(v)) * DT_S) for v in (e.speed_m_s, true))
    assert way_m == pytest.approx(true_m, rel=0.05)
    stuck = e.flags.astype(int) & OdometryFlag.STUCK > 0
    assert_stuck(log, held, stuck)
    assert_allclose(stuck, (e.stuck_probability > ALARM), atol=0)


@pytest.mark.parametrize("current_A", [math.nan, 1.0])
def test_the_observer_says_so_with_and_without_motor_currents(current_A):
    log, true, held = drive(5, current_A)
    e = SlipEstimator(default_observer(RLMA)).run(log).estimates
    assert_stuck(log, held, e.immobilised > 0.5)
    assert np.sum(np.abs(e.speed_m_s)) * DT_S == pytest.approx(np.sum(np.abs(true)) * DT_S, rel=0.05)


def test_a_robot_that_rolls_is_never_stuck():
    log, true, _ = drive(6, stuck=False)
    e = Odometry(RLMA).run(log).estimates
    assert not (e.flags.astype(int) & OdometryFlag.STUCK).any()
    assert np.sum(np.abs(e.speed_m_s)) == pytest.approx(np.sum(np.abs(true)), rel=0.02)


def assert_stuck(log, held, stuck):
    """The alarm comes within a second of the second outside speed, and goes with the robot's freedom."""
    second = np.flatnonzero(held & np.isfinite(log.speed_m_s))[1]
    assert log.time_s[np.argmax(stuck)] <= log.time_s[second] + 1.0
    assert not stuck[~held & (log.time_s < 25.0)].any()
    assert not stuck[log.time_s > log.time_s[np.flatnonzero(held)[-1]] + 2.0].any()
