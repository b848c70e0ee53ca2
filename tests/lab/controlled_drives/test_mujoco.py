"""The bars on the robot in MuJoCo, a plant that knows nothing of our equations; the true speed is fed back."""

from functools import cache

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install mujoco")

from ohmward.traction.control import (
    ControlFlag,
    Measurement,
    SlidingMode,
    SlipCommand,
    SlipController,
    SpeedCommand,
    SpeedController,
)
from ohmward.traction.control.slip_law import SlipLaw
from ohmward_lab.simulate.ground import Patch
from ohmward_lab.simulate.mujoco_plant import RlmaParameters, RlmaPlant
from ohmward_lab.simulate.robot_sensors import stack
from ohmward_lab.traction.compared_slip_laws import FuzzySlidingMode, SlipPid, SlipRatioSlidingMode
from traction.control.examples import LIMITS, SLIDING, UNSURE, WHEEL

DRAG = RlmaParameters(drag_N_s2_per_m2=32.0)
LAWS: dict[str, SlipLaw] = {"sliding": SLIDING, "fuzzy": FuzzySlidingMode(SLIDING)}


def drive(controller, command, friction, duration_s, speed_m_s=0.0, dt_s=1e-3, parameters=DRAG, slippery_s=1e3):
    """Truth over time, and the flags of every step; slippery_s: the floor has 0.2 from then on."""
    plant = RlmaPlant(parameters, [Patch(friction=friction), Patch(friction=0.2, from_s=slippery_s)])
    truths = [plant.reset(speed_m_s)]
    state, flags = controller.init(measured(truths[0])), []
    while truths[-1].time_s < duration_s - 1e-9:
        state, torque, report = controller.step(state, command(truths[-1].time_s), measured(truths[-1]), dt_s)
        truths.append(plant.step(torque, dt_s))
        flags.append(report.flags)
    return stack(truths), np.array(flags).astype(int)


def measured(truth):
    return Measurement(truth.wheel_speed_rad_s[:2], truth.wheel_centre_speed_m_s[:2])


def reversals(torque_Nm, size_Nm):
    """How often the torque turns back by more than a size."""
    count, direction, turning = 0, 0, torque_Nm[0]
    for torque in torque_Nm:
        if direction * (turning - torque) > size_Nm or (direction == 0 and abs(torque - turning) > size_Nm):
            count, direction, turning = count + 1, np.sign(torque - turning), torque
        elif direction * (torque - turning) > 0:
            turning = torque
    return count - 1


@cache
def from_rest(name, friction):
    return drive(SlipController(WHEEL, LAWS[name], LIMITS), lambda _: SlipCommand(0.12), friction, 1.5)[0]


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("friction", [0.2, 0.8])
def test_friction_taken_as_a_half_the_slip_is_there_after_260_ms_and_stays(name, friction):
    truth = from_rest(name, friction)
    error = truth.slip_ratio[:, :2] - 0.12
    assert np.abs(error[truth.time_s > 0.26]).max() <= 0.02
    assert np.sqrt(np.mean(error[truth.time_s > 0.8] ** 2)) <= 0.01


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("friction", [0.2, 0.8])
def test_there_is_no_limit_cycle_at_the_start(name, friction):
    torque = from_rest(name, friction).torque_N_m[:, 0]
    assert reversals(torque, 0.1) <= 6
    assert np.abs(np.diff(torque)).max() < 1.0
    assert torque.min() >= 0.0


def test_a_limit_cycle_would_be_seen():
    torque = drive(SlipController(WHEEL, SlipPid(), LIMITS), lambda _: SlipCommand(0.12), 0.2, 0.5, dt_s=0.01)
    assert reversals(torque[0].torque_N_m[:, 0], 0.1) > 10


@pytest.mark.parametrize(("friction", "reached"), [(0.2, True), (0.8, False)])
def test_it_is_friction_that_tells_the_floors_apart(friction, reached):
    truth = from_rest("sliding", friction)
    adhesion = truth.traction_N[:, :2] / truth.normal_N[:, :2]
    assert (truth.friction == friction).all()
    assert (adhesion[(truth.time_s > 0.05) & (truth.time_s < 0.15)] > 0.99 * 0.2).all()
    assert adhesion[truth.time_s < 0.5].max() <= friction + 1e-6
    assert (adhesion[truth.time_s < 0.5].max() < 0.21) == reached


@pytest.mark.parametrize("speed_m_s", [0.0, 1.0], ids=["from rest", "moving"])
@pytest.mark.parametrize("friction", [0.2, 0.8])
def test_the_law_of_the_slip_ratio_holds_with_a_layer_that_follows_its_gain(friction, speed_m_s):
    control = SlipController(WHEEL, SlipRatioSlidingMode(UNSURE), LIMITS)
    truth, _ = drive(control, lambda _: SlipCommand(0.12), friction, 1.5, speed_m_s)
    error = truth.slip_ratio[:, :2] - 0.12
    assert np.abs(error[truth.time_s > 0.36]).max() <= 0.02
    assert reversals(truth.torque_N_m[:, 0], 0.1) <= 6


@pytest.mark.parametrize("law", [SLIDING, SlidingMode(UNSURE, integral_per_s=50.0)], ids=["plain", "with integral"])
@pytest.mark.parametrize("friction", [0.2, 0.8])
def test_a_spin_ends_as_fast_as_the_torque_can_end_it(law, friction):
    control, start_s = SlipController(WHEEL, law, LIMITS), 0.3
    plant = RlmaPlant(RlmaParameters(), [Patch(friction=friction)])
    plant.reset()
    truths = [plant.step(LIMITS.torque_Nm, 1e-3) for _ in range(round(1e3 * start_s))]
    state = control.init(measured(truths[-1]))
    grip_Nm = WHEEL.radius_m * truths[-1].traction_N[:2].mean()
    slowest_rad_s2 = (LIMITS.torque_Nm + grip_Nm) / WHEEL.inertia_kg_m2
    least_s = truths[-1].slip_speed_m_s[:2].mean() / WHEEL.radius_m / slowest_rad_s2
    for _ in range(700):
        state, torque, _ = control.step(state, SlipCommand(0.12), measured(truths[-1]), 1e-3)
        truths.append(plant.step(torque, 1e-3))
    truth = stack(truths)
    late = truth.time_s > start_s + 1.05 * least_s + 0.08
    assert np.abs(truth.slip_ratio[late, :2] - 0.12).max() <= 0.02
    assert truth.wheel_speed_rad_s[:, :2].min() > 0.0


def test_case_1_braking_on_slippery_ground():
    control = SlipController(WHEEL, SLIDING, LIMITS)
    truth, flags = drive(control, lambda _: SlipCommand(-0.18), 0.2, 1.5, speed_m_s=1.0)
    fast = (truth.time_s > 0.06) & (truth.speed_m_s > 0.25)
    assert np.abs(truth.slip_ratio[fast, :2] + 0.18).max() <= 0.02
    assert truth.speed_m_s.min() > -0.05
    assert flags[-1, 0] & ControlFlag.STOPPED


def test_case_2_driving_on_the_normal_floor_then_braking_on_the_slippery_one():
    control = SlipController(WHEEL, SLIDING, LIMITS)
    command = lambda t: SlipCommand(0.12 if t < 6.0 else -0.18)  # noqa: E731
    truth, _ = drive(control, command, 0.8, 6.5, dt_s=2e-3, slippery_s=6.0)
    before = (truth.time_s > 1.0) & (truth.time_s < 6.0)
    after = (truth.time_s > 6.15) & (truth.speed_m_s > 0.25)
    assert np.sqrt(np.mean((truth.slip_ratio[before, :2] - 0.12) ** 2)) <= 0.01
    assert np.abs(truth.slip_ratio[after, :2] + 0.18).max() <= 0.02


def test_the_speed_loop_stays_within_its_bound_where_the_floor_turns_slippery():
    control = SpeedController(WHEEL, SLIDING, LIMITS, acceleration_m_s2=1.5)
    p = RlmaParameters()
    truth, flags = drive(control, lambda _: SpeedCommand(2.0), 0.8, 2.0, parameters=p, slippery_s=0.8)
    rim = WHEEL.radius_m * truth.wheel_speed_rad_s[:, :2]
    late = truth.time_s > 0.85
    assert (truth.slip_speed_m_s[late, :2] <= np.maximum(0.12 * rim[late], control.creep_m_s) + 0.01).all()
    hard = late & (truth.time_s < 1.4)
    assert (truth.traction_N[hard, :2] >= 0.99 * 0.2 * truth.normal_N[hard, :2]).all()
    assert (flags[900:, 0] & ControlFlag.SLIP_BOUND).any()
