"""Edges of counts: exact where their time is, better than counts where it is noisy, and no more than counts without."""

import math

import numpy as np
import pytest

from kernels import assert_compiled_is_plain, kernel_of
from ohmward.errors import InputError
from ohmward.filters.belief import Belief
from ohmward.traction import RLMA, scene
from ohmward_lab.traction.momentum_observer import (
    MomentumNoise,
    MomentumObserver,
    count_angle,
    count_std_rad,
    edge_angle,
)
from traction.speed_observer.examples import FLOOR

DT, COUNTS = 1e-3, 4096
COUNT_RAD = 2 * math.pi / COUNTS
R, J = RLMA.wheel.radius_m, RLMA.inertia[2]
TORQUE, FORCE = 3.0, 20.0
TURNING = (TORQUE - R * FORCE) / J


def observer(edge_std_counts=0.02):
    noise = MomentumNoise(count_std_rad(COUNTS), edge_std_counts, gyro_std_rad_s=0.005)
    return MomentumObserver(scene(RLMA, FLOOR), noise)


def sample_of(turned_rad, age_s):
    blank = observer().no_sample()
    return blank._replace(
        dt_s=DT,
        turned_rad=np.array([turned_rad, turned_rad, math.nan, math.nan]),
        edge_age_s=np.array([age_s, age_s, math.nan, math.nan]),
        current_A=np.full(2, TORQUE / RLMA.motor.wheel_constant_Nm_per_A),
        yaw_rate_rad_s=0.0,
    )


def believed(ahead_rad, speed_rad_s=0.0, ahead_std_rad=1e-5):
    model = observer().model
    x, P = np.zeros(len(model.names)), 1e-6 * np.eye(len(model.names))
    x[model.ahead(0)], x[model.wheel(0)], x[model.force(0)] = ahead_rad, speed_rad_s, FORCE
    P[model.ahead(0), model.ahead(0)] = ahead_std_rad**2
    return model, Belief(x, P), model.drive(x, np.full(2, TORQUE), 0.0)


def spinning(rng=None, until_s=0.2):
    """Both wheels from rest under constant torque and force: true speeds, and samples with counts and edges."""
    time = DT * np.arange(1, round(until_s / DT) + 1)
    angle = 0.5 * TURNING * time**2
    phase = rng.random() if rng else 0.5
    shown = np.floor(angle / COUNT_RAD + phase)
    edge = (shown - phase + (0.02 * rng.standard_normal(len(time)) if rng else 0.0)) * COUNT_RAD
    age = np.clip(time - np.sqrt(2 * np.maximum(edge, 0.0) / TURNING), 0.0, DT)
    turned = COUNT_RAD * np.diff(shown, prepend=math.floor(phase))
    return TURNING * time, [sample_of(c, a if c else math.nan) for c, a in zip(turned, age, strict=True)]


def wheel_speeds(observer_, samples):
    state = observer_.init()
    step = kernel_of(observer_, state, observer_.no_sample())
    found = []
    for sample in samples:
        state, estimate = step(state, sample)
        found.append(estimate.wheel_speed_rad_s[0])
    return np.array(found)


@pytest.mark.parametrize("age_s", [0.0, 0.3e-3, DT])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_an_edge_is_where_the_wheel_was(age_s, way):
    speed = 2.0 * way
    now = -0.5 * way * COUNT_RAD + speed * age_s - 0.5 * TURNING * age_s**2
    model, belief, b = believed(now, speed)
    seen = edge_angle(model, 0, belief, sample_of(way * COUNT_RAD, age_s), b)
    assert seen.row @ belief.mean == pytest.approx(seen.angle_rad, abs=1e-15)
    assert math.sqrt(seen.variance) == pytest.approx(0.02 * COUNT_RAD)


def test_without_an_edge_a_wheel_is_within_its_count():
    still = sample_of(0.0, math.nan)
    model, belief, b = believed(0.4 * COUNT_RAD)
    assert math.isnan(edge_angle(model, 0, belief, still, b).angle_rad)
    for side in (1.0, -1.0):
        model, belief, b = believed(0.7 * side * COUNT_RAD)
        assert edge_angle(model, 0, belief, still, b).angle_rad == pytest.approx(0.5 * side * COUNT_RAD)


@pytest.mark.parametrize("age_s", [math.nan, -1e-4, 2 * DT])
def test_where_no_time_was_captured_the_count_counts(age_s):
    model, belief, b = believed(0.3 * COUNT_RAD)
    seen = edge_angle(model, 0, belief, sample_of(COUNT_RAD, age_s), b)
    count = count_angle(model, 0)
    assert seen.row == pytest.approx(count.row)
    assert (seen.angle_rad, seen.variance) == (count.angle_rad, count.variance)


def test_edges_tell_the_speed_of_a_wheel_better_than_counts():
    errors: dict[str, list[np.ndarray]] = {"counts": [], "edges": []}
    for seed in range(5):
        speed, samples = spinning(np.random.default_rng(seed))
        for name, edges in (("counts", None), ("edges", 0.02)):
            errors[name].append((wheel_speeds(observer(edges), samples) - speed)[50:])
    rms = {name: np.sqrt(np.mean(np.square(found))) for name, found in errors.items()}
    assert rms["edges"] < 0.4 * rms["counts"]


def test_compiled_and_plain_steps_agree_with_edges():
    plain = observer()
    assert_compiled_is_plain(plain, plain.init(), spinning(np.random.default_rng(1))[1][:30], 1e-9)


def test_an_edge_lies_somewhere():
    with pytest.raises(InputError, match=r"momentum_noise.edge_std_counts must be > 0"):
        observer(0.0)
