"""A stop on ice whose motors hold the wheels, seen by encoders on the driven wheels and motor currents alone."""

import numpy as np
import pytest

from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward_lab.simulate.ground import Patch
from ohmward_lab.simulate.mujoco_plant import RlmaParameters, RlmaPlant, drive
from traction.speed_observer.examples import observed

from .mujoco_runs import DT_S, believed, samples_of

NOISE = ObserverNoise(gyro_std_rad_s=0.003)


def stop(gain):
    """Drive off for 3 s, then brake the wheels until they stand, with so much torque for their speed [N m s]."""

    def torque_Nm(truth):
        if truth.time_s < 3.0:
            return np.clip(12.0 * (min(1.0, 0.6 * truth.time_s) - truth.speed_m_s), -4.0, 4.0)
        return np.clip(-gain * truth.wheel_speed_rad_s[:2], -24.0, 24.0)

    return torque_Nm


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.6, 20.0])
@pytest.mark.parametrize("friction", [0.1, 0.2])
def test_nine_of_ten_speeds_are_in_their_band(friction, gain):
    truth = drive(RlmaPlant(RlmaParameters(), [Patch(friction=friction)]), stop(gain), 6.0, DT_S)
    for seed in (1, 2, 3):
        rng = np.random.default_rng(seed)
        samples = samples_of(truth, rng)
        _, e = observed(SpeedObserver(believed(rng), noise=NOISE, rest_hold_s=np.inf), samples)
        error = e.speed_m_s - truth.speed_m_s[1:]
        assert np.mean(np.abs(error) < 1.96 * e.speed_std_m_s) > 0.9
