"""A load that nobody told, in MuJoCo: a robot with 40 % more or 20 % less mass than its file says."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.traction.speed_observer import speed_evidence
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward_lab.simulate.ground import Patch
from ohmward_lab.simulate.mujoco_plant import RlmaParameters, RlmaPlant, drive
from traction.speed_observer.examples import observed

from .mujoco_runs import DT_S, believed, samples_of


def spin(truth):
    """More torque [N m] than a floor of 0.2 takes."""
    return 4.0


def stop(truth):
    """Drive off for 3 s, then brake the wheels, which slide on a floor of 0.3."""
    if truth.time_s < 3.0:
        return np.clip(12.0 * (min(1.0, 0.6 * truth.time_s) - truth.speed_m_s), -4.0, 4.0)
    return np.clip(-0.6 * truth.wheel_speed_rad_s[:2], -3.0, 3.0)


def covered(load, friction, torque, duration_s, **noise):
    """Share of the speeds in their 95 % band, from half a second on."""
    parameters = replace(RlmaParameters(), mass_kg=load * RlmaParameters().mass_kg)
    truth = drive(RlmaPlant(parameters, [Patch(friction=friction)]), torque, duration_s, DT_S)
    rng = np.random.default_rng(1)
    samples = samples_of(truth, rng)
    _, e = observed(SpeedObserver(believed(rng), noise=ObserverNoise(**noise), rest_hold_s=np.inf), samples)
    error = e.speed_m_s - truth.speed_m_s[1:]
    return float(np.mean((np.abs(error) < 1.96 * e.speed_std_m_s)[50:]))


@pytest.mark.parametrize("load", [0.8, 1.4])
@pytest.mark.parametrize(("friction", "torque", "duration_s"), [(0.2, spin, 4.0), (0.3, stop, 6.0)])
def test_nine_of_ten_speeds_are_in_their_band_whatever_the_load(load, friction, torque, duration_s):
    assert covered(load, friction, torque, duration_s) > 0.9
    assert covered(load, friction, torque, duration_s, mass_std=0.15) > 0.9


def test_a_mass_that_is_taken_for_certain_misleads(monkeypatch):
    monkeypatch.setattr("kernels._KERNELS", {})
    monkeypatch.setattr(speed_evidence, "MASS_STD", 0.0)
    assert covered(1.4, 0.2, spin, 4.0) < 0.2
