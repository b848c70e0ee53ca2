"""Forward speed from the wheels that grip: closed forms, and drives in which wheels spin."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ohmward.trace import Kernel
from ohmward.traction import RLMA, ROBOTINO
from ohmward.traction.odometry.grip import GRIP_M_S2, LOOSE_M_S, LOOSE_SHARE, lever_m, speed_by_grip
from ohmward.traction.odometry.noise import OdometryNoise
from ohmward.traction.odometry.pose_filter import PoseFilter
from ohmward.traction.odometry.sample import OdometryFlag
from traction.odometry.examples import DT_S, samples

FILTER = PoseFilter(RLMA, OdometryNoise())  # rims without creep
NOISE = OdometryNoise(turn_scale_std=0.0)
HALF_TRACK_M = float(RLMA.rolling[1, 1])


def grip(rims, turn=0.0, by_gyro=True, followed=0.5, since=0.02):
    rims = np.array(rims)
    return speed_by_grip(rims, np.mean(rims), turn, by_gyro, followed, since, 0.0, RLMA, NOISE)


def run(given):
    """Estimates (T, ...) of the default filter of [T]'s robot."""
    kernel = Kernel(FILTER.step, FILTER.init(FILTER.no_sample()), FILTER.no_sample())
    return kernel.scan(FILTER.init(FILTER.no_sample()), given)[1]


def rims(*speeds_m_s):
    """Wheel speeds (T, 2) of rims with these speeds (T,)."""
    return np.column_stack(speeds_m_s) / RLMA.wheel.radius_m


def test_wheels_that_roll_on_a_curve_and_slip_against_each_other_show_their_mean():
    turn, slip = 0.8, 0.1
    rolling = np.array([0.5 - HALF_TRACK_M * turn, 0.5 + HALF_TRACK_M * turn])
    assert grip(rolling, turn).forward_m_s == pytest.approx(0.5, abs=1e-15)
    assert grip(rolling + np.array([-slip, slip]), turn).forward_m_s == pytest.approx(0.5, abs=1e-15)
    assert grip(rolling, turn).beyond_m_s == 0.0


def test_a_wheel_counts_with_the_fourth_power_of_its_distance():
    now = grip([2.5, 0.5])
    assert now.loose_m_s == pytest.approx(LOOSE_M_S + LOOSE_SHARE * 0.5)
    counted = 1 / (1 + (2.0 / now.loose_m_s) ** 4)
    assert now.forward_m_s == pytest.approx((0.5 + counted * 2.5) / (1 + counted))
    assert abs(now.forward_m_s - 0.5) < 0.001
    alone = grip([2.5, 0.5], by_gyro=False)
    assert alone.forward_m_s == pytest.approx(0.5 + GRIP_M_S2 * 0.02 + alone.loose_m_s)  # below the mean, 1.5 m/s


def test_wheels_that_all_run_away_are_followed_as_fast_as_friction_can():
    now = grip([4.5, 4.5], since=0.02)
    assert now.followed_m_s == pytest.approx(0.5 + GRIP_M_S2 * 0.02)
    assert now.forward_m_s == pytest.approx(now.followed_m_s + now.loose_m_s)
    assert now.beyond_m_s == pytest.approx(4.0 - GRIP_M_S2 * 0.02)
    assert grip([4.5, 4.5], since=1e9).beyond_m_s == 0.0  # the first values are believed


def test_wheels_that_roll_sideways_too_count_alike():
    speeds = np.array([0.1, 0.5, -3.0])
    now = speed_by_grip(speeds, 0.2, 1.0, True, 0.2, 0.02, 0.0, ROBOTINO, NOISE)
    assert now.forward_m_s == pytest.approx(0.2)


def test_one_wheel_that_spins_up_slowly_neither_moves_nor_turns_the_robot():
    """The left wheel gains 4 m/s in two seconds, 2 m/s^2 each: no jump, and plain wheel odometry is 4 m wrong."""
    time_s = DT_S * np.arange(1000)
    right = np.full(1000, 0.5)
    left = 0.5 + np.where((time_s >= 5) & (time_s < 9), 2.0 * (2.0 - abs(time_s - 7.0)), 0.0)
    e = run(samples(FILTER, wheel_speed_rad_s=rims(left, right), yaw_rate_rad_s=np.zeros(1000)))
    assert not (e.flags.astype(int) & OdometryFlag.WHEEL_JUMP).any()
    assert e.x_m[-1] == pytest.approx(10.0, abs=0.1)
    assert abs(e.y_m[-1]) < 0.05
    assert np.mean(left + right) / 2 * 20.0 > 13.9


@pytest.mark.parametrize("slip_m_s", [0.04, 0.15])
def test_the_band_opens_to_the_slip_by_which_gyro_and_wheels_disagree(slip_m_s):
    """Rims at v -+ s of a robot that goes straight: std of the speed s at the comparison, s e^(-t/tau) more later."""
    apart = np.where(np.arange(600) < 100, 0.0, slip_m_s)
    apart[200:] = 0.0
    wheels = rims(0.5 - apart, 0.5 + apart)
    e = run(samples(FILTER, wheel_speed_rad_s=wheels, yaw_rate_rad_s=np.zeros(600)))
    rejected = np.flatnonzero(e.flags.astype(int) & OdometryFlag.TURN_REJECTED)
    k = max(rejected[rejected < 200])
    before = e.twist_cov[99, 0, 0]
    opened = e.twist_cov[k, 0, 0] - before
    assert opened == pytest.approx(slip_m_s**2, rel=0.05)
    k = rejected[-1]
    opened = e.twist_cov[k, 0, 0] - before
    later = k + round(FILTER.noise.correlation_s / DT_S)
    assert e.twist_cov[later, 0, 0] - before == pytest.approx(opened * math.exp(-2.0), rel=0.02)
    assert_allclose(e.x_m[-1], 0.5 * 600 * DT_S, atol=1e-3)


def test_the_band_covers_wheels_that_all_spin():
    """Both rims gain 3 m/s at 15 m/s^2 and hold it for a second; the robot goes on at 0.5 m/s."""
    time_s = DT_S * np.arange(600)
    both = 0.5 + np.clip(15.0 * (time_s - 5.0), 0.0, 3.0) * (time_s < 6.0)
    e = run(samples(FILTER, wheel_speed_rad_s=rims(both, both), yaw_rate_rad_s=np.zeros(600)))
    true_m = 0.5 * time_s
    assert e.pose_cov[-1, 0, 0] ** 0.5 > 0.5
    assert abs(e.x_m[-1] - true_m[-1]) < 3 * e.pose_cov[-1, 0, 0] ** 0.5


def test_a_gyro_that_glitches_does_not_move_the_robot():
    gyro = np.where(np.arange(500) % 50 == 25, 5.0, 0.0) * np.where(np.arange(500) % 100 == 25, 1.0, -1.0)
    e = run(samples(FILTER, wheel_speed_rad_s=rims(np.full(500, 0.5), np.full(500, 0.51)), yaw_rate_rad_s=gyro))
    assert e.distance_m[-1] == pytest.approx(0.505 * 500 * DT_S, rel=0.002)


def test_the_lever_is_half_the_track():
    assert lever_m(RLMA) == pytest.approx(HALF_TRACK_M)
