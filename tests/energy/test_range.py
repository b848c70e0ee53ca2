import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from energy.examples import battery, certain, learned
from ohmward.energy.leg import Leg, Stretch, stretch_of
from ohmward.energy.range import distances, range_left, time_left
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


def test_ground_that_gives_energy_has_no_end():
    c = certain(idle_W=0.1, force_N=1.0, climb=1.0, regeneration=1.0)
    found = range_left(c, [stretch_of(Leg(100.0, "grass", 0.5, -0.1))], battery(), BatteryState(0.5))
    assert found.distance_m == (np.inf,) * 3


def test_more_doubt_is_a_wider_range_and_less_charge_a_shorter_one():
    sure, unsure, less = (
        range_left(learned(), [LEG], battery(), BatteryState(soc, std)).distance_m
        for soc, std in ((0.6, 0.0), (0.6, 0.08), (0.3, 0.0))
    )
    assert unsure.p90 - unsure.p10 > 1.2 * (sure.p90 - sure.p10)
    assert less.p50 < 0.55 * sure.p50


def test_standing_it_is_energy_over_idle_power():
    found = time_left(certain(), battery(), BatteryState(0.5))
    assert np.array(found) == pytest.approx(36000.0 * 24.0 * 0.5 / 10.0, rel=1e-5)


def test_no_distance_ahead_is_refused():
    with pytest.raises(InputError, match="the way ahead has no distance"):
        range_left(certain(), [Stretch("", 10.0)], battery(), BatteryState(0.5))
