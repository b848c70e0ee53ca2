"""Our equations of motion and MuJoCo's, the same robot on the same ground: neither knows of the other.

Ours leave out that wheels which spin up tilt the body, and that they are gyroscopes: hence runs of moderate spin.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ohmward.traction.dynamics.forces import RobotInput, rates, scene
from ohmward.traction.friction.law import CoulombCreep
from ohmward.traction.friction.terrain import RollingResistance, Terrain
from ohmward.traction.robot.chassis import Differential, SkidSteer
from ohmward.traction.robot.motor import Motor
from ohmward.traction.robot.robot import Robot, Wheel
from ohmward_lab.simulate.ground import Grade, Patch
from ohmward_lab.simulate.mujoco_plant import FRONT_AND_REAR, RlmaParameters, RlmaPlant, drive

pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install mujoco")

TIMES_S = np.linspace(0.0, 1.0, 101)


def yaw_inertia(p):
    length, width, _ = p.body_m
    across = 0.5 * p.wheel_inertia_kg_m2 + p.wheel_mass_kg * p.wheel_width_m**2 / 12
    wheels = p.wheel_mass_kg * np.sum(p.wheel_position_m**2) + 4 * across
    return p.body_mass_kg * (length**2 + width**2) / 12 + wheels


def our_robot(p, chassis):
    return Robot(
        name="the plant's",
        mass_kg=p.mass_kg,
        yaw_inertia_kg_m2=yaw_inertia(p),
        chassis=chassis(p.front_m, p.rear_m, p.track_m),
        wheel=Wheel(p.wheel_radius_m, p.wheel_width_m, p.wheel_inertia_kg_m2),
        motor=Motor(torque_constant_Nm_per_A=1.0, resistance_ohm=0.1),
        height_m=p.centre_height_m,
    )


def ours(p, chassis, mu, torque_N_m, grade_rad=0.0):
    """State over `TIMES_S` (T, n) by SciPy's implicit solver."""
    creep = CoulombCreep(mu, p.slip_stiffness_s_per_m)
    robot = our_robot(p, chassis)
    ground = scene(robot, Terrain("creep", creep, RollingResistance(0.0, 1.0, 0.0), "this test"))
    torque = np.broadcast_to(np.asarray(torque_N_m, dtype=float), robot.driven)
    u = RobotInput(torque, grade_rad)
    x0 = np.zeros(robot.freedoms + robot.driven)
    solution = solve_ivp(lambda _, x: rates(x, u, ground), (0.0, 1.0), x0, "LSODA", TIMES_S, rtol=1e-6, atol=1e-8)
    return solution.y.T


def plants(p, mu, torque_N_m, grade_rad=0.0):
    plant = RlmaPlant(p, [Patch(friction=mu)], Grade(grade_rad=(grade_rad,)))
    return drive(plant, lambda _: torque_N_m, duration_s=1.0)


@pytest.mark.parametrize("mu, torque_N_m, grade_rad", [(0.8, 3.0, 0.0), (0.2, 2.7, 0.0), (0.5, 4.0, 0.1)])
def test_straight_ahead_gripping_and_spinning(mu, torque_N_m, grade_rad):
    p = RlmaParameters(rolling_resistance=0.0)
    x, truth = ours(p, Differential, mu, torque_N_m, grade_rad), plants(p, mu, torque_N_m, grade_rad)
    assert truth.speed_m_s == pytest.approx(x[:, 0], rel=5e-3, abs=5e-3)
    assert truth.wheel_speed_rad_s[:, 0] == pytest.approx(x[:, 2], rel=0.04, abs=0.05)


@pytest.mark.parametrize("mu, left_N_m, right_N_m, slides", [(0.8, -4.0, 6.0, False), (0.3, -3.5, 4.0, True)])
def test_skid_steering_creeping_and_sliding(mu, left_N_m, right_N_m, slides):
    p = RlmaParameters(rolling_resistance=0.0, driven=FRONT_AND_REAR)
    torque_N_m = np.array([left_N_m, right_N_m, left_N_m, right_N_m])
    x, truth = ours(p, SkidSteer, mu, torque_N_m), plants(p, mu, torque_N_m)
    assert (truth.yaw_rate_rad_s[-1] > 2.0) == slides
    assert truth.yaw_rate_rad_s == pytest.approx(x[:, 2], rel=0.02, abs=5e-3)
    assert truth.speed_m_s == pytest.approx(x[:, 0], abs=0.02)
