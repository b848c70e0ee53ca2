"""Logs in order of time, and the new battery that they are measured against."""

from dataclasses import replace

import numpy as np
import pytest

from battery.health.test_discharge_capacity import update
from ohmward.battery.battery import Knowledge, SeenLog
from ohmward.battery.chemistries import Normal, generic_battery
from ohmward.battery.health.ageing import HealthPoint, Track, logarithm
from ohmward.battery.health.history import DatedLogs, common_error, in_order_of_time, newness, points_of, unlearnt
from ohmward.errors import InputError
from ohmward.logs import Log


def log(name: str, start_unix_s: float | None = None) -> Log:
    time_s = np.arange(0.0, 3601.0, 60.0)
    return Log(name, time_s, np.full(61, -5.0), np.full(61, 3.7), np.full(61, 20.0), start_unix_s=start_unix_s)


def test_logs_with_a_clock_are_sorted_by_it():
    dated = in_order_of_time([log("b", 2e9), log("a", 1e9)])
    assert [one.name for one in dated.logs] == ["a", "b"]
    assert dated.has_clock and not dated.notes


def test_logs_without_a_clock_follow_each_other():
    dated = in_order_of_time([log("b"), log("a")])
    assert [one.name for one in dated.logs] == ["b", "a"]
    np.testing.assert_allclose(dated.start_s, [0.0, 3600.0])
    assert "wall clock" in dated.notes[0]


def test_a_log_without_a_clock_among_others_is_refused():
    with pytest.raises(InputError, match="a: no date in this log"):
        in_order_of_time([log("b", 1e9), log("a")])


def test_a_log_without_a_date_among_more_that_have_one_is_left_out():
    dated = in_order_of_time([log("c", 2e9), log("undated"), log("a", 1e9)])
    assert [each.name for each in dated.logs] == ["a", "c"]
    assert len(dated.left_out) == 1
    assert dated.left_out[0].startswith("undated: no date in this log")


def test_no_log_is_refused():
    with pytest.raises(InputError, match="health needs at least one log"):
        in_order_of_time([])


def test_the_capacity_when_new_is_that_of_the_file_or_as_given():
    battery = generic_battery("nmc", 10.0)
    assert newness(battery, []).capacity_Ah == 10.0
    assert newness(battery, [], 9.5).capacity_Ah == 9.5


def test_the_resistance_when_new_of_a_label_is_that_of_the_first_log_that_shows_it():
    shows = update("two", 0.1)._replace(own_resistance_ohm=Normal(0.2, 0.01))
    new = newness(generic_battery("nmc", 10.0), [update("one", 0.1), shows])
    assert new.resistance_ohm == 0.2
    assert "nobody tested it" in new.notes[-1]


def test_the_resistance_when_new_of_a_tested_battery_is_that_of_its_file():
    label = generic_battery("nmc", 10.0)
    tested = replace(label, noise=replace(label.noise, resistance_std=0.1))
    assert "the battery file's" in newness(tested, [update("one", 0.1)]).notes[-1]


def test_a_file_that_has_learnt_is_told_of_its_logs_once_more():
    battery = replace(generic_battery("nmc", 10.0), knowledge=Knowledge(("capacity",), (0.01,), (SeenLog("a", "x"),)))
    assert unlearnt(battery).knowledge == Knowledge(("capacity",), (0.01,))
    assert "what it was then" in newness(battery, []).notes[-1]


def test_points_hold_throughput_and_the_capacity_of_a_discharge():
    dated = DatedLogs((log("a"), log("b")), np.array([0.0, 86400.0]), True)
    new = newness(generic_battery("nmc", 10.0), [update("a", 0.1)])
    first, second = points_of(dated, [update("a", 0.1), update("b", 0.14)], new)
    assert first.cycles == pytest.approx(0.25)
    assert np.exp(first.log_capacity.mean) == pytest.approx(1.0)
    assert np.exp(second.log_capacity.mean) == pytest.approx(8.6 / 9.0)
    track = Track.of([first, second], "log_capacity")
    np.testing.assert_allclose(track.days, [0.0, 1.0])
    np.testing.assert_allclose(track.cycles, [0.125, 0.375])


def test_a_copy_of_a_log_moves_no_charge_again():
    dated = DatedLogs((log("a"), log("copy of a")), np.array([0.0, 0.0]), True)
    copy = update("copy of a", np.nan)._replace(verdict="seen")
    new = newness(generic_battery("nmc", 10.0), [update("a", 0.1)])
    assert [point.cycles for point in points_of(dated, [update("a", 0.1), copy], new)] == [0.25, 0.0]


def test_a_quantity_that_is_not_known_has_no_logarithm():
    assert logarithm(Normal(np.nan, np.inf), 1.0).std == np.inf
    assert not HealthPoint("a", 0.0, 1.0, 0.0).shows_capacity


def test_logs_share_the_error_of_the_capacity_after_the_first_log_or_the_first_full_discharge():
    battery = generic_battery("nmc", 10.0)
    halves = [update("a", 0.5)._replace(capacity_Ah=Normal(10.0, 0.9)), update("b", 0.5)]
    assert common_error(battery, halves) == pytest.approx(0.09)
    assert common_error(battery, [*halves, update("c", 0.1)]) == pytest.approx(0.03)
