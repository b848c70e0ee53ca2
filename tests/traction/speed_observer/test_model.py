"""The robot as the observer sees it: how late its encoders are, and what its currents' noise does."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.filters import unpack
from ohmward.filters.belief import PackedBelief
from ohmward.trace import Kernel
from ohmward.traction import Differential, RollingResistance, Terrain, scene
from ohmward.traction.friction.law import WardIagnemma
from ohmward.traction.motion.sample import CleanSample
from ohmward.traction.speed_observer import encoders
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import KNOWN_GROUND, States
from ohmward_lab.simulate.implicit_step import EULER
from traction.examples import plant

from .examples import DT_S, LOW, RLMA_ON_FLOOR, at_rest, log, observed

SUBSTEPS = 400
CURRENTS_A = np.array([2.0, 3.0])


def clean(current_A, measured=True):
    wheels = len(RLMA_ON_FLOOR.robot.places)
    currents = np.asarray(current_A, dtype=float)
    none = np.zeros(wheels)
    return CleanSample(
        dt_s=DT_S,
        modelled_s=DT_S,
        unmodelled_s=0.0,
        current_A=currents,
        current_measured=np.full(len(currents), measured),
        wheel_speed_rad_s=none,
        wheel_measured=none > 1,
        pitch_rad=math.nan,
        time_credible=True,
        gap=False,
    )


def floor(stiffness_s_per_m):
    law = WardIagnemma(0.7, stiffness_s_per_m)
    return scene(LOW, Terrain("tests", law, RollingResistance(a1=0.0, a3_s_per_m=0.0), "tests"))


def mean_speed(place, x, current_A):
    """Mean of the wheels' speeds over a step (driven,), by 400 implicit steps."""
    _, after = plant(place, DT_S / SUBSTEPS, EULER).scan(x, np.tile(current_A, (SUBSTEPS, 1)))
    return np.trapezoid(np.vstack([x, after])[:, 2:], axis=0) / SUBSTEPS


@pytest.mark.parametrize("stiffness_s_per_m", [1e-3, 1.0, 5.0, 20.0, 100.0])
def test_an_encoder_shows_the_end_of_the_step_less_its_lag(stiffness_s_per_m):
    place = floor(stiffness_s_per_m)
    model, x = Model(place, KNOWN_GROUND, ObserverNoise()), np.array([0.5, 0.0, 0.5 / 0.12, 0.5 / 0.12])
    step = model.slip_step(x, clean(CURRENTS_A))
    after = model.next_state(x, clean(CURRENTS_A))
    shown = after[2:] - model.encoder_lag(x, after, step)[:2]
    assert shown == pytest.approx(mean_speed(place, x, CURRENTS_A), abs=0.05 * np.abs(after - x)[2:].max() + 1e-3)


def test_bodies_and_spinning_wheels_are_half_a_step_late():
    place = floor(1e-3)
    model, x = Model(place, KNOWN_GROUND, ObserverNoise()), np.array([0.5, 0.1, 4.0, 4.0])
    step = model.slip_step(x, clean(CURRENTS_A))
    after = np.array([0.6, 0.3, 4.0, 5.0])
    lag = model.encoder_lag(x, after, step)
    assert lag[:2] == pytest.approx([0.0, 0.5], abs=1e-3)
    assert lag[2:] == pytest.approx(0.5 * place.robot.rolling[2:] @ [0.1, 0.2] / 0.12)


@pytest.mark.parametrize("axle", ["front", "all"])
def test_passive_wheels_of_a_robot_that_accelerates_show_its_speed_now(axle):
    robot = replace(LOW, chassis=Differential(0.314, 0.314, 0.30)) if axle == "front" else LOW
    place = scene(robot, RLMA_ON_FLOOR.terrains[0])
    time_s, a = DT_S * np.arange(1, 201), 1.0
    mean_speed = a * (time_s - 0.5 * DT_S)
    samples = log(np.full(200, np.nan), np.zeros(200))
    samples.wheel_speed_rad_s[:, 2:] = mean_speed[:, None] / 0.12
    observer = SpeedObserver(place, noise=ObserverNoise(passive_std_rad_s=0.02), rest_hold_s=np.inf)
    _, e = observed(observer, samples)
    # the filter does not expect such an acceleration, so it trails by a little of a step's change
    assert e.speed_m_s[100:] - a * time_s[100:] == pytest.approx(0.0, abs=0.3 * a * DT_S)


def test_the_noise_of_a_torque_moves_its_wheel_by_its_derivative():
    model = Model(RLMA_ON_FLOOR, States(), ObserverNoise())
    x = np.array([0.5, 0.0, 0.51 / 0.12, 0.51 / 0.12, 0.0, 0.0, 0.0, 0.0, 1.0])
    noise = model.torque_noise_rad_s(model.slip_step(x, clean(CURRENTS_A)), clean(CURRENTS_A))
    step_A, wheels = 1e-4, slice(2, 4)
    ends = [
        np.array([model.next_state(x, clean(CURRENTS_A + d))[wheels] for d in step_A * sign * np.eye(2)])
        for sign in (-1, 1)
    ]
    per_A = np.diag(ends[1] - ends[0]) / (2 * step_A)
    assert noise == pytest.approx(model.noise.torque_std_Nm / 0.517 * per_A, rel=0.02)
    assert np.all(
        model.torque_noise_rad_s(model.slip_step(x, clean(CURRENTS_A)), clean(CURRENTS_A, measured=False)) > 10 * noise
    )


def wavy_drive(rng, noise_A):
    """Samples of a robot that drives in waves of 3 s, and its true states (T, 4); noise_A: of its currents."""
    current, x = 0.36 + np.sin(2.0 * DT_S * np.arange(1500)), np.array([0.5, 0.0, 0.5 / 0.12, 0.5 / 0.12])
    _, truth = plant(RLMA_ON_FLOOR).scan(x, np.column_stack([current, current]))
    samples = log(truth[:, 2], current)
    samples.wheel_speed_rad_s[:, :2] += 0.02 * rng.standard_normal((1500, 2))
    samples.current_A[:] += noise_A * rng.standard_normal((1500, 2))
    return samples, truth


def observed_wavy(noise_A):
    """Share of the speeds in their 95 % band, and the logarithm of the stiffness at the end, whose truth is 0."""
    samples, truth = wavy_drive(np.random.default_rng(0), noise_A)
    noise = ObserverNoise(encoder_std_rad_s=0.02, torque_std_Nm=0.517 * noise_A, encoder_lag_share=0.0)
    observer = SpeedObserver(RLMA_ON_FLOOR, noise=noise)
    first = at_rest(observer)._replace(wheel_speed_rad_s=np.full(4, 0.5 / 0.12))
    state, e = Kernel(observer.step, observer.init(first), first).scan(observer.init(first), samples)
    inside = np.abs(e.speed_m_s - truth[:, 0]) < 1.96 * e.speed_std_m_s
    return inside.mean(), unpack(PackedBelief(*state.belief)).mean[observer.model.layout.index("log_stiffness")]


def test_noise_of_the_currents_makes_no_wheel_look_stiff(monkeypatch):
    covered, stiffness = observed_wavy(noise_A=0.3)
    assert covered > 0.92
    monkeypatch.setattr(encoders, "true_share", lambda *_: 1.0)
    believed, stiffer = observed_wavy(noise_A=0.3)
    assert believed < 0.9
    assert stiffer > stiffness + 0.7
