"""Robots drawn from the very prior: what is predicted of their next stretch must hold as often as it says."""

import numpy as np

from energy.examples import PRIOR
from ohmward.energy.consumption import (
    begin_drive,
    design_row,
    energy_demand,
    learn,
    scatter_J2,
    start,
    with_terrain,
)
from ohmward.energy.leg import Leg, stretch_of
from ohmward.energy.points import normal_points, quantiles
from ohmward.energy.range import DIMENSIONS, needed_J

ROBOTS = 300


def a_prediction(seed):
    """Whether the energy of 500 m on the next day is within P10-P90, after two days of ten stretches."""
    rng = np.random.default_rng(seed)
    c = with_terrain(start(PRIOR), "grass")
    truth = rng.multivariate_normal(c.mean, c.cov)
    sigma, tau = (np.sqrt(v.sum / rng.chisquare(v.dof)) for v in (c.scatter, c.day))

    def spent(stretch):
        ground_J2, idle_J2 = scatter_J2(c, stretch)
        scatter_J = np.sqrt(sigma**2 * ground_J2 / c.scatter.value + idle_J2)
        return float(design_row(c, stretch) @ truth + scatter_J * rng.standard_normal())

    for _ in range(2):
        c = begin_drive(c)
        truth[[-3, -1]] = tau / np.sqrt(2) * rng.standard_normal(2)  # day effects; the force stands between
        for _ in range(10):
            s = stretch_of(Leg(rng.uniform(20, 80), "grass", rng.uniform(0.2, 1.0), rng.normal(0, 0.01)))
            c = learn(c, s, spent(s))
    c = begin_drive(c)
    truth[[-3, -1]] = tau / np.sqrt(2) * rng.standard_normal(2)
    ahead = stretch_of(Leg(500.0, "grass", 0.5))
    band = quantiles(needed_J(energy_demand(c, [ahead]), normal_points(DIMENSIONS)))
    return band.p10 <= spent(ahead) <= band.p90


def test_four_of_five_predictions_come_true():
    inside = np.mean([a_prediction(seed) for seed in range(ROBOTS)])
    # three standard deviations of a share of 300, and a little for the variances that are learned apart
    assert 0.8 - 0.08 <= inside <= 0.8 + 0.1
