"""Without motor currents the slip is as unknown as a lasting force makes it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA, RollingResistance, Terrain
from ohmward.traction.friction.law import CoulombCreep
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.estimator import observe
from ohmward.traction.speed_observer.make_observer import UNMEASURED_TRACTION, make_observer, unmeasured_force_walk

SLOPE_S_PER_M = 5.0
GROUND = Terrain("creep", CoulombCreep(0.8, SLOPE_S_PER_M), RollingResistance(a3_s_per_m=0.0), "tests")
TIME_S = np.arange(0.0, 4.0, 0.01)


def drive(current_A):
    speed = np.full((len(TIME_S), 4), 3.0)
    speed[:, 2:] = np.nan
    return DriveLog("even", TIME_S, speed, np.full((len(TIME_S), 2), current_A))


def test_the_walk_is_that_of_a_lasting_force():
    walk = unmeasured_force_walk(RLMA, 0.36, GROUND)
    slip_m_s = UNMEASURED_TRACTION / SLOPE_S_PER_M
    assert walk * math.sqrt(1 / (2 * SLOPE_S_PER_M * GRAVITY)) == pytest.approx(slip_m_s)


def test_the_slip_is_known_no_better_than_such_a_force_allows():
    unknown = make_observer(RLMA, drive(math.nan), GROUND).observer
    std = observe(unknown, drive(math.nan)).estimates.slip_speed_std_m_s[-1]
    forgetful = replace(unknown, noise=replace(unknown.noise, speed_walk=0.01))
    assert np.all(std > 0.7 * UNMEASURED_TRACTION / SLOPE_S_PER_M)
    assert np.all(observe(forgetful, drive(math.nan)).estimates.slip_speed_std_m_s[-1] < 0.5 * std)


def test_where_currents_tell_the_force_the_walk_is_the_usual_one():
    known = make_observer(RLMA, drive(0.0), GROUND).observer
    assert known.noise.speed_walk == type(known.noise).speed_walk
