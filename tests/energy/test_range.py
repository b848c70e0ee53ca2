import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from energy.examples import PRIOR, battery, certain, learned
from ohmward.energy.consumption import learn, start
from ohmward.energy.leg import Leg, Stretch, stretch_of
from ohmward.energy.range import credible, distances, range_along, range_left
from ohmward.energy.usable_energy import BatteryState
from ohmward.errors import InputError

LEG = stretch_of(Leg(100.0, "grass", 0.5))


def test_without_doubt_it_is_energy_over_energy_per_metre():
    found = range_left(certain(), [LEG], battery(), BatteryState(0.8, reserve_soc=0.2))
    usable_J = 36000.0 * 24.0 * 0.6
    assert np.array(found.distance_m) == pytest.approx(usable_J / (20.0 + 10.0 / 0.5), rel=1e-5)
    assert np.array(found.time_s) == pytest.approx(2 * np.array(found.distance_m))
    assert np.array(found.usable_J) == pytest.approx(usable_J, rel=1e-9)
    assert found.power_W == pytest.approx(20.0)


def test_the_length_of_the_way_ahead_does_not_matter():
    ch = BatteryState(0.8, 0.03)
    long, short = (range_left(learned(), [stretch_of(Leg(d, "grass", 0.5))], battery(), ch) for d in (1000.0, 1.0))
    assert np.array(long.distance_m) == pytest.approx(np.array(short.distance_m))


@given(st.floats(1.0, 100.0), st.floats(-50.0, 50.0), st.floats(0.0, 1e6))
def test_the_root_of_distance(per_m, scatter, usable):
    (d,) = distances(*(np.array([v]) for v in (per_m, scatter, usable)))
    assert per_m * d + scatter * np.sqrt(d) == pytest.approx(usable, rel=1e-9, abs=1e-6)


def test_no_ground_descends_for_ever():
    c = certain(idle_W=0.1, force_N=1.0, climb=1.0, regeneration=1.0)
    down, flat = (
        range_left(c, [stretch_of(Leg(100.0, "grass", 0.5, grade_rad))], battery(), BatteryState(0.5)).distance_m
        for grade_rad in (-0.1, 0.0)
    )
    assert down == pytest.approx(flat)


def test_the_least_of_a_broad_guess_is_a_tenth_of_its_mean():
    broad = certain()
    broad.cov[6, 6] = 40.0**2  # N^2, of a force of 20 N
    left = range_left(broad, [LEG], battery(), BatteryState(0.5)).distance_m
    assert left.p90 == pytest.approx(10.0 * left.p50, rel=0.01)


@pytest.mark.parametrize(("measured_J", "is_credible"), [(-4000.0, False), (0.0, False), (1000.0, True)])
def test_driving_that_seems_to_cost_nothing_is_not_credible(measured_J, is_credible):
    c = start(PRIOR)
    for _ in range(20):
        c = learn(c, LEG, measured_J)
    believed = credible(c, [LEG])
    assert (believed is c) == is_credible
    assert range_left(believed, [LEG], battery(), BatteryState(0.5)).distance_m.p50 < 432e3 / 5.0


def test_more_doubt_is_a_wider_range_and_less_charge_a_shorter_one():
    sure, unsure, less = (
        range_left(learned(), [LEG], battery(), BatteryState(soc, std)).distance_m
        for soc, std in ((0.6, 0.0), (0.6, 0.08), (0.3, 0.0))
    )
    assert unsure.p90 - unsure.p10 > 1.2 * (sure.p90 - sure.p10)
    assert less.p50 < 0.55 * sure.p50


def test_no_distance_ahead_is_refused():
    with pytest.raises(InputError, match="the way ahead has no distance"):
        range_left(certain(), [Stretch("", 10.0)], battery(), BatteryState(0.5))


@pytest.mark.parametrize("length_m", [10.0, 9000.0, 90_000.0])
def test_along_even_ground_the_plan_makes_no_difference(length_m):
    """12,960 m are left, which is beyond the end of two of the plans; there the ground is not known."""
    plan = [stretch_of(Leg(length_m / 50, "grass", 0.5))] * 50
    found = range_along(certain(), plan, [LEG], battery(), BatteryState(0.8, reserve_soc=0.2))
    expected = range_left(certain(), [LEG], battery(), BatteryState(0.8, reserve_soc=0.2))
    assert found.distance_m.p50 == pytest.approx(expected.distance_m.p50, rel=1e-3)
    assert found.time_s.p50 == pytest.approx(expected.time_s.p50, rel=1e-3)
    wide = found.distance_m.p90 - found.distance_m.p10 > 1.0
    assert wide == (length_m < expected.distance_m.p50)


def test_a_climb_ahead_is_where_the_battery_ends():
    """Level ground takes 40 J/m of the 100 kJ that are left, the climb the weight of 40 kg besides."""
    level, climb = Leg(2000.0, "grass", 0.5), Leg(200.0, "grass", 0.5, grade_rad=0.2)
    charge = BatteryState(100e3 / (36000.0 * 24.0))
    found = range_along(certain(), [stretch_of(level), stretch_of(climb)], [LEG], battery(), charge)
    rise_J_per_m = 40.0 * 9.80665 * np.sin(0.2)
    assert found.distance_m.p50 == pytest.approx(2000.0 + 20e3 / (40.0 + rise_J_per_m), rel=1e-3)
    found = range_along(certain(), [stretch_of(climb), stretch_of(level)], [LEG], battery(), charge)
    assert found.distance_m.p50 == pytest.approx(200.0 + (100e3 - 200.0 * (40.0 + rise_J_per_m)) / 40.0, rel=1e-3)


def test_a_way_down_gives_nothing_that_was_not_there_before():
    """A robot whose battery ends on the climb does not reach the way down behind it."""
    up, down = (stretch_of(Leg(200.0, "grass", 0.5, grade_rad=g)) for g in (0.2, -0.2))
    c = certain(idle_W=0.1, regeneration=1.0)
    half_J = 0.5 * 200.0 * (20.2 + 40.0 * 9.80665 * np.sin(0.2))
    found = range_along(c, [up, down], [LEG], battery(), BatteryState(half_J / (36000.0 * 24.0)))
    assert found.distance_m.p50 == pytest.approx(100.0, rel=1e-3)


def test_a_stop_may_outlast_the_battery():
    """At 10 W of electronics, 864 kJ last for a day."""
    found = range_along(
        certain(), [stretch_of(Leg(0.0, "grass", 0.5, stop_s=1e6))], [LEG], battery(), BatteryState(1.0)
    )
    assert found.distance_m == (0.0, 0.0, 0.0) and found.time_s.p50 == pytest.approx(86_400.0, rel=1e-3)
