"""The plant against mechanics on paper; tolerances are what soft contacts and the tilt of the body leave."""

import math
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install mujoco")

from ohmward.errors import InputError
from ohmward.optional import MissingPackageError
from ohmward.traction.robot.robot import GRAVITY as G
from ohmward_lab.simulate.ground import Grade, Patch
from ohmward_lab.simulate.mujoco_plant import (
    DRY,
    FRONT_AND_REAR,
    RlmaParameters,
    RlmaPlant,
    drive,
)

FREE = RlmaParameters(rolling_resistance=0.0)
M, R, J = FREE.mass_kg, FREE.wheel_radius_m, FREE.wheel_inertia_kg_m2
BASE_M = FREE.front_m + FREE.rear_m


def fitted_acceleration(truth, start=0):
    return np.polyfit(truth.time_s[start:], truth.speed_m_s[start:], 1)[0]


@pytest.mark.parametrize("driven, rotor_kg_m2", [((0, 1), 0.0), (FRONT_AND_REAR, 0.0), ((0, 1), 0.02)])
def test_gripping_wheels_accelerate_the_mass_and_their_own_inertia(driven, rotor_kg_m2):
    p = RlmaParameters(rolling_resistance=0.0, driven=driven, rotor_inertia_kg_m2=rotor_kg_m2)
    truth = drive(RlmaPlant(p), 1.5, duration_s=1.0)
    inertia_kg = M + (4 * J + len(driven) * rotor_kg_m2) / R**2
    assert fitted_acceleration(truth, 30) == pytest.approx(len(driven) * 1.5 / R / inertia_kg, rel=2e-3)


def test_the_forces_of_the_ground_are_the_change_of_momentum():
    truth = drive(RlmaPlant(FREE, [Patch(friction=0.4)]), 6.0, duration_s=0.5, dt_s=1e-3)
    impulse = np.trapezoid(truth.traction_N.sum(axis=1), truth.time_s)
    assert impulse == pytest.approx(M * truth.speed_m_s[-1], rel=2e-3)


def test_at_rest_the_wheels_carry_the_weight_by_the_lever_rule():
    p = RlmaParameters(front_m=0.25, rear_m=0.35)
    truth = drive(RlmaPlant(p), 0.0, duration_s=2.0)
    assert truth.normal_N[-1] == pytest.approx(p.static_load_N, rel=2e-3)
    assert truth.normal_N[-1].sum() == pytest.approx(M * G, rel=1e-6)
    assert p.static_load_N[:2].sum() == pytest.approx(M * G * 0.35 / 0.6)


def test_the_robot_starts_in_balance():
    truth = drive(RlmaPlant(FREE), 0.0, duration_s=0.1)
    assert truth.normal_N == pytest.approx(np.full(truth.normal_N.shape, M * G / 4), rel=1e-9)


def test_load_moves_to_the_rear_by_what_the_moments_need():
    truth = drive(RlmaPlant(FREE), 4.0, duration_s=1.0)
    a = fitted_acceleration(truth, 50)
    moment_N_m = M * a * FREE.centre_height_m + 4 * J * a / R
    moved_N = truth.normal_N[-1, 2:].sum() - M * G / 2
    assert moved_N == pytest.approx(moment_N_m / BASE_M, rel=5e-3)


def spinning_on(mu, torque_N_m):
    """Body acceleration, spin acceleration of the front wheels and their load, when the front wheels slide.

    Load N = m g/4 - (m a h + 2 J w' + 2 J a/R)/(2 L), thrust a = 2 mu N/(m + 2 J/R^2), spin J w' = tau - R mu N.
    """
    a_per_N = 2 * mu / (M + 2 * J / R**2)
    h_eff = M * FREE.centre_height_m + 2 * J / R
    load_N = (M * G / 4 - torque_N_m / BASE_M) / (1 + (h_eff * a_per_N - 2 * R * mu) / (2 * BASE_M))
    return a_per_N * load_N, (torque_N_m - R * mu * load_N) / J, load_N


@pytest.mark.parametrize("mu, torque_N_m", [(0.2, 3.0), (0.8, 11.0)])
def test_a_spinning_wheel_pushes_with_mu_N_and_spins_up_with_the_rest(mu, torque_N_m):
    truth = drive(RlmaPlant(FREE, [Patch(friction=mu)]), torque_N_m, duration_s=0.6)
    a, spin, load_N = spinning_on(mu, torque_N_m)
    late = slice(30, None)
    assert truth.slip_speed_m_s[late, :2].min() > 0.9
    assert truth.traction_N[late, :2] == pytest.approx(mu * truth.normal_N[late, :2], rel=1e-3)
    assert truth.normal_N[late, :2] == pytest.approx(np.full((31, 2), load_N), rel=3e-3)
    assert fitted_acceleration(truth, 30) == pytest.approx(a, rel=3e-3)
    assert np.polyfit(truth.time_s[late], truth.wheel_speed_rad_s[late, 0], 1)[0] == pytest.approx(spin, rel=1e-2)


def test_every_wheel_turns_by_its_own_torque_and_traction():
    p = RlmaParameters(rolling_resistance=0.0, rotor_inertia_kg_m2=0.02)
    truth = drive(RlmaPlant(p, [Patch(friction=0.2)]), 4.0, duration_s=0.5, dt_s=1e-3)
    inertia = J + np.array([0.02, 0.02, 0.0, 0.0])
    gained = np.trapezoid(truth.torque_N_m - R * truth.traction_N, truth.time_s, axis=0) / inertia
    assert gained == pytest.approx(truth.wheel_speed_rad_s[-1], rel=0.02)


def test_below_the_limit_traction_is_linear_in_slip_speed():
    torques = np.array([1.0, 2.0, 4.0, 6.0])
    ends = [drive(RlmaPlant(FREE), torque, duration_s=0.1) for torque in torques]
    slip = np.array([end.slip_speed_m_s[-1, 0] for end in ends])
    traction = np.array([end.traction_N[-1, 0] for end in ends])
    assert np.all(np.diff(slip) > 0.005)
    assert traction == pytest.approx(FREE.slip_stiffness_s_per_m * M * G / 4 * slip, rel=5e-3)


def test_going_from_grip_to_ice_neither_lifts_nor_chatters():
    truth = drive(RlmaPlant(FREE, [DRY, Patch(friction=0.2, from_s=0.5)]), 5.0, duration_s=1.5, dt_s=1e-3)
    after = truth.time_s > 0.55
    assert truth.normal_N.min() > 0.85 * M * G / 4
    assert truth.normal_N.max() < 1.15 * M * G / 4
    assert np.abs(np.diff(truth.normal_N[after], axis=0)).max() < 0.02
    assert truth.traction_N[after, :2] == pytest.approx(0.2 * truth.normal_N[after, :2], rel=1e-3)
    assert np.all(np.diff(truth.slip_speed_m_s[after, 0]) > 0)


def test_a_wheel_that_slips_at_tens_of_metres_per_second_stays_on_the_ground():
    truth = drive(RlmaPlant(FREE), 12.0, duration_s=1.0)
    assert truth.slip_speed_m_s[-1, 0] > 40.0
    loads = truth.normal_N[truth.time_s > 0.3]
    assert np.ptp(loads, axis=0).max() < 1.0


def test_the_ground_ends_under_each_wheel_when_it_gets_there():
    truth = drive(RlmaPlant(FREE, [DRY, Patch(friction=0.2, from_m=0.5)]), 3.0, duration_s=1.5, dt_s=1e-3)
    x = truth.position_m[:, 0]
    for wheel, ahead_m in ((0, FREE.front_m), (2, -FREE.rear_m)):
        change = x[np.argmax(truth.friction[:, wheel] < 0.5)]
        assert change == pytest.approx(0.5 - ahead_m, abs=2e-3)


@pytest.mark.parametrize("grade_rad", [0.1, -0.1])
def test_on_a_grade_it_rolls_down_freely(grade_rad):
    truth = drive(RlmaPlant(FREE, grade=Grade(grade_rad=(grade_rad,))), 0.0, duration_s=1.0)
    expected = -M * G * math.sin(grade_rad) / (M + 4 * J / R**2)
    assert fitted_acceleration(truth, 20) == pytest.approx(expected, rel=2e-3)
    assert truth.normal_N[-1].sum() == pytest.approx(M * G * math.cos(grade_rad), rel=1e-4)


@pytest.mark.parametrize("grade_rad, stays", [(0.015, True), (0.025, False)])
def test_rolling_resistance_holds_the_robot_on_a_grade_below_its_coefficient(grade_rad, stays):
    plant = RlmaPlant(RlmaParameters(rolling_resistance=0.02), grade=Grade(grade_rad=(grade_rad,)))
    truth = drive(plant, 0.0, duration_s=1.0)
    assert (abs(truth.wheel_angle_rad[-1]).max() < 0.01) == stays


def test_an_accelerometer_at_rest_on_a_grade_feels_it():
    plant = RlmaPlant(RlmaParameters(rolling_resistance=0.3), grade=Grade(grade_rad=(0.2,)))
    truth = drive(plant, 0.0, duration_s=1.0)
    expected = [G * math.sin(0.2), 0.0, G * math.cos(0.2)]
    assert truth.specific_force_m_s2[-1] == pytest.approx(expected, abs=0.02)


def test_rolling_resistance_and_drag_balance_the_drive_at_the_final_speed():
    p = RlmaParameters(rolling_resistance=0.02, drag_N_s2_per_m2=100.0)
    truth = drive(RlmaPlant(p), 3.0, duration_s=3.0)
    assert truth.speed_m_s[-1] == pytest.approx(math.sqrt((2 * 3.0 / R - 0.02 * M * G) / 100.0), rel=2e-3)


@pytest.mark.parametrize("mu, grade_rad", [(0.8, 0.0), (0.2, 0.0), (0.8, 0.1), (0.2, -0.05)])
def test_the_energy_of_the_motors_is_found_again(mu, grade_rad):
    p = RlmaParameters(rolling_resistance=0.02, drag_N_s2_per_m2=5.0)
    truth = drive(RlmaPlant(p, [Patch(friction=mu)], Grade(grade_rad=(grade_rad,))), 3.5, duration_s=1.5, dt_s=1e-3)

    def over_time(power_W):
        return np.trapezoid(power_W, truth.time_s)

    v, omega = truth.speed_m_s, truth.wheel_speed_rad_s
    motors_J = over_time((truth.torque_N_m * omega).sum(axis=1))
    kinetic_J = 0.5 * M * v[-1] ** 2 + 0.5 * J * np.sum(omega[-1] ** 2)
    slip_J = over_time((truth.traction_N * truth.slip_speed_m_s).sum(axis=1))
    rolling_J = over_time((p.rolling_resistance * p.static_load_N * R * np.abs(omega)).sum(axis=1))
    drag_J = over_time(p.drag_N_s2_per_m2 * np.abs(v) ** 3)
    height_J = M * G * math.sin(grade_rad) * truth.position_m[-1, 0]
    assert min(slip_J, rolling_J, drag_J, kinetic_J) > 0
    assert motors_J == pytest.approx(kinetic_J + slip_J + rolling_J + drag_J + height_J, rel=3e-3)


@pytest.mark.parametrize("step_s", [0.5e-3, 2e-3])
def test_the_step_of_the_physics_does_not_show(step_s):
    ground = [DRY, Patch(friction=0.2, from_s=0.5)]
    one, other = (drive(RlmaPlant(FREE, ground, longest_step_s=s), 4.0, duration_s=1.0) for s in (1e-3, step_s))
    after = one.time_s > 0.05
    assert other.speed_m_s[after] == pytest.approx(one.speed_m_s[after], rel=3e-3)
    assert other.slip_speed_m_s[-1, 0] == pytest.approx(one.slip_speed_m_s[-1, 0], rel=3e-3)
    assert other.traction_N[-1, :2] == pytest.approx(one.traction_N[-1, :2], rel=1e-3)


def test_how_often_it_is_asked_does_not_show():
    often, seldom = (drive(RlmaPlant(FREE), 3.0, duration_s=0.5, dt_s=dt) for dt in (1e-3, 0.1))
    assert seldom.speed_m_s[-1] == pytest.approx(often.speed_m_s[-1], rel=1e-12)


def turned(left_N_m, right_N_m, **ground):
    return drive(RlmaPlant(FREE, **ground), lambda _: (left_N_m, right_N_m), duration_s=1.0)


def test_gripping_wheels_turn_only_as_fast_as_they_creep_sideways():
    truth = turned(1.0, 3.0)
    moment_N_m = 0.5 * FREE.track_m * (truth.traction_N[-1] @ [-1, 1, -1, 1])
    sideways_N_m_s = FREE.slip_stiffness_s_per_m * np.sum(FREE.static_load_N * FREE.wheel_position_m[:, 0] ** 2)
    assert truth.yaw_rate_rad_s[-1] == pytest.approx(moment_N_m / sideways_N_m_s, rel=5e-3)
    assert truth.heading_rad[-1] > 0.005
    assert truth.position_m[-1, 1] > 0


def test_the_mirror_image_turns_the_other_way():
    left, right = turned(-2.0, 9.0), turned(9.0, -2.0)
    assert right.yaw_rate_rad_s == pytest.approx(-left.yaw_rate_rad_s, abs=1e-6)
    assert right.normal_N[-1] == pytest.approx(left.normal_N[-1, [1, 0, 3, 2]], rel=1e-6)


def test_in_a_turn_the_outer_wheels_roll_faster():
    truth = turned(-8.0, 12.0)
    outer_less_inner = truth.wheel_centre_speed_m_s[-1, 3] - truth.wheel_centre_speed_m_s[-1, 2]
    assert truth.yaw_rate_rad_s[-1] > 0.5
    assert outer_less_inner == pytest.approx(FREE.track_m * truth.yaw_rate_rad_s[-1])
    assert truth.slip_speed_m_s[-1, 2:] == pytest.approx(np.zeros(2), abs=0.02)


def test_speeds_and_forces_of_a_turn_are_those_of_its_path():
    truth = turned(-8.0, 12.0)
    middle = slice(60, 100)
    cos, sin = np.cos(truth.heading_rad), np.sin(truth.heading_rad)
    vx, vy = (np.gradient(truth.position_m[:, axis], truth.time_s) for axis in (0, 1))
    assert truth.speed_m_s[middle] == pytest.approx((cos * vx + sin * vy)[middle], abs=1e-3)
    assert truth.lateral_speed_m_s[middle] == pytest.approx((cos * vy - sin * vx)[middle], abs=1e-3)
    assert truth.yaw_rate_rad_s[middle] == pytest.approx(np.gradient(truth.heading_rad, truth.time_s)[middle], abs=1e-3)
    sideways_N = truth.lateral_N.sum(axis=1)[middle]
    assert sideways_N.min() > 5.0
    assert M * truth.specific_force_m_s2[middle, 1] == pytest.approx(sideways_N, rel=0.02)


def test_braking_slips_negative_and_backwards_mirrors_forwards():
    plant = RlmaPlant(FREE)
    plant.reset(speed_m_s=1.0)
    braking = plant.step(-3.0, 0.2)
    assert np.all(braking.slip_ratio[:2] < -0.01)
    forwards, backwards = (drive(plant, torque, duration_s=0.5) for torque in (1.0, -1.0))
    assert backwards.speed_m_s[-1] == pytest.approx(-forwards.speed_m_s[-1], rel=1e-3)


def test_reset_rolls_where_it_points_without_slip():
    plant = RlmaPlant(FREE)
    start = plant.reset(speed_m_s=0.5, heading_rad=2.0)
    assert (start.speed_m_s, start.lateral_speed_m_s) == pytest.approx((0.5, 0.0), abs=1e-12)
    assert start.slip_speed_m_s == pytest.approx(np.zeros(4), abs=1e-12)
    end = plant.step(0.0, 1.0)
    assert end.position_m[:2] == pytest.approx([0.5 * math.cos(2.0), 0.5 * math.sin(2.0)], rel=1e-3)
    assert end.heading_rad == pytest.approx(2.0)


def test_a_wheel_that_spins_on_the_spot_has_slip_ratio_one():
    start = drive(RlmaPlant(FREE, [Patch(friction=0.01)]), 5.0, duration_s=0.1)
    assert start.slip_ratio[-1, :2] == pytest.approx([1.0, 1.0], abs=0.01)


def test_slip_ratio_is_undefined_at_rest():
    assert np.isnan(RlmaPlant().reset().slip_ratio).all()


def test_a_reset_plant_repeats_itself_to_the_bit():
    plant = RlmaPlant(FREE, [DRY, Patch(friction=0.2, from_s=0.2)])
    first, second = (drive(plant, 4.0, duration_s=0.4) for _ in range(2))
    assert np.array_equal(first.speed_m_s, second.speed_m_s)


def test_a_simulated_second_costs_a_few_times_what_mujoco_takes_of_it():
    """Two to four times; a time of its own would judge the machine."""
    mujoco = pytest.importorskip("mujoco")
    plant = RlmaPlant()
    model = plant._model
    data = mujoco.MjData(model)

    def cost_s(work):
        start = time.process_time()
        work()
        return time.process_time() - start

    def bare():
        for _ in range(round(1.0 / model.opt.timestep)):
            mujoco.mj_step(model, data)

    whole = min(cost_s(lambda: drive(plant, 2.0, duration_s=1.0, dt_s=0.1)) for _ in range(20))
    assert whole < 6.0 * min(cost_s(bare) for _ in range(20))


@pytest.mark.parametrize(
    "change, message",
    [
        ({"mass_kg": 5.0}, "rlma.mass_kg must exceed that of the 4 wheels, 6 kg"),
        ({"track_m": 0.0}, "rlma.track_m must be > 0, got 0"),
        ({"driven": (0, 0)}, "rlma.driven must name wheels"),
        ({"driven": (4,)}, "rlma.driven must name wheels"),
        ({"rolling_resistance": -0.1}, "rlma.rolling_resistance must be >= 0"),
    ],
)
def test_impossible_parameters_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        RlmaParameters(**change)


@pytest.mark.parametrize(
    "torque_N_m, dt_s, message",
    [
        ((1.0, 2.0, 3.0), 0.01, r"torque_N_m must be a number or one for each driven wheel \(0, 1\), got \(3,\)"),
        (math.nan, 0.01, "torque_N_m must be finite"),
        (1.0, 0.0, "dt_s must be > 0"),
    ],
)
def test_steps_that_cannot_be_done_are_refused(torque_N_m, dt_s, message):
    with pytest.raises(InputError, match=message):
        RlmaPlant().step(torque_N_m, dt_s)


def test_a_step_that_would_make_the_slip_swing_is_refused():
    with pytest.raises(InputError, match="longest_step_s must be between"):
        RlmaPlant(FREE, longest_step_s=4e-3)


def test_ground_without_an_adhesion_is_refused():
    with pytest.raises(InputError, match="adhesion of the ground must be finite"):
        RlmaPlant(patches=[Patch("soft soil")])


def test_without_mujoco_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingPackageError, match="pip install mujoco"):
        RlmaPlant()


def test_mujoco_is_imported_only_when_a_plant_is_made():
    code = "import sys, ohmward_lab.simulate.mujoco_plant; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
