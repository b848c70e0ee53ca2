"""Disturbance acceleration of drives made by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.logs import DriveLog
from ohmward.traction import RLMA, ROBOTINO, Motor, hard_terrain
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.estimator import observe
from ohmward.traction.speed_observer.make_observer import disturbance_m_s2, make_observer

TIME = 0.01 * np.arange(1000)


def drive(robot=RLMA, extra_m_s2=0.0, motion=None, noise=0.0, seed=1):
    """Currents that accelerate body and wheels along x exactly so, and as much more against the motion."""
    speed = 0.3 + 0.1 * np.sin(TIME) if motion is None else motion
    acceleration = np.gradient(speed, TIME)
    n, radius_m = robot.driven, robot.wheel.radius_m
    wheels = np.outer(speed, robot.rolling[:, 0]) / radius_m
    forward = np.linalg.pinv(robot.rolling[:n].T)[:, 0]
    force = np.outer(robot.mass_kg * (acceleration + extra_m_s2 * np.sign(speed)), forward)
    torque = radius_m * force + robot.inertia[robot.freedoms] * np.gradient(wheels[:, :n], TIME, axis=0)
    wheels = wheels + noise * np.random.default_rng(seed).standard_normal(wheels.shape)
    wheels[:, n:] = math.nan
    return DriveLog("drive", TIME, wheels, torque / robot.motor.wheel_constant_Nm_per_A)


IDEAL = [replace(r, motor=Motor(0.05, 0.2, gear_ratio=10.0, rotor_inertia_kg_m2=3e-3)) for r in (RLMA, ROBOTINO)]


@pytest.mark.parametrize("robot", IDEAL, ids=["RLMA", "Robotino"])
@pytest.mark.parametrize("extra", [0.0, 0.3, 3.0])
def test_what_was_put_in_comes_out(robot, extra):
    assert disturbance_m_s2(robot, drive(robot, extra)) == pytest.approx(extra, abs=0.01)
    assert disturbance_m_s2(robot, drive(robot, extra, motion=-0.3 + 0 * TIME)) == pytest.approx(extra, abs=0.01)


def test_noise_of_encoders_does_not_count():
    assert disturbance_m_s2(IDEAL[0], drive(IDEAL[0], noise=0.05)) < 0.1


def test_a_friction_that_the_motor_is_known_to_have_is_explained():
    robot = IDEAL[0]
    friction_Nm = 0.5 * robot.mass_kg * robot.wheel.radius_m / robot.driven
    known = replace(robot, motor=replace(robot.motor, friction_Nm=friction_Nm, friction_speed_rad_s=0.01))
    log = drive(robot, extra_m_s2=0.5)
    assert disturbance_m_s2(robot, log) == pytest.approx(0.5, abs=0.01)
    assert disturbance_m_s2(known, log) == pytest.approx(0.0, abs=0.01)


def test_a_log_that_cannot_tell_gives_nothing():
    log = drive()
    for short in (log.select(slice(0, 1)), log.select(slice(0, 25)), drive(motion=0 * TIME)):
        assert disturbance_m_s2(RLMA, short) == 0.0
    assert disturbance_m_s2(RLMA, replace(log, motor_current_A=np.full((TIME.size, 2), math.nan))) == 0.0


def chosen(*given):
    return make_observer(*given)


def test_a_disturbance_opens_the_grade_and_a_large_one_the_slip():
    ground = hard_terrain("dry asphalt")
    none, slope, drag = (chosen(IDEAL[0], drive(IDEAL[0], extra), ground) for extra in (0.0, 0.4, 3.0))
    assert none.observer.noise.grade_std_rad == pytest.approx(math.radians(1.0))
    assert slope.observer.noise.grade_std_rad == pytest.approx(0.4 / GRAVITY, rel=0.05)
    assert slope.observer.noise.radius_std == none.observer.noise.radius_std
    assert not any(note.level == "warning" for note in slope.notes)
    assert drag.observer.noise.radius_std == pytest.approx(3.0 / GRAVITY, rel=0.05)
    seen = replace(drive(IDEAL[0], 3.0), speed_m_s=0.3 + 0.1 * np.sin(TIME))
    assert chosen(IDEAL[0], seen, ground).observer.noise.radius_std == none.observer.noise.radius_std
    assert any(note.level == "warning" and "0.31 g more than the robot accelerates" in note.text for note in drag.notes)


def test_a_robot_that_drags_does_not_run_away():
    robot = replace(ROBOTINO, motor=Motor(0.5, 0.2))
    log = drive(robot, extra_m_s2=3.0, motion=0.1 + 0.02 * np.sin(TIME), noise=0.05)
    estimates = observe(make_observer(robot, log, hard_terrain("dry asphalt"), "ekf").observer, log).estimates
    assert np.abs(estimates.speed_m_s - 0.1).max() < 0.1
    assert estimates.speed_std_m_s[100:].min() > 0.02
