import numpy as np
import pytest

from ohmward_lab.simulate.mission import DayPlan, days, first_discharged, working_day
from ohmward_lab.simulate.profile import Profile


def charge_Ah(profile: Profile) -> float:
    return float(np.trapezoid(profile.current_A, profile.time_s)) / 3600.0


def day(**plan) -> Profile:
    return working_day(np.random.default_rng(0), 2.0, DayPlan(**plan))


def test_a_day_drives_most_of_the_capacity_and_charges_half_of_it():
    without = day(opportunity_charges=False)
    assert 7.8 <= without.time_s[-1] / 3600.0 <= 8.5
    assert -2.4 < charge_Ah(without) < -1.6
    assert charge_Ah(day()) - charge_Ah(without) == pytest.approx(1.0, abs=1e-3)


def test_brakes_give_charge_back_and_pauses_draw_the_idle_current():
    current = day().current_A
    assert (current[current < 0].size > 20_000) and np.any((current > 0) & (current < 0.9))
    assert np.median(current) < 0


def test_the_cold_charges_slower_and_as_much():
    warm, cold = day(ambient_degC=25.0), day(ambient_degC=-10.0)
    assert cold.current_A.max() < 0.5 * warm.current_A.max()
    assert charge_Ah(cold) == pytest.approx(charge_Ah(warm), abs=1e-3)


def test_currents_scale_with_the_capacity():
    small, large = (working_day(np.random.default_rng(3), Q) for Q in (1.0, 5.0))
    assert large.current_A == pytest.approx(5.0 * small.current_A)


def test_the_temperature_swings_about_its_mean():
    ambient = day(ambient_degC=15.0, swing_K=12.0).ambient_degC
    # 08:00 to 16:10: from halfway down to the warmest hour
    assert ambient[0] == pytest.approx(15.0 - 12.0 * 0.5, abs=0.1) and ambient.max() == pytest.approx(27.0, abs=0.1)


def test_days_follow_one_another():
    rng = np.random.default_rng(0)
    two = days(rng, 2.0, (DayPlan(25.0, charged_fully=True), DayPlan(5.0)))
    assert np.all(np.diff(two.time_s) > 0)
    assert two.ambient_degC[0] == 25.0 and two.ambient_degC[-1] == 5.0


def test_the_day_starts_after_a_discharge_at_its_first_temperature():
    whole, start_s = first_discharged(day(ambient_degC=5.0, swing_K=3.0), 2.0, 0.2)
    before = whole.time_s <= start_s
    assert np.trapezoid(whole.current_A[before], whole.time_s[before]) / 3600.0 == pytest.approx(-0.4, abs=1e-3)
    assert np.ptp(whole.ambient_degC[before]) == 0.0
