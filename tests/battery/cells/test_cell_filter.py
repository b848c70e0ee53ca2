import math
from dataclasses import replace

import numpy as np
import pytest

from battery.examples import PLAIN, STRAIGHT
from kernels import kernel_of
from ohmward.battery.cells.cell_filter import COMMON, GAIN, SOC, CellFilter, CellSample, CellSpread, TypicalCell
from ohmward.filters.belief import Belief, unpack
from ohmward.filters.kalman import correct_state

#: Cells that differ in charge and capacity only, so that the difference of their voltages is linear in both.
CHARGE_ONLY = CellSpread(
    resistance_std=0.0, curve_std_V=0.0, soc_axis_std=0.0, overpotential_share=0.0, soc_walk=0.0, efficiency_std=0.0
)
FILTER = CellFilter(STRAIGHT, replace(PLAIN, ocv_slip_std=0.0), 1, CHARGE_ONLY)


def typical(soc, soc_std=1e-4, voltage_V=0.0):
    ones = np.ones_like(soc)
    return TypicalCell(soc, soc_std * ones, 0.0 * ones, ones, ones, voltage_V * ones)


def first(soc_std=1e-4):
    return CellSample(0.0, 0.0, math.nan, 25.0, typical(0.8, soc_std))


def test_it_is_the_regression_of_the_voltages_on_charge_and_capacity():
    """On a straight curve V_k - V = slope (d_soc + d_gain moved) + noise: a linear regression with a prior."""
    rng = np.random.default_rng(0)
    steps = 400
    current_A = rng.uniform(-2.0, 1.5, steps)
    dt_s = np.full(steps, 10.0)
    dt_s[0] = 0.0
    mean_A = 0.5 * (current_A + np.concatenate([[0.0], current_A[:-1]]))
    moved = np.cumsum(mean_A * dt_s) / STRAIGHT.capacity_As
    y = 0.04 + 0.1 * moved + CHARGE_ONLY.voltage_std_V * rng.standard_normal(steps)

    soc = 0.6 + moved
    assert (soc + y).min() > 0.05 and (soc + y).max() < 0.95
    samples = CellSample(dt_s, current_A, y + 3.5, np.full(steps, 25.0), typical(soc, 1e-4, 3.5))
    state = FILTER.init(CellSample(0.0, 0.0, math.nan, 25.0, typical(float(soc[0]))))
    state, estimates = kernel_of(FILTER, state, CellSample(0.0, 0.0, 0.0, 25.0, typical(0.5))).scan(state, samples)

    X = np.stack([np.ones(steps), moved], axis=1)
    prior = np.diag([CHARGE_ONLY.soc_std**-2, CHARGE_ONLY.capacity_std**-2])
    # the step before the first sample moved nothing, and each R is that of a curve linearised without an error
    information = prior + X.T @ X / CHARGE_ONLY.voltage_std_V**2
    mean = np.linalg.solve(information, X.T @ y / CHARGE_ONLY.voltage_std_V**2)
    cov = np.linalg.inv(information)
    belief = unpack(state.belief)
    assert belief.mean[GAIN] == pytest.approx(mean[1], abs=1e-6)
    assert belief.mean[SOC] == pytest.approx(mean[0] + moved[-1] * mean[1], abs=1e-6)
    assert belief.cov[GAIN, GAIN] == pytest.approx(cov[1, 1], rel=1e-6)
    assert estimates.capacity_ratio[-1] == pytest.approx(1 / (1 + mean[1]), abs=1e-6)


def test_what_the_typical_cell_learns_moves_the_differences_as_in_one_filter_of_both():
    rng = np.random.default_rng(1)
    A = rng.standard_normal((6, 6))
    cov = 1e-3 * (A @ A.T)
    joint = Belief(np.array([0.0, *rng.standard_normal(5)]), cov)
    e, variance = 0.02, 3e-3
    expected = correct_state(joint, COMMON, e, variance)
    after = typical(0.8 + expected.mean[COMMON], math.sqrt(expected.cov[COMMON, COMMON]))
    found = FILTER.follow(joint, TypicalCell(*(float(x) for x in after)), float(expected.mean[COMMON]))
    assert found.mean[1:] == pytest.approx(expected.mean[1:], abs=1e-12)
    assert found.mean[COMMON] == 0.0
    assert found.cov == pytest.approx(expected.cov, abs=1e-12)


def test_a_cell_on_a_straight_curve_is_known_as_the_typical_one_and_no_better():
    """The voltage says d_soc whatever the common error is: their covariance stays zero."""
    state = FILTER.init(first(0.1))
    for _ in range(50):
        sample = CellSample(1.0, 0.0, 3.55, 25.0, typical(0.8, 0.1, 3.6))
        state, estimate = FILTER.step(state, CellSample(*sample[:4], TypicalCell(*(float(x) for x in sample.typical))))
    assert estimate.soc_difference == pytest.approx(-0.05, abs=1e-3)
    assert estimate.soc_std == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize("voltage_V", [math.nan, 0.0, -1.0, 1e9])
def test_a_voltage_that_no_cell_has_leaves_the_estimate(voltage_V):
    filter_ = replace(FILTER, spread=CellSpread())
    state = filter_.init(first())
    _, estimate = filter_.step(state, CellSample(1.0, -1.0, voltage_V, 25.0, typical(0.8, 0.01, 3.6)))
    assert estimate.soc == pytest.approx(0.8)
    assert estimate.soc_difference_std == pytest.approx(CellSpread().soc_std, rel=1e-3)
    assert estimate.flags == 2
