"""Fits of traction laws: what goes in comes out, intervals hold, and a law is judged by what it has not seen."""

import math

import numpy as np
import pytest
from scipy.stats import binom, kstest, t

from ohmward.errors import InputError
from ohmward.traction.friction.law import CoulombCreep, contact
from ohmward.traction.friction.terrain import SOILS
from ohmward_lab.traction.friction_fit import (
    Family,
    ForceSlip,
    Free,
    LawFit,
    brush,
    burckhardt,
    coulomb_creep,
    drawbar_N,
    fit_law,
    lack_of_fit,
    left_out_errors_N,
    select_law,
    soft_ground,
    ward_iagnemma,
    ward_iagnemma_with_slope,
)

FLOOR = 1e-3
RIM_M_S = np.array([0.0, 0.03, 0.05, 0.08, 0.1, 0.12, 0.15, 0.2, 0.4, 1.0])
CONTACT = contact(RIM_M_S, np.full(10, 0.1), np.linspace(20.0, 25.0, 10))
#: Of each family: values of its parameters.
TRUTHS = [
    (ward_iagnemma(), (0.6, 30.0)),
    (ward_iagnemma_with_slope(), (0.6, 30.0, -0.02)),
    (burckhardt(FLOOR), (0.9, 12.0, 0.3)),
    (brush(0.05, FLOOR), (0.7, 3e4)),
    (coulomb_creep(), (0.6, 6.0)),
    (soft_ground(SOILS["firm soil"], 0.06, 0.05, FLOOR), (28.0, 0.01)),
]
#: One start: for tests that fit often.
SLOPE = Family("slope", (Free("slope_s_per_m", 1e-2, 1e4, (10.0,)),), lambda slope: CoulombCreep(1e3, slope))
GRIPPING = contact(np.tile(np.linspace(0.08, 0.12, 5), 4), np.full(20, 0.1), np.full(20, 50.0))
GROUPS = np.tile(np.arange(5), 4)


def measured(family, values, share=0.05, at=CONTACT, noise_N=0.0, rng=None):
    exact = drawbar_N(family.make(*values), share, at)
    return ForceSlip(at, exact + (noise_N * rng.standard_normal(len(exact)) if rng else 0.0))


@pytest.mark.parametrize(("family", "values"), TRUTHS, ids=[family.name for family, _ in TRUTHS])
def test_what_made_the_forces_is_found(family, values):
    fit = fit_law(measured(family, values), family)
    assert fit.rmse_N < 1e-4
    assert [i.value for i in fit.intervals] == pytest.approx([*values, 0.05], rel=2e-3)
    assert fit.law == family.make(*(i.value for i in fit.intervals[:-1]))
    assert fit.family == family.name


def test_the_resistance_acts_against_the_motion():
    law, share = CoulombCreep(0.5, 10.0), 0.2
    rolling = contact(np.array([0.1, -0.1]), np.array([0.1, -0.1]), np.array([30.0, 30.0]))
    assert drawbar_N(law, share, rolling) == pytest.approx([-6.0, 6.0])


def test_it_is_linear_regression_where_the_law_is_linear():
    data = measured(SLOPE, (20.0,), 0.05, GRIPPING, 0.5, np.random.default_rng(1))
    columns = np.column_stack([GRIPPING.load_N * GRIPPING.slip_speed_m_s, -GRIPPING.load_N])
    best, squares, *_ = np.linalg.lstsq(columns, data.force_N, rcond=None)
    std = np.sqrt(squares[0] / 18 * np.linalg.inv(columns.T @ columns)[1, 1])
    slope, share = fit_law(data, SLOPE).intervals
    assert (slope.value, share.value) == pytest.approx(tuple(best), rel=1e-6)
    assert share.high - share.value == pytest.approx(t.ppf(0.975, 18) * std, rel=1e-6)
    assert math.log(slope.high / slope.value) == pytest.approx(math.log(slope.value / slope.low))


def test_intervals_hold_as_often_as_they_say():
    rng, runs = np.random.default_rng(2), 300
    held = 0
    for _ in range(runs):
        slope, _ = fit_law(measured(SLOPE, (20.0,), 0.05, GRIPPING, 1.0, rng), SLOPE).intervals
        held += slope.low < 20.0 < slope.high
    assert binom.ppf(1e-3, runs, 0.95) <= held <= binom.ppf(1 - 1e-3, runs, 0.95)


def test_what_the_data_do_not_show_reaches_from_limit_to_limit():
    family = coulomb_creep()
    adhesion, slope, _ = fit_law(measured(family, (0.9, 5.0), 0.05, GRIPPING), family).intervals
    assert not adhesion.identified and (adhesion.low, adhesion.high) == pytest.approx((1e-3, 5.0))
    assert slope.identified and slope.value == pytest.approx(5.0, rel=1e-3)


def test_the_lack_of_fit_is_even_where_the_law_holds():
    rng = np.random.default_rng(3)
    data = [measured(SLOPE, (20.0,), 0.05, GRIPPING, 1.0, rng) for _ in range(200)]
    chances = [lack_of_fit(fit_law(d, SLOPE), d, GROUPS) for d in data]
    assert kstest(chances, "uniform").pvalue > 1e-3


def test_the_lack_of_fit_shows_a_law_that_does_not_hold():
    curved = measured(ward_iagnemma(), (0.5, 200.0), 0.05, GRIPPING, 0.1, np.random.default_rng(4))
    assert lack_of_fit(fit_law(curved, SLOPE), curved, GROUPS) < 1e-6


def test_a_group_is_foretold_from_the_others_only():
    data = ForceSlip(GRIPPING, np.arange(20.0))
    seen = []

    def mean_of_others(others, groups):
        seen.append(set(groups.tolist()))
        law = CoulombCreep(1e-9, 1e-9)
        share = -float(np.mean(others.force_N)) / 50.0
        return LawFit("mean", law, share, (), 0.0)

    errors_N = left_out_errors_N(data, GROUPS, mean_of_others)
    assert seen == [set(range(5)) - {g} for g in range(5)]
    for out in (np.equal(GROUPS, g) for g in range(5)):
        assert errors_N[out] == pytest.approx(data.force_N[~out].mean() - data.force_N[out], abs=1e-6)


def test_the_law_that_foretells_best_is_chosen():
    truth = ward_iagnemma()
    at = contact(np.tile(RIM_M_S, 2), np.full(20, 0.1), np.full(20, 25.0))
    data = measured(truth, (0.6, 30.0), 0.05, at, 0.05, np.random.default_rng(5))
    assert select_law(data, [SLOPE, truth], np.tile(RIM_M_S, 2)).family == truth.name


def test_what_is_refused():
    few = measured(SLOPE, (20.0,)).pick(np.arange(10) < 2)
    with pytest.raises(InputError, match="slope has 2 parameters and needs more measurements, got 2"):
        fit_law(few, SLOPE)
    broken = ForceSlip(GRIPPING, np.full(20, np.nan))
    with pytest.raises(InputError, match="force_N must hold 20 finite numbers"):
        fit_law(broken, SLOPE)
    good = measured(SLOPE, (20.0,), at=GRIPPING)
    with pytest.raises(InputError, match="at least two groups"):
        left_out_errors_N(good, np.zeros(20), lambda d, _: fit_law(d, SLOPE))
    with pytest.raises(InputError, match="more than the 2 parameters and fewer than the 20 values; got 20"):
        lack_of_fit(fit_law(good, SLOPE), good, np.arange(20))
    with pytest.raises(InputError, match="families must hold"):
        select_law(good, [], GROUPS)
    with pytest.raises(InputError, match="slope needs starts within 1 to 2, got"):
        Family("bad", (Free("slope", 1.0, 2.0, (3.0,)),), lambda s: CoulombCreep(1.0, s))
