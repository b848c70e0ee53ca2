"""Counts against a gyro: what is learnt, what is not, and poses of robots that stop and go."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ohmward.filters import kalman
from ohmward.filters.belief import Belief, pack, unpack
from ohmward.filters.consistency import mean_bounds
from ohmward.trace import Kernel
from ohmward.traction import RLMA
from ohmward.traction.odometry.corrections import COMPARED_S
from ohmward.traction.odometry.estimator import Odometry
from ohmward.traction.odometry.measured_motion import turn_per_slip, turn_std
from ohmward.traction.odometry.model import (
    AHEAD,
    APART,
    CURVATURE,
    DELAY,
    GYRO_SCALE,
    NAMES,
    OFFSET,
    RADIUS,
    TURN_SCALE,
    OdometryNoise,
)
from ohmward.traction.odometry.pose_filter import ANY_STD, CONSTANT_ERRORS, PoseFilter, pose_filter, with_wider_prior
from ohmward.traction.odometry.sample import OdometryFlag
from ohmward.traction.robot.packaged import generic_robot
from traction.odometry.examples import DT_S, INDOOR, TRACK_M, integrate, samples, scan, stop_and_go

FILTER = PoseFilter(RLMA, OdometryNoise())  # rims without creep


@pytest.mark.parametrize(
    ("counts", "late_s", "every"), [(4096, 0.0, 1), (1024, 0.0, 1), (4096, 0.1, 1), (4096, 0.0, 10)]
)
def test_stop_and_go_is_as_good_as_the_gyro_less_its_mean_at_rest_and_its_band_is_true(counts, late_s, every):
    """Thirty robots by 4096 and by 1024 counts, with a gyro that is 100 ms late, and at 5 Hz."""
    settings, step_s = pose_filter(INDOOR), every * DT_S
    errors, plain, nees = [], [], []
    for seed in range(30):
        drive = stop_and_go(seed, counts, late_s, every)
        given = {"wheel_speed_rad_s": drive.wheel_speed_rad_s, "yaw_rate_rad_s": drive.gyro_rad_s}
        _, e = scan(settings, samples(settings, dt_s=np.full(len(drive.pose), step_s), **given))
        error = np.array([e.x_m[-1], e.y_m[-1], e.yaw_rad[-1]]) - drive.pose[-1]
        yaw = np.cumsum(drive.gyro_rad_s - drive.gyro_rad_s[: int(3.0 / step_s)].mean()) * step_s
        way = drive.wheel_speed_rad_s.mean(axis=1) * INDOOR.wheel.radius_m * step_s
        middle = yaw - np.diff(yaw, prepend=0.0) / 2
        reckoned = np.array([way @ np.cos(middle), way @ np.sin(middle)])
        errors.append(np.hypot(*error[:2]))
        plain.append(np.hypot(*(reckoned - drive.pose[-1, :2])))
        nees.append(error @ np.linalg.solve(e.pose_cov[-1], error))
    assert np.mean(errors) < 1.1 * np.mean(plain)
    lower, upper = mean_bounds(3, len(nees), 0.9999)
    assert lower / 2 < np.mean(nees) < upper


def test_no_scale_is_learnt_at_rest_or_straight_on():
    """Ten minutes of noise at rest, and as much of a drive straight on, by counts: scales are as they were."""
    rng = np.random.default_rng(3)
    steps = 30_000
    count = 2 * math.pi / 1024
    way = np.floor(np.cumsum(np.full(steps, 3.0 * DT_S))[:, None] / count + rng.random(2)) * count
    speeds = np.diff(way, axis=0, prepend=way[:1]) / DT_S
    gyro = 0.01 + 0.005 * rng.standard_normal(steps)
    for wheels in (np.zeros((steps, 2)), speeds):
        state, _ = scan(FILTER, samples(FILTER, wheel_speed_rad_s=wheels, yaw_rate_rad_s=gyro))
        mean, cov = unpack(state.belief)
        assert mean[RADIUS] == 0.0
        for scale in (GYRO_SCALE, TURN_SCALE):
            assert abs(mean[scale]) < 0.5 * math.sqrt(cov[scale, scale])
        assert abs(mean[CURVATURE]) < 3 * math.sqrt(cov[CURVATURE, CURVATURE]) + 1e-9


def test_no_scale_is_learnt_from_the_turn_that_unequal_wheels_show_straight_on():
    """Five minutes straight on, at 200 Hz, with wheels that differ by one standard deviation and a cheap gyro."""
    steps, dt_s, noise = 60_000, 0.005, FILTER.noise
    rng = np.random.default_rng(1)
    motion = [0.5, 0.5 * noise.wheel_difference_std * turn_per_slip(RLMA)]
    count = 2 * math.pi / 2000
    angle = dt_s * np.arange(steps + 1)[:, None] * (RLMA.rolling[: RLMA.driven] @ motion / RLMA.wheel.radius_m)
    wheels = np.diff(np.floor(angle / count + rng.random(2)), axis=0) * count / dt_s
    gyro = 0.004 * rng.standard_normal(steps)
    given = samples(FILTER, wheel_speed_rad_s=wheels, yaw_rate_rad_s=gyro, dt_s=np.full(steps, dt_s))
    state, _ = scan(FILTER, given)
    mean, cov = unpack(state.belief)
    assert abs(mean[TURN_SCALE]) < 0.1 * math.sqrt(cov[TURN_SCALE, TURN_SCALE])


def test_what_the_wheels_show_of_a_turn_is_shared_between_track_and_gyro():
    """Turns without slip by exact wheels: k_w = -0.01 is the gyro's half of it where both may err alike."""
    noise = replace(
        OdometryNoise(), turn_share=0.0, turn_scale_std=0.01, gyro_offset_std_rad_s=1e-6, encoder_std_rad=1e-6
    )
    settings, time_s = PoseFilter(RLMA, noise), DT_S * np.arange(4000)
    turn = 0.6 * np.sin(0.05 * time_s)
    wheels = np.column_stack([np.full(4000, 0.5), turn]) @ RLMA.rolling[:2].T / RLMA.wheel.radius_m
    state, _ = scan(settings, samples(settings, wheel_speed_rad_s=wheels, yaw_rate_rad_s=0.99 * turn))
    mean, cov = unpack(state.belief)
    assert mean[TURN_SCALE] == pytest.approx(-0.01, abs=5e-4)
    assert mean[GYRO_SCALE] == pytest.approx(0.005, abs=5e-4)
    assert math.sqrt(cov[GYRO_SCALE, GYRO_SCALE]) == pytest.approx(0.01 / math.sqrt(2), rel=0.05)


def test_wheels_alone_are_plain_odometry():
    rng = np.random.default_rng(2)
    motion = np.cumsum(0.05 * rng.standard_normal((500, 2)), axis=0)
    speeds = motion @ RLMA.rolling[:2].T / RLMA.wheel.radius_m
    _, e = scan(FILTER, samples(FILTER, wheel_speed_rad_s=speeds))
    plain = integrate(motion[:, 0], np.zeros(500), motion[:, 1])
    assert_allclose(np.column_stack([e.x_m, e.y_m, e.yaw_rad]), plain, atol=1e-9)


@pytest.mark.parametrize("gyro", [True, False])
def test_counts_of_rows_that_come_late_or_are_lost_keep_their_way(gyro):
    """Of the counts of a robot that speeds up and slows down, one row in three is missing: no way is."""
    rng = np.random.default_rng(5)
    steps, count = 600, 2 * math.pi / 1024
    angle = np.floor(np.cumsum(3.0 * DT_S * (1 + np.sin(DT_S * np.arange(steps)))) / count) * count
    known = np.flatnonzero((np.arange(steps) < 10) | (rng.random(steps) < 2 / 3) | (np.arange(steps) == steps - 1))
    speeds = np.full((steps, 2), np.nan)
    speeds[known[1:]] = (np.diff(angle[known]) / np.diff(known) / DT_S)[:, None]
    given = {"wheel_speed_rad_s": speeds} | ({"yaw_rate_rad_s": np.zeros(steps)} if gyro else {})
    _, e = scan(FILTER, samples(FILTER, **given))
    assert e.x_m[-1] == pytest.approx(RLMA.wheel.radius_m * (angle[-1] - angle[0]), rel=1e-9)


def test_an_offset_that_drifts_as_the_gyro_warms_up_is_tracked_and_covered():
    """By 0.02 rad/s, with a time constant of 50 s, in drives of two minutes."""
    settings, nees, offsets = pose_filter(INDOOR), [], []
    for seed in range(12):
        drive = stop_and_go(seed, 4096)
        drift = 0.02 * (1.0 - np.exp(-DT_S * np.arange(len(drive.gyro_rad_s)) / 50.0)) * (-1) ** seed
        given = {"wheel_speed_rad_s": drive.wheel_speed_rad_s, "yaw_rate_rad_s": drive.gyro_rad_s + drift}
        _, e = scan(settings, samples(settings, **given))
        error = np.array([e.x_m[-1], e.y_m[-1], e.yaw_rad[-1]]) - drive.pose[-1]
        nees.append(error @ np.linalg.solve(e.pose_cov[-1], error))
        offsets.append((e.gyro_offset_rad_s[-1] - drive.offset_rad_s - drift[-1]) / e.gyro_offset_std_rad_s[-1])
    assert np.mean(nees) < mean_bounds(3, len(nees), 0.9999)[1]
    assert np.max(np.abs(offsets)) < 3.0


@pytest.mark.parametrize("fault", ["gyro at zero for a while", "wheels unlike by 2 %", "turned by hand"])
def test_the_yaw_stays_in_its_band(fault):
    settings, apart = pose_filter(INDOOR), []
    for seed in range(6):
        drive = stop_and_go(seed, 4096)
        wheels, gyro, yaw = np.array(drive.wheel_speed_rad_s), np.array(drive.gyro_rad_s), drive.pose[:, 2]
        t = DT_S * np.arange(len(gyro))
        if fault == "gyro at zero for a while":
            gyro[(t > 40.0) & (t < 47.0)] = 0.0
        elif fault == "turned by hand":
            turned = np.where((t > 40.0) & (t < 50.0), 0.05, 0.0)
            wheels, gyro = np.zeros_like(wheels), turned + gyro - np.diff(yaw, prepend=0.0) / DT_S
            yaw = np.clip(t - 40.0, 0.0, 10.0) * 0.05
        else:
            wheels[:, 0] /= 1.02
        _, e = scan(settings, samples(settings, wheel_speed_rad_s=wheels, yaw_rate_rad_s=gyro))
        apart.append((e.yaw_rad[-1] - yaw[-1]) / np.sqrt(e.pose_cov[-1, 2, 2]))
    assert np.sqrt(np.mean(np.square(apart))) < 2.0


def test_noise_of_wheel_speeds_is_learnt_beside_counts():
    """White noise of speeds without counts: its variance over time is s^2 dt for each side, that of counts is none."""
    rng, steps, std_rad_s = np.random.default_rng(6), 15_000, 0.05
    turn = 0.4 * np.sin(0.2 * DT_S * np.arange(steps))
    wheels = np.column_stack([np.full(steps, 0.5), turn]) @ RLMA.rolling[:2].T / RLMA.wheel.radius_m
    noisy = wheels + std_rad_s * rng.standard_normal(wheels.shape)
    state, e = scan(FILTER, samples(FILTER, wheel_speed_rad_s=noisy, yaw_rate_rad_s=turn + 0.01))
    expected = (turn_per_slip(RLMA) * RLMA.wheel.radius_m * std_rad_s) ** 2 * DT_S
    assert expected < state.sums.differences.wheels_variance < 2.0 * expected
    assert abs(e.gyro_offset_rad_s[-1] - 0.01) < 3.0 * e.gyro_offset_std_rad_s[-1]


@pytest.mark.parametrize("counts", [60, 1024])
def test_a_count_is_seen_where_steps_differ_by_it(counts):
    drive = stop_and_go(1, counts, seconds=30.0)
    given = {"wheel_speed_rad_s": drive.wheel_speed_rad_s, "yaw_rate_rad_s": drive.gyro_rad_s}
    state, _ = scan(pose_filter(INDOOR), samples(pose_filter(INDOOR), **given))
    assert state.motion.encoder.least_rad == pytest.approx(2 * math.pi / counts, rel=1e-6)


def test_an_angle_between_wheels_and_gyro_stays_within_a_count():
    drive = stop_and_go(2, 1024)
    given = {"wheel_speed_rad_s": drive.wheel_speed_rad_s, "yaw_rate_rad_s": drive.gyro_rad_s}
    state, _ = scan(pose_filter(INDOOR), samples(pose_filter(INDOOR), **given))
    mean, cov = unpack(state.belief)
    count_m = 2 * math.pi / 1024 * INDOOR.wheel.radius_m
    assert len(mean) == len(NAMES)
    assert abs(mean[APART]) < 2 * count_m / TRACK_M
    assert math.sqrt(cov[APART, APART]) < count_m / TRACK_M


@pytest.mark.parametrize("scale_std", [0.02, 0.25])
def test_a_yaw_that_is_unsure_shortens_the_way_and_bends_it(scale_std):
    """After a turn of a gyro whose scale is unsure and no track shows, straight on: moments of cos e and sin e."""
    noise = OdometryNoise(
        gyro_offset_std_rad_s=0.0, gyro_offset_walk=0.0, gyro_walk=1e-9, gyro_delay_std_s=0.0, wheels_ahead_std_s=0.0,
        radius_std=0.0, slip_share=0.0, side_slip_share=0.0, side_arm_std_m=0.0, gyro_scale_std=scale_std,
        turn_scale_std=10.0,
    )  # fmt: skip
    settings = PoseFilter(RLMA, noise)
    steps, turn = 1500, 2 * math.pi
    rate = np.where(np.arange(steps) < 500, turn / (500 * DT_S), 0.0)
    speed = np.where(np.arange(steps) < 500, 0.0, 0.5)
    wheels = np.column_stack([speed, rate]) @ RLMA.rolling[:2].T / RLMA.wheel.radius_m
    _, e = scan(settings, samples(settings, wheel_speed_rad_s=wheels, yaw_rate_rad_s=rate))
    s, way_m = scale_std * turn, 0.5 * 1000 * DT_S
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    errors = np.array([way_m * (1 - np.cos(s * nodes)), way_m * np.sin(s * nodes), s * nodes])
    moments = errors * weights @ errors.T / math.sqrt(2 * math.pi)
    assert_allclose(np.diag(e.pose_cov[-1]), np.diag(moments), rtol=0.04)
    assert e.pose_cov[-1, 1, 2] == pytest.approx(moments[1, 2], rel=0.02)


@pytest.mark.parametrize(
    "fault", ["zero from the start", "0.02 from the start", "zero after 40 s", "frozen after 40 s"]
)
def test_the_turn_that_a_dead_gyro_missed_is_the_wheels_and_covered_before_it_is_found(fault):
    """Ten robots; the wheels alone are as far off, and the band is theirs."""
    settings, missed, wheels = pose_filter(INDOOR), [], []
    for seed in range(10):
        drive = stop_and_go(seed, 4096)
        dies = 0 if "start" in fault else round(40.0 / DT_S)
        value = {"z": 0.0, "0": 0.02, "f": drive.gyro_rad_s[dies]}[fault[0]]
        gyro = np.where(np.arange(len(drive.gyro_rad_s)) < dies, drive.gyro_rad_s, value)
        silent = np.where(np.arange(len(gyro)) < dies, gyro, np.nan)
        given = (samples(settings, wheel_speed_rad_s=drive.wheel_speed_rad_s, yaw_rate_rad_s=g) for g in (gyro, silent))
        e, alone = (scan(settings, of)[1] for of in given)
        sigmas = np.abs(e.yaw_rad - drive.pose[:, 2]) / np.sqrt(e.pose_cov[:, 2, 2])
        assert np.mean(sigmas < 3.0) > 0.85
        assert sigmas[-1] < 3.0
        missed.append(e.yaw_rad[-1] - drive.pose[-1, 2])
        wheels.append(alone.yaw_rad[-1] - drive.pose[-1, 2])
    assert np.mean(np.abs(missed)) < np.mean(np.abs(wheels)) + 0.1


def test_noise_of_a_gyro_at_rest_is_no_turn_that_it_reports_late():
    """A sawtooth about the offset, one for each comparison, where wheels and gyro are known to be 0.1 s apart."""
    settings = replace(FILTER, noise=replace(FILTER.noise, encoder_std_rad=1e-9))
    start = settings.init(settings.no_sample())
    mean, cov = unpack(start.belief)
    mean[AHEAD] = 0.1
    cov[DELAY, DELAY] = cov[AHEAD, AHEAD] = 0.0
    period = round(COMPARED_S / DT_S)
    gyro = 0.005 + 0.01 * (np.tile(np.arange(period), 30) / (period - 1) - 0.5)
    given = samples(settings, wheel_speed_rad_s=np.zeros((len(gyro), 2)), yaw_rate_rad_s=gyro)
    kernel = Kernel(settings.step, start, settings.no_sample())
    state, _ = kernel.scan(start._replace(belief=pack(Belief(mean, cov))), given)
    assert_allclose(unpack(state.belief).mean[OFFSET], 0.005, atol=1e-4)


def test_slip_in_turns_makes_them_smaller_to_both_sides():
    """Its error changes sign with the turn; that of wheels which slip unequally on a straight way does not."""
    noise = OdometryNoise()
    left, right = (float(turn_std(0.5, turn, INDOOR, noise)) for turn in (0.8, -0.8))
    assert left == -right and left == pytest.approx(noise.turn_share * 0.8, rel=1e-3)
    straight = noise.slip_difference_share * turn_per_slip(INDOOR) * 0.5
    assert float(turn_std(0.5, 0.0, INDOOR, noise)) == pytest.approx(straight)


def test_coarse_counts_at_a_high_rate_are_no_jumps():
    """150 counts at 200 Hz: one count more changes the speed of a mecanum wheel's rim by 0.45 m/s."""
    robot, rng = generic_robot(9.0, 0.0762, 0.36, layout="mecanum"), np.random.default_rng(0)
    dt_s, count = 0.005, 2 * math.pi / 150
    way_m = np.cumsum(0.25 + 0.1 * np.sin(dt_s * np.arange(4001))) * dt_s
    angles = way_m[:, None] * robot.rolling[:, 0] / robot.wheel.radius_m + rng.random(4) * count
    speeds = np.diff(count * np.floor(angles / count), axis=0) / dt_s
    settings = PoseFilter(robot, OdometryNoise())
    e = scan(settings, samples(settings, wheel_speed_rad_s=speeds, dt_s=np.full(4000, dt_s)))[1]
    assert e.x_m[-1] == pytest.approx(way_m[-1] - way_m[0], rel=0.01)
    assert not (e.flags.astype(int) & OdometryFlag.WHEEL_JUMP).any()


def test_unequal_wheels_turn_a_robot_that_scrubs_no_farther_than_its_other_turns():
    """After a rest it makes a tenth of the turns of its wheels, and of the one by which they differ straight on."""
    share, offset, steps = 0.1, 0.005, round(30.0 / DT_S)
    speed, turn = np.repeat([[0.0, 0.5, 0.5, 0.5], [0.0, 0.0, 0.5, 0.0]], steps, axis=1)
    rims_m_s = np.column_stack([speed, turn + 0.006 * speed]) @ RLMA.rolling[: RLMA.driven].T
    wheels = rims_m_s / RLMA.wheel.radius_m
    _, e = scan(FILTER, samples(FILTER, wheel_speed_rad_s=wheels, yaw_rate_rad_s=share * turn + offset))
    assert_allclose(e.gyro_offset_rad_s[-1], offset, atol=3e-4)
    assert_allclose(e.yaw_rad[-1], share * np.sum(turn) * DT_S, atol=0.03)


def test_the_position_is_that_of_the_middle_of_the_driven_axle():
    odometry, turn_rad_s = Odometry(INDOOR), 0.5
    rim_rad_s = 0.5 * TRACK_M * turn_rad_s / INDOOR.wheel.radius_m
    for k in range(500):
        pose = odometry.update(0.02 * k, wheel_speed_rad_s=[-rim_rad_s, rim_rad_s])
    assert pose.yaw_rad == pytest.approx(0.02 * 499 * turn_rad_s, rel=0.01)
    assert (pose.x_m, pose.y_m) == pytest.approx((0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("e", CONSTANT_ERRORS, ids=["unlike wheels", "track", "outside speeds"])
def test_a_wider_prior_is_as_if_from_the_start(e):
    """Of a constant error, whatever has been measured of it together with the others and the pose."""
    rng, std, n = np.random.default_rng(7), 0.002, len(NAMES)
    errors = np.flatnonzero(e)
    parts = np.eye(n)
    parts[errors[0], errors[1:]] = -1.0  # the first of them is their sum less the others

    def measured(std):
        variances = np.ones(n)
        variances[errors[0]] = std**2
        prior = Belief(np.zeros(n), parts @ np.diag(variances) @ parts.T)
        return kalman.correct(prior, np.array([5.0, 6.0, 4.0]), H, 0.01 * np.eye(3)).belief

    H = 0.1 * rng.standard_normal((3, n))
    H[:, errors] = 500.0
    found, wider = with_wider_prior(measured(std), e, std)
    expected = measured(2.0 * std)
    assert wider == 2.0 * std
    assert_allclose(found.mean, expected.mean, atol=1e-9)
    assert_allclose(found.cov, expected.cov, atol=1e-9)


def test_a_prior_is_no_wider_once_its_error_has_been_opened():
    opened = Belief(np.full(len(NAMES), 0.5), np.diag(np.full(len(NAMES), 0.1)))
    found, std = with_wider_prior(opened, CONSTANT_ERRORS[1], 0.03)
    assert std == ANY_STD and np.array_equal(found.mean, opened.mean) and np.array_equal(found.cov, opened.cov)


@pytest.mark.parametrize("share", [0.7, 1.3])
def test_a_track_that_is_further_off_than_usual_turns_no_robot(share):
    """One that turns to the left alone, so that the gyro's offset and the track share what they differ by."""
    offset, time_s = 0.01, DT_S * np.arange(round(100.0 / DT_S))
    speed = np.where(time_s > 1.0, 0.5, 0.0)
    turn = np.where((time_s > 1.0) & (np.sin(0.4 * time_s) > 0.3), 0.6, 0.0)
    wheels = np.column_stack([speed, share * turn]) @ INDOOR.rolling[: INDOOR.driven].T / INDOOR.wheel.radius_m
    gyro = turn + offset + 0.004 * np.random.default_rng(0).standard_normal(turn.size)
    settings = pose_filter(INDOOR)
    _, e = scan(settings, samples(settings, wheel_speed_rad_s=wheels, yaw_rate_rad_s=gyro))
    assert abs(e.yaw_rad[-1] - np.sum(turn) * DT_S) < 0.4 * np.sqrt(e.pose_cov[-1, 2, 2])
