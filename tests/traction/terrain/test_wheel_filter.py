import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction.motion.sample import RobotSample, no_sample, samples_of, sanitize
from ohmward.traction.terrain.slip_on_floors import GAP_S
from ohmward.traction.terrain.wheel_filter import METHODS, WheelFilter, WheelState
from traction.terrain.drives import OMNI, SOFT, along, omni_drive, steady


def run(method, drive, **settings):
    wheels = WheelFilter(OMNI, method, **settings)
    log = drive.log
    return along(wheels, samples_of(log, OMNI, before_s=0.0))


@pytest.mark.parametrize("method", METHODS)
def test_forces_and_rims_are_found_where_nothing_is_noisy(method):
    _, belief = run(method, omni_drive([SOFT] * 3, 20.0))
    _, force = steady(OMNI, [SOFT] * 3, 0.15 * np.array([np.cos(np.radians(20)), np.sin(np.radians(20)), 0.0]))
    np.testing.assert_allclose(belief.force_N[-1], force, rtol=0.01, atol=0.05)
    np.testing.assert_allclose(
        belief.rim[-1], [0.15 * np.cos(np.radians(20)), 0.15 * np.sin(np.radians(20)), 0], atol=1e-6
    )


def test_the_sigma_of_the_forces_is_the_size_of_their_errors():
    rng = np.random.default_rng(2)
    _, force = steady(OMNI, [SOFT] * 3, np.array([0.0, 0.15, 0.0]))
    _, belief = run("ukf", omni_drive([SOFT] * 3, 90.0, seconds=60.0, rng=rng), current_std_A=0.15)
    error = belief.force_N[200:] - force
    assert np.all(np.std(error, axis=0) < 1.3 * belief.force_std_N[200:].mean(axis=0))
    assert np.all(np.abs(error.mean(axis=0)) < 0.3)


def test_matching_finds_the_noise_of_encoders_and_currents():
    rng = np.random.default_rng(3)
    drive = omni_drive([SOFT] * 3, 45.0, seconds=60.0, rng=rng)
    state, _ = run("aukf", drive, encoder_std_rad_s=0.3, current_std_A=0.5, given_samples=20.0, window=300.0)
    np.testing.assert_allclose(np.sqrt(state.variance[:3]), 0.1, rtol=0.25)
    np.testing.assert_allclose(np.sqrt(state.variance[3:]), 0.15, rtol=0.25)


@pytest.mark.parametrize("method", METHODS)
def test_a_current_that_is_missing_leaves_its_force_where_it_was(method):
    wheels = WheelFilter(OMNI, method)
    drive = omni_drive([SOFT] * 3, 20.0)
    state, before = run(method, drive)
    missing = RobotSample(0.5, drive.log.wheel_speed_rad_s[-1], np.array([np.nan, *drive.log.motor_current_A[-1, 1:]]))
    after, belief = wheels.step(WheelState(*state), sanitize(missing, GAP_S))
    assert belief.force_N[0] == pytest.approx(before.force_N[-1, 0], abs=0.02)
    variance = before.force_std_N[-1, 0] ** 2 + 0.5 * wheels.walk[3] ** 2
    assert belief.force_std_N[0] == pytest.approx(np.sqrt(variance), rel=1e-3)
    assert belief.force_std_N[1] < 0.8 * belief.force_std_N[0]
    assert after.variance[3] == state.variance[3]


def test_rims_without_an_encoder_wander_as_far_as_they_may():
    wheels = WheelFilter(OMNI)
    state, before = run("ukf", omni_drive([SOFT] * 3, 20.0))
    _, belief = wheels.step(WheelState(*state), sanitize(no_sample(OMNI)._replace(dt_s=0.5), GAP_S))
    np.testing.assert_allclose(belief.rim, before.rim[-1], atol=1e-9)
    np.testing.assert_allclose(belief.rim_std**2, before.rim_std[-1] ** 2 + 0.5 * wheels.walk[:3] ** 2, rtol=1e-6)


def test_wrong_settings_are_refused():
    with pytest.raises(InputError, match="method must be one of ekf, aekf, ukf, aukf, got 'kf'"):
        WheelFilter(OMNI, "kf")
    with pytest.raises(InputError, match="window must be > 0"):
        WheelFilter(OMNI, window=0.0)
