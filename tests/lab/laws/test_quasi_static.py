from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.trace import Kernel, linearize
from ohmward.traction import RLMA, RobotInput, next_state, scene
from ohmward.traction.friction.law import WardIagnemma, contact
from ohmward_lab.traction.quasi_static import motion_rates, next_motion, slip_at_force, wheel_slip
from traction.examples import HARD, LAWS, LOAD_N, ROBOTS, SLIPPERY

every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
P, U = scene(RLMA, HARD), RobotInput(np.array([2.0, 4.0]))


@every_law
@pytest.mark.parametrize("travel", [0.0, 0.02, 0.5, -0.7])
@pytest.mark.parametrize("share", [-0.95, -0.4, -0.01, 0.0, 0.01, 0.4, 0.95])
def test_the_slip_at_a_force_gives_that_force_on_the_rising_branch(law, travel, share):
    slips = np.sign(share) * np.linspace(0.0, 3.0, 30_001)
    curve = abs(law.force_N(contact(travel + slips, travel, LOAD_N)))
    force = share * curve.max()
    slip = slip_at_force(law, force, travel, LOAD_N)
    assert law.force_N(contact(travel + slip, travel, LOAD_N)) == pytest.approx(force, abs=2e-4)
    assert abs(slip) == pytest.approx(abs(slips[np.argmax(curve >= abs(force))]), abs=2e-4)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_the_closed_form(share):
    slip = slip_at_force(WardIagnemma(0.7, 20.0), share * 70.0, 0.5, 100.0)
    assert slip == pytest.approx(-np.log(1 - share) / 20.0, rel=1e-5)


@every_law
def test_a_force_that_the_ground_cannot_give_has_no_slip(law):
    assert np.isnan(slip_at_force(law, 200.0, 0.5, LOAD_N))


def test_its_derivative_is_that_of_the_inverse():
    law = LAWS["ward-iagnemma"]
    slip, J = linearize(lambda F: np.array([slip_at_force(law, F[0], 0.5, 100.0)]), np.array([35.0]))
    slope = 100.0 * 0.7 * 20.0 * np.exp(-20.0 * slip[0])
    assert J[0, 0] == pytest.approx(1 / slope, rel=1e-6)


def test_it_follows_the_full_model_once_the_wheels_have_settled():
    kernel = Kernel(lambda x, u: (next_state(x, u, P, 0.002), x), np.zeros(4), U)
    x, _ = kernel.scan(np.zeros(4), RobotInput(np.tile(U.current_A, (500, 1))))
    motion = np.zeros(2)
    for _ in range(100):
        motion = next_motion(motion, U, P, 0.01)
    wheels = wheel_slip(motion, U, P)
    np.testing.assert_allclose(motion, x[:2], rtol=1e-3)
    slip = 0.12 * x[2:] - (x[0] + np.array([-0.15, 0.15]) * x[1])
    np.testing.assert_allclose(wheels.slip_speed_m_s, slip, rtol=0.01)
    np.testing.assert_allclose(wheels.speed_rad_s, x[2:], rtol=1e-3)


def test_with_a_high_centre_it_follows_the_full_model_too():
    p = scene(ROBOTS["front-driven, lossy, high"], HARD)
    x = np.zeros(4)
    kernel = Kernel(lambda x, u: (next_state(x, u, p, 0.002), x), x, U)
    x, _ = kernel.scan(x, RobotInput(np.tile(U.current_A, (500, 1))))
    wheels = wheel_slip(x[:2], U, p)
    slip = 0.12 * x[2:] - (x[0] + np.array([-0.15, 0.15]) * x[1])
    np.testing.assert_allclose(wheels.slip_speed_m_s, slip, rtol=0.02)


def test_too_much_torque_is_nan_and_enough_adhesion_is_not():
    strong = RobotInput(np.full(2, 19.0))
    assert np.isnan(wheel_slip(np.zeros(2), strong, scene(RLMA, SLIPPERY)).slip_speed_m_s).all()
    assert np.isfinite(wheel_slip(np.zeros(2), replace_share(strong, 20.0), scene(RLMA, SLIPPERY)).slip_speed_m_s).all()


def replace_share(u, share):
    return u._replace(adhesion_share=share)


def test_halving_the_step_quarters_the_error():
    def end(n):
        motion = np.zeros(2)
        for _ in range(n):
            motion = next_motion(motion, U, P, 0.4 / n)
        return motion[0]

    exact = end(640)
    assert (end(20) - exact) / (end(40) - exact) == pytest.approx(4.0, rel=0.2)


def test_traced_it_is_the_same():
    kernel = Kernel(lambda m, u: (motion_rates(m, u, P), wheel_slip(m, u, P)), np.zeros(2), U)
    motion = np.array([0.3, 0.2])
    traced_rates, traced_wheels = kernel(motion, U)
    np.testing.assert_allclose(traced_rates, motion_rates(motion, U, P), rtol=1e-12)
    for traced, plain in zip(traced_wheels, wheel_slip(motion, U, P), strict=True):
        np.testing.assert_allclose(traced, plain, rtol=1e-9)


def test_skid_steering_is_refused():
    with pytest.raises(InputError, match="quasi-static slip needs wheels that are free sideways; use implicit_step"):
        next_motion(np.zeros(3), RobotInput(np.zeros(4)), scene(ROBOTS["skid-steer"], HARD), 0.01)


def test_the_omni_robot_rolls_too():
    robot = replace(ROBOTS["omni"])
    p = scene(robot, HARD)
    motion = next_motion(np.zeros(3), RobotInput(np.full(3, 0.5)), p, 0.01)
    assert motion[2] > 0.0
    np.testing.assert_allclose(motion[:2], 0.0, atol=1e-12)
