"""The effective track of a robot that scrubs, from wheels and gyro of a log."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.logs import DriveLog
from ohmward.traction import RLMA, SkidSteer, hard_terrain
from ohmward.traction.speed_observer.estimator import observe
from ohmward.traction.speed_observer.make_observer import make_observer, with_effective_track, yaw_rate_of_wheels

SKID = replace(RLMA, chassis=SkidSteer(0.314, 0.314, 0.30))
GROUND = hard_terrain("dry asphalt")


def drive(effective_m=0.54, gyro=True, every=1, turns=0.8):
    """A slalom at 0.6 m/s; the wheels come in every so many samples."""
    t = 0.02 * np.arange(3000)
    yaw_rate = turns * np.sin(0.5 * t)
    sides = 0.6 + np.outer(yaw_rate, [-0.5, 0.5, -0.5, 0.5]) * effective_m
    wheels = np.where((np.arange(t.size) % every == 0)[:, None], sides / SKID.wheel.radius_m, np.nan)
    return DriveLog("slalom", t, wheels, np.full(wheels.shape, np.nan), yaw_rate if gyro else None)


@pytest.mark.parametrize("every", [1, 7])
def test_wheels_and_gyro_tell_it_exactly(every):
    found = with_effective_track(SKID, drive(every=every))
    assert isinstance(found.chassis, SkidSteer)
    assert found.chassis.effective_track_m == pytest.approx(0.54, rel=1e-9)


def test_the_yaw_rate_of_wheels_that_roll_is_that_of_the_body():
    log = drive(effective_m=0.30)
    np.testing.assert_allclose(yaw_rate_of_wheels(SKID, log.wheel_speed_rad_s), log.yaw_rate_rad_s, atol=1e-12)


def test_what_tells_no_track_changes_nothing():
    noise = np.random.default_rng(1).normal(0.0, 1.0, (3000, 4))
    no_turn = replace(drive(), wheel_speed_rad_s=5.0 + noise)
    for log in (drive(gyro=False), drive(turns=0.05), no_turn):
        assert with_effective_track(SKID, log) is SKID
    known = replace(RLMA, chassis=SkidSteer(0.314, 0.314, 0.30, 0.5))
    assert with_effective_track(known, drive()) is known
    assert with_effective_track(RLMA, drive()) is RLMA


def test_slow_wheels_beside_a_fast_gyro_keep_the_speed_in_turns():
    log = drive(every=10)  # 5 Hz and 50 Hz
    chosen = make_observer(SKID, log, GROUND)
    assert any("1.8 times the track" in str(note) for note in chosen.notes)
    assert chosen.observer.noise.encoder_lag_share == 0.0
    found = observe(chosen.observer, log).estimates
    error = found.speed_m_s - 0.6
    assert np.sqrt(np.mean(error[500:] ** 2)) < 0.03
    assert np.mean(np.abs(error) < 1.96 * found.speed_std_m_s) > 0.95
