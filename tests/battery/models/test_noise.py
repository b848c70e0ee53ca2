"""Noise of a battery's model along its state of charge."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from ohmward.battery.models.noise import BatteryNoise, CurrentSensor
from ohmward.errors import InputError


def test_overpotential_share_is_one_number_or_stands_on_a_grid():
    assert BatteryNoise(overpotential_share=0.2).overpotential_share_at(0.7) == 0.2
    along = BatteryNoise(overpotential_share=(0.1, 0.1, 0.5))
    assert along.overpotential_share_at(0.25) == pytest.approx(0.1)
    assert along.overpotential_share_at(0.75) == pytest.approx(0.3)
    assert along.overpotential_share_at(1.2) == pytest.approx(0.5)


def test_the_error_of_the_full_end_adds_to_the_axis_in_proportion_to_the_charge():
    noise = BatteryNoise(soc_axis_std=0.03, full_soc_std=0.05)
    assert noise.axis_std_at(0.0) == 0.03
    assert noise.axis_std_at(0.8) == pytest.approx(0.05)
    assert BatteryNoise(soc_axis_std=0.03).axis_std_at(0.8) == 0.03


def test_a_negative_share_is_refused():
    with pytest.raises(InputError, match="overpotential_share"):
        BatteryNoise(overpotential_share=(0.1, -0.1))


def test_a_grid_of_one_value_is_refused():
    with pytest.raises(InputError, match=r"noise\.model_std_V must have 2 values or more on its grid of SoC"):
        BatteryNoise(model_std_V=(0.008,))
    with pytest.raises(InputError, match=r"noise\.overpotential_share must have 2 values or more"):
        BatteryNoise(overpotential_share=(0.05,))


def test_an_offset_may_walk_where_it_was_known_exactly():
    sensor = CurrentSensor(offset_std_A=0.0, offset_walk_A=0.01)
    after_a_day_A = 0.01 * math.sqrt(24.0)
    assert not sensor.contradicts(2.9 * after_a_day_A)
    assert sensor.contradicts(3.1 * after_a_day_A)


DAY_S = 86400.0
TESTED_UNIX_S = 1.79e9
DATED = BatteryNoise(
    capacity_std=0.1,
    resistance_std=0.3,
    ageing_correlation=0.6,
    capacity_known_unix_s=TESTED_UNIX_S,
    capacity_known_std=0.02,
)


def test_a_capacity_is_known_on_the_day_of_its_test_and_doubted_with_the_days_since():
    assert DATED.on(TESTED_UNIX_S).capacity_std == 0.02
    assert DATED.on(TESTED_UNIX_S + 73 * DAY_S).capacity_std == pytest.approx(math.hypot(0.02, 0.2 * 0.1))
    assert DATED.on(TESTED_UNIX_S - 73 * DAY_S) == DATED.on(TESTED_UNIX_S + 73 * DAY_S)
    assert DATED.on(TESTED_UNIX_S + 365 * DAY_S).capacity_std == 0.1
    assert DATED.on(TESTED_UNIX_S).resistance_std == 0.3


def test_after_a_year_the_error_grows_with_the_root_of_time_up_to_four_years():
    two, four, ten = (DATED.on(TESTED_UNIX_S + years * 365 * DAY_S) for years in (2, 4, 10))
    assert (two.capacity_std, two.resistance_std) == pytest.approx((0.1 * math.sqrt(2), 0.3 * math.sqrt(2)))
    assert (four.capacity_std, four.resistance_std) == pytest.approx((0.2, 0.6))
    assert ten == four
    assert four.ageing_correlation == DATED.ageing_correlation


def test_only_the_loss_by_age_goes_with_the_resistances():
    then = DATED.on(TESTED_UNIX_S + 73 * DAY_S)
    assert then.ageing_covariance == pytest.approx(0.2 * DATED.ageing_covariance)
    assert DATED.on(TESTED_UNIX_S).ageing_covariance == 0.0


def test_what_was_learnt_is_doubted_again_with_age():
    learnt = BatteryNoise(
        capacity_std=0.03, resistance_std=0.1, capacity_known_unix_s=TESTED_UNIX_S, capacity_known_std=0.03
    )
    year = learnt.on(TESTED_UNIX_S + 365 * DAY_S)
    assert (year.capacity_std, year.resistance_std) == (0.1, 0.3)


def test_without_a_date_the_noise_is_that_of_the_file():
    assert BatteryNoise(capacity_std=0.07).on(TESTED_UNIX_S) == BatteryNoise(capacity_std=0.07)
    assert DATED.on(math.nan) == DATED


def test_a_clock_that_nobody_has_set_is_no_date():
    assert DATED.on(0.0) == DATED.on(math.inf) == DATED
    learnt_in_1970 = replace(DATED, capacity_known_unix_s=60.0)
    assert learnt_in_1970.on(TESTED_UNIX_S) == learnt_in_1970
