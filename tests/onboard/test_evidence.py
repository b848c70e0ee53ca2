"""Bands that grow while nothing is measured: closed forms, and what may have happened meanwhile."""

import math

import numpy as np
import pytest

from ohmward import generic_battery
from ohmward.battery.models.noise import USUAL_C
from ohmward.energy.points import Quantiles
from ohmward.energy.range_step import RangeEstimate
from ohmward.filters.consistency import BAND_95
from ohmward.onboard.evidence import Age, AgeingModel
from ohmward.onboard.robot_state import RobotState
from ohmward.traction import RLMA
from ohmward.traction.robot.packaged import ROBOTINO, SEEDER
from ohmward.traction.robot.robot import GRAVITY
from onboard.ros.test_messages import charge, driven

BATTERY = generic_battery("lfp", 12.0, 4)
REACH = RangeEstimate(Quantiles(900.0, 1000.0, 1200.0), Quantiles(9.0, 10.0, 12.0), 1e5, 100.0, 0.9, 50.0, 0)


def aged(state, model=None, **ages):
    """The state after so many seconds without evidence: (age, silent) by its name."""
    model = model or AgeingModel(BATTERY, RLMA)
    return model.aged(state, {name: Age(*age) for name, age in ages.items()}, current_A=-6.0)


@pytest.mark.parametrize(("current_A", "rate_C"), [(-6.0, 0.5), (6.0, 0.5), (-1.0, USUAL_C), (math.nan, USUAL_C)])
def test_the_band_of_the_charge_grows_by_an_unknown_current(current_A, rate_C):
    """An hour at this current moves the share `rate_C` of the capacity."""
    ages = {"battery": Age(600.0, True)}
    found = AgeingModel(BATTERY).aged(driven(), ages, current_A)
    assert found.battery is not None
    assert found.battery.soc == 0.5
    assert found.battery.soc_std == pytest.approx(math.hypot(0.02, rate_C / 6.0))
    assert found.silent == ("battery",)


def test_a_charge_that_may_be_anything_is_unknown_and_so_is_the_range():
    state = driven()._replace(range=REACH)
    hours = [0.0, 0.2, 0.4, 1.0, 10.0]
    found = [aged(state, battery=(3600.0 * h, True)) for h in hours]
    assert [s.battery is None for s in found] == [s.range is None for s in found] == [False] * 3 + [True] * 2


def test_a_charge_that_never_was_known_does_not_vanish_for_being_old():
    state = driven()._replace(battery=charge()._replace(soc_std=0.4))
    assert aged(state, battery=(0.001, False)).battery is not None


def test_the_range_widens_with_the_charge_it_rests_on():
    state = driven()._replace(range=REACH)
    now, later = (aged(state, battery=(age_s, True)).range for age_s in (0.0, 600.0))
    assert now.distance_m == pytest.approx(REACH.distance_m)
    low, middle, high = later.distance_m
    assert middle == 1000.0
    share = 1.2815516 * (0.5 / 6.0) / 0.5
    assert (low, high) == pytest.approx(
        (1000.0 - 1000 * math.hypot(0.1, share), 1000.0 + 1000 * math.hypot(0.2, share))
    )


@pytest.mark.parametrize("age_s", [0.3, 1.0, 10.0])
@pytest.mark.parametrize("braking", [-1.0, 0.0, 1.0])
def test_no_motion_that_adhesion_and_motors_allow_leaves_the_bands(age_s, braking):
    """The robot brakes or accelerates as hard as its weight lets it, up to its motors' speed without load."""
    state, model = driven(), AgeingModel(BATTERY, RLMA)
    found = aged(state, model, drive=(age_s, False))
    assert state.slip is not None
    times = np.linspace(0.0, age_s, 2001)
    speeds = np.clip(state.slip.speed_m_s + braking * GRAVITY * times, -model.fastest_m_s, model.fastest_m_s)
    assert abs(speeds[-1] - found.slip.speed_m_s) <= BAND_95 * found.slip.speed_std_m_s + 1e-9
    moved_m = abs(np.trapezoid(speeds, times))
    assert moved_m <= BAND_95 * math.sqrt(found.pose.pose_cov[0, 0])
    assert moved_m <= BAND_95 * found.pose.position_std_m


def test_numbers_of_a_drive_without_a_band_are_unknown_once_they_are_old():
    slip = aged(driven(), drive=(0.5, False)).slip
    assert np.isnan(slip.slip_ratio).all() and np.isnan(slip.traction_N).all()


def test_a_drive_whose_wheels_are_silent_is_unknown():
    found = aged(driven(), drive=(2.0, True))
    assert (found.slip, found.pose) == (None, None)
    assert found.battery == driven().battery


@pytest.mark.parametrize("robot", [RLMA, ROBOTINO, SEEDER])
def test_the_fastest_speed_is_that_of_the_motors_without_load(robot):
    model = AgeingModel(BATTERY, robot)
    turns_rad_s = BATTERY.voltage_max_V / robot.motor.wheel_constant_Nm_per_A
    assert model.fastest_m_s == pytest.approx(turns_rad_s * robot.wheel.radius_m)
    assert AgeingModel(None, robot).fastest_m_s == pytest.approx(10.0)


def test_evidence_in_time_changes_nothing():
    state = RobotState(5.0, 1.7e9, battery=charge())
    assert AgeingModel(BATTERY, RLMA).aged(state, {}) == state
