import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction import RLMA, SkidSteer
from ohmward.traction.friction.law import contact
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.robot.robot import free_sideways
from ohmward_lab.simulate.closed_loop.observing import (
    Observation,
    Observing,
    assumed_terrain,
    make_observer,
    noise,
)
from ohmward_lab.simulate.closed_loop.sensing import ArrivedSample, ExternalSpeed, Sensing
from ohmward_lab.simulate.ground import Patch

BASE = Patch(friction=0.5)


def sample(dt_s, wheel_speed_rad_s):
    return RobotSample(dt_s, np.array([wheel_speed_rad_s] * 2 + [math.nan] * 2), np.zeros(2))


def test_the_age_of_an_estimate_counts_from_when_its_sample_was_taken():
    observation = Observation(make_observer(Observing("ekf"), Sensing(), RLMA, BASE), RLMA)
    observation.update(ArrivedSample(0.10, sample(0.0, 2.0)))
    told = observation.measurement(np.array([2.0, 2.1]), np.zeros(2), 0.14)
    assert told.age_s == pytest.approx(0.04)
    assert told.wheel_speed_rad_s.tolist() == [2.0, 2.1]
    assert told.travel_speed_m_s == pytest.approx([0.24, 0.24], abs=0.01)
    assert (told.travel_speed_std_m_s > 0).all()


def test_without_an_observer_the_truth_is_told():
    observation = Observation(None, RLMA)
    assert observation.update(ArrivedSample(0.0, sample(0.0, 1.0))) is None
    told = observation.measurement(np.ones(2), np.array([0.3, 0.4]), 5.0)
    assert told.travel_speed_m_s.tolist() == [0.3, 0.4]
    assert told.age_s == 0.0
    assert told.travel_speed_std_m_s.tolist() == [0.0, 0.0]


def test_the_assumed_terrain_keeps_slope_and_limit_without_the_corner():
    creep, smooth = BASE.ground(RLMA).traction, assumed_terrain(BASE, RLMA).traction
    assert smooth.force_N(contact(1e-6, 0.0, 100.0)) == pytest.approx(
        creep.force_N(contact(1e-6, 0.0, 100.0)), rel=1e-4
    )
    assert smooth.force_N(contact(5.0, 0.0, 100.0)) == pytest.approx(50.0)
    assert assumed_terrain(Patch(terrain="gravel"), RLMA) == Patch(terrain="gravel").ground(RLMA)


def test_what_is_believed_is_the_base_unless_it_is_said():
    assert Observing().assumed_patch(BASE) == BASE
    assert Observing(terrain="ice").assumed_patch(BASE).name == "ice"
    assert Observing(slip_stiffness_s_per_m=3.0).assumed_patch(BASE) == replace(BASE, slip_stiffness_s_per_m=3.0)


def test_methods_are_filters_with_and_without_learnt_noise():
    made = {name: make_observer(Observing(name), Sensing(), RLMA, BASE) for name in ("ekf", "aekf", "ukf", "aukf")}
    assert {name: (o.method, o.matching) for name, o in made.items()} == {
        "ekf": ("ekf", False),
        "aekf": ("ekf", True),
        "ukf": ("ukf", False),
        "aukf": ("ukf", True),
    }


def test_a_sensor_that_is_not_there_has_no_noise():
    without = noise(Sensing(gyro=False), RLMA)
    assert (without.gyro_std_rad_s, without.passive_std_rad_s, without.speed_std_m_s) == (None, None, None)
    everything = noise(Sensing(encoders="all", pitch=True, speed=ExternalSpeed(0.1, 0.07)), RLMA)
    assert everything.passive_std_rad_s == everything.encoder_std_rad_s
    assert everything.speed_std_m_s == 0.07
    assert everything.pitch_std_rad is not None


def test_a_skid_steered_robot_is_taken_for_one_that_is_free_sideways():
    skid = replace(RLMA, chassis=SkidSteer(0.3, 0.4, 0.5))
    free = free_sideways(skid)
    assert not free.chassis.scrubs
    assert [(p.name, p.x_m, p.y_m, p.driven) for p in free.places] == [
        (p.name, p.x_m, p.y_m, True) for p in skid.places
    ]
    assert free_sideways(RLMA) is RLMA


@pytest.mark.parametrize(
    "values, message",
    [
        ({"method": "guess"}, "observer.method must be one of ekf, aekf, ukf, aukf, momentum, true, got 'guess'"),
        ({"terrain": "moon"}, "observer.terrain must be one of"),
        ({"friction": 0.0}, "observer.friction must be > 0"),
        ({"slip_stiffness_s_per_m": 0.0}, "observer.slip_stiffness_s_per_m must be > 0"),
    ],
)
def test_impossible_settings_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        Observing(**values)
