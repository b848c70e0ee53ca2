"""Capacity over logs from the estimates of a filter, against the Gaussian of all logs at once."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ohmward.battery.chemistries import Normal, generic_battery
from ohmward.battery.health.ageing import logarithm
from ohmward.battery.health.capacity_over_logs import capacity_over_logs, shows_capacity

BATTERY = generic_battery("nmc", 10.0)
DAY_S = 86400.0


def test_it_is_the_gaussian_of_the_walk_given_all_measurements():
    rng = np.random.default_rng(0)
    time_s: Any = DAY_S * np.array([0.0, 0.2, 0.4, 0.5, 0.9])  # no day yet, in which a battery ages
    walk = np.asarray(BATTERY.noise.capacity_walk_variance(time_s))
    prior = 0.1**2 + np.minimum.outer(walk, walk)
    R = np.diag(np.square([0.05, 0.2, 0.03, 0.03, 0.02]))
    y = rng.multivariate_normal(np.full(5, 0.9), prior + R)

    def given(n: int) -> tuple[np.ndarray, np.ndarray]:
        gain = prior[:, :n] @ np.linalg.inv((prior + R)[:n, :n])
        return 0.9 + gain @ (y[:n] - 0.9), prior - gain @ prior[:n]

    filtered = [(given(k + 1)[0][k], given(k + 1)[1][k, k] ** 0.5) for k in range(5)]
    found = capacity_over_logs(BATTERY, time_s, *zip(*filtered, strict=True))
    mean, cov = given(5)
    np.testing.assert_allclose(found.mean, mean, atol=1e-12)
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(cov)), atol=1e-12)
    assert found.change.mean == pytest.approx(mean[-1] - mean[0], abs=1e-12)
    assert found.change.std == pytest.approx((cov[0, 0] + cov[-1, -1] - 2 * cov[0, -1]) ** 0.5, abs=1e-12)


def test_a_capacity_found_long_ago_opens_as_that_of_a_file_does():
    found = capacity_over_logs(BATTERY, DAY_S * np.array([0.0, 365.0, 730.0]), [0.95] * 3, [0.05] * 3)
    aged_std = 0.1 * np.array([0.0, 1.0, np.sqrt(2.0)])
    np.testing.assert_allclose(found.std[1:], np.hypot(0.05, aged_std[1:]), rtol=0.02)  # less what is smoothed
    assert found.change.std >= aged_std[-1]


def test_one_log_has_no_change():
    found = capacity_over_logs(BATTERY, [5.0], [0.9], [0.05])
    assert (found.mean, found.std, found.change) == ([0.9], [0.05], (0.0, 0.0))


@pytest.mark.parametrize(
    ("of_file", "mean", "std", "is_known"),
    [(0.1, 1.0, 0.09, False), (0.1, 1.0, 0.07, True), (0.01, 1.0, 0.015, True), (0.1, 0.68, 0.12, True)],
)
def test_logs_show_the_capacity_if_they_say_as_much_as_the_file_or_surely_another(of_file, mean, std, is_known):
    battery = replace(BATTERY, noise=replace(BATTERY.noise, capacity_std=of_file))
    assert shows_capacity(battery, logarithm(Normal(mean, std), 1.0)) is is_known
