"""Sudden changes: found where they are, told apart by what changed with them, and none where there is only ageing."""

import math

import numpy as np
import pytest

from ohmward.battery.chemistries import Normal, generic_battery
from ohmward.battery.health.ageing import WORN_LOSS, HealthPoint
from ohmward.battery.health.health import Health, health_of

BATTERY = generic_battery("nmc", 10.0)
#: Change of ln(capacity) and ln(resistance), and whether full charges go on, after a year.
CHANGES = {
    "counter": (-0.1, 0.1, True),
    "battery": (-0.1, 0.3, True),
    "not full": (-0.1, 0.0, False),
    "exchange": (0.15, -0.4, True),
    "unknown": (0.1, 0.0, True),
}


def points(months: int, change: str = "", seed: int = 1) -> list[HealthPoint]:
    """A log a week of a battery that ages to 80 % in five years; what changes after a year."""
    rng = np.random.default_rng(seed)
    days = np.sort(rng.uniform(0.0, 30.4 * months, 4 * months))
    found = []
    for k, day in enumerate(days):
        age = day / (5 * 365.25)
        capacity, resistance, full = -WORN_LOSS * age + 0.02 * rng.normal(), 0.4 * age + 0.05 * rng.normal(), True
        if change and day > 365.0:
            more, ohm, full = CHANGES[change]
            capacity, resistance = capacity + more, resistance + ohm
        own = Normal(capacity, 0.02), Normal(resistance, 0.05)
        found.append(HealthPoint(f"week {k}", 1.7e9 + 86400.0 * day, 5.0, 3.5, *own, 20.0, full))
    return found


def health(of: list[HealthPoint]) -> Health:
    return health_of(BATTERY, of, np.random.default_rng(0))


def test_ageing_alone_is_no_sudden_change():
    found = [health(points(24, seed=seed)) for seed in range(12)]
    assert [one.changes for one in found] == [()] * 12
    truth = -WORN_LOSS * 2 / 5
    z = [(one.capacity_now.mean - truth) / one.capacity_now.std for one in found]
    assert max(map(abs, z)) < 2.0


@pytest.mark.parametrize("cause", CHANGES)
def test_a_sudden_change_is_found_and_told_by_what_changed_with_it(cause):
    found = health(points(24, cause))
    (change,) = found.changes
    assert change.cause == cause
    assert change.days == pytest.approx(365.0, abs=20.0)
    assert abs(change.capacity.mean - CHANGES[cause][0]) < 3 * change.capacity.std


@pytest.mark.parametrize(("cause", "lost"), [("counter", 0.0), ("not full", 0.0), ("battery", -0.1)])
def test_only_a_change_of_the_battery_is_a_loss(cause, lost):
    """A wrong counter and broken-off charges leave the trend as it would be without them."""
    now = health(points(24, cause)).capacity_now
    assert abs(now.mean - (-WORN_LOSS * 2 / 5 + lost)) < 2 * now.std


def test_one_cold_log_is_named_and_moves_nothing():
    of = points(18)
    cold = of[36]._replace(log_capacity=Normal(of[36].log_capacity.mean - 0.15, 0.02), temperature_degC=2.0)
    found = health([*of[:36], cold, *of[37:]])
    assert [(outlier.log, outlier.cause) for outlier in found.outliers] == [("week 36", "cold")]
    assert found.capacity_now.mean == pytest.approx(health(of).capacity_now.mean, abs=0.005)


def test_a_cold_winter_is_no_ageing():
    of = [
        p._replace(log_capacity=Normal(p.log_capacity.mean - 0.1, 0.02), temperature_degC=0.0) if k >= 30 else p
        for k, p in enumerate(points(12))
    ]
    found = health(of)
    assert [change.cause for change in found.changes] == ["cold"]
    assert abs(found.capacity_now.mean + WORN_LOSS / 5) < 2 * found.capacity_now.std


def test_logs_that_say_nothing_leave_the_prior():
    of = [HealthPoint(f"log {k}", 1.7e9 + 86400.0 * k, 1.0, 0.1) for k in range(5)]
    found = health(of)
    assert math.exp(found.capacity_now.mean) == pytest.approx(0.95, abs=0.06)
    assert found.capacity_now.std > 0.03
    assert (found.changes, found.outliers) == ((), ())


def test_the_order_of_the_points_does_not_matter():
    of = points(6)
    assert health(of[::-1]).capacity_now == health(of).capacity_now
