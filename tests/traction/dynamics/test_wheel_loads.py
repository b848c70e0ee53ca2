"""Loads of the wheels as weighed, in the place of those that follow from the geometry."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction import ROBOTINO
from ohmward.traction.dynamics.forces import RobotInput, normal_loads
from ohmward.traction.robot.robot import ROBOT_FILE

LOADS = (30.4, 50.0, 30.4)


def test_weighed_loads_are_the_loads_of_the_models():
    robot = replace(ROBOTINO, wheel_load_N=LOADS)
    weight = robot.mass_kg * 9.80665
    np.testing.assert_allclose(
        normal_loads(RobotInput(np.zeros(3)), robot, np.zeros(2)), np.array(LOADS) / sum(LOADS) * weight, rtol=1e-12
    )


def test_weighed_loads_are_kept_in_the_file():
    robot = replace(ROBOTINO, wheel_load_N=LOADS)
    assert ROBOT_FILE.parse(ROBOT_FILE.dump(robot)).wheel_load_N == LOADS


@pytest.mark.parametrize(
    "loads, message",
    [
        ((3.1, 5.1, 3.1), "add up to the weight of robot.mass_kg, 110.8 N within 5 %, got 11.3 N"),
        ((30.0, 80.0), "must have 3 values"),
        ((60.0, 60.0, -10.0), "wheel_load_N must be > 0"),
    ],
)
def test_loads_that_cannot_be_are_refused(loads, message):
    with pytest.raises(InputError, match=message):
        replace(ROBOTINO, wheel_load_N=loads)
