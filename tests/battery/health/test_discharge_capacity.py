"""Capacity of a discharge: where discharges end, which of them count, and which were broken off."""

import math

import numpy as np
import pytest

from ohmward.battery.chemistries import Normal
from ohmward.battery.health.history import DatedLogs, Newness, points_of, used_capacities
from ohmward.battery.learning.log_update import LogUpdate
from ohmward.logs import Log

NOTHING = Normal(math.nan, math.inf)


def update(log: str, soc_min: float, capacity_Ah: float = 10.0) -> LogUpdate:
    given = Normal(capacity_Ah * (1 - soc_min), 0.01 * capacity_Ah * (1 - soc_min))
    return LogUpdate(
        log=log,
        verdict="learnt",
        reason="",
        hours=3.0,
        soc_min=soc_min,
        soc_max=1.0,
        capacity_Ah=Normal(capacity_Ah, 0.3),
        resistance_ohm=Normal(0.1, 0.01),
        offset_A=Normal(0.0, 0.01),
        information={},
        residual_rms_V=0.005,
        misfit=1.0,
        soc_start=Normal(soc_min, 0.02),
        soc_end=Normal(1.0, 0.01),
        own_capacity_Ah=NOTHING,
        own_resistance_ohm=NOTHING,
        given_Ah=given,
    )


def given(*lows: float) -> list:
    found = used_capacities([update(f"log {k}", low) for k, low in enumerate(lows)])
    return [pytest.approx(each.capacity_Ah.mean) for each in found]


def test_a_discharge_gives_all_above_its_end():
    (found,) = used_capacities([update("one", 0.1)])
    assert found.latest is not None and found.latest.log == "one"
    assert found.capacity_Ah.mean == pytest.approx(9.0)
    assert found.capacity_Ah.std == pytest.approx(9.0 * math.hypot(0.01, 0.01))


def test_a_battery_that_is_not_emptied_has_all_of_its_capacity():
    (found,) = used_capacities([update("one", 0.5)])
    assert found.latest is None
    assert found.capacity_Ah == Normal(10.0, 0.3)


def test_discharges_that_were_broken_off_do_not_count():
    assert given(0.1, 0.6, 0.3, 0.1) == [9.0, 9.0, 9.0, 9.0]


def test_an_end_that_rises_slowly_is_followed():
    """As the resistance of an old battery grows, its cut-off comes earlier from cycle to cycle."""
    assert given(0.10, 0.14, 0.55, 0.18, 0.22, 0.25) == [9.0, 8.6, 8.6, 8.2, 7.8, 7.5]


def test_a_curve_that_was_learnt_moves_capacity_and_end_together_and_not_their_product():
    updates = [update("one", 0.05, 10.0), update("two", 0.13, 10.9), update("three", 0.6, 11.0)]
    assert [each.capacity_Ah.mean for each in used_capacities(updates)] == pytest.approx([9.5, 9.483, 9.483])


def test_a_log_that_was_set_aside_changes_nothing():
    updates = [update("one", 0.1), update("two", math.nan)]
    assert [each.latest.log for each in used_capacities(updates) if each.latest] == ["one", "one"]


def test_a_deeper_discharge_is_no_growth_and_a_curve_that_was_learnt_no_loss():
    new = Newness(10.0, 0.1, ())
    logs = [Log(name, 3600.0 * np.arange(2.0), np.zeros(2), np.full(2, 13.0)) for name in ("one", "two", "three")]
    dated = DatedLogs(tuple(logs), np.array([0.0, 1e6, 2e6]), True)
    learnt = update("three", 0.13)
    updates = [update("one", 0.17), update("two", 0.03, 9.3), learnt]
    points = points_of(dated, updates, new)
    assert math.exp(points[1].log_capacity.mean) == pytest.approx(0.93, abs=0.01)
    same = update("two", 0.07)._replace(given_Ah=updates[0].given_Ah)
    points = points_of(dated, [updates[0], same, learnt], new)
    assert math.exp(points[1].log_capacity.mean) == pytest.approx(1.0, abs=0.01)
