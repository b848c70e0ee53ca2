"""Pose and twist against closed forms, against robots drawn from the noise, and with sensors that fail."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ohmward.errors import InputError
from ohmward.filters.consistency import mean_bounds
from ohmward.filters.estimator import rows_of
from ohmward.traction import RLMA, ROBOTINO, SkidSteer
from ohmward.traction.odometry.corrections import COMPARED_S, HEADING_WAIT
from ohmward.traction.odometry.model import ANY_HEADING_RAD, OdometryNoise, noise_of
from ohmward.traction.odometry.pose_filter import PoseFilter, pose_filter
from ohmward.traction.odometry.sample import OdometryFlag
from ohmward.traction.robot.packaged import generic_robot
from ohmward.traction.terrain.floor import ROLLING, STIFFNESS
from traction.odometry.examples import DT_S, NOISE, drive, gauss_markov, samples, scan

FREE = (
    "encoder_std_rad",
    "correlation_s",
    "turn_correlation_s",
    "speed_correlation_s",
    "speed_std_m_s",
    "increment_walk",
)
EXACT = replace(OdometryNoise(), **{f.name: 0.0 for f in fields(OdometryNoise) if f.name not in FREE})  # type: ignore[arg-type]
FILTER = PoseFilter(RLMA, OdometryNoise())  # rims without creep


def run(settings, given):
    """Estimates (T, ...)."""
    return scan(settings, given)[1]


def rolling(v, w, steps):
    """Wheel speeds (T, 2) of [T]'s robot that rolls so."""
    speeds = RLMA.rolling[:2] @ np.array([v, w]) / RLMA.wheel.radius_m
    return np.tile(speeds, (steps, 1))


def nees(e, pose, k):
    error = np.array([e.x_m[k], e.y_m[k], e.yaw_rad[k]]) - pose[k]
    return float(error @ np.linalg.solve(e.pose_cov[k], error))


@pytest.mark.parametrize("gyro", [True, False])
def test_a_circle_ends_where_it_began(gyro):
    steps = 1000
    w = 2 * math.pi / (steps * DT_S)
    given = {"wheel_speed_rad_s": rolling(0.5, w, steps)} | ({"yaw_rate_rad_s": np.full(steps, w)} if gyro else {})
    e = run(PoseFilter(RLMA, EXACT), samples(FILTER, **given))
    assert_allclose([e.x_m[-1], e.y_m[-1], e.yaw_rad[-1]], [0.0, 0.0, 2 * math.pi], atol=1e-9)
    # Chords of equal steps on the circle of radius v/w.
    chord = 2 * 0.5 / w * math.sin(math.pi / 2) * (w * DT_S / 2) / math.sin(w * DT_S / 2)
    assert e.y_m[steps // 2 - 1] == pytest.approx(chord, rel=1e-5)
    assert e.distance_m[-1] == pytest.approx(0.5 * steps * DT_S)
    assert not e.flags.any()


@pytest.mark.parametrize("with_gyro", [False, True])
@pytest.mark.parametrize("motion", [(0.3, 0.0), (0.0, 0.2), (-0.2, 0.1)])
@pytest.mark.parametrize("robot", [ROBOTINO, generic_robot(9.0, 0.05, 0.3, layout="mecanum")], ids=["omni", "mecanum"])
def test_wheels_with_rollers_show_the_motion_in_every_direction(robot, motion, with_gyro):
    speeds = np.tile(robot.rolling @ np.array([*motion, 0.0]) / robot.wheel.radius_m, (100, 1))
    settings = PoseFilter(robot, EXACT)
    gyro = {"yaw_rate_rad_s": np.zeros(100)} if with_gyro else {}
    e = run(settings, samples(settings, wheel_speed_rad_s=speeds, **gyro))
    assert_allclose([e.x_m[-1], e.y_m[-1]], np.array(motion) * 100 * DT_S, atol=1e-12)
    assert_allclose([e.yaw_rad[-1], e.speed_m_s[-1], e.speed_left_m_s[-1]], [0.0, *motion], atol=1e-12)


def test_wheels_that_roll_freely_tell_the_motion_and_those_that_drive_creep():
    """Driven wheels show 1 / (1 - creep) of the way; without the others, the creep of the noise is taken off."""
    creep, steps = 0.0075, 200
    settings = PoseFilter(RLMA, replace(EXACT, creep=creep))
    speeds = rolling(0.5, 0.0, steps)
    given = {"wheel_speed_rad_s": speeds / (1.0 - creep), "yaw_rate_rad_s": np.zeros(steps)}
    for passive in (np.full((steps, 2), np.nan), speeds):
        e = run(settings, samples(settings, passive_rad_s=passive, **given))
        assert e.x_m[-1] == pytest.approx(0.5 * steps * DT_S, rel=1e-12)
    spin = given | {"wheel_speed_rad_s": 3.0 * speeds, "passive_rad_s": speeds}
    assert run(settings, samples(settings, **spin)).x_m[-1] == pytest.approx(0.5 * steps * DT_S, rel=1e-12)


def test_creep_is_rolling_resistance_over_stiffness_where_all_wheels_drive_and_more_where_some_do():
    share = ROLLING / STIFFNESS
    assert noise_of(ROBOTINO).creep == pytest.approx(share)
    assert noise_of(RLMA).creep == pytest.approx(2 * share, rel=0.02)  # half of the weight is on driven wheels


def test_wheels_that_scrub_are_learnt_from_the_gyro_and_turn_the_robot_when_it_fails():
    """The robot turns by a fifth of what its wheels show, and its gyro fails after a minute."""
    steps, turn = 4000, 0.5
    wheels = np.array([rolling(0.5, turn, 1)[0]] * steps)
    gyro = np.where(np.arange(steps) < 3000, 0.2 * turn, np.nan)
    e = run(FILTER, samples(FILTER, wheel_speed_rad_s=wheels, yaw_rate_rad_s=gyro))
    rejected = (e.flags.astype(int) & OdometryFlag.TURN_REJECTED) != 0
    assert rejected[:100].any() and not rejected[100:].any()
    assert e.yaw_rad[-1] == pytest.approx(0.2 * turn * steps * DT_S, rel=0.02)


def test_a_wheel_that_jumps_leaves_the_speed_to_the_other_where_a_gyro_tells_the_turn():
    """The left wheel spins up at once for three seconds, while the robot speeds up from rest."""
    time_s = DT_S * np.arange(300)
    speed = np.clip(0.25 * (time_s - 1.0), 0.0, 1.0)
    wheels = rolling(1.0, 0.0, 300) * speed[:, None]
    wheels[100:250, 0] += 250.0
    e = run(FILTER, samples(FILTER, wheel_speed_rad_s=wheels, yaw_rate_rad_s=np.zeros(300)))
    assert (e.flags.astype(int) & OdometryFlag.WHEEL_JUMP).any()
    assert abs(e.x_m[-1] - np.sum(speed) * DT_S) < 0.25


def test_the_way_is_as_uncertain_as_correlated_slip_makes_it():
    """Var of the way: radius^2 s^2 + 2 sigma^2 tau (T - tau (1 - e^(-T/tau))), an integrated Gauss-Markov process."""
    noise = replace(EXACT, radius_std=0.004, slip_share=0.02)
    steps, tau = 1500, noise.correlation_s
    settings = PoseFilter(RLMA, noise)
    e = run(settings, samples(settings, wheel_speed_rad_s=rolling(0.5, 0.0, steps)))
    T = steps * DT_S
    slip = 2 * (0.02 * 0.5) ** 2 * tau * (T - tau * (1 - math.exp(-T / tau)))
    assert e.pose_cov[-1, 0, 0] == pytest.approx((0.004 * 0.5 * T) ** 2 + slip, rel=0.02)
    assert e.twist_cov[-1, 0, 0] == pytest.approx(
        (0.004 * 0.5) ** 2 + (0.02 * 0.5) ** 2 + (RLMA.wheel.radius_m * noise.encoder_std_rad / DT_S) ** 2 / 2, rel=1e-6
    )


def test_the_offset_is_learnt_at_rest_as_well_as_its_noise_allows():
    """Var of the mean of white noise of density q^2 over T is q^2 / T, where a late gyro has no turn left to report."""
    steps = 500
    rng = np.random.default_rng(1)
    noise = replace(OdometryNoise(), gyro_offset_walk=0.0, encoder_std_rad=0.0)
    gyro = 0.01 + noise.gyro_walk / math.sqrt(DT_S) * rng.standard_normal(steps)
    settings = PoseFilter(RLMA, noise)
    e = run(settings, samples(settings, wheel_speed_rad_s=np.zeros((steps, 2)), yaw_rate_rad_s=gyro))
    used_s = steps * DT_S - COMPARED_S
    assert e.gyro_offset_std_rad_s[-1] == pytest.approx(noise.gyro_walk / math.sqrt(used_s), rel=0.02)
    assert abs(e.gyro_offset_rad_s[-1] - 0.01) < 3 * e.gyro_offset_std_rad_s[-1]
    assert abs(e.yaw_rad[-1]) < 3 * math.sqrt(e.pose_cov[-1, 2, 2])
    assert e.position_std_m[-1] < 1e-3


def test_the_pose_is_consistent_over_drives_of_fifty_metres():
    """NEES of the pose over 50 robots drawn from the noise, at three places of the way: in the 99.9 % bounds."""
    drives = [drive(FILTER, seed) for seed in range(50)]
    found = [run(FILTER, d.samples) for d in drives]
    T = len(drives[0].pose)
    lower, upper = mean_bounds(3, len(drives), 0.999)
    for share in (0.3, 0.6, 1.0):
        k = int(share * T) - 1
        assert lower < np.mean([nees(e, d.pose, k) for e, d in zip(found, drives, strict=True)]) < upper
    offsets = [
        (e.gyro_offset_rad_s[-1] - d.offset_rad_s) / e.gyro_offset_std_rad_s[-1]
        for e, d in zip(found, drives, strict=True)
    ]
    lower, upper = mean_bounds(1, len(drives), 0.999)
    assert lower < np.mean(np.square(offsets)) < upper


def test_a_traced_step_is_the_step():
    d = drive(FILTER, 3, distance_m=2.0)
    state = FILTER.init(FILTER.no_sample())
    traced = run(FILTER, d.samples)
    for _, sample in zip(range(150), rows_of(d.samples), strict=False):
        state, e = FILTER.step(state, sample)
    assert_allclose([e.x_m, e.y_m, e.yaw_rad], [traced.x_m[149], traced.y_m[149], traced.yaw_rad[149]], atol=1e-12)
    assert_allclose(e.pose_cov, traced.pose_cov[149], rtol=1e-9, atol=1e-18)


def test_speeds_from_outside_show_slip_forward_and_to_the_left():
    """Wheels that turn twice as fast as the robot moves, and a robot that slides to its left."""
    steps = 500
    outside = np.full(steps, math.nan)
    outside[::5] = 0.25
    left = np.where(np.isnan(outside), math.nan, 0.1)
    stds = np.full(steps, 0.01)
    settings = PoseFilter(RLMA, replace(OdometryNoise(), slip_share=0.5, side_slip_share=0.2))
    e = run(settings, samples(
        settings, wheel_speed_rad_s=rolling(0.5, 0.0, steps), yaw_rate_rad_s=np.zeros(steps),
        speed_m_s=outside, speed_std_m_s=stds, speed_left_m_s=left, speed_left_std_m_s=stds,
    ))  # fmt: skip
    assert_allclose([e.speed_m_s[-1], e.speed_left_m_s[-1]], [0.25, 0.1], atol=0.02)
    assert_allclose([e.x_m[-1], e.y_m[-1]], [2.5, 1.0], atol=0.15)


def test_a_speed_beyond_its_gate_opens_the_band_and_is_believed_when_it_comes_again():
    steps = 300
    outside = np.full(steps, math.nan)
    outside[100::10] = 0.25
    given = {"speed_m_s": outside, "speed_std_m_s": np.full(steps, 0.01)}
    e = run(FILTER, samples(FILTER, wheel_speed_rad_s=rolling(0.5, 0.0, steps), **given))
    assert int(e.flags[100]) & OdometryFlag.SPEED_REJECTED
    assert e.twist_cov[100, 0, 0] > 0.1**2  # it may be garbage
    assert_allclose(e.speed_m_s[110:], 0.25, atol=0.1)  # it goes back to the wheels' in between


def test_a_robot_that_an_outside_speed_shows_to_be_stuck_stays_so_until_the_next_one():
    """Wheels at 0.5 m/s, a speed of zero once a second: from the second one on the robot stands in between, too."""
    steps = 1000
    outside = np.full(steps, math.nan)
    outside[::50] = np.where(np.arange(0, steps, 50) < 500, 0.5, 0.0)
    given = {"speed_m_s": outside, "speed_std_m_s": np.full(steps, 0.03)}
    e = run(
        FILTER, samples(FILTER, wheel_speed_rad_s=rolling(0.5, 0.0, steps), yaw_rate_rad_s=np.zeros(steps), **given)
    )
    assert_allclose(e.speed_m_s[552:], 0.0, atol=0.1)
    assert e.x_m[-1] - e.x_m[551] < 0.5  # of 4.5 m by the wheels


@pytest.mark.parametrize("age_s", [0.0, 0.06])
def test_pose_increments_correct_slip_and_a_gyro(age_s):
    """Wheels that spin, a gyro with an offset, and visual odometry of a robot on a circle, late."""
    steps, v, w = 600, 0.3, 0.2
    late, length = round(age_s / DT_S), 5
    pose = integrate_circle(v, w, length)
    increment = np.full((steps, 3), math.nan)
    increment[length + late :: length] = pose
    settings = replace(FILTER, noise=replace(FILTER.noise, slip_share=0.3, increment_scale_std=0.0))
    e = run(settings, samples(
        settings, wheel_speed_rad_s=rolling(0.4, w, steps), yaw_rate_rad_s=np.full(steps, w + 0.02),
        increment=increment, increment_std=np.tile([1e-3, 1e-3, 1e-3], (steps, 1)),
        increment_s=np.full(steps, length * DT_S), increment_age_s=np.full(steps, age_s),
    ))  # fmt: skip
    assert not e.flags.any()
    assert e.speed_m_s[-1] == pytest.approx(v, abs=0.01)
    assert e.gyro_offset_rad_s[-1] == pytest.approx(0.02, abs=3 * e.gyro_offset_std_rad_s[-1] + 1e-3)
    error = np.array([e.x_m[-1], e.y_m[-1], e.yaw_rad[-1]]) - integrate_circle(v, w, steps)
    assert np.hypot(*error[:2]) < 0.1 and abs(error[2]) < 0.03


def increments(pose, length, share, rng):
    """Increments (T, 3) over so many steps, as late, with this share of the way, and their standard deviations (3,)."""
    std = np.array([3e-3, 3e-3, 1e-3])
    found = np.full(pose.shape, math.nan)
    for k in range(2 * length, len(pose), length):
        before, after = pose[k - 2 * length], pose[k - length]
        x, y = share * (after - before)[:2]
        c, s = math.cos(before[2]), math.sin(before[2])
        found[k] = [c * x + s * y, c * y - s * x, after[2] - before[2]] + std * rng.standard_normal(3)
    return found, std


@pytest.mark.parametrize("share", [0.9, 1.0])
def test_increments_that_show_less_than_the_way_spoil_neither_the_pose_nor_its_band(share):
    """Ten robots beside a lidar that is 10 % short, as in a corridor, or right: no worse than without it."""
    off_m = np.zeros((10, 2))
    nees = np.zeros((10, 2))
    for seed in range(10):
        robot = drive(FILTER, seed)
        seen, std = increments(robot.pose, 5, share, np.random.default_rng(seed))
        given = robot.samples._replace(
            increment=seen,
            increment_std=np.tile(std, (len(seen), 1)),
            increment_s=np.full(len(seen), 5 * DT_S),
            increment_age_s=np.full(len(seen), 5 * DT_S),
        )
        for k, among in enumerate((given, robot.samples)):
            e = run(FILTER, among)
            error = np.array([e.x_m[-1], e.y_m[-1], e.yaw_rad[-1]]) - robot.pose[-1]
            off_m[seed, k] = np.hypot(*error[:2])
            nees[seed, k] = error @ np.linalg.solve(e.pose_cov[-1], error)
    beside, alone = off_m.mean(axis=0)
    assert beside < alone
    assert nees[:, 0].mean() < mean_bounds(3, 10, 0.9999)[1]


@pytest.mark.parametrize("every", [5, 50])
def test_outside_speeds_whose_errors_last_spoil_neither_the_pose_nor_its_band(every):
    """Ten robots beside speeds that are 3 % short, with errors of half a minute as large as their noise."""
    off_m = np.zeros((10, 2))
    nees = np.zeros(10)
    slow = replace(NOISE, correlation_s=30.0)
    for seed in range(10):
        robot, rng, std = drive(FILTER, seed), np.random.default_rng(seed), 0.03
        T = len(robot.pose)
        moved = np.diff(robot.pose, axis=0, prepend=np.zeros((1, 3))) / DT_S
        yaw = robot.pose[:, 2]
        speed = moved[:, 0] * np.cos(yaw) + moved[:, 1] * np.sin(yaw)
        errors = std * (rng.standard_normal(T) + gauss_markov(rng, T, slow))
        seen = np.where(np.arange(T) % every == 0, 0.97 * speed + errors, math.nan)
        given = robot.samples._replace(
            robot=robot.samples.robot._replace(speed_m_s=seen, speed_std_m_s=np.full(T, std))
        )
        for k, among in enumerate((given, robot.samples)):
            e = run(FILTER, among)
            error = np.array([e.x_m[-1], e.y_m[-1], e.yaw_rad[-1]]) - robot.pose[-1]
            off_m[seed, k] = np.hypot(*error[:2])
            if among is given:
                nees[seed] = error @ np.linalg.solve(e.pose_cov[-1], error)
    beside, alone = off_m.mean(axis=0)
    assert beside < 1.1 * alone
    assert nees.mean() < mean_bounds(3, 10, 0.9999)[1]


def integrate_circle(v, w, steps):
    """Pose (3,) after so many steps."""
    middle = (np.arange(steps) + 0.5) * w * DT_S
    return np.array([np.sum(v * DT_S * np.cos(middle)), np.sum(v * DT_S * np.sin(middle)), w * DT_S * steps])


def turning(heading, steps, std=0.05, settings=FILTER, **more):
    """A robot that stands and of which a compass says `heading` (steps,) with this standard deviation."""
    given = {"wheel_speed_rad_s": np.zeros((steps, 2)), "heading_rad": heading, "heading_std_rad": np.full(steps, std)}
    return samples(settings, **(given | more))


@pytest.mark.parametrize(("scale", "radius"), [(0.8, 1.0), (0.9, 1.0), (1.1, 1.0), (1.0, 1.0), (1.0, 1.1)])
def test_outside_speeds_of_another_scale_move_no_robot_and_the_band_holds_another_radius_too(scale, radius):
    rng, time_s = np.random.default_rng(5), DT_S * np.arange(7500)
    speed = 0.5 * np.clip(np.sin(0.3 * time_s) + 0.5, 0.0, 1.0)
    outside = np.where(np.arange(7500) % 5 == 0, scale * speed + 0.03 * rng.standard_normal(7500), math.nan)
    wheels = np.outer(speed / radius / RLMA.wheel.radius_m, np.ones(2))
    given = samples(FILTER, wheel_speed_rad_s=wheels, yaw_rate_rad_s=np.zeros(7500), speed_m_s=outside)
    e = run(replace(FILTER, noise=replace(FILTER.noise, gyro_offset_std_rad_s=0.0, gyro_offset_walk=0.0)), given)
    way_m, std_m = np.sum(speed) * DT_S, math.sqrt(e.pose_cov[-1, 0, 0])
    assert abs(e.x_m[-1] * radius / way_m - 1.0) < 0.02
    assert abs(e.x_m[-1] - way_m) < 3.0 * std_m
    assert std_m / way_m < (0.01 if scale == radius else 0.12)


def test_the_first_heading_is_the_zero_and_the_next_ones_correct_the_joint_gaussian_of_yaw_and_zero():
    """Two headings of a wheels-only robot against the conditional mean and covariance of (yaw, zero)."""
    noise, steps, std, first, second = replace(EXACT, turn_share=0.3, turn_scale_std=0.1), 401, 0.04, 3.0, -2.6
    settings = PoseFilter(RLMA, noise)
    heading = np.full(steps, math.nan)
    heading[0], heading[-1] = first, second  # the shorter way between them is across pi
    wheels = rolling(0.0, 0.1, steps)
    wheels[0] = 0.0
    plain = run(settings, samples(settings, wheel_speed_rad_s=wheels))
    found = run(settings, turning(heading, steps, std, settings, wheel_speed_rad_s=wheels))
    yaw, variance = plain.yaw_rad[-1], plain.pose_cov[-1, 2, 2]
    zero_variance = 1.0 / (1.0 / ANY_HEADING_RAD**2 + 1.0 / std**2)
    zero = zero_variance / std**2 * first
    nu = second + 2 * math.pi - yaw - zero
    gain = variance / (variance + zero_variance + std**2)
    assert variance > 0.001 and not found.flags.any()
    assert found.yaw_rad[-1] == pytest.approx(yaw + gain * nu, abs=1e-9)
    assert found.pose_cov[-1, 2, 2] == pytest.approx((1.0 - gain) * variance, rel=1e-9)
    assert_allclose(found.yaw_rad[:-1], plain.yaw_rad[:-1], atol=1e-12)  # the zero alone is learnt from the first


def test_a_heading_that_its_source_calls_unknown_is_not_used():
    still = turning(np.full(50, math.nan), 50)
    unknown = turning(np.linspace(0.0, 1.0, 50), 50, std=3.0)
    np.testing.assert_array_equal(run(FILTER, unknown).pose_cov, run(FILTER, still).pose_cov)


def test_of_headings_whose_errors_are_alike_one_counts():
    steps = round(HEADING_WAIT * NOISE.correlation_s / DT_S) + 1
    often = run(FILTER, turning(np.full(steps, 1.0), steps))
    ends = np.where(np.isin(np.arange(steps), [0, steps - 1]), 1.0, math.nan)
    seldom = run(FILTER, turning(ends, steps))
    for name in ("yaw_rad", "pose_cov"):
        assert_allclose(getattr(often, name), getattr(seldom, name), atol=1e-15)


def test_a_disturbed_heading_is_flagged_and_moves_nothing_and_a_lasting_one_is_another_zero():
    """Iron turns the compass by a radian for four seconds, and a building for good."""
    steps, time_s = 2000, DT_S * np.arange(2000)
    heading = 0.5 + ((time_s > 10.0) & (time_s < 14.0)) + 1.0 * (time_s > 20.0)
    given = {"yaw_rate_rad_s": np.zeros(steps)}
    e = run(FILTER, turning(heading, steps, **given))
    rejected = (e.flags.astype(int) & OdometryFlag.HEADING_REJECTED) != 0
    during = (time_s > 10.0) & (time_s < 14.0)
    assert rejected[during].mean() > 0.4 and not rejected[time_s < 10.0].any()
    assert rejected[time_s > 20.0].sum() > 5.0 / DT_S and not rejected[time_s > 35.0].any()
    assert np.abs(e.yaw_rad).max() < 0.02


def test_a_heading_keeps_the_yaw_of_a_drive_whose_gyro_turns_by_itself():
    """NEES of the pose over 50 robots drawn from the noise whose gyro was never at rest, with a compass."""
    drives = [drive(FILTER, seed) for seed in range(50)]
    lower, upper = mean_bounds(3, len(drives), 0.999)
    found = []
    for seed, d in enumerate(drives):
        rng, T = np.random.default_rng(1000 + seed), len(d.pose)
        noise = gauss_markov(rng, T, NOISE)
        heading = np.mod(d.pose[:, 2] + rng.uniform(-math.pi, math.pi) + NOISE.heading_std_rad * noise, 2 * math.pi)
        found.append(run(FILTER, d.samples._replace(heading_rad=heading)))
    assert lower < np.mean([nees(e, d.pose, -1) for e, d in zip(found, drives, strict=True)]) < upper
    assert found[0].pose_cov[-1, 2, 2] < run(FILTER, drives[0].samples).pose_cov[-1, 2, 2]


def test_an_increment_that_began_before_what_is_remembered_is_not_used():
    steps = 100
    increment = np.full((steps, 3), math.nan)
    increment[60] = [1.0, 0.0, 0.0]
    e = run(FILTER, samples(
        FILTER, wheel_speed_rad_s=rolling(0.5, 0.0, steps), increment=increment, increment_s=np.full(steps, 1.0),
    ))  # fmt: skip
    assert int(e.flags[60]) == OdometryFlag.INCREMENT_TOO_OLD
    assert e.x_m[-1] == pytest.approx(0.5 * steps * DT_S)


def test_a_wheel_that_spins_does_not_turn_the_robot():
    """One wheel twice as fast for two seconds: the gyro says that the robot goes straight, and its offset stays."""
    steps = 1000
    speeds = rolling(0.3, 0.0, steps)
    speeds[500:600, 0] *= 2.0
    e = run(FILTER, samples(FILTER, wheel_speed_rad_s=speeds, yaw_rate_rad_s=np.full(steps, 0.01)))
    assert e.gyro_offset_rad_s[-1] == pytest.approx(0.01, abs=1e-3)
    assert abs(e.yaw_rad[-1]) < 0.02
    assert (e.flags.astype(int) & OdometryFlag.WHEEL_SLIPS).any()
    assert e.slip_probability[550, 0] > 0.99 and e.slip_probability[550, 1] < 0.01


def test_an_offset_that_has_changed_is_found_at_the_next_rest():
    steps = 2000
    gyro = np.where(np.arange(steps) < 500, 0.01, 0.2)
    e = run(FILTER, samples(FILTER, wheel_speed_rad_s=np.zeros((steps, 2)), yaw_rate_rad_s=gyro))
    assert e.gyro_offset_rad_s[-1] == pytest.approx(0.2, abs=1e-3)


def test_without_wheels_the_band_grows_as_an_unseen_acceleration_makes_it():
    steps = 400
    speeds = rolling(0.5, 0.0, steps)
    speeds[100:] = math.nan
    e = run(FILTER, samples(FILTER, wheel_speed_rad_s=speeds))
    assert int(e.flags[-1]) == OdometryFlag.NO_WHEELS
    assert e.pose_cov[-1, 0, 0] ** 0.5 == pytest.approx(0.25 * 6.0**2, rel=0.05)


@pytest.mark.parametrize("wheels_s", [0.0, 2.0], ids=["never a wheel", "wheels until 2 s"])
def test_without_wheels_an_outside_speed_gives_the_way(wheels_s):
    rng = np.random.default_rng(1)
    time_s = DT_S * np.arange(3000)
    speeds = np.where(time_s[:, None] < wheels_s, rolling(0.5, 0.0, len(time_s)), math.nan)
    speed_m_s = np.where(np.arange(len(time_s)) % 10 == 0, 0.5 + 0.1 * rng.standard_normal(len(time_s)), math.nan)
    e = run(FILTER, samples(FILTER, wheel_speed_rad_s=speeds, yaw_rate_rad_s=0.0 * time_s, speed_m_s=speed_m_s))
    assert int(e.flags[-1]) == OdometryFlag.NO_WHEELS
    assert e.distance_m[-1] == pytest.approx(0.5 * time_s[-1], rel=0.03)
    assert e.twist_cov[-1, 0, 0] ** 0.5 < 0.2


@pytest.mark.parametrize("stuck_m_s, turns", [(0.0, True), (0.5, False)])
def test_a_stuck_outside_speed_is_left_out_and_the_way_restored(stuck_m_s, turns):
    time_s = DT_S * np.arange(3000)
    speed_m_s, turn_rad_s = 0.5 + 0.3 * np.sin(time_s), 0.5 * np.sin(0.7 * time_s) * turns
    speeds = (np.column_stack([speed_m_s, turn_rad_s]) @ RLMA.rolling[:2].T) / RLMA.wheel.radius_m
    outside = np.where(np.arange(3000) % 10 == 0, np.where(time_s < 20.0, speed_m_s, stuck_m_s), math.nan)
    given = samples(FILTER, wheel_speed_rad_s=speeds, yaw_rate_rad_s=turn_rad_s, speed_m_s=outside)
    e, alone = run(FILTER, given), run(FILTER, given._replace(robot=given.robot._replace(speed_m_s=time_s * math.nan)))
    assert e.distance_m[-1] > 0.85 * alone.distance_m[-1]
    assert math.hypot(e.x_m[-1] - alone.x_m[-1], e.y_m[-1] - alone.y_m[-1]) < 0.4
    assert (int(e.flags[2990]) & OdometryFlag.SPEED_REJECTED) and e.stuck_probability[-1] < 0.1


def test_the_way_that_mecanum_rollers_lose_sideways_is_lost_back_again():
    robot, steps = generic_robot(9.0, 0.05, 0.3, layout="mecanum"), 1000
    left_m_s = np.where(np.arange(2 * steps) < steps, 0.5, -0.5)
    speeds = np.column_stack([0.0 * left_m_s, left_m_s, 0.0 * left_m_s]) @ robot.rolling.T / robot.wheel.radius_m
    settings = pose_filter(robot)
    e = run(settings, samples(settings, wheel_speed_rad_s=speeds, yaw_rate_rad_s=0.0 * left_m_s))
    y_std_m = np.sqrt(e.pose_cov[:, 1, 1])
    assert y_std_m[steps - 1] == pytest.approx(settings.noise.roller_slip_std * 0.5 * steps * DT_S, rel=0.15)
    assert y_std_m[-1] < 0.5 * y_std_m[steps - 1]


def test_glitches_of_an_encoder_move_nothing():
    steps = 500
    clean = rolling(0.5, 0.0, steps)
    speeds = clean.copy()
    speeds[25::50, 0] += 40.0
    e = run(FILTER, samples(FILTER, wheel_speed_rad_s=speeds, yaw_rate_rad_s=np.zeros(steps)))
    assert_allclose([e.x_m[-1], e.y_m[-1]], [0.5 * steps * DT_S, 0.0], atol=0.02)
    assert int(np.sum(e.flags.astype(int) & OdometryFlag.WHEEL_JUMP != 0)) == steps // 50


def test_no_sample_makes_the_state_no_number():
    rng = np.random.default_rng(7)
    bad = np.array([math.nan, math.inf, -math.inf, 1e300, -1.0, 0.0, 1e9])
    steps = 3000
    given = samples(FILTER, wheel_speed_rad_s=rolling(0.5, 0.1, steps), yaw_rate_rad_s=np.full(steps, 0.1))

    def noisy(values):
        if isinstance(values, tuple):
            return type(values)(*map(noisy, values))
        values = np.array(values, dtype=float)
        wrong = rng.random(values.shape) < 0.3
        return np.where(wrong, rng.choice(bad, values.shape), values)

    e = run(FILTER, noisy(given))
    assert np.isfinite(e.x_m).all() and np.isfinite(e.pose_cov).all()
    assert (e.position_std_m >= 0).all()


def test_noise_is_checked_and_that_of_a_skid_steered_robot_is_wide():
    with pytest.raises(InputError, match=r"noise\.gyro_walk must be >= 0"):
        OdometryNoise(gyro_walk=-1.0)
    with pytest.raises(InputError, match="increment_walk must have 3 values"):
        OdometryNoise(increment_walk=(0.1, 0.1))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="late_steps"):
        PoseFilter(RLMA, OdometryNoise(), late_steps=-1)
    with pytest.raises(InputError, match=r"noise\.scrub must be"):
        OdometryNoise(scrub=1.5)
    scrubbing = replace(RLMA, chassis=SkidSteer(0.3, 0.3, 0.3))
    assert noise_of(scrubbing).turn_scale_std >= 5 * noise_of(RLMA).turn_scale_std


@pytest.mark.parametrize("effective_track_m, turns", [(None, 1.0 / 1.5), (0.57, 0.3 / 0.57)])
def test_without_a_gyro_a_skid_steered_robot_turns_as_its_effective_track_or_a_usual_one_says(effective_track_m, turns):
    chassis = SkidSteer(0.3, 0.3, 0.3, effective_track_m)
    settings, steps, turn = pose_filter(replace(RLMA, chassis=chassis)), 500, 0.4
    rims_m_s = np.array([0.5, 0.0, turn]) @ settings.robot.rolling.T
    given = samples(settings, wheel_speed_rad_s=np.tile(rims_m_s / RLMA.wheel.radius_m, (steps, 1)))
    e = run(settings, given)
    assert e.yaw_rad[-1] == pytest.approx(turns * turn * steps * DT_S)
    known_std = np.sqrt(e.pose_cov[-1, 2, 2]) / (turn * steps * DT_S)
    assert known_std < 0.2 if effective_track_m else 0.15 < known_std < 0.3


def test_a_car_that_never_rests_learns_the_offset_of_a_gyro_that_warms_up():
    """Curves of both sides at two speeds tell the offset from the zero of the steering angle."""
    car = generic_robot(20.0, 0.06, 0.3, 0.4, layout="car")
    settings, t = pose_filter(car), DT_S * np.arange(10000)
    speed, turn = 0.6 + 0.3 * np.sign(np.sin(0.31 * t)), 0.3 * np.sign(np.sin(0.17 * t))
    offset = 0.02 * (1.0 - np.exp(-t / 60.0))
    wheels = np.column_stack([speed, turn]) @ car.rolling[:2].T / car.wheel.radius_m
    given = samples(settings, wheel_speed_rad_s=wheels, yaw_rate_rad_s=turn + offset)
    e = run(settings, given)
    apart_rad = e.yaw_rad - np.cumsum(turn) * DT_S
    assert np.all(np.abs(apart_rad) < 3.0 * np.sqrt(e.pose_cov[:, 2, 2]))
    assert e.gyro_offset_rad_s[-1] == pytest.approx(offset[-1], abs=0.004)


@pytest.mark.parametrize(("usual_s", "opens"), [(DT_S, True), (5.0, False)], ids=["a gap", "slow sensors"])
def test_the_way_of_a_robot_that_stands_at_both_ends_of_a_gap_is_unknown(usual_s, opens):
    """In ten seconds it may have sped up and braked again, unless its sensors are always so slow."""
    dt_s = np.array([*[usual_s] * 100, 10.0])
    found = run(FILTER, samples(FILTER, dt_s=dt_s, wheel_speed_rad_s=np.zeros((101, 2)), yaw_rate_rad_s=np.zeros(101)))
    assert found.position_std_m[-2] < 0.1
    assert (found.position_std_m[-1] > 5.0) == opens
