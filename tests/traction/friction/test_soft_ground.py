from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from ohmward.errors import InputError
from ohmward.traction.friction.law import SoftGround, Soil, contact, mean_shear
from ohmward.traction.friction.terrain import SOILS

RADIUS, WIDTH, LOAD = 0.12, 0.05, 100.0


def ground(name="regolith"):
    return SoftGround(SOILS[name], RADIUS, WIDTH)


def pressure(soil, z):
    return (soil.cohesive_modulus / WIDTH + soil.frictional_modulus) * z**soil.exponent


def carried(soil, sinkage):
    """Load that the pressure carries under a rut whose bottom is the parabola of Bekker's wheel."""
    height = np.sqrt(2 * RADIUS * sinkage)
    return quad(lambda x: WIDTH * pressure(soil, sinkage - x * x / (2 * RADIUS)), 0.0, height)[0]


def test_the_pressure_under_the_wheel_carries_the_load():
    sinkage = ground().footprint(LOAD).sinkage_m
    assert SOILS["regolith"].exponent == 1.0
    assert carried(SOILS["regolith"], sinkage) == pytest.approx(LOAD, rel=1e-6)


@pytest.mark.parametrize("name", SOILS)
def test_bekkers_two_terms_carry_the_load_nearly_where_n_is_not_one(name):
    assert carried(SOILS[name], ground(name).footprint(LOAD).sinkage_m) == pytest.approx(LOAD, rel=0.04)


@pytest.mark.parametrize("name", SOILS)
def test_compaction_is_the_work_on_a_metre_of_rut(name):
    work = quad(lambda z: WIDTH * pressure(SOILS[name], z), 0.0, ground(name).footprint(LOAD).sinkage_m)[0]
    assert ground(name).compaction_N(LOAD) == pytest.approx(work, rel=1e-8)


@pytest.mark.parametrize(
    "rim, travel, creepage", [(1.0, 0.8, 0.2), (1.0, 0.0, 1.0), (0.8, 1.0, -0.25), (-1.0, -0.9, -0.1)]
)
def test_traction_is_the_shear_stress_integrated_along_the_contact(rim, travel, creepage):
    soil, length = SOILS["regolith"], ground().footprint(LOAD).length_m
    strongest = soil.cohesion_Pa + LOAD / (WIDTH * length) * np.tan(np.radians(soil.friction_deg))

    def stress(x):
        return strongest * (1 - np.exp(-abs(creepage) * x / soil.shear_length_m))

    expected = np.sign(creepage) * WIDTH * quad(stress, 0.0, length)[0]
    assert ground().force_N(contact(rim, travel, LOAD)) == pytest.approx(expected, rel=1e-9)


def test_more_load_sinks_deeper_and_pulls_more():
    loads = np.array([20.0, 50.0, 100.0, 300.0])
    assert np.all(np.diff(ground().footprint(loads).sinkage_m) > 0)
    assert np.all(np.diff(ground().force_N(contact(1.0, 0.7, loads))) > 0)


def test_it_does_not_sink_deeper_than_its_axle():
    assert ground("soft soil").footprint(1e6).sinkage_m == RADIUS


def test_mean_shear_is_smooth_where_the_series_takes_over():
    x = np.array([0.0, 1e-12, 1e-3 - 1e-9, 1e-3 + 1e-9, 1.0])
    exact = [0.0, 5e-13, *(0.5 * v - v * v / 6 + v**3 / 24 for v in x[2:4]), np.exp(-1.0)]
    np.testing.assert_allclose(mean_shear(x), exact, rtol=1e-9)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"exponent": 3.0}, "soil.exponent must be < 3"),
        ({"friction_deg": 80.0}, "soil.friction_deg must be between 0 and 60"),
        ({"shear_length_m": 0.0}, "soil.shear_length_m must be > 0"),
        ({"cohesion_Pa": -1.0}, "soil.cohesion_Pa must be >= 0"),
    ],
)
def test_impossible_soils_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(Soil("s", 1e6, 0.0, 1.0, 0.0, 30.0, 0.01), **change)
