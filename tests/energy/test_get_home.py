from dataclasses import replace

import numpy as np
import pytest

from energy.examples import battery, certain, learned
from ohmward.energy.leg import Leg
from ohmward.energy.range import get_home
from ohmward.energy.usable_energy import BatteryState
from ohmward.errors import InputError

#: 40 J/m on level grass at 0.5 m/s, 432 kJ in the battery: 10.8 km.
HALF = BatteryState(0.5)


def test_without_doubt_a_plan_can_be_driven_or_not():
    for distance_m, expected in ((10_700.0, 1.0), (10_900.0, 0.0)):
        found = get_home(certain(), [Leg(distance_m, "grass", 0.5)], battery(), HALF)
        assert found.probability == expected


def test_the_point_of_return_is_half_the_range():
    found = get_home(certain(), [Leg(5_000.0, "grass", 0.5), Leg(5_000.0, "grass", 0.5)], battery(), HALF)
    assert found.point_of_return_m == pytest.approx(5_400.0, rel=1e-4)
    assert get_home(certain(), [Leg(2_000.0, "grass", 0.5)], battery(), HALF).point_of_return_m == 2_000.0


def test_a_hill_counts_on_the_way_back_as_well():
    # downhill the idle power alone, 20 J/m; back up 40 + 40 * 9.80665 * sin(0.1)
    found = get_home(certain(), [Leg(20_000.0, "grass", 0.5, -0.1)], battery(), HALF)
    assert found.point_of_return_m == pytest.approx(432e3 / (60.0 + 40 * 9.80665 * np.sin(0.1)), rel=1e-4)


def test_milestones_add_up():
    plan = [Leg(1000.0, "grass", 0.5, stop_s=60.0), Leg(500.0, "grass", 0.25), Leg(0.0, "grass", 1.0, stop_s=100.0)]
    found = get_home(certain(), plan, battery(), HALF)
    assert [m.distance_m for m in found.milestones] == [1000.0, 1500.0, 1500.0]
    assert [m.time_s for m in found.milestones] == [2060.0, 4060.0, 4160.0]
    energy = np.array([40_600.0, 70_600.0, 71_600.0])
    assert [m.energy_J.p50 for m in found.milestones] == pytest.approx(energy, rel=1e-5)
    assert [m.soc.p50 for m in found.milestones] == pytest.approx(0.5 - energy / 864e3, rel=1e-4)


def test_a_task_takes_its_energy_once_and_not_on_the_way_back():
    leg = Leg(2_000.0, "grass", 0.5)
    (bare,), (tasked,) = (
        get_home(certain(), [one], battery(), HALF).milestones for one in (leg, replace(leg, task_J=50e3))
    )
    assert tasked.energy_J.p50 - bare.energy_J.p50 == pytest.approx(50e3)
    far = get_home(certain(), [Leg(10_000.0, "grass", 0.5, task_J=100e3)], battery(), HALF)
    # of 432 kJ, all along the leg: 40 J/m and 10 J/m of the task there, 40 J/m back
    assert far.point_of_return_m == pytest.approx(432e3 / 90.0, rel=1e-4)


def test_probability_falls_along_the_plan_and_with_the_reserve():
    plan = [Leg(1500.0, "grass", 0.5) for _ in range(6)]
    c = learned()
    chances = [
        [m.probability for m in get_home(c, plan, battery(), BatteryState(0.5, 0.05, reserve_soc=r)).milestones]
        for r in (0.0, 0.1)
    ]
    assert all(np.diff(row).max() <= 0.0 for row in chances)
    assert chances[1][-1] < chances[0][-1]
    assert 0.0 < chances[0][-1] < 1.0


def test_more_confidence_turns_earlier():
    plan = [Leg(9_000.0, "grass", 0.5)]
    bold, wary = (
        get_home(learned(), plan, battery(), BatteryState(0.5, 0.05), confidence).point_of_return_m
        for confidence in (0.5, 0.99)
    )
    assert 0.0 < wary < 0.9 * bold


def test_a_plan_that_takes_no_time_is_refused():
    with pytest.raises(InputError, match="the plan takes no time"):
        get_home(certain(), [Leg(0.0, "grass", 0.5)], battery(), HALF)


def test_an_empty_plan_is_refused():
    with pytest.raises(InputError, match="the plan has no leg"):
        get_home(certain(), [], battery(), HALF)
