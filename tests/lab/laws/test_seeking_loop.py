"""The seeker in closed loop: slip controller, wheel and body on roads with a peak, a load that grows with the speed."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from laws.examples import best_slip_ratio, driving_force
from ohmward.trace import Kernel
from ohmward.traction.control import Limits, SlipCommand, SlipController
from ohmward.traction.friction.law import WardIagnemma
from ohmward.traction.friction.terrain import ROADS
from ohmward_lab.traction.set_points import SetPointSeeker
from traction.control.examples import SLIDING, WHEEL, Truth, measured, turn

DT = 1e-3
LAWS: dict[str, Any] = {
    "dry asphalt": ROADS["dry asphalt road"],
    "wet asphalt": ROADS["wet asphalt road"],
    "no peak": WardIagnemma(0.5, 8.0),
}
#: Drag that a peak of one load holds at about 2 m/s.
DRAG_N_S2_PER_M2 = 25.0


def seek(seeker, name, start, duration_s, motor_Nm=20.0):
    """The mean of what was held in the last second, the last set-point, and the speed there."""
    control = SlipController(WHEEL, SLIDING, Limits(motor_Nm))
    x = Truth(1.0 / WHEEL.radius_m, 1.0)
    state, found = control.init(measured(x)), seeker.init(start)
    hold = Kernel(control.step, state, SlipCommand(start), measured(x), DT)
    climb = Kernel(seeker.step, found, start, 0.1, DT)
    wanted, slips, set_point = start, [], None
    for _ in range(round(duration_s / DT)):
        state, torque, report = hold(state, SlipCommand(wanted), measured(x), DT)
        x = turn(x, float(torque), LAWS[name], DT, DRAG_N_S2_PER_M2 * x.speed_m_s * abs(x.speed_m_s))
        found, set_point = climb(found, report.slip_ratio, report.force_N / WHEEL.load_N, DT)
        wanted = set_point.slip_ratio
        slips.append(report.slip_ratio)
    return float(np.mean(slips[-1000:])), set_point, x.speed_m_s


@cache
def held_at_the_peak(name, start):
    return seek(SetPointSeeker(), name, start, 16.0)


@pytest.mark.slow
@pytest.mark.parametrize("start", [0.05, 0.3])
@pytest.mark.parametrize("name", ["dry asphalt", "wet asphalt"])
def test_the_peak_is_climbed_and_held_from_both_sides(name, start):
    slip, set_point, speed = held_at_the_peak(name, start)
    law = LAWS[name]
    assert set_point.identified
    assert driving_force(law, slip, WHEEL.load_N, speed) >= 0.99 * law.peak_adhesion * WHEEL.load_N
    assert set_point.centre == pytest.approx(law.peak_slip_ratio, abs=0.04)


@pytest.mark.slow
def test_the_slip_of_least_energy_is_below_that_of_most_traction():
    share = 0.05
    slip, set_point, speed = seek(SetPointSeeker("energy", resistance_coefficient=share), "dry asphalt", 0.15, 10.0)
    best = best_slip_ratio(LAWS["dry asphalt"], WHEEL.load_N, share * WHEEL.load_N, speed)
    assert set_point.identified
    assert slip == pytest.approx(best, abs=0.02)
    assert slip < 0.7 * LAWS["dry asphalt"].peak_slip_ratio


@pytest.mark.slow
def test_a_set_point_that_the_motor_cannot_hold_is_not_identified_and_stays():
    slip, set_point, _ = seek(SetPointSeeker(), "dry asphalt", 0.2, 4.0, motor_Nm=5.0)
    assert slip < 0.1
    assert not set_point.identified
    assert set_point.centre == 0.2
    assert math.isnan(set_point.slope)
