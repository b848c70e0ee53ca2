import numpy as np
import pytest

from ohmward.trace import Kernel
from ohmward.traction import RLMA
from ohmward.traction.terrain.floor import (
    drag_columns,
    drag_share,
    inertial_forces,
    static_loads,
    undetermined_force_std,
)
from traction.terrain.drives import OMNI, SOFT, steady


@pytest.mark.parametrize("direction_deg", [0.0, 37.0, 90.0, 200.0, 330.0])
def test_the_forces_are_those_of_the_balance_of_the_body(direction_deg):
    a = np.radians(direction_deg)
    rim = 0.15 * np.array([np.cos(a), np.sin(a), 0.0])
    _, force = steady(OMNI, [SOFT] * 3, rim)
    found = np.einsum("dws,s->d", drag_columns(OMNI, rim), [SOFT.rolling, SOFT.roller])
    np.testing.assert_allclose(found, force, rtol=1e-3, atol=0.02)


def test_rows_of_motions_give_the_same_as_each_of_them_and_as_a_traced_one():
    motions = np.random.default_rng(3).normal(0.0, 0.1, (7, 3))
    kernel = Kernel(lambda m: drag_columns(OMNI, m), motions[0])
    rows = drag_columns(OMNI, motions)
    np.testing.assert_allclose(rows, [drag_columns(OMNI, m) for m in motions], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(rows, [kernel(m) for m in motions], rtol=1e-12, atol=1e-12)


def test_a_robot_that_only_rolls_needs_its_rolling_share():
    force = drag_columns(RLMA, np.array([2.0, 0.0])).sum(axis=1) @ [0.03, 0.5]
    assert drag_share(RLMA, np.array([2.0, 0.0]), force) == pytest.approx(0.03, rel=1e-4)


def test_acceleration_takes_mass_times_acceleration():
    force = inertial_forces(OMNI, np.array([0.5, -0.2, 0.0]))
    np.testing.assert_allclose(force @ OMNI.rolling[:, :2], OMNI.mass_kg * np.array([0.5, -0.2]), rtol=1e-12)


def test_loads_add_up_to_the_weight():
    assert static_loads(OMNI).sum() == pytest.approx(11.3 * 9.80665)


def test_the_friction_of_a_motor_at_rest_is_open_and_of_one_that_turns_is_known():
    std = undetermined_force_std(OMNI, np.array([0.0, 3.0, -3.0]))
    assert std[0] == pytest.approx(0.15 / 0.036)
    assert std[1] == std[2] < 1e-4
