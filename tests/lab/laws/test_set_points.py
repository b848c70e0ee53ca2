import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from ohmward.errors import InputError
from ohmward.traction.friction.law import CoulombCreep, WardIagnemma
from ohmward.traction.friction.terrain import ROADS
from ohmward_lab.traction.set_points import best_slip, driving_force, maximize
from traction.examples import LAWS, LOAD_N


@pytest.mark.parametrize("name", LAWS)
def test_the_best_slip_is_the_one_that_scipy_finds(name):
    found = best_slip(LAWS[name], LOAD_N, 3.0, 0.5)

    def waste(slip):
        return -(1 - slip) * (1 - 3.0 / driving_force(LAWS[name], slip, LOAD_N, 0.5))

    other = minimize_scalar(waste, bounds=(1e-4, 0.9), method="bounded", options={"xatol": 1e-10})
    assert found.efficiency == pytest.approx(-other.fun, rel=1e-9)
    assert found.slip_ratio == pytest.approx(other.x, abs=1e-5)


@pytest.mark.parametrize("name", LAWS)
def test_the_best_slip_lies_below_the_peak_and_grows_with_the_resistance(name):
    slips = [best_slip(LAWS[name], LOAD_N, resistance, 0.5).slip_ratio for resistance in (1.0, 3.0, 9.0)]
    assert slips == sorted(slips)
    assert slips[-1] < maximize(lambda slip: driving_force(LAWS[name], slip, LOAD_N, 0.5))[0]


def test_where_the_force_is_proportional_to_slip_speed_it_is_a_quadratic_equation():
    # (1 - x) (1 - a (1 - x)/x), a = R/(N c v): stationary at x = sqrt(a / (1 + a))
    law, resistance, speed = CoulombCreep(0.9, 2.0), 2.0, 0.5
    a = resistance / (LOAD_N * 2.0 * speed)
    assert best_slip(law, LOAD_N, resistance, speed).slip_ratio == pytest.approx(np.sqrt(a / (1 + a)), abs=1e-6)


def test_on_a_hard_floor_it_is_a_few_per_cent_and_far_below_the_peak():
    road = ROADS["dry asphalt road"]
    assert 0.01 < best_slip(road, LOAD_N, 0.01 * LOAD_N, 0.5).slip_ratio < 0.04
    assert 0.01 < best_slip(road, LOAD_N, 0.03 * LOAD_N, 0.5).slip_ratio < 0.04 < road.peak_slip_ratio / 4


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match=r"resistance_N must be below what the ground gives \(.* N\), got 80"):
        best_slip(WardIagnemma(0.2, 20.0), LOAD_N, 80.0, 0.5)
    with pytest.raises(InputError, match="load_N must be > 0"):
        best_slip(WardIagnemma(0.2, 20.0), 0.0, 1.0, 0.5)
    with pytest.raises(InputError, match="travel_speed_m_s must be > 0"):
        best_slip(WardIagnemma(0.2, 20.0), 100.0, 1.0, -0.5)
