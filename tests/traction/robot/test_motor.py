from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.traction import Motor
from ohmward.traction.robot.motor import (
    copper_loss,
    current_for_torque,
    friction_torque,
    ideal_torque,
    wheel_torque,
)
from traction.examples import LOSSY

IDEAL = Motor(torque_constant_Nm_per_A=0.5, resistance_ohm=0.2)
currents, speeds = st.floats(-30, 30), st.floats(-50, 50)


def test_an_ideal_motor_by_hand():
    assert wheel_torque(IDEAL, 3.0, 7.0) == 1.5
    assert copper_loss(IDEAL, -3.0) == pytest.approx(1.8)


def test_a_gear_multiplies_torque_and_squares_the_inertia():
    geared = replace(IDEAL, gear_ratio=10.0, rotor_inertia_kg_m2=2e-5)
    assert wheel_torque(geared, 3.0, 7.0) == pytest.approx(15.0)
    assert geared.inertia_at_wheel_kg_m2 == pytest.approx(2e-3)


def test_the_gears_efficiency_holds_driving_and_nearly_braking():
    gear = replace(IDEAL, gear_efficiency=0.8)
    assert wheel_torque(gear, 3.0, 20.0) == pytest.approx(0.8 * 1.5)
    assert wheel_torque(gear, -3.0, 20.0) == pytest.approx(-1.2 * 1.5)  # 1/(2 - eta) = 0.83 comes back


@given(current=currents, speed=speeds)
def test_what_goes_in_comes_out_or_is_lost(current, speed):
    electrical = (LOSSY.resistance_ohm * current + LOSSY.wheel_constant_Nm_per_A * speed) * current
    drive = friction_torque(LOSSY, current, speed) * speed
    shaft = wheel_torque(LOSSY, current, speed) * speed
    assert copper_loss(LOSSY, current) >= 0
    assert drive >= 0
    assert electrical == pytest.approx(copper_loss(LOSSY, current) + drive + shaft, rel=1e-12, abs=1e-9)


@given(current=currents, speed=speeds)
def test_the_current_for_a_torque_gives_that_torque(current, speed):
    torque = wheel_torque(LOSSY, current, speed)
    assert wheel_torque(LOSSY, current_for_torque(LOSSY, torque, speed), speed) == pytest.approx(torque, abs=1e-9)


@given(current=currents, speed=speeds)
def test_reverse_is_the_mirror_image(current, speed):
    assert wheel_torque(LOSSY, -current, -speed) == pytest.approx(-wheel_torque(LOSSY, current, speed), abs=1e-12)
    assert ideal_torque(LOSSY, -current) == -ideal_torque(LOSSY, current)


@pytest.mark.parametrize(
    "field, value, rule",
    [
        ("torque_constant_Nm_per_A", 0.0, "> 0"),
        ("resistance_ohm", -0.1, "> 0"),
        ("gear_ratio", np.inf, "finite"),
        ("gear_efficiency", 1.2, "> 0 and at most 1, got 1.2"),
        ("gear_efficiency", 0.0, "> 0 and at most 1, got 0"),
        ("friction_Nm", -1.0, ">= 0"),
        ("rotor_inertia_kg_m2", np.nan, "finite"),
    ],
)
def test_impossible_motors_are_refused(field, value, rule):
    with pytest.raises(InputError, match=f"motor.{field} must be {rule}"):
        replace(IDEAL, **{field: value})
