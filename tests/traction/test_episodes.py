"""From alarms to episodes."""

import numpy as np
import pytest

from ohmward.traction.observed_drive import immobilised_episodes, robot_episodes, slip_episodes
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.estimator import SlipRun
from ohmward.traction.terrain.slip_on_floors import FloorEstimate, FloorRun

TIME = 0.1 * np.arange(100)


def track(alarm, slip=0.0, ratio=0.0, stuck=0.0, time_s=TIME):
    wheels = np.ones((TIME.size, 2))
    blank = dict.fromkeys(SlipEstimate._fields, np.zeros(TIME.size))
    known = {"slipping": alarm * wheels, "slip_speed_m_s": slip * wheels, "slip_ratio": ratio * wheels}
    return SlipRun(time_s, SlipEstimate(**(blank | known | {"immobilised": stuck * np.ones(TIME.size)})), 0.0)


def alarm_of(*stretches):
    alarm = np.zeros((TIME.size, 2))
    for wheel, first, last in stretches:
        alarm[first : last + 1, wheel] = 1.0
    return alarm


def test_no_alarm_is_no_episode():
    assert slip_episodes(track(0.0), ["left", "right"]) == []
    assert immobilised_episodes(track(0.0)) == []


def test_each_wheel_has_its_own_in_order_of_time():
    found = slip_episodes(track(alarm_of((1, 10, 20), (0, 40, 45))), ["left", "right"])
    assert [e.wheel for e in found] == ["right", "left"]
    assert (found[0].start_s, found[0].end_s) == pytest.approx((1.0, 2.0))
    assert (found[1].start_s, found[1].end_s) == pytest.approx((4.0, 4.5))


def test_short_pauses_are_bridged():
    found = slip_episodes(track(alarm_of((0, 10, 20), (0, 24, 30), (0, 40, 41))), ["left", "right"])
    assert [(e.start_s, e.end_s) for e in found] == [pytest.approx((1.0, 3.0)), pytest.approx((4.0, 4.1))]


def test_alarms_of_single_samples_are_no_episodes():
    alarm = alarm_of((0, 10, 10), (0, 13, 13), (1, 10, 10), (1, 40, 41))
    (found,) = slip_episodes(track(alarm), ["left", "right"])
    assert (found.wheel, found.start_s, found.end_s) == ("right", pytest.approx(4.0), pytest.approx(4.1))


def test_consecutive_samples_of_a_slow_log_are_one_episode():
    (found,) = slip_episodes(track(alarm_of((0, 10, 12)), time_s=10.0 * TIME), ["left", "right"])
    assert (found.start_s, found.end_s) == (pytest.approx(10.0), pytest.approx(12.0))


def test_the_greatest_slip_keeps_its_sign():
    slip = 0.1 + 0.9 * np.sin(TIME)[:, None]
    (found,) = slip_episodes(track(alarm_of((0, 0, 99)), slip, np.where(slip > 0.5, np.nan, slip)), ["left", "right"])
    assert found.greatest_slip_m_s == pytest.approx(1.0, abs=0.01)
    assert found.greatest_slip == pytest.approx(-0.8, abs=0.01)


def test_a_stuck_robot():
    stuck = np.where(np.arange(TIME.size) >= 90, 1.0, 0.0)
    (found,) = immobilised_episodes(track(0.0, stuck=stuck))
    assert (found.start_s, found.end_s) == pytest.approx((9.0, 9.9))


def test_a_robot_that_loses_more_than_is_allowed_for_sure_has_an_episode_of_its_own():
    slip = np.where((TIME > 2.95) & (TIME < 5.05), 0.23, 0.04)
    blank = dict.fromkeys(FloorEstimate._fields, np.zeros(TIME.size))
    rim = np.tile([0.0, 0.15, 0.0], (TIME.size, 1))
    for std, count in ((0.1, 1), (0.12, 0)):
        known = {"travel_slip": slip, "travel_slip_std": np.full(TIME.size, std), "rim": rim}
        found = robot_episodes(FloorRun(TIME, FloorEstimate(**(blank | known)), 0.0))
        assert len(found) == count  # 0.23 - 0.05 is 1.8 sigmas of 0.1 and 1.5 of 0.12
        for episode in found:
            assert episode[:3] == pytest.approx(("robot", 3.0, 5.0))
            assert episode[3:] == pytest.approx((0.23 * 0.15, 0.23))
