"""Drives and their sensors: those of the plant, physical, and with the errors that the condition names, no others."""

import numpy as np
import pytest

from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.assess.draws import signs
from ohmward_lab.assess.traction import (
    BASE_DRIVE,
    DRIVEN_S,
    ROBOTS,
    SAMPLE_S,
    TRUTH_INTERVAL_S,
    World,
    drives,
    in_world,
    measured,
)
from ohmward_lab.simulate.closed_loop import Patch
from ohmward_lab.simulate.closed_loop.traction_plant import TractionPlant

RUNS = 2
EXACT = BASE_DRIVE._replace(current_gain=0.0, gyro_offset_rad_s=0.0, current_noise_A=0.0, counts_per_turn=10**9)


def rim_m_s(name, world, truth):
    """(T - 1, driven, B) mean speeds of the rims."""
    robot = in_world(ROBOTS[name], world)
    return np.diff(truth.angle_rad[:, : robot.driven], axis=0) / TRUTH_INTERVAL_S * robot.wheel.radius_m


def travel_m_s(name, truth):
    """(T, driven, B) of the centres of the driven wheels."""
    robot = ROBOTS[name]
    columns = [truth.speed_m_s, truth.lateral_speed_m_s, truth.yaw_rate_rad_s]
    motion = np.stack(columns if robot.freedoms == 3 else columns[::2], axis=1)
    return np.einsum("wm,tmb->twb", robot.rolling[: robot.driven], motion)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_drive_uses_its_speeds_and_stops_among_them(name):
    truth = drives(name, World(), RUNS, 1)
    assert truth.speed_m_s.shape == (round(DRIVEN_S / TRUTH_INTERVAL_S), RUNS)
    size = np.abs(truth.speed_m_s)
    assert 0.3 < size.max() < 1.1 and (size < 1e-3).mean() > 0.01 and truth.speed_m_s.min() < -0.1
    np.testing.assert_allclose(rim_m_s(name, World(), truth), travel_m_s(name, truth)[1:], atol=0.25)
    assert not np.array_equal(truth.speed_m_s[:, 0], truth.speed_m_s[:, 1])


def test_the_motion_is_that_of_the_plant():
    world = World("gravel")
    truth = drives("rlma", world, RUNS, 1)
    plant = TractionPlant(ROBOTS["rlma"], [Patch("gravel")], longest_step_s=SAMPLE_S)
    # Torques change within the time kept; over a cruise they hardly do, so the plant follows from the start of a ramp.
    torque = np.diff(truth.impulse_Nms[:, :, 0], axis=0, prepend=0.0) / TRUTH_INTERVAL_S
    found = [plant.step(each, TRUTH_INTERVAL_S).speed_m_s for each in torque]
    np.testing.assert_allclose(found, truth.speed_m_s[:, 0], atol=0.03)


def test_ice_lies_under_the_left_wheels_alone():
    truth = drives("rlma", World(patch="ice", one_side=True), RUNS, 1)
    far = (np.nan_to_num(np.abs(truth.slip_ratio)) > 0.2) & (np.abs(travel_m_s("rlma", truth)) > 0.2)
    assert far[:, 0].sum() > 50 > 5 * far[:, 1].sum()


def test_the_world_is_in_the_truth():
    smaller = World(radius_ratio=0.95)
    truth = drives("rlma", smaller, RUNS, 1)
    np.testing.assert_allclose(rim_m_s("rlma", smaller, truth), travel_m_s("rlma", truth)[1:], atol=0.1)
    base, heavy = drives("rlma", World(), RUNS, 1), drives("rlma", World(mass_ratio=1.5), RUNS, 1)
    work = [np.abs(np.diff(found.impulse_Nms, axis=0)).sum() for found in (base, heavy)]
    assert work[1] / work[0] == pytest.approx(1.5, abs=0.1)
    slope = drives("rlma", World(grade_rad=0.15), RUNS, 1)
    assert slope.grade_rad.max() == pytest.approx(0.15) and slope.grade_rad.min() == pytest.approx(-0.15)
    gravity = slope.specific_force_m_s2[1:] - np.diff(slope.speed_m_s, axis=0) / TRUTH_INTERVAL_S
    np.testing.assert_allclose(np.median(gravity / (GRAVITY * np.sin(slope.grade_rad[1:]))), 1.0, atol=0.01)


def test_sensors_are_exact_without_errors():
    sample, truth = measured("rlma", EXACT, RUNS, 1)
    n, rolling = ROBOTS["rlma"].driven, np.diff(truth.angle_rad, axis=0) / EXACT.interval_s
    np.testing.assert_allclose(sample.wheel_speed_rad_s[1:, :n], rolling[:, :n], atol=1e-6)
    assert np.isnan(sample.wheel_speed_rad_s[:, n:]).all() and np.isnan(sample.speed_m_s).all()
    torque = np.diff(truth.impulse_Nms, axis=0) / EXACT.interval_s
    constant = ROBOTS["rlma"].motor.wheel_constant_Nm_per_A
    np.testing.assert_allclose(sample.current_A[1:], torque / constant, atol=1e-9)
    assert np.abs(sample.yaw_rate_rad_s - truth.yaw_rate_rad_s).std() < 0.003
    assert np.isnan(sample.pitch_rad).all()


def test_sensors_have_the_errors_of_the_condition():
    plain, truth = measured("rlma", EXACT, 4, 1)
    wrong, _ = measured("rlma", EXACT._replace(current_gain=0.3, gyro_offset_rad_s=0.05), 4, 1)
    driving = np.abs(plain.current_A) > 1.0
    ratio = wrong.current_A / np.where(driving, plain.current_A, np.nan)
    np.testing.assert_allclose(np.nanmean(ratio, axis=(0, 1)), 1.0 + 0.3 * signs(4))
    np.testing.assert_allclose((wrong.yaw_rate_rad_s - truth.yaw_rate_rad_s).mean(axis=0), 0.05 * signs(4), atol=1e-3)
    coarse, _ = measured("rlma", EXACT._replace(counts_per_turn=64), 4, 1)
    counts = coarse.wheel_speed_rad_s[:, :2] * EXACT.interval_s * 64 / (2 * np.pi)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    lost, _ = measured("rlma", EXACT._replace(missing=0.3), 4, 1)
    assert np.isnan(lost.current_A).mean() == pytest.approx(0.3, abs=0.02)
    late, _ = measured("rlma", EXACT._replace(speed_interval_s=0.1, speed_delay_s=0.2), 4, 1)
    at = np.flatnonzero(np.isfinite(late.speed_m_s[:, 0]))
    assert at[0] == 10 and set(np.diff(at)) == {5} and set(late.speed_age_s[at, 0]) == {0.2}
    assert (late.speed_m_s[at] - truth.speed_m_s[at - 10]).std() == pytest.approx(0.03, rel=0.1)
    slow, then = measured("rlma", EXACT._replace(interval_s=0.1), 4, 1)
    np.testing.assert_array_equal(then.speed_m_s, truth.speed_m_s[::5])
    assert slow.dt_s[0] == 0.0 and set(slow.dt_s[1:]) == {0.1}
    glitchy, _ = measured("rlma", EXACT._replace(glitches=0.01), 4, 1)
    jumps = np.abs(glitchy.wheel_speed_rad_s[:, :2] - plain.wheel_speed_rad_s[:, :2]) > 10.0
    assert jumps.mean() == pytest.approx(0.01, rel=0.3)
