"""Ice on a slope in MuJoCo, where wheels that turn steadily slide: a speed from outside tells, and is believed soon."""

import numpy as np
import pytest

from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward_lab.simulate.mujoco_plant import drive
from traction.speed_observer.examples import observed

from .mujoco_runs import DT_S, believed, ice_on_a_slope, rmse, samples_of

RADIUS_M, SPEED_STD_M_S = 0.12, 0.03
NOISE = ObserverNoise(speed_std_m_s=SPEED_STD_M_S, gyro_std_rad_s=0.003)


def on_wheel_speed(truth):
    """Torque [N m] of a drive that holds the speed of its wheels: 0.8 m/s, and 0.2 m/s from 5 s on."""
    wanted = min(0.8, 0.8 * truth.time_s) if truth.time_s < 5.0 else 0.2
    return np.clip(6.0 * (wanted - RADIUS_M * truth.wheel_speed_rad_s[:2]), -12.0, 12.0)


def held(values):
    """The values (T,) with the last number in place of nan, 0 before the first."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return np.where(np.isfinite(values[last]), values[last], 0.0)


@pytest.mark.parametrize("late_steps", [2, 20])
@pytest.mark.parametrize("grade_rad", [0.08, -0.08])
def test_a_speed_from_outside_is_used_at_least_as_well_as_by_holding_it(grade_rad, late_steps):
    truth = drive(ice_on_a_slope(0.1, grade_rad), on_wheel_speed, 8.0, DT_S)
    rng = np.random.default_rng(1)
    samples = samples_of(truth, rng, speed_every=10, speed_std=SPEED_STD_M_S, age_steps=late_steps)
    _, e = observed(SpeedObserver(believed(rng), noise=NOISE, rest_hold_s=np.inf), samples)
    error = e.speed_m_s - truth.speed_m_s[1:]
    assert rmse(error) < 1.15 * rmse(held(samples.speed_m_s) - truth.speed_m_s[1:])
    assert np.mean(np.abs(error) < 1.96 * e.speed_std_m_s) > 0.65
    assert (e.flags.astype(int) & SlipFlag.SPEED_RESET).any()
