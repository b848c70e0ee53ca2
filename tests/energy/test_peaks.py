import numpy as np
import pytest

from ohmward.energy.consumption import begin_drive, learn, start, with_terrain
from ohmward.energy.consumption_prior import prior_from_robot
from ohmward.energy.leg import Leg, Stretch, stretch_of
from ohmward.energy.peaks import PeakRatio, mean_power_W, peaks_of_way
from ohmward.energy.points import normal_tail
from ohmward.traction import RLMA

GRASS = stretch_of(Leg(50.0, "grass", 0.5))
KNOWN = begin_drive(learn(with_terrain(begin_drive(start(prior_from_robot(RLMA))), "grass"), GRASS, 3000.0))


def seen(ratios: np.ndarray) -> PeakRatio:
    found = PeakRatio()
    for ratio in ratios:
        found = found.with_stretch(50.0 * ratio, 50.0)
    return found


def test_the_ratio_that_was_seen_outweighs_the_usual_one():
    ratios = np.exp(np.log(3.0) + 0.1 * np.random.default_rng(1).standard_normal(400))
    found = seen(ratios)
    assert (found.mean, found.squares) == pytest.approx((np.log(ratios).mean(), 400 * np.log(ratios).var()))
    assert found.expected == pytest.approx((np.log(3.0), 0.1), rel=0.25)
    assert seen(ratios[:1]).expected[1] > found.expected[1]


@pytest.mark.parametrize(("peak_W", "mean_W"), [(0.0, 50.0), (50.0, 0.0), (50.0, -5.0)])
def test_a_stretch_that_takes_no_power_tells_nothing(peak_W, mean_W):
    assert PeakRatio(2.0, 0.5, 0.1).with_stretch(peak_W, mean_W) == PeakRatio(2.0, 0.5, 0.1)


def test_peaks_come_as_often_as_stretches_whose_peak_is_higher():
    ratio = seen(np.array([2.0, 2.0, 2.0]))
    peaks = peaks_of_way(KNOWN, [GRASS] * 5, ratio)
    mean, std = ratio.expected
    power_W = mean_power_W(KNOWN, GRASS) * np.exp(mean + std * np.array([-1.0, 0.0, 1.0, 6.0]))
    expected = normal_tail(np.array([-1.0, 0.0, 1.0])) / GRASS.time_s
    assert peaks.above(power_W) == pytest.approx([*expected, 0.0], rel=1e-3)


def test_a_long_leg_has_the_peaks_of_many_stretches():
    long = stretch_of(Leg(1800.0, "grass", 0.5))
    of_long, of_short = (peaks_of_way(KNOWN, way, PeakRatio()) for way in ([long], [GRASS]))
    at = np.array([1.2 * mean_power_W(KNOWN, GRASS)])
    assert of_long.above(at)[0] == pytest.approx(of_short.above(at)[0] * GRASS.time_s / 180.0, rel=0.01)


def test_a_robot_that_stands_has_no_peaks():
    assert peaks_of_way(KNOWN, [Stretch("", 60.0)], PeakRatio()).per_s.sum() == 0.0
