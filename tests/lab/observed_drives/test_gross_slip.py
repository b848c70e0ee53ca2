"""Gross slip: when grip and slide look alike, which is likelier, and how the filter starts again."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.filters.belief import Belief
from ohmward.traction.motion.sample import CleanSample
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_evidence import (
    Judgement,
    SpeedEvidence,
    change_by_momentum,
    is_ambiguous,
    log_friction_of_sliding,
    with_gross_slip,
    with_unexplained,
)
from ohmward.traction.speed_observer.states import KNOWN_GROUND, States
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop.run import score
from traction.speed_observer.examples import RLMA_ON_FLOOR

MODEL = Model(RLMA_ON_FLOOR, States(), ObserverNoise())
GRADE = MODEL.layout.index("grade_rad")
GATE, GAINED_M_S = 10.8, 0.1
#: Of the floor of these tests.
FLOOR_ADHESION = 0.7


def belief(grade_rad, grade_std_rad=0.015, slip_m_s=0.01):
    """Wheels that drive with 13 N each at 0.3 m/s, on a slope as learnt."""
    omega = (0.3 + slip_m_s) / 0.12
    cov = MODEL.first_belief(np.zeros(2)).cov.copy()
    cov[GRADE, GRADE] = grade_std_rad**2
    return Belief(np.array([0.3, 0.0, omega, omega, 0.0, 0.0, grade_rad, 0.0, 1.0]), cov)


def clean(current_A):
    none = np.zeros(4)
    return CleanSample(
        dt_s=0.01,
        modelled_s=0.01,
        unmodelled_s=0.0,
        current_A=np.full(2, current_A),
        current_measured=np.full(2, True),
        wheel_speed_rad_s=none,
        wheel_measured=none > 1,
        pitch_rad=np.nan,
        time_credible=True,
        gap=False,
    )


def after(grade_rad=-0.06, gained_m_s=GAINED_M_S, current_A=3.0, **others):
    evidence = SpeedEvidence(unexplained_m_s=gained_m_s)
    return with_gross_slip(Judgement(evidence, belief(grade_rad, **others), False), clean(current_A), MODEL, GATE)


def test_another_sensor_or_a_known_ground_leaves_no_doubt():
    assert is_ambiguous(MODEL)
    for noise in (
        ObserverNoise(pitch_std_rad=0.01),
        ObserverNoise(speed_std_m_s=0.05),
        ObserverNoise(passive_std_rad_s=0.1),
    ):
        assert not is_ambiguous(Model(RLMA_ON_FLOOR, States(), noise))
    assert not is_ambiguous(Model(RLMA_ON_FLOOR, KNOWN_GROUND, ObserverNoise()))


def test_wheels_slide_where_the_ground_gives_no_more_than_their_force():
    b = belief(-0.06)
    most_N = FLOOR_ADHESION * MODEL.static_load_N[0]
    wanted = np.log(MODEL.traction_N(b.mean)[0] / most_N)
    assert log_friction_of_sliding(b, GAINED_M_S, MODEL) == pytest.approx(wanted, abs=1e-6)
    assert log_friction_of_sliding(b, -GAINED_M_S, MODEL) < -6.0


def test_it_starts_again_from_wheels_that_slide():
    found = after()
    mean, cov = found.belief
    assert mean[0] == pytest.approx(0.3 - GAINED_M_S)
    assert np.sqrt(cov[0, 0]) == pytest.approx(np.hypot(0.05, 0.5 * GAINED_M_S))
    assert mean[2:4] == pytest.approx(0.31 / 0.12)
    assert np.all(MODEL.grip(mean, MODEL.slip(mean)) < 0.01)
    assert mean[GRADE] == 0.0 and cov[GRADE, GRADE] == pytest.approx(MODEL.noise.grade_std_rad**2)
    assert found.ground_changed and found.evidence.unexplained_m_s == 0.0


@pytest.mark.parametrize(
    "other",
    [
        {"grade_rad": -0.03},
        {"gained_m_s": -GAINED_M_S},
        {"grade_std_rad": 0.006},
        {"slip_m_s": 0.002},
        {"current_A": -3.0},
    ],
    ids=[
        "a usual slope",
        "slower than forces say",
        "a slope that has been learnt",
        "too low a friction",
        "motors that brake",
    ],
)
def test_otherwise_it_goes_on(other):
    found = after(**other)
    assert not found.ground_changed and found.belief.mean[0] == 0.3
    assert found.evidence.unexplained_m_s == other.get("gained_m_s", GAINED_M_S)


@pytest.mark.slow
def test_a_start_on_ice_is_no_slope():
    scenario = closed_loop.find_scenario("onto-ice")
    found = score(closed_loop.run(replace(scenario, sensors=replace(scenario.sensors, encoders="driven"))))
    assert found is not None
    assert found.speed_coverage_95 > 0.85
    assert found.speed_rmse_m_s < 0.08


@pytest.mark.parametrize("log_friction", [-2.0, 0.0, 1.0])
def test_the_change_by_momentum_is_that_of_any_ground(log_friction):
    """F = (tau - J_w d omega / dt) / r is the traction of any ground."""
    before = belief(0.0, slip_m_s=0.05)
    before.mean[MODEL.layout.index("log_friction")] = log_friction
    sample = clean(3.0)
    step = MODEL.slip_step(before.mean, sample)
    end = before._replace(mean=np.array([*step.motion, *step.omega, *before.mean[4:]]))
    changed = change_by_momentum(before, end, sample, MODEL)
    assert changed == pytest.approx(step.motion[0] - before.mean[0], abs=1e-12)


def test_what_the_wheels_alone_have_moved_is_unexplained():
    before, moved_m_s = belief(0.0), 0.004
    step = MODEL.slip_step(before.mean, clean(3.0))
    mean = np.array([*step.motion, *step.omega, *before.mean[4:]])
    mean[0] += moved_m_s
    end = before._replace(mean=mean)
    found = with_unexplained(SpeedEvidence(), before, end, end, clean(3.0), MODEL)
    assert found.unexplained_m_s == pytest.approx(moved_m_s, abs=1e-12)
