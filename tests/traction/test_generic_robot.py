"""A robot of a few sizes."""

import math

import pytest

from ohmward.errors import InputError
from ohmward.traction.robot.chassis import Omni
from ohmward.traction.robot.packaged import generic_robot
from ohmward.traction.robot.robot import GRAVITY, ROBOT_FILE, Wheel


@pytest.mark.parametrize(
    ("layout", "driven"),
    [("two-wheel", 2), ("skid-steer", 4), ("car", 2), ("tricycle", 2), ("mecanum", 4), ("omni", 3)],
)
def test_it_is_a_robot_of_these_sizes(layout, driven):
    robot = generic_robot(60.0, 0.1, 0.45, 0.5, 5.0, layout)
    assert robot.mass_kg == 60.0
    assert robot.wheel.radius_m == pytest.approx(0.1 / math.sqrt(2.0) if layout == "mecanum" else 0.1)
    assert 2 * robot.chassis.arm_m == 0.45 if isinstance(robot.chassis, Omni) else robot.chassis.track_m == 0.45
    assert robot.driven == driven
    assert robot.loads[:, 0].sum() == pytest.approx(1.0)
    assert ROBOT_FILE.dump(ROBOT_FILE.parse(ROBOT_FILE.dump(robot))) == ROBOT_FILE.dump(robot)


def test_its_motors_pull_the_weight_at_standstill_and_run_free_at_two_and_a_half_metres_a_second():
    robot = generic_robot(60.0, 0.1, 0.45, gear_ratio=5.0)
    stall_A = 24.0 / robot.motor.resistance_ohm
    pull_N = robot.driven * robot.motor.wheel_constant_Nm_per_A * stall_A / robot.wheel.radius_m
    assert pull_N == pytest.approx(60.0 * GRAVITY)
    assert 24.0 / robot.motor.wheel_constant_Nm_per_A * robot.wheel.radius_m == pytest.approx(2.5)


def test_a_size_that_cannot_be_is_refused():
    with pytest.raises(InputError, match="track_m must be"):
        generic_robot(60.0, 0.1, -0.45)


@pytest.mark.parametrize("make", [lambda: generic_robot(5.0, 65.0, 300.0), lambda: Wheel(65.0, 20.0, 1.0)])
def test_wheels_in_millimetres_are_refused(make):
    with pytest.raises(InputError, match=r"must be at most 3, got 65; in millimetres\? then it is 0\.065"):
        make()
