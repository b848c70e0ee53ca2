import numpy as np
import pytest

from ohmward.traction import RLMA
from ohmward.traction.motion.sample import change_since, empty_history, remember
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import KNOWN_GROUND

from .examples import DT_S, RLMA_ON_FLOOR, log, observed


def test_the_change_since_then_even_within_a_step():
    history = empty_history(3)
    for dt_s, change in [(0.1, 5.0), (0.1, 1.0), (0.2, 2.0)]:
        history = remember(history, dt_s, change)
    assert [change_since(history, age) for age in (0.0, 0.1, 0.2, 0.3, 0.35)] == pytest.approx([0, 1, 2, 3, 5.5])


def test_older_than_what_is_remembered_is_all_that_is_remembered():
    history = remember(remember(empty_history(1), 0.1, 5.0), 0.1, 1.0)
    assert change_since(history, 9.0) == 1.0
    assert change_since(empty_history(0), 1.0) == 0.0
    assert np.shape(remember(empty_history(0), 0.1, 1.0).dt_s) == (0,)


def test_fast_samples_share_an_entry_so_that_it_reaches_back_for_a_second():
    history = empty_history(20)
    for _ in range(400):
        history = remember(history, 0.005, 0.01)
    assert [change_since(history, age) for age in (0.1, 0.333, 0.9)] == pytest.approx([0.2, 0.666, 1.8])


def test_without_currents_the_wheels_say_what_a_late_speed_has_missed():
    time_s, acceleration, age_s = np.arange(0.0, 3.0, DT_S), 1.0, 0.2
    speed = acceleration * time_s
    late = np.where(time_s >= age_s, speed - acceleration * age_s, np.nan)
    unknown = np.full(len(time_s), np.nan)
    samples = log(speed / RLMA.wheel.radius_m, unknown, speed_m_s=late, speed_age_s=np.full(len(time_s), age_s))
    observer = SpeedObserver(
        RLMA_ON_FLOOR, KNOWN_GROUND, ObserverNoise(speed_std_m_s=0.05, torque_std_Nm=20.0, speed_walk=0.3)
    )
    _, estimates = observed(observer, samples)
    assert np.abs(estimates.speed_m_s - speed)[50:].max() < 0.03
