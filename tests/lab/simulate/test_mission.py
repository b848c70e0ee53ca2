import numpy as np
import pytest

from ohmward_lab.simulate.mission import ambient_degC, drive, leg_speed, robot_day, shaft_power_W


def test_at_constant_speed_on_the_flat_power_is_rolling_resistance():
    power = shaft_power_W(np.full(5, 0.8), np.full(5, 50.0), np.zeros(5), np.full(5, 0.04))
    np.testing.assert_allclose(power, 50.0 * 9.81 * 0.04 * 0.8)


def test_without_resistance_power_is_the_change_of_kinetic_energy():
    t = np.arange(0.0, 60.0)
    speed = 0.8 * np.sin(np.pi * t / 59.0) ** 2
    power = shaft_power_W(speed, np.full(60, 50.0), np.zeros(60), np.zeros(60))
    energy = np.cumsum(0.5 * (power[1:] + power[:-1]))
    np.testing.assert_allclose(energy, 25.0 * (speed[1:] ** 2 - speed[0] ** 2), atol=0.05)


def test_climbing_a_metre_costs_its_potential_energy():
    power = shaft_power_W(np.full(101, 0.5), np.full(101, 50.0), np.full(101, np.tan(np.arcsin(0.02))), np.zeros(101))
    assert power[:100].sum() == pytest.approx(50.0 * 9.81 * 0.02 * 50.0)


def test_a_leg_starts_and_ends_at_rest_within_its_limits():
    rng = np.random.default_rng(0)
    for _ in range(50):
        speed = leg_speed(rng)
        assert speed[0] == speed[-1] == 0.0
        assert 0.29 <= speed.max() <= 0.9
        assert abs(np.diff(speed)).max() <= 0.5 + 1e-12
        assert 4.0 <= speed.sum() <= 41.0


def test_a_standing_robot_draws_its_electronics():
    profile = drive(np.random.default_rng(1), 600.0)
    assert np.median(profile.current_A[profile.current_A > -0.73]) == pytest.approx(-9.0 / 12.5)
    assert profile.current_A.min() < -3.0


def test_the_day_charges_at_noon_and_is_as_warm_as_it_should_be():
    day = robot_day(np.random.default_rng(2), charge_current_A=5.0)
    clock = 7.5 + day.time_s / 3600.0
    charging = day.current_A == 5.0
    assert 11.0 < clock[charging].min() < 12.0 < 13.0 < clock[charging].max()
    work = day.current_A < 0
    assert -18.0 < np.sum((day.current_A * np.gradient(day.time_s))[work]) / 3600.0 < -13.0
    assert ambient_degC(np.array([0.0, 43200.0]), 4.0).tolist() == [12.0, 24.0]
    assert np.all(np.diff(day.time_s) > 0.0)


def test_same_seed_same_day_other_seed_other_day():
    one, same, other = (robot_day(np.random.default_rng(seed), 5.0) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.current_A, same.current_A)
    assert one.current_A.size != other.current_A.size or np.any(one.current_A != other.current_A)
