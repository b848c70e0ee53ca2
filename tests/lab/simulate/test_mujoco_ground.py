import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward_lab.simulate.mujoco_plant import Ground, RlmaPlant, switching, uniform, zones

HERE = np.zeros((4, 2))


def test_uniform_ground_is_the_same_everywhere():
    ground = uniform(0.5, grade_rad=0.1)
    assert ground.friction(3.0, HERE).tolist() == [0.5] * 4
    assert ground.grade_rad(3.0, HERE[0]) == 0.1


@pytest.mark.parametrize("time_s, mu", [(0.0, 0.8), (0.999, 0.8), (1.0, 0.2), (2.5, 0.6)])
def test_switching_ground_changes_at_its_times(time_s, mu):
    ground = switching([1.0, 2.0], [0.8, 0.2, 0.6])
    assert ground.friction(time_s, HERE) == mu
    assert ground.grade_rad(time_s, HERE[0]) == 0.0


def test_zones_tell_the_wheels_apart():
    ground = zones([1.0], [0.8, 0.2], grade_rad=[0.0, 0.1])
    place = np.array([[1.1, 0.15], [1.1, -0.15], [0.5, 0.15], [0.5, -0.15]])
    assert ground.friction(0.0, place).tolist() == [0.2, 0.2, 0.8, 0.8]
    assert ground.grade_rad(0.0, place[0]) == 0.1
    assert ground.grade_rad(0.0, place[2]) == 0.0


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: switching([1.0], [0.8]), r"friction must be \(2,\), one piece more"),
        (lambda: zones([1.0], [0.8, 0.2], [0.0, 0.0, 0.0]), r"grade_rad must be a number or \(2,\)"),
        (lambda: zones([2.0, 1.0], [0.8, 0.2, 0.8]), "edge_m must be a list that increases strictly"),
        (lambda: uniform(0.0), "friction must be between 0.001 and 3, got 0"),
        (lambda: uniform(0.5, grade_rad=1.0), "grade_rad must be between -0.7 and 0.7, got 1"),
    ],
)
def test_impossible_ground_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


NAN_LATER = Ground(lambda t, _: 0.5 if t < 0.05 else np.nan, lambda *_: 0.0)
STEEP_LATER = Ground(lambda *_: 0.5, lambda t, _: 0.0 if t < 0.05 else 1.0)


@pytest.mark.parametrize(
    "ground, message",
    [
        (NAN_LATER, r"ground.friction must return values in \(0, 3\], got \[nan"),
        (STEEP_LATER, "ground.grade_rad must return a value within"),
    ],
)
def test_ground_of_ones_own_is_checked_as_it_is_used(ground, message):
    pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install mujoco")
    plant = RlmaPlant(ground=ground)
    with pytest.raises(InputError, match=message):
        plant.step(0.0, 0.1)
