import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction import RLMA
from ohmward_lab.simulate.closed_loop.sensing import ExternalSpeed, Sensing, SensorSuite
from ohmward_lab.simulate.closed_loop.traction_plant import TractionPlant
from ohmward_lab.simulate.ground import Patch

QUIET = Sensing(current_noise_A=0.0, drive_speed_std_rad_s=1e-9)
STEPS = 400


@pytest.fixture(scope="module")
def truths():
    """0.4 s of driving, every millisecond."""
    plant = TractionPlant(RLMA, [Patch(friction=0.8)])
    return [plant.reset(0.5), *(plant.step(np.array([2.0, 1.0]), 1e-3) for _ in range(STEPS))]


def watch(sensing, truths, seed=1):
    """When each sample arrives, and what arrives."""
    sensors = SensorSuite(sensing, RLMA, np.random.default_rng(seed))
    return [(truth.time_s, arrival) for truth in truths for arrival in sensors.sample(truth)]


def test_samples_come_at_the_interval_with_the_speeds_of_the_wheels(truths):
    seen = watch(QUIET, truths)
    assert [now for now, _ in seen] == pytest.approx(np.arange(0.0, 0.4001, 0.01))
    now, arrival = seen[20]
    true = np.mean([t.wheel_speed_rad_s for t in truths if now - 0.01 < t.time_s <= now], axis=0)
    assert arrival.sample.wheel_speed_rad_s[:2] == pytest.approx(true[:2], abs=2 * np.pi / 4096 / 0.01 + 0.02)
    assert np.isnan(arrival.sample.wheel_speed_rad_s[2:]).all()
    assert arrival.sample.dt_s == pytest.approx(0.01)


def test_the_first_speeds_are_known_at_the_start_only(truths):
    at_start, later = watch(QUIET, truths)[0][1], watch(QUIET, truths[100:])[0][1]
    assert at_start.sample.wheel_speed_rad_s[:2].tolist() == [0.0, 0.0]
    assert np.isnan(later.sample.wheel_speed_rad_s).all()
    assert later.sample.dt_s == 0.0


def test_encoders_sit_where_they_are_put(truths):
    all_wheels = watch(replace(QUIET, encoders="all"), truths)[-1][1].sample
    some = watch(replace(QUIET, encoders=("front_left", "rear_right")), truths)[-1][1].sample
    assert np.isfinite(all_wheels.wheel_speed_rad_s).all()
    assert np.isfinite(some.wheel_speed_rad_s).tolist() == [True, False, False, True]


def test_delays_delay(truths):
    seen = watch(replace(QUIET, delay_s=0.03), truths)
    assert [now - a.taken_s for now, a in seen] == pytest.approx(np.full(len(seen), 0.03))
    assert len(seen) == 38


def test_jitter_never_brings_an_old_sample_after_a_new_one(truths):
    taken = [a.taken_s for _, a in watch(replace(QUIET, jitter_s=0.05), truths)]
    assert taken == sorted(set(taken))
    assert len(taken) < 40


def test_steps_in_time_add_up_over_lost_samples(truths):
    seen = watch(replace(QUIET, drop_share=0.4), truths)
    assert 12 < len(seen) < 36
    assert sum(a.sample.dt_s for _, a in seen[1:]) == pytest.approx(seen[-1][1].taken_s - seen[0][1].taken_s)


def test_a_current_is_the_mean_since_the_sample_before():
    plant = TractionPlant(RLMA, [Patch(friction=0.8)])
    truths = [plant.reset(), *(plant.step(4.0 if k % 2 else 0.0, 1e-3) for k in range(100))]
    current = watch(QUIET, truths)[-1][1].sample.current_A
    assert current == pytest.approx(np.full(2, 2.0 / RLMA.motor.wheel_constant_Nm_per_A), abs=0.02)


def test_a_speed_from_outside_rides_along_with_its_age(truths):
    speed = ExternalSpeed(interval_s=0.1, std_m_s=1e-6, delay_s=0.025)
    seen = [a for _, a in watch(replace(QUIET, speed=speed), truths) if np.isfinite(a.sample.speed_m_s)]
    assert [a.taken_s for a in seen] == pytest.approx([0.03, 0.13, 0.23, 0.33])
    assert [a.sample.speed_age_s for a in seen] == pytest.approx([0.03] * 4)
    true = {round(t.time_s, 3): t.speed_m_s for t in truths}
    assert [a.sample.speed_m_s for a in seen] == pytest.approx([true[x] for x in (0.0, 0.1, 0.2, 0.3)], abs=1e-5)


def test_a_compass_shows_the_heading_within_half_a_turn(truths):
    turned = [t._replace(heading_rad=t.heading_rad + 4.0) for t in truths]
    error = np.array(
        [math.remainder(a.heading_rad - 4.0, 2 * math.pi) for _, a in watch(replace(QUIET, compass=True), turned)]
    )
    assert 0.02 < error.std() < 0.08 and 0.0 < abs(error.mean()) < 0.15
    assert all(math.isnan(a.heading_rad) for _, a in watch(QUIET, truths))


def test_a_speed_from_outside_may_be_lost(truths):
    speed = ExternalSpeed(interval_s=0.01, drop_share=1.0)
    assert not any(np.isfinite(a.sample.speed_m_s) for _, a in watch(replace(QUIET, speed=speed), truths))


def test_the_drives_know_their_wheels_to_within_their_noise(truths):
    sensors = SensorSuite(replace(QUIET, drive_speed_std_rad_s=0.05), RLMA, np.random.default_rng(2))
    error = np.array([sensors.drive_speeds(t) - t.wheel_speed_rad_s[:2] for t in truths])
    assert error.std() == pytest.approx(0.05, rel=0.2)


def test_what_is_not_there_is_not_measured(truths):
    sample = watch(replace(QUIET, gyro=False), truths)[-1][1].sample
    assert np.isnan([sample.yaw_rate_rad_s, sample.pitch_rad, sample.speed_m_s]).all()
    assert abs(watch(replace(QUIET, pitch=True), truths)[-1][1].sample.pitch_rad) < 0.02


@pytest.mark.parametrize(
    "values, message",
    [
        ({"interval_s": 0.0}, "sensors.interval_s must be > 0"),
        ({"drop_share": 2.0}, "sensors.drop_share must be between 0 and 1"),
        ({"delay_s": -0.1}, "sensors.delay_s must be >= 0"),
    ],
)
def test_impossible_sensors_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        Sensing(**values)


def test_an_encoder_needs_a_wheel():
    with pytest.raises(InputError, match=r"sensors\.encoders must be .* a list out of front_left"):
        Sensing(encoders=("left",)).encoder_wheels(RLMA)


def test_glitches_change_single_speeds_of_the_encoders(truths):
    clean = np.array([arrival.sample.wheel_speed_rad_s[:2] for _, arrival in watch(QUIET, truths)])
    spoilt = replace(QUIET, encoder_spike_share=0.2, encoder_spike_rad_s=20.0)
    found = np.array([arrival.sample.wheel_speed_rad_s[:2] for _, arrival in watch(spoilt, truths)])
    off = np.abs(found - clean)
    assert 0.05 < np.mean(off > 10) < 0.4
    assert off[off > 10] == pytest.approx(20.0, abs=0.5) and off[off <= 10].max() < 0.5
