import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.trace import Kernel, linearize
from ohmward.traction import CompactionResistance, RollingResistance
from ohmward.traction.friction.law import SoftGround
from ohmward.traction.friction.terrain import SOILS

SOIL = CompactionResistance(SoftGround(SOILS["regolith"], 0.12, 0.05))
every_law = pytest.mark.parametrize("law", [RollingResistance(), SOIL], ids=["hard", "soil"])


def test_the_formula_by_hand():
    expected = -200.0 * (0.0075 * (1 - np.exp(-50.0 * 0.1)) + 0.02 * 0.1)
    assert RollingResistance().force_N(0.1, 200.0) == pytest.approx(expected)


def test_soil_resists_with_its_compaction():
    assert SOIL.force_N(2.0, 100.0) == pytest.approx(-SOIL.ground.compaction_N(100.0))


@every_law
@given(speed=st.floats(-10, 10), load=st.floats(0, 1e3))
def test_it_takes_energy_and_is_odd(law, speed, load):
    assert law.force_N(speed, load) * speed <= 0.0
    assert law.force_N(-speed, load) == -law.force_N(speed, load)


@every_law
def test_at_rest_it_is_zero_with_the_slope_of_both_sides(law):
    value, J = linearize(lambda v: np.array([law.force_N(v[0], 100.0)]), np.array([0.0]))
    assert value[0] == 0.0
    assert J[0, 0] == pytest.approx((law.force_N(1e-8, 100.0) - law.force_N(-1e-8, 100.0)) / 2e-8, rel=1e-5)


@every_law
def test_traced_it_is_the_same(law):
    kernel = Kernel(law.force_N, 0.0, 0.0)
    for speed in (-0.3, 0.0, 0.01, 2.0):
        assert kernel(speed, 90.0) == pytest.approx(law.force_N(speed, 90.0), rel=1e-12)


@pytest.mark.parametrize(
    "values, name", [((-0.1,), "a1"), ((0.01, 0.0), "a2_s_per_m"), ((0.01, 1.0, -1.0), "a3_s_per_m")]
)
def test_impossible_parameters_are_refused(values, name):
    with pytest.raises(InputError, match=f"rolling.{name} must be"):
        RollingResistance(*values)
