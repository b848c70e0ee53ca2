"""State of charge that something else than the voltage tells at the start of a log."""

import math
from dataclasses import replace

import numpy as np
import pytest

from battery.learning.test_another_battery import day
from cli.examples import MODEL
from ohmward.battery.battery import Knowledge, SeenLog
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.learning import learn
from ohmward.battery.learning.samples import samples_of
from ohmward.battery.learning.start import full_at_start, given_at_start
from ohmward.logs import Log

LABEL = generic_battery("nmc", 10.0)
MIDNIGHT_S = 1_700_000_000.0


def evening(start_unix_s: float | None = MIDNIGHT_S, voltage_V: float = 3.9, current_A: float = 0.0) -> Log:
    """An hour at a steady current."""
    time_s = np.arange(0.0, 3600.0, 60.0)
    steady = np.ones(time_s.size)
    log = Log("evening", time_s, current_A * steady, voltage_V * steady, 25.0 * steady)
    return replace(log, start_unix_s=start_unix_s)


def after(*logs: SeenLog):
    """The label after it has seen these logs."""
    return replace(LABEL, knowledge=Knowledge((), (), logs))


def test_the_user_knows_better_than_the_log_before():
    battery = after(SeenLog("day", "", MIDNIGHT_S - 86400.0, MIDNIGHT_S, end_soc=0.4, end_soc_std=0.02))
    (told,) = given_at_start(battery, evening(), 0.7)
    assert (told.sample, told.soc, told.std) == (0, 0.7, 0.03)


@pytest.mark.parametrize("gap_s", [0.0, 60.0, 1200.0])
@pytest.mark.parametrize(("end_A", "start_A", "rate_C"), [(0.0, 0.0, 0.05), (-20.0, 0.0, 2.05), (0.0, -5.0, 0.55)])
def test_a_log_goes_on_with_the_charge_of_the_one_before(gap_s, end_A, start_A, rate_C):
    battery = after(
        SeenLog(
            "day", "", MIDNIGHT_S - 86400.0, MIDNIGHT_S - gap_s, end_soc=0.4, end_soc_std=0.02, end_current_A=end_A
        ),
        SeenLog("a day without a clock", end_soc=0.9, end_soc_std=0.01),
    )
    (told,) = given_at_start(battery, evening(current_A=start_A), None)
    assert told.soc == 0.4
    # the current of either side may have gone on in between
    assert told.std == pytest.approx(math.hypot(0.02, 0.01, rate_C * gap_s / 3600.0))


@pytest.mark.parametrize(
    "seen",
    [
        SeenLog("two hours before", "", 0.0, MIDNIGHT_S - 7200.0, end_soc=0.4, end_soc_std=0.02),
        SeenLog("of an older file", "", 0.0, MIDNIGHT_S),
        SeenLog("without a clock", end_soc=0.4, end_soc_std=0.02),
    ],
)
def test_another_log_tells_nothing(seen):
    assert given_at_start(after(seen), evening(), None) == ()
    assert given_at_start(after(seen), evening(None), None) == ()


@pytest.mark.parametrize(
    ("voltage_V", "current_A", "full"), [(4.2, 0.0, True), (4.2, 1.0, False), (4.2, -1.0, False), (4.1, 0.0, False)]
)
def test_a_rest_at_the_voltage_of_a_full_battery_is_full(voltage_V, current_A, full):
    (samples,) = samples_of(evening(voltage_V=voltage_V, current_A=current_A), LABEL)
    told = full_at_start(LABEL, samples)
    assert bool(told) is full
    if told:
        assert told[0].soc == 1.0 and told[0].std == pytest.approx(math.hypot(0.03, LABEL.noise.soc_axis_std))


def test_what_was_learnt_at_the_end_of_a_log_is_kept_in_the_file():
    learnt = learn(LABEL, [evening()])
    (update,) = learnt.updates
    assert learnt.battery.knowledge is not None
    (seen,) = learnt.battery.knowledge.logs
    assert (seen.end_soc, seen.end_soc_std) == tuple(update.soc_end)
    (told,) = given_at_start(learnt.battery, evening(MIDNIGHT_S + 3600.0), None)
    assert told.soc == update.soc_end.mean


def test_what_is_new_of_a_log_goes_on_with_the_charge_of_what_was_learnt_from():
    log = replace(day(MODEL, 1), start_unix_s=MIDNIGHT_S)
    middle_s = float(log.time_s[len(log) // 2])
    morning, afternoon = log.between(-np.inf, middle_s), log.between(middle_s, np.inf)
    battery = learn(generic_battery("nmc", 12.0, 3), [morning]).battery
    (of_whole,), (apart,) = (learn(battery, [each]).updates for each in (log, afternoon))
    assert of_whole.soc_start.std == pytest.approx(apart.soc_start.std, rel=0.01)
    assert abs(of_whole.soc_start.mean - apart.soc_start.mean) < 0.1 * apart.soc_start.std


def day_in_two_parts(monkeypatch) -> tuple[Log, int]:
    """A day from full that is solved in two parts, and the first sample of the second."""
    log = day(MODEL, 1)
    middle = len(log) // 2
    monkeypatch.setattr("ohmward.battery.learning.samples._MOST_SAMPLES", middle + 1)
    return log, middle


def test_a_given_start_is_not_that_of_a_later_part_whose_log_has_no_voltage_before(monkeypatch):
    log, middle = day_in_two_parts(monkeypatch)
    blind = replace(log, voltage_V=np.where(np.arange(len(log)) < middle, np.nan, log.voltage_V))
    (update,) = learn(generic_battery("nmc", 12.0, 3), [blind], initial_soc=1.0).updates
    truth = 1.0 + float(log.charge_Ah()[middle]) / 12.0
    assert update.verdict == "learnt"
    assert abs(update.soc_start.mean - truth) < 2.0 * update.soc_start.std < 0.3


def test_no_log_goes_on_with_the_charge_of_a_part_before_the_last_one(monkeypatch):
    log, middle = day_in_two_parts(monkeypatch)
    blind = replace(log, voltage_V=np.where(np.arange(len(log)) < middle, log.voltage_V, np.nan))
    for learnt_from, is_known in ((log, True), (blind, False)):
        (seen,) = learn(generic_battery("nmc", 12.0, 3), [learnt_from]).battery.learnt_logs
        assert (seen.end_soc is not None) == (seen.end_soc_std is not None) == is_known
