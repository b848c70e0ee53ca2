"""The curves of a step against the rule that they stand for."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.trace import Kernel
from ohmward.traction.terrain.floor import new_floor, slip_scale, travel_speed, wheel_motion
from ohmward.traction.terrain.slip_on_floors import MOST_MU, SlipCurves
from traction.terrain.drives import OMNI, SMOOTH, SOFT
from traction.terrain.slip_rule import slip_belief

FLOORS = {"smooth": SMOOTH, "soft": SOFT, "unseen": new_floor((SMOOTH, SOFT))}
#: Largest error of mean, sigma and covariance. Where friction is unknown the law lets go at each node of the rule, in
#: one step, which the curves take over one of their distances.
MOST_OFF = {"smooth": (1e-3, 1e-3, 1e-3), "soft": (1e-4, 1e-4, 1e-4), "unseen": (0.05, 0.1, 0.05)}


@pytest.mark.parametrize("name", FLOORS)
def test_the_curves_are_those_of_the_rule(name):
    curves, rng, off = SlipCurves(FLOORS[name]), np.random.default_rng(4), []
    for share, std in zip(rng.uniform(-0.45, 0.45, (200, 3)), rng.uniform(0.005, 0.05, (200, 3)), strict=True):
        rule, found = slip_belief(FLOORS[name], share, std), curves.belief(share, std)
        sigma = np.sqrt(np.diag(found.cov)) - np.sqrt(np.diag(rule.cov))
        off.append([abs(e).max() for e in (found.mean - rule.mean, sigma, found.cov - rule.cov)])
        assert np.linalg.eigvalsh(found.cov).min() > 0
    assert np.all(np.max(off, axis=0) < MOST_OFF[name])


def test_slip_is_odd_and_ends_where_no_floor_gives_more():
    curves = SlipCurves(SOFT)
    forth, back = (curves.belief(sign * np.array([0.3, 0.1, 5.0]), np.full(3, 0.02)) for sign in (1, -1))
    np.testing.assert_array_equal(forth.mean, -back.mean)
    np.testing.assert_allclose(forth.cov, back.cov, rtol=1e-12)
    assert forth.mean[2] == pytest.approx(curves.mean(MOST_MU)) == 1.0


def test_traced_it_is_the_same():
    floor = replace(SOFT, across=0.6, across_std=0.1, side=-0.2, side_std=0.05, speed_power=0.1, speed_power_std=0.02)
    curves = SlipCurves(floor)

    def belief(share, std, rim):
        scale = slip_scale(floor, *wheel_motion(OMNI, rim), travel_speed(rim))
        return curves.belief(share, std, scale)

    at = np.array([0.3, -0.2, 0.6]), np.array([0.02, 0.03, 0.04]), np.array([0.2, -0.1, 0.3])
    rule = slip_belief(floor, *at[:2], slip_scale(floor, *wheel_motion(OMNI, at[2]), travel_speed(at[2])))
    for found, expected, curve in zip(Kernel(belief, *at)(*at), belief(*at), rule, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        np.testing.assert_allclose(found, curve, atol=1e-4)
