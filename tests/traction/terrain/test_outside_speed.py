from dataclasses import replace

import numpy as np
import pytest

from ohmward.traction.motion.sample import RobotSample, sanitize
from ohmward.traction.observed_drive import observe_on_floors
from ohmward.traction.terrain.floor import Floors, SlipBelief
from ohmward.traction.terrain.recognition import (
    LASTING_SHARE,
    MU_MEMORY_S,
    LossSample,
    LossState,
    SeenLoss,
    averaged,
    corrected,
    log_likelihood,
    loss_sample,
    seen,
)
from ohmward.traction.terrain.slip_on_floors import GAP_S, FloorFlag, FloorSlipEstimator
from traction.terrain.drives import OMNI, SMOOTH, SOFT, omni_drive, on_floors

LATE = slice(100, None)
#: Asks for the forces of SOFT and slips by about half as much.
FIRM = replace(SOFT, name="firm", stiffness=6.0, friction=2.0)
NOTHING = np.full(3, np.nan)


def true_slip(drive):
    return 1 - np.hypot(*drive.motion[LATE, :2].mean(axis=0)) / 0.15


def with_speed(drive, until_s=np.inf, std_m_s=0.01, seed=3):
    """The log of a drive with an outside speed in every third sample, about 10 Hz."""
    log = drive.log
    shown = (np.arange(len(log)) % 3 == 0) & (log.time_s < until_s)
    speed = drive.motion[:, 0] + np.random.default_rng(seed).normal(0.0, std_m_s, len(log))
    return replace(log, speed_m_s=np.where(shown, speed, np.nan), speed_std_m_s=np.full(len(log), std_m_s))


@pytest.mark.parametrize("direction_deg", [0.0, 20.0])
@pytest.mark.parametrize("under, right", [(SOFT, 0), (FIRM, 1)])
def test_an_outside_speed_tells_floors_apart_that_ask_for_like_forces(direction_deg, under, right):
    drive = omni_drive([under] * 3, direction_deg, rng=np.random.default_rng(10))
    floors = on_floors((SOFT, FIRM))
    blind, seeing = floors.run(drive.log), floors.run(with_speed(drive))
    assert blind.floor_probability[LATE, :, right].mean() < 0.6
    assert seeing.floor_probability[LATE, :, right].mean() > 0.75
    assert abs(seeing.travel_slip[LATE].mean() - true_slip(drive)) < 0.02
    assert seeing.travel_slip_std[LATE].mean() < 0.7 * blind.travel_slip_std[LATE].mean()


def test_a_floor_never_met_is_believed_where_the_speed_shows_it():
    drive = omni_drive([SOFT] * 3, 0.0, rng=np.random.default_rng(11))
    floors = on_floors((SMOOTH, FIRM))
    blind, seeing = floors.run(drive.log), floors.run(with_speed(drive))
    assert blind.floor_probability[LATE, :, -1].mean() < 0.5 < 0.9 < seeing.floor_probability[LATE, :, -1].mean()
    assert abs(blind.travel_slip[LATE].mean() - true_slip(drive)) > 0.08
    assert abs(seeing.travel_slip[LATE].mean() - true_slip(drive)) < 0.02


def test_the_band_with_a_speed_covers_and_is_narrower():
    inside, narrower = [], []
    for seed in range(20):
        drive = omni_drive([SOFT] * 3, 20.0, rng=np.random.default_rng(100 + seed))
        blind, seeing = on_floors((SMOOTH,)).run(drive.log), on_floors((SMOOTH,)).run(with_speed(drive, seed=seed))
        off = seeing.travel_slip[LATE] - true_slip(drive)
        inside.append(np.mean(abs(off) < 1.96 * seeing.travel_slip_std[LATE]))
        narrower.append(seeing.travel_slip_std[LATE].mean() / blind.travel_slip_std[LATE].mean())
    assert np.mean(inside) > 0.93
    assert np.max(narrower) < 0.4


def test_some_of_it_stays_after_the_speed_has_gone():
    drive = omni_drive([SOFT] * 3, 0.0, rng=np.random.default_rng(12))
    track = on_floors((SMOOTH,)).run(with_speed(drive, until_s=4.0))
    std = track.travel_slip_std
    t = track.time_s
    with_it, after, later = (std[(t > a) & (t < b)].mean() for a, b in ((3.0, 4.0), (4.5, 5.5), (7.0, 8.0)))
    assert with_it < after < later < on_floors((SMOOTH,)).run(drive.log).travel_slip_std[t > 7.0].mean()
    assert abs(track.travel_slip[t > 4.5].mean() - true_slip(drive)) < 0.05


def test_across_the_robot_a_forward_speed_tells_little():
    """At 90 degrees the forward motion is 0 on every floor."""
    drive = omni_drive([SOFT] * 3, 90.0, rng=np.random.default_rng(13))
    floors = on_floors((SOFT, FIRM))
    blind, seeing = floors.run(drive.log), floors.run(with_speed(drive))
    np.testing.assert_allclose(seeing.travel_slip[LATE].mean(), blind.travel_slip[LATE].mean(), atol=0.03)


def test_a_speed_that_no_slip_explains_is_refused_and_flagged():
    drive = omni_drive([SOFT] * 3, 0.0, rng=np.random.default_rng(14))
    log = with_speed(drive)
    wrong = replace(log, speed_m_s=log.speed_m_s - 3.0)
    track, blind = on_floors((SOFT,)).run(wrong), on_floors((SOFT,)).run(drive.log)
    np.testing.assert_array_equal(track.travel_slip, blind.travel_slip)
    refused = track.flags.astype(int) & FloorFlag.SPEED_REFUSED > 0
    np.testing.assert_array_equal(refused, np.isfinite(log.speed_m_s))
    some = replace(log, speed_m_s=np.where(np.arange(len(log)) % 30 == 0, wrong.speed_m_s, log.speed_m_s))
    notes = observe_on_floors(OMNI, some, Floors(OMNI.name, (SOFT,)), "ukf").notes
    assert any("speed refused" in note.text for note in notes)


def test_live_is_what_the_run_gives():
    log = with_speed(omni_drive([SOFT] * 3, 0.0, rng=np.random.default_rng(15)))
    floors = on_floors((SMOOTH, SOFT))
    robot = FloorSlipEstimator(floors)
    rows = zip(log.time_s, log.wheel_speed_rad_s, log.motor_current_A, log.speed_m_s, log.speed_std_m_s, strict=True)
    found = [robot.update(t, w, a, speed_m_s=v, speed_std_m_s=s).travel_slip for t, w, a, v, s in rows]
    np.testing.assert_allclose(found, floors.run(log).travel_slip, rtol=1e-9, atol=1e-12)


def test_the_mean_loss_has_less_variance_but_not_without_end():
    state = LossState()
    assert not seen(state).known
    for n in range(1, 5):
        state = averaged(state, LossSample(0.2, 0.01, False), False, 0.0)
        loss = seen(state)
        assert loss.value == pytest.approx(0.2)
        assert loss.variance == pytest.approx(0.01 * (LASTING_SHARE + (1 - LASTING_SHARE) / n))
    faded = averaged(state, LossSample(np.nan, np.nan, False), False, MU_MEMORY_S)
    assert faded.mean == state.mean and faded.count == pytest.approx(state.count / np.e)
    assert averaged(state, LossSample(np.nan, np.nan, False), True, 0.1).count == 0.0
    assert averaged(state, LossSample(0.9, 0.01, False), False, 0.1)[::2] == pytest.approx((0.9, 1.0))


def test_the_loss_of_a_sample_and_its_variance():
    sample = RobotSample(0.1, NOTHING, NOTHING, speed_m_s=0.15, speed_std_m_s=0.01, speed_age_s=0.2)
    still = np.zeros(3)
    loss = loss_sample(
        sanitize(sample, GAP_S), np.array([0.2, 0.0, 0.0]), np.full(3, 0.02), np.array([0.1, 0.0, 0.0]), 0.2
    )
    assert loss[:2] == pytest.approx((0.25, (0.01**2 + 0.02**2 + 0.02**2) / 0.04))
    old = loss_sample(sanitize(sample._replace(speed_age_s=5.0), GAP_S), np.array([0.2, 0.0, 0.0]), still, still, 0.2)
    assert old.refused and np.isnan(old.value)
    none = loss_sample(sanitize(sample._replace(speed_m_s=np.nan), GAP_S), np.array([0.2, 0.0, 0.0]), still, still, 0.2)
    assert not none.refused and np.isnan(none.value)


def test_likelihood_and_correction_are_those_of_the_normal_distribution():
    rng, b = np.random.default_rng(5), np.array([0.5, 0.1, -0.4])
    slips = [SlipBelief(rng.normal(0, 0.2, 3), (a := rng.normal(0, 0.1, (3, 3))) @ a.T) for _ in range(2)]
    loss = SeenLoss(True, 0.3, 0.004)
    mixed = np.array([[0, 0, 0], [1, 1, 1], [0, 1, 0]])
    joint = np.array([slips[0].mean[0], slips[1].mean[1], slips[0].mean[2]])
    cov = np.where([[1, 0, 1], [0, 0, 0], [1, 0, 1]], slips[0].cov, np.where(np.eye(3), slips[1].cov, 0.0))
    expected = [(b @ s.mean, b @ s.cov @ b + 0.004) for s in slips] + [(b @ joint, b @ cov @ b + 0.004)]
    np.testing.assert_allclose(
        log_likelihood(loss, mixed, slips, b), [-0.5 * ((0.3 - m) ** 2 / v + np.log(v)) for m, v in expected]
    )
    after = corrected(slips[0], loss, b)
    information = np.linalg.inv(slips[0].cov) + np.outer(b, b) / 0.004
    np.testing.assert_allclose(after.cov, np.linalg.inv(information), rtol=1e-6)
    mean = after.cov @ (np.linalg.solve(slips[0].cov, slips[0].mean) + b * 0.3 / 0.004)
    np.testing.assert_allclose(after.mean, mean, rtol=1e-6)
