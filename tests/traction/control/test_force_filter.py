"""What is believed of a wheel against the equations of the wheel."""

import math

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction.control import ForceFilter, Measurement
from ohmward.traction.control.force_filter import plausible_step_s
from traction.control.examples import DRY, WHEEL, Truth, measured, turn

DT = 1e-3


def follow(force_filter, steps, torque=2.0, measure=lambda k, x: measured(x)):
    x = Truth()
    estimate = force_filter.init(measured(x))
    for k in range(steps):
        x = turn(x, torque, DRY, DT)
        estimate = force_filter.update(estimate, torque, measure(k, x), WHEEL, DT)
    return x, estimate


def test_force_and_acceleration_are_found():
    _, estimate = follow(ForceFilter(), 600)
    inertia = WHEEL.mass_kg + WHEEL.inertia_kg_m2 / WHEEL.radius_m**2
    assert estimate.acceleration_m_s2 == pytest.approx(2.0 / WHEEL.radius_m / inertia, rel=1e-3)
    assert estimate.force_N == pytest.approx(WHEEL.mass_kg * estimate.acceleration_m_s2, rel=1e-3)


def test_the_lag_is_of_the_first_order():
    force_filter = ForceFilter(force_lag_s=0.02)
    estimate = force_filter.init(Measurement(0.0, 0.0))
    for _ in range(2000):
        estimate = force_filter.update(estimate, 1.2, Measurement(0.0, 0.0), WHEEL, 1e-5)
    assert estimate.force_N == pytest.approx(10.0 * (1 - math.exp(-1.0)), rel=1e-3)


def test_a_late_speed_is_brought_up_to_now():
    def late(k, x):
        return Measurement(x.wheel_speed_rad_s, x.speed_m_s - 0.754 * 0.02, age_s=0.02)

    x, estimate = follow(ForceFilter(), 600, measure=late)
    assert estimate.travel_speed_m_s == pytest.approx(x.speed_m_s, abs=5e-4)


@pytest.mark.parametrize(
    "bad",
    [
        Measurement(math.nan, 1.0),
        Measurement(1.0, math.inf),
        Measurement(1.0, 1.0, age_s=0.2),
        Measurement(1.0, 1.0, age_s=math.nan),
        Measurement(1.0, 1.0, age_s=-0.1),
        Measurement(1.0, 1.0, travel_speed_std_m_s=0.5),
    ],
)
def test_what_cannot_be_used_changes_nothing(bad):
    force_filter = ForceFilter()
    _, estimate = follow(force_filter, 300)
    after = force_filter.update(estimate, 2.0, bad, WHEEL, DT)
    assert after._replace(known=estimate.known) == estimate
    assert after.known == 0.0


def test_nothing_is_learned_across_a_gap():
    force_filter = ForceFilter()
    x, estimate = follow(force_filter, 300)
    lost = force_filter.update(estimate, 2.0, Measurement(math.nan, math.nan), WHEEL, DT)
    back = force_filter.update(lost, 2.0, Measurement(x.wheel_speed_rad_s + 5.0, x.speed_m_s + 0.5), WHEEL, DT)
    assert (back.force_N, back.acceleration_m_s2) == (estimate.force_N, estimate.acceleration_m_s2)


def test_no_time_gives_no_news():
    force_filter = ForceFilter()
    x, estimate = follow(force_filter, 300)
    again = force_filter.update(estimate, 2.0, measured(x), WHEEL, 0.0)
    assert again == pytest.approx(estimate)


def test_the_wheels_are_independent():
    force_filter = ForceFilter()
    both = Measurement(np.array([1.0, math.nan]), np.array([0.1, 0.1]))
    estimate = force_filter.update(force_filter.init(Measurement(np.zeros(2), np.zeros(2))), 0.0, both, WHEEL, DT)
    assert estimate.known.tolist() == [1.0, 0.0]
    assert np.isfinite(estimate.force_N).all()


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match=r"force_filter.force_lag_s must be > 0"):
        ForceFilter(force_lag_s=0.0)


@pytest.mark.parametrize(
    "m", [Measurement(2e5, 1.0), Measurement(-math.inf, 1.0), Measurement(1.0, 2e3), Measurement(1.0, math.nan)]
)
def test_a_speed_that_nothing_has_is_no_measurement(m):
    assert not ForceFilter().usable(m)


def test_an_observed_force_is_followed_with_the_lag():
    force_filter = ForceFilter(force_lag_s=0.005)
    estimate = force_filter.init(Measurement(1.0, 0.1))
    for _ in range(5):
        estimate = force_filter.update(estimate, 0.0, Measurement(1.0, 0.1, force_N=40.0), WHEEL, DT)
    assert estimate.force_N == pytest.approx(40.0 * (1 - (5 / 6) ** 5))


def test_a_force_that_nothing_has_is_seen_by_the_controller_itself():
    estimate = ForceFilter().init(Measurement(1.0, 0.1))
    for given in (1e8, math.inf, math.nan):
        after = ForceFilter().update(
            estimate, 0.0, Measurement(1.0, 0.1, force_N=given, acceleration_m_s2=given), WHEEL, DT
        )
        assert after.force_N == 0.0 and after.acceleration_m_s2 == 0.0


@pytest.mark.parametrize(
    ("given_s", "taken_s"), [(0.01, 0.01), (60.0, 60.0), (61.0, 0.0), (0.0, 0.0), (-1.0, 0.0), (math.inf, 0.0)]
)
def test_a_step_that_no_clock_has_takes_no_time(given_s, taken_s):
    assert plausible_step_s(given_s) == taken_s
    assert plausible_step_s(math.nan) == 0.0
