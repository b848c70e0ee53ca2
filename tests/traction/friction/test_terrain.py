import pytest

from ohmward.errors import InputError
from ohmward.traction import hard_terrain, soft_terrain
from ohmward.traction.friction.law import WardIagnemma, contact
from ohmward.traction.friction.terrain import ADHESION, ROADS


@pytest.mark.parametrize("name", ADHESION)
def test_a_hard_floor_has_the_peak_and_the_sliding_value_of_its_table(name):
    law, published = hard_terrain(name).traction, ADHESION[name]
    assert isinstance(law, WardIagnemma)
    assert published.peak[0] <= law.peak_adhesion <= published.peak[1] + 1e-12
    assert published.sliding[0] <= law.force_N(contact(9.0, 0.0, 1.0)) <= published.sliding[1] + 1e-12
    assert law.peak_slip_speed_m_s == pytest.approx(0.1)


def test_table_4_1():
    assert dict(ADHESION) == {
        "dry asphalt": ((0.8, 0.9), (0.75, 0.75)),
        "wet asphalt": ((0.5, 0.7), (0.45, 0.6)),
        "gravel": ((0.6, 0.6), (0.55, 0.55)),
        "ice": ((0.1, 0.1), (0.07, 0.07)),
    }


@pytest.mark.parametrize("name", ROADS)
def test_a_road_is_burckhardts(name):
    assert hard_terrain(name).traction is ROADS[name]
    assert "Burckhardt" in hard_terrain(name).source


@pytest.mark.parametrize(
    "name, passable", [("firm soil", True), ("regolith", True), ("LETE sand", True), ("soft soil", False)]
)
def test_a_wheel_of_100_N_passes_all_soils_but_the_softest(name, passable):
    terrain = soft_terrain(name, 0.12, 0.05)
    pull, resistance = terrain.traction.force_N(contact(1.0, 0.5, 100.0)), -terrain.rolling.force_N(0.5, 100.0)
    assert 0 < resistance < 100.0
    assert (pull > resistance) == passable


def test_an_unknown_terrain_is_refused_with_those_that_there_are():
    with pytest.raises(InputError, match=r"dry asphalt, .*ice road; got 'tarmac'"):
        hard_terrain("tarmac")
    with pytest.raises(InputError, match=r"soft soil, .*LETE sand; got 'ice'"):
        soft_terrain("ice", 0.12, 0.05)
