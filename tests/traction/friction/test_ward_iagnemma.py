import numpy as np
import pytest
import sympy as sp

from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward.traction.friction.law import Burckhardt, Contact, WardIagnemma, adhesion, contact
from ohmward.traction.friction.terrain import ROADS

LAW = WardIagnemma(1.0, 20.0, -0.4, sliding=0.6)


def mu(law, slip):
    return law.force_N(contact(slip, 0.0, 1.0))


def test_the_formula_by_hand():
    assert mu(WardIagnemma(0.7, 20.0), 0.05) == pytest.approx(0.7 * (1 - np.exp(-1.0)))
    assert mu(WardIagnemma(0.7, 20.0, 0.1), -0.05) == pytest.approx(-0.7 * (1 - np.exp(-1.0)) - 0.005)


def test_without_c3_it_saturates_at_c1():
    law = WardIagnemma(0.7, 20.0)
    assert law.peak_slip_speed_m_s == np.inf
    assert law.peak_adhesion == 0.7
    assert mu(law, 10.0) == pytest.approx(0.7, abs=1e-12)


def test_small_c3_is_the_limit():
    slip = np.linspace(0.0, 2.0, 100)
    np.testing.assert_allclose(mu(WardIagnemma(0.7, 20.0, -1e-9), slip), mu(WardIagnemma(0.7, 20.0), slip), atol=1e-8)


def test_the_peak_is_where_sympy_finds_it():
    s = sp.symbols("s", positive=True)
    f = 1 - sp.exp(-20 * s) - sp.Rational(2, 5) * s
    (at,) = sp.solve(sp.diff(f, s), s)
    assert LAW.peak_slip_speed_m_s == pytest.approx(float(at), rel=1e-12)
    assert LAW.peak_adhesion == pytest.approx(float(f.subs(s, at)), rel=1e-12)


def test_beyond_the_peak_it_falls_to_the_sliding_value_and_stays():
    slip = np.linspace(LAW.peak_slip_speed_m_s, 5.0, 1000)
    values = mu(LAW, slip)
    assert np.all(np.diff(values) <= 0)
    assert values[-1] == 0.6
    assert mu(LAW, 0.5) == pytest.approx(1.0 - 0.2, abs=1e-4)


def test_before_the_peak_the_sliding_value_does_nothing():
    assert mu(LAW, 0.01) == pytest.approx(1 - np.exp(-0.2) - 0.004)


@pytest.mark.parametrize("slip_speed", [0.02, 0.1, 1.0])
def test_made_from_a_peak_it_has_that_peak(slip_speed):
    law = WardIagnemma.with_peak(0.85, 0.75, slip_speed)
    assert law.peak_slip_speed_m_s == pytest.approx(slip_speed)
    assert law.peak_adhesion == pytest.approx(0.85)
    assert mu(law, 100.0) == 0.75


@pytest.mark.parametrize("speed", [0.3, 1.0, 20.0])
@pytest.mark.parametrize("name", ROADS)
def test_at_one_speed_it_is_burckhardts_law(name, speed):
    road: Burckhardt = ROADS[name]
    slip = np.linspace(-1.0, 1.0, 201) * speed
    at_speed = Contact(slip, speed, speed, 1.0)
    np.testing.assert_allclose(road.at_speed(speed).force_N(at_speed), road.force_N(at_speed), atol=1e-12)


@pytest.mark.parametrize(
    "name, slip, peak, sliding",
    [
        ("dry asphalt road", 0.170, 1.17, 0.76),
        ("dry concrete road", 0.160, 1.09, 0.66),
        ("wet asphalt road", 0.131, 0.80, 0.51),
        ("dry cobbles road", 0.400, 1.00, 0.70),
        ("wet cobbles road", 0.140, 0.38, 0.28),
        ("snow road", 0.060, 0.19, 0.13),
        ("ice road", 1.0, 0.05, 0.05),
    ],
)
def test_the_peaks_of_the_roads_are_the_known_ones(name, slip, peak, sliding):
    road = ROADS[name]
    assert road.peak_slip_ratio == pytest.approx(slip, abs=6e-4)
    assert (road.peak_adhesion, road.sliding) == pytest.approx((peak, sliding), abs=6e-3)


def test_where_rim_and_travel_oppose_burckhardts_adhesion_is_that_of_sliding():
    road = ROADS["dry cobbles road"]
    assert road.force_N(contact(1.0, -0.9, 1.0)) == road.force_N(contact(1.0, 0.0, 1.0)) == road.sliding


def test_parameters_may_be_states_of_a_filter():
    kernel = Kernel(adhesion, 0.0, 0.0, 0.0, 0.0)
    assert kernel(0.05, 0.7, 20.0, -0.1) == pytest.approx(0.7 * (1 - np.exp(-1.0)) - 0.005)


@pytest.mark.parametrize(
    "arguments, message",
    [
        ((0.0, 20.0), "c1 must be > 0, got 0"),
        ((0.7, -1.0), "c2_s_per_m must be > 0, got -1"),
        ((0.7, 20.0, np.nan), "c3_s_per_m must be finite"),
        ((0.7, 20.0, -14.0), r"c3_s_per_m must be > -c1 \* c2 = -14.*got -14"),
        ((0.7, 20.0, -0.1, 0.8), "sliding must be between 0 and 0.6"),
        ((0.7, 20.0, -0.1, -0.1), "sliding must be between 0"),
    ],
)
def test_impossible_parameters_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        WardIagnemma(*arguments)


def test_a_sliding_wheel_that_would_be_pushed_is_refused():
    with pytest.raises(InputError, match=r"burckhardt.c3 must be at most .* = 0\.5, or a sliding wheel is pushed"):
        Burckhardt(0.5, 50.0, 0.6)
    with pytest.raises(InputError, match="speed_m_s must be > 0"):
        ROADS["snow road"].at_speed(0.0)
