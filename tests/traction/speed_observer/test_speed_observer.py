"""The observer on its own model: exact cases, reductions, consistency."""

import json
from dataclasses import replace

import numpy as np
import pytest

from kernels import kernel_of
from ohmward.errors import InputError
from ohmward.filters import unpack
from ohmward.filters.belief import Belief, PackedBelief
from ohmward.filters.consistency import mean_bounds, nees
from ohmward.filters.kalman import correct_state
from ohmward.trace import Kernel
from ohmward.traction import RollingResistance, SkidSteer, scene
from ohmward.traction.motion.sample import RobotSample, sanitize
from ohmward.traction.speed_observer.body_sensors import correct_sensor
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import KNOWN_GROUND
from traction.examples import plant

from .examples import DT_S, FLOOR, RLMA_ON_FLOOR, SCENES, at_rest, log, observed

FULL = ObserverNoise(
    gyro_std_rad_s=0.01,
    passive_std_rad_s=0.1,
    speed_std_m_s=0.05,
    pitch_std_rad=0.01,
)


def test_at_rest_it_stays_at_rest():
    _, e = observed(SpeedObserver(RLMA_ON_FLOOR), log(np.zeros(200), np.zeros(200)))
    assert e.speed_m_s == pytest.approx(0.0, abs=2e-4)
    assert e.speed_std_m_s[-1] < 0.003
    assert np.isnan(e.slip_ratio).all()


@pytest.mark.parametrize("method", ["ekf", "ukf"])
@pytest.mark.parametrize("name", SCENES)
def test_every_robot_and_method_follows_its_wheels(name, method):
    place = SCENES[name]
    observer = SpeedObserver(place, method=method, noise=FULL)
    n, wheels = place.robot.driven, len(place.robot.places)
    motion = np.array([0.3, 0.2]) if place.robot.freedoms == 2 else np.array([0.3, 0.0, 0.2])
    speeds = place.robot.rolling @ motion / place.robot.wheel.radius_m
    blank = observer.no_sample()
    sample = blank._replace(
        dt_s=np.full(300, DT_S), wheel_speed_rad_s=np.tile(speeds, (300, 1)), current_A=np.zeros((300, n))
    )
    kernel = kernel_of(observer, observer.init(at_rest(observer)), at_rest(observer))
    _, e = kernel.scan(observer.init(blank._replace(wheel_speed_rad_s=speeds, current_A=np.zeros(n))), sample)
    assert e.speed_m_s[-1] == pytest.approx(0.3, abs=0.01)
    assert e.yaw_rate_rad_s[-1] == pytest.approx(0.2, abs=0.05)
    assert e.wheel_speed_rad_s.shape == (300, n) and wheels >= n


def test_compiled_it_does_what_it_does_with_floats():
    observer = SpeedObserver(RLMA_ON_FLOOR, noise=FULL, matching=True)
    state = observer.init(at_rest(observer))
    sample = RobotSample(
        0.01, np.array([1.0, 1.3, 0.9, np.nan]), np.array([2.0, np.nan]), 0.1, 0.4, 0.01, 0.11, np.nan, 0.0
    )
    kernel = kernel_of(observer, state, sample)
    plain, compiled = observer.step(state, sample), kernel(state, sample)
    np.testing.assert_allclose(flat(compiled), flat(plain), rtol=1e-9, atol=1e-12)


def flat(value):
    if isinstance(value, tuple):
        return np.concatenate([flat(v) for v in value])
    return np.ravel(np.asarray(value, dtype=float))


def test_the_state_is_plain_numbers():
    observer = SpeedObserver(RLMA_ON_FLOOR, noise=FULL)
    state, _ = observed(observer, log(np.zeros(3), np.zeros(3)))
    assert json.loads(json.dumps(flat(state).tolist())) == flat(state).tolist()


def test_one_measurement_is_the_joint_gaussian():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((3, 3))
    prior = Belief(rng.standard_normal(3), root @ root.T + np.eye(3))
    after = correct_state(prior, 1, 0.7, 0.4)
    information = np.linalg.inv(prior.cov) + np.diag([0.0, 1 / 0.4, 0.0])
    assert after.cov == pytest.approx(np.linalg.inv(information))
    mean = np.linalg.solve(information, np.linalg.solve(prior.cov, prior.mean) + np.array([0.0, 0.7 / 0.4, 0.0]))
    assert after.mean == pytest.approx(mean)
    gated_after, accepted = correct_sensor(prior, 0.7, lambda x: x[1:2], 0.4, 1e9)
    assert accepted and gated_after.mean == pytest.approx(after.mean)
    assert not correct_sensor(prior, np.nan, lambda x: x[1:2], 0.4, 1e9)[1]


def test_lasting_states_return_to_their_prior_and_no_further():
    observer = SpeedObserver(RLMA_ON_FLOOR, rest_hold_s=np.inf)
    names = observer.model.layout.names
    blind = log(np.full(2000, np.nan), np.zeros(2000), dt_s=np.full(2000, 0.1))
    state, e = observed(observer, blind)
    std = dict(zip(names, np.sqrt(np.diag(unpack(PackedBelief(*state.belief)).cov)), strict=True))
    assert std["log_friction"] == pytest.approx(0.7, rel=0.01)
    assert std["grade_rad"] == pytest.approx(np.radians(1.0), rel=0.01)
    assert np.all(np.diff(e.speed_std_m_s) > 0)


def drawn(observer, own, rng, torque_of, steps, blind=False):
    """NEES (steps,) of a robot that the observer's own model `own` drew, noise included."""
    noise = observer.noise
    state = observer.init(at_rest(observer))
    prior = unpack(state.belief)
    x = prior.mean + np.linalg.cholesky(prior.cov) @ rng.standard_normal(len(prior.mean))
    kernel = kernel_of(observer, state, at_rest(observer))
    statistic = []
    for k in range(steps):
        current = np.full(2, torque_of(k * DT_S) / 0.517)
        sample = at_rest(observer)._replace(dt_s=DT_S, current_A=current)
        mean, Q = own(x, sample, current)
        x = mean + np.linalg.cholesky(Q + 1e-18 * np.eye(len(Q))) @ rng.standard_normal(len(x))
        encoders = x[2:4] + noise.encoder_std_rad_s * rng.standard_normal(2)
        speed = x[0] + 0.05 * rng.standard_normal() if k % 10 == 0 and not blind else np.nan
        sample = sample._replace(wheel_speed_rad_s=np.array([*encoders, np.nan, np.nan]), speed_m_s=speed)
        state, _ = kernel(state, sample)
        statistic.append(nees(unpack(PackedBelief(*state.belief)), x))
    return statistic


def own_model(observer):
    """Compiled (state, sample, current_A) -> mean and process noise of the next state, by the observer's model."""
    model = observer.model

    def advance(x, sample, current_A):
        clean = sanitize(sample, observer.gap_s)._replace(current_A=current_A)
        return model.next_state(x, clean), model.process_noise(model.slip_step(x, clean), clean)

    mean = unpack(observer.init(at_rest(observer)).belief).mean
    return Kernel(advance, mean, at_rest(observer), np.zeros(2))


@pytest.mark.parametrize("method", ["ekf", "ukf"])
def test_nees_of_the_four_states_on_known_ground(method):
    noise = ObserverNoise(encoder_lag_share=0.0, speed_std_m_s=0.05)
    observer = SpeedObserver(RLMA_ON_FLOOR, KNOWN_GROUND, noise, method=method, rest_hold_s=np.inf)
    rng, own = np.random.default_rng(2), own_model(observer)
    runs = np.array([drawn(observer, own, rng, lambda t: 1.0 + np.sin(4 * t), 100) for _ in range(20)])
    lower, upper = mean_bounds(4, 20, 0.999)
    assert np.all((lower < runs[:, 9::30].mean(axis=0)) & (runs[:, 9::30].mean(axis=0) < upper))


def test_matching_finds_the_noise_of_the_encoders():
    rng = np.random.default_rng(3)
    speeds = np.full((3000, 4), 3.0) + 0.3 * rng.standard_normal((3000, 4))
    small = ObserverNoise(encoder_std_rad_s=0.1)
    state, _ = observed(
        SpeedObserver(RLMA_ON_FLOOR, KNOWN_GROUND, small, matching=True),
        log(speeds[:, 0], np.full(3000, 0.3585))._replace(wheel_speed_rad_s=speeds),
    )
    assert np.sqrt(state.matched.encoder.variance) == pytest.approx(0.3, rel=0.15)


def test_an_external_speed_shows_the_radius():
    true_share = 1.01
    speeds = np.full(4000, 0.4 / (0.12 * true_share))
    sample = log(speeds, np.full(4000, 0.3), speed_m_s=np.full(4000, 0.4))
    observer = SpeedObserver(RLMA_ON_FLOOR, noise=ObserverNoise(speed_std_m_s=0.02, radius_std=0.02))
    _, e = observed(observer, sample)
    assert e.radius_ratio[-1] == pytest.approx(true_share, abs=3 * e.radius_std[-1])
    assert e.radius_std[-1] < 0.005


def test_on_level_ground_the_rolling_resistance_is_learnt():
    twice = scene(RLMA_ON_FLOOR.robot, FLOOR._replace(rolling=RollingResistance(a1=0.015, a3_s_per_m=0.0)))
    current = 0.8 + 0.5 * np.sin(np.arange(1500) * DT_S)
    start = np.array([0.5, 0.0, 0.5 / 0.12, 0.5 / 0.12])
    _, truth = plant(twice).scan(start, np.column_stack([current, current]))
    noise = ObserverNoise(pitch_std_rad=0.001, speed_std_m_s=0.02)
    observer = SpeedObserver(RLMA_ON_FLOOR, noise=noise)
    samples = log(truth[:, 2], current, pitch_rad=np.zeros(1500), speed_m_s=truth[:, 0])
    state, _ = observed(observer, samples)
    belief, i = unpack(PackedBelief(*state.belief)), observer.model.layout.index("rolling_excess")
    std = np.sqrt(belief.cov[i, i])
    assert std < 0.35 < noise.rolling_std
    assert belief.mean[i] == pytest.approx(1.0, abs=3 * std)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": "kf"}, "method must be one of ekf, ukf, got 'kf'"),
        ({"gate": 0.0}, "gate must be > 0"),
        ({"window": 0.5}, "window must be >= 1"),
    ],
)
def test_settings_that_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        SpeedObserver(RLMA_ON_FLOOR, **change)


def test_a_robot_that_scrubs_is_refused_with_advice():
    robot = replace(RLMA_ON_FLOOR.robot, chassis=SkidSteer(0.314, 0.314, 0.3))
    with pytest.raises(InputError, match="describe a skid-steered robot as Differential"):
        SpeedObserver(scene(robot, FLOOR))


def test_noise_and_states_that_are_refused():
    with pytest.raises(InputError, match=r"noise.gyro_std_rad_s must be > 0"):
        ObserverNoise(gyro_std_rad_s=0.0)
    with pytest.raises(InputError, match=r"noise.grade_walk must be >= 0"):
        ObserverNoise(grade_walk=-1.0)
