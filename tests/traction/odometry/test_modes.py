"""Which wheels roll: modes in closed form, and drives in which wheels spin."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2, norm

from ohmward.filters.belief import Belief
from ohmward.trace import Kernel
from ohmward.traction import RLMA, ROBOTINO
from ohmward.traction.motion.outside_speed import OutsideSpeed
from ohmward.traction.odometry.corrections import OVERRUN_S, Overrun, Unconfirmed, confirm, run_over
from ohmward.traction.odometry.model import NAMES, SLIP, OdometryNoise
from ohmward.traction.odometry.modes import (
    EVIDENCE_S,
    LOOSE_SIGMAS,
    MET_S,
    ROLLING_M_S,
    SLIP_LASTS_S,
    SLIPPING_M_S,
    ModeState,
    Turning,
    first_modes,
    lever_m,
    mixed,
    slip_modes,
    weigh,
)
from ohmward.traction.odometry.pose_filter import PoseFilter, with_rims_alone
from ohmward.traction.odometry.sample import OdometryFlag
from ohmward.traction.robot.chassis import Differential
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.robot.robot import GRAVITY
from traction.odometry.examples import DT_S, INDOOR, TRACK_M, one_side_spins, samples, scan, stop_and_go

FILTER = PoseFilter(RLMA, OdometryNoise())  # rims without creep
NOISE = OdometryNoise(turn_share=0.0, gyro_delay_std_s=0.0, wheels_ahead_std_s=0.0)
HALF_TRACK_M = float(RLMA.rolling[1, 1])
STILL = Turning(0.0, True, 0.0, 0.0)
HEARD = np.zeros(3, dtype=bool)


def step(before, rims, turning=STILL, since=0.02, robot=RLMA):
    rims = np.array(rims)
    return weigh(before, rims, np.mean(rims), HEARD[: len(rims)], turning, True, since, 0.0, robot, NOISE)


def at(speed, robot=RLMA):
    """State of a robot that has gone at this speed for long."""
    return first_modes(robot)._replace(forward_m_s=np.full(robot.driven, speed), followed_m_s=speed)


@cache
def kernel_with_modes(settings):
    nothing = settings.no_sample()

    def both(state, sample):
        after, estimate = settings.step(state, sample)
        return after, (estimate, after.motion.modes.probability)

    return Kernel(both, settings.init(nothing), nothing, lowering="machine")


def run(settings, given):
    """Estimates (T, ...), and the probabilities (T, modes)."""
    return kernel_with_modes(settings).scan(settings.init(settings.no_sample()), given)[1]


def rims(*speeds_m_s):
    """Wheel speeds (T, 2) of rims with these speeds (T,)."""
    return np.column_stack(speeds_m_s) / RLMA.wheel.radius_m


def test_every_wheel_and_every_side_can_slip_where_no_wheel_rolls_sideways():
    assert slip_modes(RLMA) == [(0,), (1,)]
    four = replace(RLMA, chassis=Differential(0.3, 0.3, 0.3, driven="all"))
    assert slip_modes(four) == [(0,), (1,), (2,), (3,), (0, 2), (1, 3)]
    assert slip_modes(load_robot("husky")) == slip_modes(four)  # it slides sideways, and no rim shows that
    assert slip_modes(ROBOTINO) == []


def test_wheels_that_roll_on_a_curve_show_their_mean_and_slip_no_more_than_before():
    turn = 0.8
    rolling = [0.5 - HALF_TRACK_M * turn, 0.5 + HALF_TRACK_M * turn]
    after, speed = step(at(0.5), rolling, Turning(turn, True, 0.0, 0.0))
    assert speed.forward_m_s == pytest.approx(0.5, abs=1e-12)
    assert speed.std_m_s == pytest.approx(0.0, abs=1e-7)
    assert (after.probability[1:] <= first_modes(RLMA).probability[1:]).all()


def test_wheels_that_turn_the_robot_by_another_share_show_their_mean_too():
    turn, scale = 0.8, -0.2
    rolling = [0.5 - HALF_TRACK_M * turn / (1 + scale), 0.5 + HALF_TRACK_M * turn / (1 + scale)]
    _, speed = step(at(0.5), rolling, Turning(turn, True, scale, 0.0))
    assert speed.forward_m_s == pytest.approx(0.5, abs=1e-12)


def test_the_probabilities_are_those_of_bayes():
    """Left rim at 0.7, right one at 0.52 m/s after both at 0.5: densities written out, for a tenth of a second."""
    left, right, before = 0.7, 0.52, 0.5
    after, speed = step(at(before), [left, right], since=EVIDENCE_S)
    mean = (left + right) / 2
    sigma2 = ROLLING_M_S**2 + (0.02 * before) ** 2
    s2 = sigma2 + SLIPPING_M_S**2 + (0.3 * before) ** 2
    q = (mean - before) ** 2
    roll = math.exp(-0.5 * min(((left - mean) ** 2 + (right - mean) ** 2) / sigma2, 25.0) - 0.5) / math.sqrt(sigma2)
    slips = [
        math.exp(-0.5 * min((v - before) ** 2 / q, 25.0)) / math.sqrt(s2 + (left - right) ** 2) for v in (right, left)
    ]
    likely = mixed(first_modes(RLMA).probability, EVIDENCE_S) * np.array([roll, *slips])
    assert_allclose(after.probability, likely / likely.sum(), rtol=1e-9)
    assert speed.forward_m_s == pytest.approx(after.probability @ np.array([mean, right, left]))


def test_modes_begin_and_end_as_their_times_say():
    prior = first_modes(RLMA).probability
    assert prior.sum() == pytest.approx(1.0)
    assert_allclose(prior[1:], SLIP_LASTS_S / MET_S)
    slips = mixed(np.array([0.0, 1.0, 0.0]), 0.5)
    assert_allclose(slips, [1 - math.exp(-0.5 / SLIP_LASTS_S), math.exp(-0.5 / SLIP_LASTS_S), 0.0], atol=1e-12)


def test_wheels_that_all_run_away_are_followed_as_fast_as_friction_can():
    after, speed = step(at(0.5), [4.5, 4.5])
    assert after.followed_m_s == pytest.approx(0.5 + GRAVITY * 0.02)
    loose = LOOSE_SIGMAS * math.hypot(ROLLING_M_S, 0.02 * 0.5)
    assert speed.forward_m_s == pytest.approx(after.followed_m_s + loose)
    assert speed.std_m_s == pytest.approx(4.5 - 0.5)  # what the rims have gained
    assert step(at(0.5), [4.5, 4.5], since=1e9)[1].std_m_s == pytest.approx(0.0, abs=1e-7)  # the first are believed


def test_without_a_gyro_and_in_a_gap_nothing_is_evidence():
    before = at(0.5)
    seen = before, np.array([2.0, 0.5]), 1.25, HEARD[:2]
    silent = weigh(*seen, STILL._replace(holds=False), True, 0.02, 0.0, RLMA, NOISE)[0]
    held = weigh(*seen, STILL, False, 0.02, 0.0, RLMA, NOISE)[0]
    late = weigh(*seen, STILL, True, 3.0, 0.0, RLMA, NOISE)[0]
    for after in (silent, held, late):
        assert_allclose(after.probability, before.probability, atol=1e-6)


def test_a_slip_is_over_after_a_while_without_a_gyro():
    state = at(0.5)._replace(probability=np.array([0.0, 1.0, 0.0]))
    silent = STILL._replace(holds=False)
    for _ in range(500):
        state, _ = weigh(state, np.full(2, 0.5), 0.5, HEARD[:2], silent, True, 0.02, 0.0, RLMA, NOISE)
    assert_allclose(state.probability, at(0.5).probability, atol=0.01)


def test_wheels_that_roll_sideways_too_count_alike():
    _, speed = step(ModeState(np.ones(1), np.zeros(3), 0.0, 0.2), [0.1, 0.3, 0.2], robot=ROBOTINO)
    assert speed.forward_m_s == pytest.approx(0.2)


@pytest.mark.parametrize(("every", "counts"), [(1, 4096), (1, 512), (10, 4096)])
def test_no_drive_without_slip_makes_slip_more_likely_than_before(every, counts):
    """Stop and go on floors that change: for no longer than a second in any of ten drives."""
    settings, prior = PoseFilter(INDOOR, OdometryNoise()), 2 * SLIP_LASTS_S / MET_S
    for seed in range(10):
        drive = stop_and_go(seed, counts, every=every)
        given = {"wheel_speed_rad_s": drive.wheel_speed_rad_s, "yaw_rate_rad_s": drive.gyro_rad_s}
        _, modes = run(settings, samples(settings, dt_s=np.full(len(drive.pose), every * DT_S), **given))
        more = np.concatenate([[0], 1.0 - modes[:, 0] > prior, [0]]).astype(int)
        begins, ends = np.flatnonzero(np.diff(more) > 0), np.flatnonzero(np.diff(more) < 0)
        assert ((ends - begins) * every * DT_S < 1.0).all()


@pytest.mark.parametrize(("ramp_s", "counts", "within_s"), [(0.5, 4096, 0.5), (0.1, 4096, 0.25), (0.5, 512, 0.6)])
@pytest.mark.parametrize("side", [0, 1])
def test_the_wheel_that_spins_is_named_and_the_speed_is_that_of_the_other(ramp_s, counts, within_s, side):
    """A wheel of a robot on a curve gains 0.33 m/s for six seconds; its rims are read by counts."""
    settings, found = PoseFilter(INDOOR, OdometryNoise()), []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        time_s = DT_S * np.arange(1500)
        v = np.clip(0.5 * (time_s - 3.0), 0.0, 0.8)
        w = 0.4 * np.sin(0.3 * time_s + seed) * (v > 0)
        spin = 0.33 * np.clip(np.minimum(time_s - 15.0, 21.0 - time_s) / ramp_s, 0.0, 1.0)
        edges = np.column_stack([v - TRACK_M / 2 * w, v + TRACK_M / 2 * w])
        edges[:, side] += spin
        count = 2 * math.pi / counts
        angle = np.floor(np.cumsum(edges * DT_S, axis=0) / INDOOR.wheel.radius_m / count + rng.random(2)) * count
        speeds = np.diff(angle, axis=0, prepend=angle[:1]) / DT_S
        gyro = w + 0.01 + 0.002 * rng.standard_normal(len(w))
        e, modes = run(settings, samples(settings, wheel_speed_rad_s=speeds, yaw_rate_rad_s=gyro))
        during = (time_s > 15.0) & (time_s < 21.0)
        named = np.flatnonzero(modes[during][:, 1 + side] > 0.5)
        assert named[0] * DT_S < within_s
        assert modes[during][:, 2 - side].max() < 0.5
        inside = np.abs(e.speed_m_s - v) < 1.96 * np.sqrt(e.twist_cov[:, 0, 0])
        found.append(inside[during].mean())
        assert abs(e.gyro_offset_rad_s[-1] - 0.01) < 1.5e-3
    assert np.mean(found) > 0.95


def test_one_wheel_that_spins_up_slowly_neither_moves_nor_turns_the_robot():
    """The left wheel gains 4 m/s in two seconds, 2 m/s^2 each: no jump, and plain wheel odometry is 4 m wrong."""
    time_s = DT_S * np.arange(1000)
    right = 0.5 + 1e-4 * np.sin(5.0 * time_s)  # an encoder that repeats itself has stopped
    left = 0.5 + np.where((time_s >= 5) & (time_s < 9), 2.0 * (2.0 - abs(time_s - 7.0)), 0.0)
    _, e = scan(FILTER, samples(FILTER, wheel_speed_rad_s=rims(left, right), yaw_rate_rad_s=np.zeros(1000)))
    assert not (e.flags.astype(int) & OdometryFlag.WHEEL_JUMP).any()
    assert e.x_m[-1] == pytest.approx(10.0, abs=0.1)
    assert abs(e.y_m[-1]) < 0.05
    assert np.mean(left + right) / 2 * 20.0 > 13.9


def test_the_band_covers_wheels_that_all_spin():
    """Both rims gain 3 m/s at 15 m/s^2 and hold it for a second; the robot goes on at 0.5 m/s."""
    time_s = DT_S * np.arange(600)
    both = 0.5 + np.clip(15.0 * (time_s - 5.0), 0.0, 3.0) * (time_s < 6.0)
    _, e = scan(FILTER, samples(FILTER, wheel_speed_rad_s=rims(both, both), yaw_rate_rad_s=np.zeros(600)))
    true_m = 0.5 * time_s
    assert e.pose_cov[-1, 0, 0] ** 0.5 > 0.5
    assert abs(e.x_m[-1] - true_m[-1]) < 3 * e.pose_cov[-1, 0, 0] ** 0.5


@pytest.mark.parametrize("rate_hz", [1, 10])
def test_outside_speeds_take_back_the_way_that_wheels_spun(rate_hz):
    """Both rims gain 0.6 m/s for six seconds; what they turned before the second outside speed is no way either.

    In at most one run of eight at 1 Hz errors that seem to last hide the slide.
    """
    time_s, nees = DT_S * np.arange(2000), []
    every = round(1 / rate_hz / DT_S)
    spins = 0.6 * np.clip(np.minimum(time_s - 15.0, 21.0 - time_s) / 0.25, 0.0, 1.0)
    rolls = 0.5 * np.clip(time_s - 3.0, 0.0, 1.0)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        heard = np.where(np.arange(2000) % every == seed % every, rolls + 0.1 * rng.standard_normal(2000), math.nan)
        edge = rolls * (1.0 + 0.005 * rng.standard_normal()) + spins
        gyro = 0.01 + 0.002 * rng.standard_normal(2000)
        given = {"wheel_speed_rad_s": rims(edge, edge), "yaw_rate_rad_s": gyro, "speed_m_s": heard}
        _, e = scan(FILTER, samples(FILTER, **given))
        nees.append((e.x_m[-1] - np.sum(rolls) * DT_S) ** 2 / e.pose_cov[-1, 0, 0])
    assert np.sum(np.array(nees) > chi2.ppf(0.99, 1)) <= 1


@pytest.mark.parametrize(("change_m_s", "std_m_s"), [(0.0, 0.0), (-0.2, 0.2), (-0.5, 0.3), (0.2, 0.2)])
def test_rims_that_slip_may_change_alone_until_they_meet_the_robot(change_m_s, std_m_s):
    """A slip of 0.3 m/s that stays, or a robot that keeps its speed: the difference is the standard deviation."""
    before = Belief(np.array([-0.3 if name == "slip" else 0.0 for name in NAMES]) / 0.01, np.zeros((15, 15)))
    after = with_rims_alone(before, -0.3, change_m_s, 0.01)
    assert 0.01 * after.mean[SLIP] == pytest.approx(-0.3)
    assert 0.01 * math.sqrt(after.cov[SLIP, SLIP]) == pytest.approx(std_m_s)


@pytest.mark.parametrize("age_s", [0.0, 0.3])
def test_the_start_of_a_spin_is_covered_until_an_outside_speed_tells(age_s):
    """Both rims gain 0.4 m/s between two outside speeds at 1 Hz; a change that these confirm leaves no band."""
    time_s, covered, calm = DT_S * np.arange(800), [], []
    spins = 0.4 * np.clip(np.minimum(time_s - 9.0, 14.0 - time_s) / 0.1, 0.0, 1.0)
    rolls = 0.6 * np.clip(time_s, 0.0, 1.0)
    late = round(age_s / DT_S)
    then = np.concatenate([np.zeros(late), rolls[: 800 - late]])
    for seed in range(8):
        rng = np.random.default_rng(seed)
        heard = np.where(np.arange(800) % 50 == 5 + 5 * seed, then + 0.05 * rng.standard_normal(800), math.nan)
        given = {"wheel_speed_rad_s": rims(rolls + spins, rolls + spins), "yaw_rate_rad_s": np.zeros(800)}
        given |= {"speed_m_s": heard, "speed_age_s": np.full(800, age_s), "speed_std_m_s": np.full(800, 0.05)}
        e, _ = run(FILTER, samples(FILTER, **given))
        std = np.sqrt(e.twist_cov[:, 0, 0])
        onset = (time_s > 9.0) & (time_s < 10.0)
        covered.append(np.mean(np.abs(e.speed_m_s - rolls)[onset] < 1.96 * std[onset]))
        calm.append(std[(time_s > 6.0) & (time_s < 9.0)].mean())
        assert np.all(e.slip_probability[(time_s > 13.2) & (time_s < 13.9)] > 0.5)
    assert np.mean(covered) > 0.9
    assert np.mean(calm) < 0.03


def test_outside_speeds_confirm_a_change_of_the_rims_by_their_likelihood():
    def after(speed_m_s, measured=True, since_m_s=0.0, age_s=0.5):
        y = OutsideSpeed(measured, speed_m_s, 0.05, 0.8, 0.0, 0.05, since_m_s)
        return confirm(Unconfirmed(0.4, 0.5, 0.4, 0.2), 0.8, y, Overrun(0.4, age_s, 0.0), 0.1)

    waits = after(0.0, measured=False)
    assert waits == pytest.approx((0.4, 0.8, 0.4, 0.2 * math.exp(-0.1 / OVERRUN_S) + 0.04))
    assert waits.speed_variance == pytest.approx(0.5 * 0.4**2)  # the robot has gained all of it, or nothing
    assert after(0.4) == pytest.approx(waits)  # the robot has not gained what the rims have
    assert after(0.8).change_m_s == pytest.approx(0.0, abs=0.005)
    assert after(0.4, since_m_s=0.4).change_m_s == pytest.approx(0.4)  # measured before the rims changed
    assert after(0.8, age_s=OVERRUN_S) == (0.8, 0.8, 0.0, 0.0)
    by_rims, by_none = (0.99 * norm.pdf(0.6, v, math.hypot(0.05, 0.05 * v)) + 0.005 for v in (0.8, 0.4))
    share = (by_rims - 0.5 * by_none) / (by_rims + 0.5 * by_none)
    assert after(0.6).change_m_s == pytest.approx(0.4 * (1.0 - share))


def test_the_end_of_a_spin_is_seen_between_two_outside_speeds():
    """Rims that spun by 0.5 m/s for three seconds come back to the robot, which never changed its speed."""
    time_s, covered = DT_S * np.arange(1000), []
    spins = 0.5 * np.clip(np.minimum(time_s - 5.0, 8.0 - time_s) / 0.1, 0.0, 1.0)
    rolls = 0.9 * np.clip(time_s, 0.0, 1.0)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        heard = np.where(np.arange(1000) % 50 == 5 * seed, rolls + 0.05 * rng.standard_normal(1000), math.nan)
        gyro = 0.002 * rng.standard_normal(1000)
        given = {"wheel_speed_rad_s": rims(rolls + spins, rolls + spins), "yaw_rate_rad_s": gyro, "speed_m_s": heard}
        _, e = scan(FILTER, samples(FILTER, **given))
        after = (time_s > 8.0) & (time_s < 9.0)
        off = (e.speed_m_s - rolls)[after] / np.sqrt(e.twist_cov[after, 0, 0])
        covered.append(np.mean(np.abs(off) < 1.96))
    assert np.mean(covered) > 0.9


def late_speeds(robot_m_s, rim_m_s, age_s, std_m_s=0.0, seed=0):
    """A drive straight ahead with outside speeds at 10 Hz, all of the same known age."""
    rng, T, steps = np.random.default_rng(seed), len(robot_m_s), round(age_s / DT_S)
    then = np.concatenate([np.full(steps, robot_m_s[0]), robot_m_s[: T - steps]])
    heard = np.where(np.arange(T) % 5 == 0, then + std_m_s * rng.standard_normal(T), math.nan)
    given = {"wheel_speed_rad_s": rims(rim_m_s, rim_m_s), "yaw_rate_rad_s": np.zeros(T)}
    return samples(FILTER, **given, speed_m_s=heard, speed_std_m_s=np.full(T, 0.05), speed_age_s=np.full(T, age_s))


def test_a_late_speed_is_predicted_over_its_age_once():
    speed = 0.5 * np.clip(DT_S * np.arange(300) - 1.0, 0.0, 4.0)
    e, _ = run(FILTER, late_speeds(speed, speed, 0.3))
    assert np.abs(e.speed_m_s - speed).max() < 0.005


def test_corrections_by_late_speeds_are_not_predicted_again():
    """Rims that are faster by 0.4 m/s for five seconds, and speeds that are 0.4 s old."""
    time_s = DT_S * np.arange(1000)
    spins = 0.4 * np.clip(np.minimum(time_s - 5.0, 10.0 - time_s) / 0.3, 0.0, 1.0)
    speed = 0.5 * np.clip(time_s, 0.0, 1.0)
    for seed in range(4):
        e, _ = run(FILTER, late_speeds(speed, speed + spins, 0.4, 0.05, seed))
        assert np.abs(e.speed_m_s - speed).max() < 0.45
        assert np.sqrt(np.mean((e.speed_m_s - speed)[(time_s > 7.0) & (time_s < 9.5)] ** 2)) < 0.1


def test_an_outside_speed_that_fell_silent_takes_no_way_back():
    silent = run_over(Overrun(0.0, 2.9, 1.0), 0.5, OutsideSpeed(False, 0.0, 0.1, 0.5, 0.0), 0.9, 0.2)
    assert silent == Overrun(0.0, pytest.approx(3.1), 0.0)
    heard = run_over(Overrun(0.4, 0.8, 1.0), 0.5, OutsideSpeed(True, 0.1, 0.1, 0.5, 0.0), 0.9, 0.2)
    assert heard == Overrun(0.1, 0.0, pytest.approx(0.1 * (math.exp(-0.2 / OVERRUN_S) + 0.1 * 0.2)), 0.4)


def test_slides_are_not_learnt_as_noise_of_the_outside_speed():
    """All rims spin by 0.4 m/s for four of ten seconds; outside speeds at 1 Hz show the later spins too."""
    time_s = DT_S * np.arange(4000)
    phase = np.mod(time_s, 10.0)
    spins = 0.4 * np.clip(np.minimum(phase - 5.0, 9.0 - phase) / 0.1, 0.0, 1.0)
    rolls = np.full(4000, 0.6)
    slides = (phase > 7.3) & (phase < 8.9) & (time_s > 30.0)
    named = []
    for seed in range(4):
        noise = 0.07 * np.random.default_rng(seed).standard_normal(4000)
        outside = np.where(np.arange(4000) % 50 == 10, rolls + noise, math.nan)
        given = {"wheel_speed_rad_s": rims(rolls + spins, rolls + spins), "yaw_rate_rad_s": np.zeros(4000)}
        given |= {"speed_m_s": outside, "speed_std_m_s": np.full(4000, 0.07)}
        e, _ = run(FILTER, samples(FILTER, **given))
        named.append(np.mean(e.slip_probability[slides] > 0.5))
    assert np.mean(named) > 0.85


def test_an_alarm_ends_when_the_rims_have_come_back():
    """Rims that spun by 0.5 m/s for four seconds, which outside speeds show at 1 Hz, until half a second before one."""
    time_s = DT_S * np.arange(800)
    spins = 0.5 * np.clip(np.minimum(time_s - 9.0, 13.6 - time_s) / 0.1, 0.0, 1.0)
    rolls = np.full(800, 0.6)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        outside = np.where(np.arange(800) % 50 == 0, rolls + 0.05 * rng.standard_normal(800), math.nan)
        given = {"wheel_speed_rad_s": rims(rolls + spins, rolls + spins), "yaw_rate_rad_s": np.zeros(800)}
        given |= {"speed_m_s": outside, "speed_std_m_s": np.full(800, 0.05)}
        e, _ = run(FILTER, samples(FILTER, **given))
        assert np.all(e.slip_probability[(time_s > 12.2) & (time_s < 13.5)] > 0.5)
        assert np.all(e.slip_probability[(time_s > 13.6) & (time_s < 13.98)] < 0.5)


def test_a_gyro_that_glitches_does_not_move_the_robot():
    gyro = np.where(np.arange(500) % 50 == 25, 5.0, 0.0) * np.where(np.arange(500) % 100 == 25, 1.0, -1.0)
    _, e = scan(
        FILTER, samples(FILTER, wheel_speed_rad_s=rims(np.full(500, 0.5), np.full(500, 0.51)), yaw_rate_rad_s=gyro)
    )
    assert e.distance_m[-1] == pytest.approx(0.505 * 500 * DT_S, rel=0.002)


def test_the_lever_is_half_the_track():
    assert lever_m(RLMA) == pytest.approx(HALF_TRACK_M)


@pytest.mark.parametrize("outside", [True, False])
@pytest.mark.parametrize("side", [0, 1])
def test_a_skid_steered_robot_one_side_of_which_spins_goes_as_fast_as_the_other(side, outside):
    settings, given, spins = one_side_spins(side, outside, np.random.default_rng(side))
    _, estimate = scan(settings, given)
    error = estimate.speed_m_s - 0.8
    std = np.sqrt(estimate.twist_cov[:, 0, 0])
    assert np.sqrt(np.mean(error[spins] ** 2)) < 0.06  # the mean of both sides is wrong by 0.25
    assert np.mean(np.abs(error[spins]) < 2.0 * std[spins]) > 0.9
