import math

import pytest

from ohmward.errors import InputError
from ohmward.traction import RLMA
from ohmward.traction.friction.law import CoulombCreep, SoftGround
from ohmward_lab.simulate.ground import Grade, Patch, adhesion, surface

WHEELS = tuple(p.name for p in RLMA.places)


def test_patches_lie_where_they_say_under_each_wheel():
    under = surface([Patch(friction=0.8), Patch(friction=0.1, from_m=1.0, to_m=2.0)], WHEELS)
    assert [p.friction for p in under.patches] == [0.1, 0.8]
    assert under.under([0.99, 1.0, 1.99, 2.0], time_s=0.0) == (1, 0, 0, 1)


def test_patches_come_and_go_in_time():
    under = surface([Patch(friction=0.8), Patch(friction=0.1, from_s=3.0, to_s=4.0)], WHEELS)
    assert [under.under([0.0] * 4, t)[0] for t in (2.99, 3.0, 3.99, 4.0)] == [1, 0, 0, 1]


def test_a_patch_may_lie_under_some_wheels_only():
    under = surface([Patch(friction=0.1, wheels=("front_left", "rear_left"))], WHEELS)
    assert under.under([0.0] * 4, 0.0) == (0, 1, 0, 1)


def test_without_patches_the_ground_is_dry_asphalt():
    (patch,) = surface([], WHEELS).patches
    assert patch.ground(RLMA).name == "dry asphalt"


def test_friction_sets_in_with_slip_speed():
    terrain = Patch(friction=0.3, slip_stiffness_s_per_m=5.0, rolling=0.02).ground(RLMA)
    assert terrain.traction == CoulombCreep(0.3, 5.0)
    assert terrain.rolling.force_N(1.0, 100.0) == pytest.approx(-2.0)
    assert adhesion(terrain) == 0.3


def test_soils_are_those_of_the_robots_wheels():
    law = Patch(terrain="soft soil").ground(RLMA).traction
    assert isinstance(law, SoftGround)
    assert math.isnan(adhesion(Patch(terrain="soft soil").ground(RLMA)))


def test_the_grade_runs_straight_between_its_points():
    grade = Grade((1.0, 3.0), (0.0, 0.1))
    assert [grade.at(x) for x in (-5.0, 1.0, 2.0, 3.0, 9.0)] == pytest.approx([0.0, 0.0, 0.05, 0.1, 0.1])


@pytest.mark.parametrize(
    "patches, message",
    [
        ([Patch(friction=0.1, from_m=1.0, to_m=3.0), Patch(friction=0.2, from_m=2.0)], "patches overlap: friction 0.1"),
        ([Patch(friction=0.1, from_s=1.0), Patch(friction=0.2, from_m=2.0)], "end one where the other begins"),
        ([Patch(friction=0.1), Patch(friction=0.2)], "2 patches have no edge"),
        ([Patch(friction=0.1, wheels=("left",))], "ground.wheels must be out of front_left"),
    ],
)
def test_patches_that_cannot_lie_together_are_refused(patches, message):
    with pytest.raises(InputError, match=message):
        surface(patches, WHEELS)


def test_patches_that_touch_do_not_overlap():
    patches = [Patch(friction=0.1, from_m=1.0, to_m=2.0), Patch(friction=0.2, from_m=2.0, to_m=3.0)]
    left, right = Patch(friction=0.1, wheels=WHEELS[::2]), Patch(friction=0.2, wheels=WHEELS[1::2])
    assert len(surface(patches, WHEELS).patches) == 3
    assert len(surface([left, right], WHEELS).patches) == 3


@pytest.mark.parametrize(
    "values, message",
    [
        ({"friction": 0.0}, "ground.friction must be > 0 and at most 3, got 0"),
        ({"friction": -0.2}, "got -0.2"),
        ({"terrain": "moon"}, "ground.terrain must be one of dry asphalt, .* got 'moon'"),
        ({"terrain": "ice", "friction": 0.1}, "give terrain or friction, not both"),
        ({"from_m": 2.0, "to_m": 1.0}, "ground.from_m must be below to_m, got 2 and 1"),
        ({"from_s": math.nan}, "ground.from_s, to_s must be finite"),
        ({"rolling": -0.1}, "ground.rolling must be between 0 and 1"),
        ({"slip_stiffness_s_per_m": 0.0}, "ground.slip_stiffness_s_per_m must be > 0"),
    ],
)
def test_impossible_patches_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        Patch(**values)


@pytest.mark.parametrize(
    "position, slope, message",
    [
        ((0.0, 1.0), (0.0,), "must be equally long"),
        ((1.0, 0.0), (0.0, 0.1), "grade.position_m must increase"),
        ((0.0,), (1.2,), "grade.grade_rad must be between -0.7 and 0.7"),
    ],
)
def test_impossible_grades_are_refused(position, slope, message):
    with pytest.raises(InputError, match=message):
        Grade(position, slope)
