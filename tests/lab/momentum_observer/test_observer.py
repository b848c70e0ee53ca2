"""Speed from momentum: exact where nothing is noisy, consistent where it is, silent about what it cannot know."""

import math
from dataclasses import replace

import numpy as np
import pytest

from kernels import assert_compiled_is_plain, kernel_of
from ohmward.errors import InputError
from ohmward.traction import RLMA, SkidSteer, scene
from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop import Command, Control, Observing, Patch, Sensing
from ohmward_lab.simulate.closed_loop.run import score
from ohmward_lab.traction.momentum_observer import MomentumFlag, MomentumNoise, MomentumObserver, count_std_rad
from traction.speed_observer.examples import FLOOR

DT = 1e-3
COUNTS = 4096
STEP_RAD = 2 * math.pi / COUNTS
STD = count_std_rad(COUNTS)
SCENE = scene(RLMA, FLOOR)
R, J, M = RLMA.wheel.radius_m, RLMA.inertia[2], RLMA.inertia[0]
ACCELEROMETER = MomentumNoise(STD, accelerometer_std_m_s2=0.05, gyro_std_rad_s=0.005)


def observer(noise=ACCELEROMETER, **changes):
    return MomentumObserver(SCENE, noise, **changes)


def rolling_N(v):
    return sum(t.rolling.force_N(v, n) for t, n in zip(SCENE.terrains, observer().model.load_N, strict=True))


def world(force_N, disturbance_m_s2=0.0, grade_rad=0.0, rest_s=0.3, duration_s=1.0, payload=0.0):
    """Rest, then both wheels with a force of (T,): torque, angle, speed of rim and body, acceleration.

    The rim slips by a tenth of a second's worth of the force, so torque, wheel and body fit together exactly.
    """
    time = DT * np.arange(round((rest_s + duration_s) / DT))
    F = np.where(time >= rest_s, np.vectorize(force_N)(time - rest_s), 0.0)
    v, rim, angle, rows = 0.0, 0.0, 0.0, []
    for k, force in enumerate(F):
        moving = time[k] >= rest_s
        a = (
            (2 * force / (1 + payload) + rolling_N(v)) / M - disturbance_m_s2 - GRAVITY * math.sin(grade_rad)
            if moving
            else 0.0
        )
        slipping = v + 0.01 * (time[k] - rest_s) * force / 10.0 if moving else 0.0
        torque = (R * force + J / R * (slipping - rim) / DT) if moving else 0.0
        v, before, rim = v + DT * a, rim, slipping
        angle += 0.5 * DT * (before + rim) / R
        rows.append((torque, angle, v, rim, a))
    return (time, *np.array(rows).T)


def samples(truth, rng=None, offset=0.0, grade_rad=0.0, pitch_offset=0.0, acceleration=True):
    """What the sensors show of it."""
    time, torque, angle, _, _, a = truth
    noise = rng.standard_normal if rng else np.zeros
    phase = rng.random(2) if rng else np.zeros(2)
    counts = np.floor(angle[:, None] / STEP_RAD + phase) if rng else angle[:, None] / STEP_RAD + phase
    turned = STEP_RAD * np.diff(counts, axis=0, prepend=counts[:1])
    blank = observer().no_sample()
    current = torque / RLMA.motor.wheel_constant_Nm_per_A
    shown = a + GRAVITY * math.sin(grade_rad) + offset + 0.05 * noise(len(time))
    for k in range(len(time)):
        yield blank._replace(
            dt_s=DT,
            turned_rad=np.array([*turned[k], math.nan, math.nan]),
            current_A=current[k] + 0.1 * noise(2) if k else np.zeros(2),
            acceleration_m_s2=shown[k] if acceleration else math.nan,
            pitch_rad=grade_rad + pitch_offset,
            yaw_rate_rad_s=0.0,
        )


def follow(observer_, rows):
    state, estimates = observer_.init(), []
    step = kernel_of(observer_, state, observer_.no_sample())
    for row in rows:
        state, estimate = step(state, row)
        estimates.append(estimate)
    return estimates


def test_at_constant_force_without_noise_the_momentum_is_exact():
    truth = world(lambda t: 20.0)
    *_, last = follow(
        observer(MomentumNoise(STD, gyro_std_rad_s=0.005, disturbance_std_m_s2=1e-6, disturbance_walk=0.0)),
        samples(truth),
    )
    assert last.speed_m_s == pytest.approx(truth[3][-1], abs=0.002)
    assert last.force_N == pytest.approx([20.0, 20.0], abs=0.2)
    assert R * last.wheel_speed_rad_s == pytest.approx([truth[4][-1]] * 2, abs=0.002)


def test_impulse_is_momentum_whatever_the_force_did():
    """The sum of torque over radius, less what wheels and rolling resistance took, over the mass."""
    truth = world(lambda t: 20.0 + 10.0 * math.sin(9.0 * t))
    *_, last = follow(
        observer(MomentumNoise(STD, gyro_std_rad_s=0.005, disturbance_std_m_s2=1e-6, disturbance_walk=0.0)),
        samples(truth),
    )
    time, torque, _, v, rim, _ = truth
    impulse = 2 * np.sum(torque) * DT / R - 2 * J / R**2 * rim[-1] + sum(rolling_N(x) for x in v[time >= 0.3]) * DT
    assert impulse / M == pytest.approx(v[-1], rel=2e-3)
    assert last.speed_m_s == pytest.approx(impulse / M, abs=0.003)


@pytest.mark.parametrize("offset, grade, pitch_offset", [(0.3, 0.0, 0.0), (0.0, 0.05, 0.0), (-0.1, 0.03, 0.01)])
def test_at_rest_the_accelerometer_learns_its_zero_on_any_slope(offset, grade, pitch_offset):
    truth = world(lambda t: 25.0, grade_rad=grade)
    rows = samples(truth, offset=offset, grade_rad=grade, pitch_offset=pitch_offset)
    *_, last = follow(observer(), rows)
    assert last.speed_m_s == pytest.approx(truth[3][-1], abs=0.006)


def test_without_an_accelerometer_the_pitch_is_the_slope():
    truth = world(lambda t: 25.0, grade_rad=0.05)
    noise = MomentumNoise(STD, gyro_std_rad_s=0.005, disturbance_std_m_s2=1e-6, disturbance_walk=0.0)
    *_, last = follow(observer(noise), samples(truth, grade_rad=0.05, acceleration=False))
    assert last.speed_m_s == pytest.approx(truth[3][-1], abs=0.003)


def test_an_unknown_disturbance_is_found_by_the_accelerometer_and_not_without():
    truth = world(lambda t: 25.0, disturbance_m_s2=0.2)
    weighed = observer(replace(ACCELEROMETER, mass_std=1e-6))
    with_it = follow(weighed, samples(truth))[-1]
    blind = observer(MomentumNoise(STD, gyro_std_rad_s=0.005, mass_std=1e-6))
    without = follow(blind, samples(truth, acceleration=False))[-1]
    assert with_it.speed_m_s == pytest.approx(truth[3][-1], abs=0.006)
    assert with_it.disturbance_m_s2 == pytest.approx(0.2, abs=0.05)
    assert without.speed_m_s - truth[3][-1] == pytest.approx(0.2, abs=0.02)
    assert without.speed_std_m_s == pytest.approx(0.17, rel=0.2)


def test_the_sigma_of_the_speed_is_true():
    errors, stds = [], []
    rng = np.random.default_rng(7)
    exact = replace(ACCELEROMETER, accelerometer_gain_std=1e-6, accelerometer_tilt_std=1e-6)
    for _ in range(12):
        disturbance_m_s2 = rng.normal(0.0, 0.17)
        payload = rng.normal(0.0, ACCELEROMETER.mass_std)
        truth = world(lambda t: 30.0, disturbance_m_s2=disturbance_m_s2, duration_s=0.4, payload=payload)
        *_, last = follow(observer(exact), samples(truth, rng, offset=rng.normal(0.0, 0.1)))
        errors.append(last.speed_m_s - truth[3][-1])
        stds.append(last.speed_std_m_s)
    nees = np.mean(np.square(np.array(errors) / stds))
    assert 0.2 < nees < 2.0  # chi-square with 12 degrees of freedom over 12: 99.8 % within 0.19 and 2.7


@pytest.mark.parametrize("payload", [-0.3, 0.3])
def test_a_payload_is_weighed_by_the_accelerometer(payload):
    truth = world(lambda t: 30.0 + 25.0 * math.sin(8.0 * t), payload=payload)
    *_, last = follow(observer(), samples(truth))
    assert abs(last.speed_m_s - truth[3][-1]) < 2 * last.speed_std_m_s
    assert last.speed_m_s == pytest.approx(truth[3][-1], abs=0.02)


def test_without_a_pitch_a_slope_is_part_of_the_doubt():
    level, unknown = (observer(MomentumNoise(STD, gyro_std_rad_s=0.005, mass_std=1e-6)) for _ in range(2))
    rows = list(samples(world(lambda t: 25.0), acceleration=False))
    told = follow(level, rows)[-1].speed_std_m_s
    doubted = follow(unknown, [row._replace(pitch_rad=math.nan) for row in rows])[-1].speed_std_m_s
    assert told == pytest.approx(0.17, rel=0.2)
    assert doubted == pytest.approx(math.hypot(0.17, 0.05 * GRAVITY), rel=0.2)


def test_a_glitch_of_the_accelerometer_moves_nothing():
    rows = list(samples(world(lambda t: 25.0)))
    glitched = [row._replace(acceleration_m_s2=35.0) if k == 700 else row for k, row in enumerate(rows)]
    clean, spiked = follow(observer(), rows), follow(observer(), glitched)
    assert spiked[-1].speed_m_s == pytest.approx(clean[-1].speed_m_s, abs=0.01)
    assert spiked[-1].disturbance_m_s2 == pytest.approx(clean[-1].disturbance_m_s2, abs=0.1)


def test_a_standing_robot_stands_and_its_offset_does_not_move_it():
    blank = observer().no_sample()
    still = blank._replace(dt_s=DT, turned_rad=np.zeros(4), current_A=np.zeros(2), acceleration_m_s2=1.0)
    *_, last = follow(observer(), [still] * 300)
    assert last.speed_m_s == pytest.approx(0.0, abs=1e-4)
    assert int(last.flags) & MomentumFlag.STANDSTILL


def test_a_ground_that_gives_way_is_seen_within_six_milliseconds():
    truth = world(lambda t: 60.0 if t < 0.5 else 10.0)
    estimates = follow(observer(), samples(truth))
    changed = [k for k, e in enumerate(estimates) if int(e.flags) & MomentumFlag.GROUND_CHANGED]
    assert not changed or min(changed) >= 800
    slow = [k for k in range(806, 1300) if abs(estimates[k].force_N[0] - 10.0) > 20.0]
    assert len(slow) < 10


def test_samples_that_lack_everything_are_bridged():
    rows = list(samples(world(lambda t: 20.0)))
    blank = observer().no_sample()
    missing = [row if k % 3 else blank._replace(dt_s=DT) for k, row in enumerate(rows)]
    for k in range(3, len(rows), 3):
        others = missing[k - 2 : k]
        assert all(np.isfinite(s.current_A).all() for s in others)
    estimates = follow(observer(), missing)
    assert all(math.isfinite(e.speed_m_s) for e in estimates)
    assert int(estimates[900].flags) & MomentumFlag.NO_CURRENT


def test_after_a_gap_the_speed_is_anything():
    rows = list(samples(world(lambda t: 20.0)))
    estimates = follow(observer(), [*rows[:800], rows[800]._replace(dt_s=0.5)])
    assert int(estimates[-1].flags) & MomentumFlag.BAD_TIME
    assert estimates[-1].speed_std_m_s > 0.9
    estimates = follow(observer(), [*rows[:800], rows[800]._replace(dt_s=math.nan)])
    assert math.isfinite(estimates[-1].speed_m_s)


def test_an_external_speed_and_passive_wheels_are_used():
    noise = MomentumNoise(STD, passive_std_rad=STD, speed_std_m_s=0.03, gyro_std_rad_s=0.005)
    truth = world(lambda t: 25.0, disturbance_m_s2=0.3)
    angle = np.cumsum(truth[3]) * DT / R
    turned = np.diff(angle, prepend=0.0)
    rows = [
        s._replace(turned_rad=np.array([*s.turned_rad[:2], d, d]))
        for s, d in zip(samples(truth, acceleration=False), turned, strict=True)
    ]
    assert follow(observer(noise), rows)[-1].speed_m_s == pytest.approx(truth[3][-1], abs=0.002)
    only_speed = replace(noise, passive_std_rad=None)
    rows = [s._replace(speed_m_s=v) for s, v in zip(samples(truth, acceleration=False), truth[3], strict=True)]
    assert follow(observer(only_speed), rows)[-1].speed_m_s == pytest.approx(truth[3][-1], abs=0.005)


def test_compiled_and_plain_steps_agree():
    plain = observer()
    rows = list(samples(world(lambda t: 20.0), np.random.default_rng(1)))[290:330]
    assert_compiled_is_plain(plain, plain.init(), rows, 1e-9)


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match=r"momentum_noise.encoder_std_rad must be > 0"):
        MomentumNoise(0.0)
    with pytest.raises(InputError, match="free sideways"):
        MomentumObserver(scene(replace(RLMA, chassis=SkidSteer(0.314, 0.314, 0.30)), FLOOR), ACCELEROMETER)
    with pytest.raises(InputError, match=r"counts_per_turn must be > 0"):
        count_std_rad(0)


@pytest.mark.slow
def test_a_drag_larger_than_believed_is_not_taken_for_the_radius_of_the_passive_wheels():
    """A resistance of 2 m/s^2 that grows with the speed, where 0.17 is usual: the speed stays the counts' own."""
    scenario = closed_loop.Scenario(
        duration_s=4.0,
        commands=(Command(torque_Nm=0.0, mode="torque"), Command(1.0, slip_ratio=0.05)),
        ground=(Patch("wet asphalt"),),
        sensors=Sensing(interval_s=0.001, encoders="all"),
        observer=Observing("momentum"),
        controller=Control("slip"),
        drag_N_s2_per_m2=32.0,
    )
    found = score(closed_loop.run(scenario))
    assert found is not None
    assert found.speed_coverage_95 > 0.9
    assert found.coverage_95 > 0.9
    assert found.speed_rmse_m_s < 0.015
