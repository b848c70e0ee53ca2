"""Calibration in one call is that of its parts, one after the other."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction.calibration import calibrate, calibrate_motor, calibrate_radius, with_parameters, with_wheel_loads
from ohmward.traction.robot.robot import GRAVITY
from traction.terrain.drives import OMNI, SMOOTH, omni_drive


@pytest.fixture(scope="module")
def drives():
    rng = np.random.default_rng(3)
    return [omni_drive([SMOOTH] * 3, direction, 0.12, 6.0, rng, OMNI) for direction in range(0, 360, 60)]


def test_the_motor_is_calibrated_with_the_new_radius(drives):
    found = calibrate(drives, OMNI)
    radius = calibrate_radius(drives, OMNI)
    motor = calibrate_motor(drives, with_parameters(OMNI, [radius]))
    assert found.parameters == (radius, *motor)
    assert found.robot == with_parameters(OMNI, found.parameters)
    assert found.floor is None


def test_a_floor_can_be_learnt_alone(drives):
    found = calibrate(drives, OMNI, parts=(), floor="smooth")
    assert found.parameters == () and found.robot == OMNI
    assert found.floor is not None and found.floor.name == "smooth"


def test_wheel_loads_are_the_mass():
    weight_N = OMNI.mass_kg * GRAVITY
    loaded = with_wheel_loads(OMNI, (0.3 * weight_N, 0.3 * weight_N, 0.5 * weight_N))
    assert loaded.mass_kg == pytest.approx(1.1 * OMNI.mass_kg)
    assert loaded.wheel_load_N == pytest.approx((0.3 * weight_N, 0.3 * weight_N, 0.5 * weight_N))


def test_loads_in_another_unit_are_refused():
    with pytest.raises(InputError, match="give newtons, not kilograms or grams"):
        with_wheel_loads(OMNI, (3.0, 3.0, 3.0))
