"""Apparent inertia: what evidence says of wheels whose motion is known, and bands where there is none."""

import numpy as np
import pytest

from ohmward.trace import Kernel, clip
from ohmward.traction import RLMA, RobotInput, RollingResistance, Terrain, scene
from ohmward.traction.friction.law import WardIagnemma
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.make_observer import default_observer
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_evidence import SpeedEvidence, grips, observes_grip, with_evidence
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import KNOWN_GROUND, States
from ohmward_lab.simulate.ground import Patch
from ohmward_lab.simulate.implicit_step import ALEXANDER, next_state
from ohmward_lab.simulate.mujoco_plant import DRY, RlmaParameters, RlmaPlant, drive
from traction.speed_observer.examples import DT_S, RLMA_ON_FLOOR, observed

from .mujoco_runs import believed, ice_on_a_slope, rmse, samples_of
from .test_gross_slip import clean
from .test_ice_on_slopes import on_wheel_speed

MODEL = Model(RLMA_ON_FLOOR, States(), ObserverNoise())
ROBOT = RLMA_ON_FLOOR.robot
SLIDING_KG = ROBOT.inertia[ROBOT.freedoms :].sum() / ROBOT.wheel.radius_m**2
GRIPPING_KG = ROBOT.inertia[0] + SLIDING_KG
N_PER_A = ROBOT.motor.wheel_constant_Nm_per_A / ROBOT.wheel.radius_m
NOISE = ObserverNoise(gyro_std_rad_s=0.003)


def driven_by(current_A, mass_kg):
    """The test after wheels that carry this mass have been driven by these currents (T,), the same on both."""
    test, rim_m_s = SpeedEvidence(), 0.0
    for current in current_A:
        rim_m_s += DT_S * 2 * N_PER_A * current / mass_kg
        omega = np.full(2, rim_m_s / ROBOT.wheel.radius_m)
        shown = MODEL.first_belief(omega)
        sample = clean(current)._replace(wheel_measured=np.full(4, True))
        test = with_evidence(test, shown, sample, MODEL)
    return test


@pytest.mark.parametrize("mass_kg", [SLIDING_KG, GRIPPING_KG])
def test_rims_and_impulse_pass_the_same_filter(mass_kg):
    test = driven_by(np.random.default_rng(1).uniform(-3.0, 3.0, 50), mass_kg)
    np.testing.assert_allclose(test.passed_m_s[1], test.impulse_Ns / mass_kg, rtol=1e-9)


def test_wheels_that_carry_the_robot_grip_and_wheels_that_turn_alone_do_not():
    current_A = 2.0 * np.sin(6.0 * DT_S * np.arange(100))
    assert grips(driven_by(current_A, GRIPPING_KG))
    sliding = driven_by(current_A, SLIDING_KG)
    assert not grips(sliding) and sliding.evidence_s < 0.0


def test_a_jump_that_excludes_grip_and_slide_is_no_evidence():
    jumped = MODEL.first_belief(np.full(2, 0.5 / ROBOT.wheel.radius_m))
    sample = clean(0.0)._replace(wheel_measured=np.full(4, True))
    assert with_evidence(SpeedEvidence(rim_age_s=0.0), jumped, sample, MODEL).evidence_s == 0.0


def test_a_steady_force_tells_nothing():
    assert abs(driven_by(np.full(300, 1.0), GRIPPING_KG).evidence_s) < 1e-3


def test_encoders_that_are_silent_tell_nothing():
    test = driven_by(2.0 * np.sin(6.0 * DT_S * np.arange(100)), GRIPPING_KG)
    for k in range(100, 200):
        sample = clean(2.0 * np.sin(6.0 * DT_S * k))
        test = with_evidence(test, MODEL.first_belief(np.zeros(2)), sample, MODEL)
    assert not grips(test)


def test_only_a_filter_that_learns_the_ground_asks():
    assert observes_grip(MODEL)
    assert not observes_grip(Model(RLMA_ON_FLOOR, KNOWN_GROUND, ObserverNoise()))


def slope(friction, grade_rad, seed=1, pitch_std_rad=None):
    """Truth and estimates of a drive at wheel speed from a dry floor onto a slope, seen by its driven wheels."""
    truth = drive(ice_on_a_slope(friction, grade_rad), on_wheel_speed, 8.0, DT_S)
    rng = np.random.default_rng(seed)
    samples = samples_of(truth, rng, pitch_std=pitch_std_rad)
    noise = ObserverNoise(gyro_std_rad_s=0.003, pitch_std_rad=pitch_std_rad)
    return truth, observed(SpeedObserver(believed(rng), noise=noise, rest_hold_s=np.inf), samples)[1]


def share_covered(truth, e):
    return np.mean(np.abs(e.speed_m_s - truth.speed_m_s[1:]) < 1.96 * e.speed_std_m_s)


@pytest.mark.parametrize("grade_rad", [0.06, 0.08, -0.08])
def test_ice_on_a_slope_opens_the_band_and_says_so(grade_rad):
    truth, e = slope(0.1, grade_rad)
    assert share_covered(truth, e) > 0.9
    wrong = np.abs(e.speed_m_s - truth.speed_m_s[1:]) > 0.2
    assert np.mean((e.flags.astype(int) & SlipFlag.SPEED_UNOBSERVED != 0)[wrong]) > 0.9


@pytest.mark.parametrize("grade_rad", [0.06, 0.08, -0.08])
def test_a_pitch_tells_more(grade_rad):
    truth, e = slope(0.1, grade_rad, pitch_std_rad=0.005)
    assert share_covered(truth, e) > 0.84


@pytest.mark.parametrize("grade_rad", [0.06, -0.08])
def test_a_slope_that_gives_grip_costs_no_accuracy(grade_rad):
    truth, e = slope(0.8, grade_rad)
    assert rmse(e.speed_m_s - truth.speed_m_s[1:]) < 0.01
    assert share_covered(truth, e) > 0.94


@pytest.mark.parametrize("grade_rad", [0.06, -0.08])
def test_a_measured_slope_that_gives_grip_leaves_the_band_narrow(grade_rad):
    truth, e = slope(0.8, grade_rad, pitch_std_rad=0.005)
    assert rmse(e.speed_m_s - truth.speed_m_s[1:]) < 0.015
    assert rmse(e.speed_std_m_s) < 0.015
    assert share_covered(truth, e) > 0.88


def servo_drive(friction, seed, steps=3000):
    """Speed (T,) and samples of a robot whose wheels follow waves and jumps of wanted speeds, on our own plant."""
    place = scene(RLMA, Terrain("slippery", WardIagnemma(friction, 20.0), RollingResistance(a3_s_per_m=0.0), "tests"))
    radius_m, inertia = RLMA.wheel.radius_m, RLMA.inertia[RLMA.freedoms]
    A_per_rad_s = 0.5 * inertia / DT_S / RLMA.motor.wheel_constant_Nm_per_A

    def step(x, wanted_rad_s):
        current_A = np.array([clip(A_per_rad_s * (wanted_rad_s[k] - x[2 + k]), -100.0, 100.0) for k in range(2)])
        after = next_state(x, RobotInput(current_A), place, DT_S, ALEXANDER)
        return after, (after, current_A)

    rng = np.random.default_rng(seed)
    time_s = DT_S * np.arange(steps)
    rates, phases = rng.uniform(0.1, 1.5, (2, 5)), rng.uniform(0.0, 6.0, (2, 5))
    forward, turn = np.sin(rates[:, None] * time_s[:, None] + phases[:, None]).sum(axis=2)
    jumps = np.repeat(rng.random(steps // 300) < 0.15, 300)
    rim_m_s = np.where(jumps, 1.2 * np.sign(forward), 0.6 * forward)[:, None] + 0.05 * turn[:, None] * [-1.0, 1.0]
    _, (x, current_A) = Kernel(step, np.zeros(4), np.zeros(2)).scan(np.zeros(4), rim_m_s / radius_m)
    speeds = np.full((steps, 4), np.nan)
    speeds[:, :2] = x[:, 2:] + 0.05 * rng.standard_normal((steps, 2))
    nothing = np.full(steps, np.nan)
    currents = current_A + 0.05 * rng.standard_normal((steps, 2))
    yaw_rate = x[:, 1] + 0.01 * rng.standard_normal(steps)
    none = [nothing, nothing, nothing, nothing, np.zeros(steps)]
    return x[:, 0], RobotSample(np.full(steps, DT_S), speeds, currents, yaw_rate, *none)


@pytest.mark.parametrize("seed", [1, 3, 6, 7])
def test_a_belief_in_sliding_wheels_ends_where_they_carry_the_robot(seed):
    speed_m_s, samples = servo_drive(0.15, seed)
    _, e = observed(default_observer("rlma"), samples)
    error = e.speed_m_s - speed_m_s
    assert rmse(error) < 0.3


@pytest.mark.parametrize(
    ("noise", "sensors"),
    [
        (ObserverNoise(passive_std_rad_s=0.07), {"passive": True}),
        (ObserverNoise(speed_std_m_s=0.05), {"speed_every": 10}),
        (ObserverNoise(speed_std_m_s=0.05), {"speed_every": 100}),
        (ObserverNoise(), {}),
    ],
    ids=["passive wheels", "outside speed", "one outside speed a second", "none"],
)
def test_a_spin_whose_drive_ends_is_no_grip(noise, sensors):
    """From a dry floor onto ice; there the motors spin the wheels, then brake them."""

    def torque_Nm(truth):
        if truth.position_m[0] < 0.8:
            return np.clip(12.0 * (0.7 - truth.speed_m_s), -3.0, 3.0)
        return -1.5 if truth.wheel_speed_rad_s[0] > 0.5 else 0.0

    truth = drive(RlmaPlant(RlmaParameters(), [DRY, Patch(friction=0.08, from_m=0.5)]), torque_Nm, 2.0, DT_S)
    rng = np.random.default_rng(1)
    observer = SpeedObserver(believed(rng), noise=noise, rest_hold_s=np.inf)
    _, e = observed(observer, samples_of(truth, rng, **sensors))
    assert np.abs(e.speed_m_s - truth.speed_m_s[1:]).max() < 0.1
