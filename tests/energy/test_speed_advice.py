from dataclasses import replace

import numpy as np
import pytest

from energy.examples import certain, learned
from ohmward.energy.consumption import HEAT, energy_demand
from ohmward.energy.leg import Leg, stretch_of
from ohmward.energy.speed_advice import speed_advice
from ohmward.errors import InputError

WIDE = (0.05, 5.0)


def per_metre(c, speed_m_s):
    return energy_demand(c, [stretch_of(Leg(1.0, "grass", speed_m_s))]).mean_J


def test_the_best_speed_is_the_least_of_a_fine_grid():
    c = certain(idle_W=6.0, force_N=20.0, speed_N_s_per_m=10.0)
    found = speed_advice(c, "grass", 0.3, WIDE)
    grid = np.linspace(0.1, 3.0, 2901)
    best = min(grid, key=lambda v: per_metre(c, v))
    assert found.speed_m_s == pytest.approx(best, abs=1e-3)
    assert found.energy_J_per_m == pytest.approx(per_metre(c, best), rel=1e-5)
    assert found.saving_J_per_m == pytest.approx(per_metre(c, 0.3) - per_metre(c, best), rel=1e-4)
    assert not found.at_limit


def test_idle_power_dominates_a_slow_robot():
    c = certain(idle_W=10.0, force_N=10.0)
    slow, fast = (speed_advice(c, "grass", v, WIDE) for v in (0.5, 2.0))
    assert slow.idle_share == pytest.approx(20.0 / 30.0)
    assert slow.idle_dominates and not fast.idle_dominates
    assert slow.speed_m_s == 5.0 and slow.at_limit


def test_heat_of_the_windings_asks_for_haste_too():
    c = certain(idle_W=6.0, force_N=20.0, speed_N_s_per_m=10.0)
    mean = c.mean.copy()
    mean[HEAT] = 0.01  # 4 W at 20 N, and 1 N s/m of 10 N s/m
    c = replace(c, mean=mean)
    best = speed_advice(c, "grass", 0.3, WIDE).speed_m_s
    assert best == pytest.approx(np.sqrt((6.0 + 4.0) / (10.0 + 1.0)))
    speeds = np.linspace(0.5 * best, 2.0 * best, 1501)
    assert speeds[np.argmin([per_metre(c, v) for v in speeds])] == pytest.approx(best, rel=1e-3)


def test_the_deviation_of_the_saving_against_random_draws():
    c = learned()
    found = speed_advice(c, "grass", 0.4, (0.1, 0.8))
    draws = np.random.default_rng(0).multivariate_normal(c.mean, c.cov, 20_000)
    saving = draws[:, 0] * (1 / 0.4 - 1 / found.speed_m_s) + draws[:, 1] * (0.4 - found.speed_m_s)
    assert found.saving_J_per_m == pytest.approx(saving.mean(), rel=0.02)
    assert found.saving_std_J_per_m == pytest.approx(saving.std(), rel=0.03)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("ice", 0.5, WIDE), "terrain must be one of grass, got 'ice'"),
        (("grass", 0.0, WIDE), "speed_m_s must be > 0"),
        (("grass", 0.5, (1.0, 0.5)), "limits_m_s must ascend"),
    ],
)
def test_what_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        speed_advice(certain(), *arguments)
