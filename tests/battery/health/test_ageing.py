"""Trend of the capacity against oracles: joint normal distribution, laws that made the data, and populations."""

import math

import numpy as np
import pytest

from ohmward.battery.health.ageing import (
    WORN_LOSS,
    AgeingFit,
    AgeingLaws,
    CapacityUncertainty,
    Track,
    ageing_laws,
    fit_ageing,
    life_ahead,
    no_law,
)

DOUBT = CapacityUncertainty(new=0.03, common=0.01, walk=0.01)
CHEMISTRIES = ["lfp", "nmc", "nca", "lipo", "lead-acid", ""]


def law(years: float, cycles: float, shape: float) -> AgeingLaws:
    return AgeingLaws(*(np.array([x]) for x in (years, cycles, shape, 0.0, 0.0)))


def seen(
    of: AgeingLaws, months: int, rng: np.random.Generator, std: float = 0.02, a_day: float = 0.6, a_month: int = 8
) -> Track:
    """Some logs a month of a battery that follows one law."""
    days = np.sort(rng.uniform(0.0, 30.4 * months, a_month * months))
    value = -of.loss(days, a_day * days)[0] + std * rng.standard_normal(days.size)
    return Track(days, a_day * days, value, np.full(days.size, std))


def years_left(fit: AgeingFit, track: Track, quantiles: tuple[float, ...]) -> list[float]:
    ahead = life_ahead(fit, track.days[-1], track.cycles[-1], np.random.default_rng(2))
    return [ahead.quantile(q) / 365.25 for q in quantiles]


@pytest.mark.parametrize("shape", [0.5, 1.0, 2.5])
def test_a_battery_of_age_one_has_lost_a_fifth(shape):
    of = law(5.0, 1000.0, shape)
    assert of.loss(np.array([2.5 * 365.25]), np.array([500.0]))[0, 0] == pytest.approx(-math.log(0.8))
    assert of.loss(np.zeros(1), np.zeros(1))[0, 0] == 0.0


def test_without_a_law_the_trend_is_the_joint_normal_distribution():
    track = Track(np.array([0.0, 10.0, 40.0]), np.zeros(3), np.array([0.01, -0.02, 0.03]), np.array([0.02, 0.03, 0.04]))
    fit = fit_ageing(no_law(), track, DOUBT, reversible_std=0.0)
    days = np.array([0.0, 25.0, 60.0])
    times = np.concatenate([track.days, days])
    walk = 0.01**2 * 86400.0 * np.minimum(times[:, None], times) / 3.6e6
    joint = DOUBT.new**2 + DOUBT.common**2 + walk
    measured = joint[:3, :3] + np.diag(track.std**2)
    gain = np.linalg.solve(measured, joint[:3, 3:]).T
    mean, std = fit.band(days, np.zeros(3))
    np.testing.assert_allclose(mean, gain @ track.value, rtol=1e-9)
    variance = np.diag(joint[3:, 3:] - gain @ joint[:3, 3:]) + DOUBT.common**2
    np.testing.assert_allclose(std, np.sqrt(variance), rtol=1e-9)


def test_logs_weigh_the_laws_by_their_likelihood():
    laws = AgeingLaws(*(np.array(c) for c in ([2.0, 20.0], [1e9, 1e9], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0])))
    track = seen(law(2.0, 1e9, 1.0), 12, np.random.default_rng(1))
    fit = fit_ageing(laws, track, DOUBT, reversible_std=0.0)
    covariance = DOUBT.covariance(track.days, track.days) + np.diag(fit.track.std**2)
    squares = [u @ np.linalg.solve(covariance, u) for u in track.value + laws.loss(track.days, track.cycles)]
    expected = 1.0 / (1.0 + math.exp(-0.5 * (squares[1] - squares[0])))
    assert fit.weight[0] == pytest.approx(expected, rel=1e-6)
    assert expected > 0.9


def test_one_log_that_is_far_off_moves_the_trend_little():
    rng = np.random.default_rng(4)
    track = seen(law(6.0, 3000.0, 1.0), 12, rng)
    spoilt = track._replace(value=np.where(np.arange(track.days.size) == 50, -0.5, track.value))
    now = track.days[-1:], track.cycles[-1:]
    clean, with_it = (fit_ageing(ageing_laws("nmc"), t, DOUBT).band(*now)[0][0] for t in (track, spoilt))
    assert abs(with_it - clean) < 0.01
    assert abs(fit_ageing(ageing_laws("nmc"), spoilt, DOUBT).residual[50]) > 10.0


@pytest.mark.parametrize("chemistry", CHEMISTRIES)
def test_without_logs_the_time_left_is_that_of_the_population(chemistry):
    nothing = Track(*np.zeros((4, 0)))
    fit = fit_ageing(ageing_laws(chemistry), nothing, DOUBT)
    ahead = life_ahead(fit, 0.0, 0.0, np.random.default_rng(3))
    early, median, late = (ahead.quantile(q) / 365.25 for q in (0.05, 0.5, 0.95))
    assert 0.0 <= early < 4.0 < median < 12.0 < late
    assert np.all(np.diff(ahead.probability) >= 0.0)
    assert np.all(ahead.log_capacity[0] <= ahead.log_capacity[2])


def test_the_time_left_covers_the_laws_that_made_the_data():
    """Batteries drawn from their population, a year of logs each: the true time left lies in nine of ten bands."""
    rng = np.random.default_rng(6)
    laws = ageing_laws("nmc")
    usual = laws.log_prior + np.where(laws.first_age == 0.0, 0.0, -np.inf)
    weight = np.exp(usual - usual.max())
    inside, batteries = 0, 24
    for row in rng.choice(weight.size, batteries, p=weight / weight.sum()):
        truth = laws.chosen(np.array([row]))
        track = seen(truth, 12, rng, std=0.01, a_month=2)  # nearly as much as eight a month show
        days = np.linspace(0.0, 60 * 365.25, 20_000)
        worn = days[np.argmax(truth.loss(days, 0.6 * days)[0] >= WORN_LOSS)]
        left = max(worn - track.days[-1], 0.0) / 365.25
        low, high = years_left(fit_ageing(laws, track, DOUBT), track, (0.05, 0.95))
        inside += low - 0.01 <= left <= high or (left > 30.0 and high == math.inf)
    assert inside / batteries >= 0.9


def test_more_months_of_logs_narrow_the_time_left():
    of = law(5.0, 1500.0, 1.0)
    widths = []
    for months in (2, 12, 24):
        track = seen(of, months, np.random.default_rng(7))
        low, high = years_left(fit_ageing(ageing_laws("nmc"), track, DOUBT), track, (0.05, 0.95))
        widths.append(math.log((high + months / 12) / (low + months / 12)))
    assert widths[2] < widths[1] < widths[0]


def test_a_battery_that_is_worn_out_has_no_time_left():
    days = np.linspace(0.0, 365.0, 50)
    track = Track(days, 0.6 * days, np.full(50, math.log(0.7)), np.full(50, 0.01))
    low, high = years_left(fit_ageing(ageing_laws("nmc"), track, DOUBT), track, (0.05, 0.95))
    assert (low, high) == (0.0, 0.0)
