"""Simulated cells that were never tested: five everyday days teach the file, two later days judge it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np

from figure import Figure, at_least, at_most
from learning_score import (
    COVERAGE_BAR,
    LABEL,
    LEARNT,
    LIVE,
    TESTED,
    Errors,
    error_figures,
    errors,
    pooled,
    value_figures,
    without_truth,
)
from lives_cells import (
    LABEL as LABEL_ONLY,
)
from lives_cells import (
    PULSES,
    PULSES_SLOW,
    Life,
    LifeCell,
    aged_cell,
    battery_from,
    capacity_of,
    measured,
    truth_of_life,
)
from lives_health import pulse_ohm
from lives_table import SETTLED_S
from measured_cells import Recording
from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal, generic_battery
from ohmward.battery.learning.fold import ocv_std_V
from ohmward.battery.learning.learn import Learnt, learn
from ohmward.battery.learning.log_update import LogUpdate
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.score import score
from ohmward_lab.simulate.mission import DayPlan, days

#: Everyday: a mean temperature of the air and a load for each day, and a full charge in the night after.
_LEARNT = tuple(
    DayPlan(degC, 4.0, load, charged_fully=True)
    for degC, load in ((22.0, 1.0), (20.0, 1.2), (24.0, 0.9), (18.0, 1.1), (21.0, 1.0))
)
#: The days after, one of them colder than all that were learnt.
_LATER = tuple(DayPlan(degC, 4.0, load, charged_fully=True) for degC, load in ((20.0, 1.1), (12.0, 1.0)))
WEEK = Life(_LEARNT + _LATER, seed=3)
#: An aged cell has less charge for a day: five cycles teach, a sixth judges.
AGED_RATIO = 0.8
AGED = Life(6 * (DayPlan(25.0, 3.0, load=0.8, charged_fully=True),), AGED_RATIO)
N_LEARNT = 5
STARTS = {"right start": 0.0, "start unknown": None}
#: Bars of the issue: RMSE over that of a file from tests, errors [%] of capacity and resistance, RMSE [points].
_TIMES_TESTED, _CAPACITY_BAR, _AGED_CAPACITY_BAR, _AGED_RESISTANCE_BAR, _AGED_RMSE_BAR = 1.5, 4.0, 3.0, 10.0, 1.5
#: Two files are the same where they differ by less than their sigma.
_SAME_BAR = 1.0
#: Labels are wrong: shares of what this one says.
_OTHER_LABELS = (0.9, 1.1)


@cache
def recorded_days(cell: LifeCell, life: Life) -> tuple[Recording, ...]:
    """One recording for each day of a life."""
    truth = truth_of_life(cell, life)
    log = replace(measured(truth, cell, f"{len(life.plans)} days"), start_unix_s=0.0)
    ends_s = [_duration_s(cell, life, k) for k in range(len(life.plans) + 1)]
    parts = []
    for k, (start_s, end_s) in enumerate(pairwise(ends_s), start=1):
        part = (log.time_s >= start_s) & (log.time_s < end_s)
        rows = np.flatnonzero(part)
        parts.append(Recording(replace(without_truth(log.select(rows)), name=f"day {k}"), truth.soc[rows]))
    return tuple(parts)


def _duration_s(cell: LifeCell, life: Life, count: int) -> float:
    """Duration of the first days of a life [s]."""
    if count == 0:
        return 0.0
    return float(days(np.random.default_rng(life.seed), capacity_of(cell.new), life.plans[:count]).time_s[-1])


def updates(battery: Battery, recordings: tuple[Recording, ...]) -> Iterator[tuple[Battery, LogUpdate]]:
    """The file and its last update after each recording, one after the other, as a robot's owner learns them."""
    for log, _ in recordings:
        battery, (update,) = learn(battery, [log])
        yield battery, update


@cache
def tested_errors(cell: LifeCell) -> dict[str, Errors]:
    """Of a file from pulses and a low rate test on the later days, by their start."""
    later = recorded_days(cell, WEEK)[N_LEARNT:]
    return {words: errors(battery_from(cell, PULSES_SLOW), later, start) for words, start in STARTS.items()}


def before_the_week(cell: LifeCell) -> Iterator[Figure]:
    """The later days without `learn`: a file from tests, the label, and the label with a filter that runs on."""
    data, parts, label = week_name(cell), recorded_days(cell, WEEK), battery_from(cell, LABEL_ONLY)
    for words, start in STARTS.items():
        yield from error_figures(data, TESTED, words, tested_errors(cell)[words], None)
        yield from error_figures(data, LABEL, words, errors(label, parts[N_LEARNT:], start), None)
    found, capacity_Ah = running_on(label, parts)
    yield from error_figures(data, LIVE, "running on", found, None)
    yield from value_figures(data, LIVE, "capacity", Normal(capacity_Ah, np.nan), capacity_of(cell.new))


def week(cell: LifeCell) -> Iterator[Figure]:
    """From the label through five everyday days: the band on the day after each, all of it on the later ones."""
    data, parts = week_name(cell), recorded_days(cell, WEEK)
    found = list(updates(battery_from(cell, LABEL_ONLY), parts[:N_LEARNT]))
    for day, (battery, _) in enumerate(found[:-1], start=1):
        words = f"after {day} day{'s' * (day > 1)}, start unknown"
        yield from first_days(data, words, errors(battery, parts[day : day + 1], None))
    battery, update = found[-1]
    yield from value_figures(data, LEARNT, "capacity", update.capacity_Ah, capacity_of(cell.new), _CAPACITY_BAR)
    yield from value_figures(data, LEARNT, "resistance", update.resistance_ohm, pulse_ohm(cell.new))
    for words, start in STARTS.items():
        bar = _TIMES_TESTED * tested_errors(cell)[words].rmse
        yield from error_figures(data, LEARNT, words, errors(battery, parts[N_LEARNT:], start), bar)
    yield from other_labels(cell)


def other_labels(cell: LifeCell) -> Iterator[Figure]:
    """The later days from labels that say another capacity: one tenth less and one tenth more."""
    parts = recorded_days(cell, WEEK)
    for ratio in _OTHER_LABELS:
        label = generic_battery(cell.chemistry, ratio * cell.label_Ah, cell.new.n_series)
        *_, (battery, update) = updates(label, parts[:N_LEARNT])
        later = errors(battery, parts[N_LEARNT:], None)
        words = f"label times {ratio:g}, start unknown"
        yield from first_days(week_name(cell), words, later)
        yield at_most(week_name(cell), LEARNT, f"interval score {words}, points", later.interval, None, ".1f")
        yield from value_figures(
            week_name(cell), LEARNT, f"capacity, label times {ratio:g}", update.capacity_Ah, capacity_of(cell.new)
        )


def week_name(cell: LifeCell) -> str:
    """For the table."""
    return f"{cell.chemistry}, {cell.name}"


def first_days(data: str, words: str, found: Errors) -> Iterator[Figure]:
    """Of a file that has learnt a day or more: its band on days after."""
    yield at_most(data, LEARNT, f"RMSE {words}, points", found.rmse, None, ".2f")
    yield at_least(data, LEARNT, f"covered {words}, %", found.covered, COVERAGE_BAR, ".0f")


def running_on(battery: Battery, parts: tuple[Recording, ...]) -> tuple[Errors, float]:
    """Errors on the later days, and the capacity [Ah], of a filter that has run since the first day."""
    estimator, found, capacity_Ah = SocEstimator(battery), [], np.nan
    for day, (log, truth) in enumerate(parts):
        run = estimator.run(log).estimates
        if day == N_LEARNT - 1:
            capacity_Ah = float(run.soh_capacity[-1]) * battery.capacity_Ah
        settled = log.time_s - log.time_s[0] >= SETTLED_S
        band = score(run.soc[settled], truth[settled], run.soc_std[settled])
        found.append((score(run.soc, truth, run.soc_std), band))
    return pooled(found[N_LEARNT:]), capacity_Ah


def before_the_cycles(cell: LifeCell) -> Iterator[Figure]:
    """The file of the new cell, its filter running through the cycles of the aged one."""
    found, capacity_Ah = running_on(battery_from(cell, PULSES), recorded_days(cell, AGED))
    yield from error_figures(aged_name(cell), LIVE, "running on", found, None)
    older_Ah = capacity_of(aged_cell(cell.new, AGED_RATIO))
    yield from value_figures(aged_name(cell), LIVE, "capacity", Normal(capacity_Ah, np.nan), older_Ah)


def aged(cell: LifeCell) -> Iterator[Figure]:
    """Five cycles of a cell with 80 % of its capacity and 1.5 times its resistance, with the file of the new cell."""
    data, parts = aged_name(cell), recorded_days(cell, AGED)
    older = aged_cell(cell.new, AGED_RATIO)
    *_, (battery, update) = updates(battery_from(cell, PULSES), parts[:N_LEARNT])
    yield from value_figures(data, LEARNT, "capacity", update.capacity_Ah, capacity_of(older), _AGED_CAPACITY_BAR)
    yield from value_figures(data, LEARNT, "resistance", update.resistance_ohm, pulse_ohm(older), _AGED_RESISTANCE_BAR)
    for words, start in STARTS.items():
        found = errors(battery, parts[N_LEARNT:], start)
        yield from error_figures(data, LEARNT, words, found, _AGED_RMSE_BAR)


def aged_name(cell: LifeCell) -> str:
    """For the table."""
    return f"{week_name(cell)}, aged to {100 * AGED_RATIO:.0f} %"


def same(cell: LifeCell) -> Iterator[Figure]:
    """Three days from the label; in another order, one of them twice, one cut in two: the same file."""
    one, two, three = (log for log, _ in recorded_days(cell, WEEK)[:3])
    middle_s = 0.5 * (two.time_s[0] + two.time_s[-1])
    halves = (two.between(-np.inf, middle_s), two.between(middle_s, np.inf))
    first, second = (replace(half, name=f"{two.name}, part {k}") for k, half in enumerate(halves, start=1))
    sequences = {
        "the other order": (three, two, one),
        "one log twice": (one, two, two, three),
        "one log cut in two": (one, first, second, three),
    }
    label = battery_from(cell, LABEL_ONLY)
    usual = learn(label, [one, two, three])
    for words, logs in sequences.items():
        other = learn(label, logs)
        for name, difference in differences(usual, other).items():
            yield at_most(week_name(cell), LEARNT, f"{words}: {name}", difference, _SAME_BAR, ".2f")


def differences(one: Learnt, two: Learnt) -> dict[str, float]:
    """Differences of two files in their own sigmas, and of the logarithms of these sigmas.

    The sigma of the curve is that of the file, the error of its SoC axis included: where the curve is steep, a
    difference in voltage is first of all one of the axis.
    """
    a, b = one.updates[-1], two.updates[-1]
    soc = np.linspace(0.1, 0.9, 33)

    def ocv_V(learnt: Learnt) -> np.ndarray:
        curve = learnt.battery.thevenin.ocv.voltage_V
        return np.interp(soc, np.linspace(0.0, 1.0, len(curve)), curve)

    return {
        "capacity, sigmas": abs(a.capacity_Ah.mean - b.capacity_Ah.mean) / a.capacity_Ah.std,
        "resistance, sigmas": abs(a.resistance_ohm.mean - b.resistance_ohm.mean) / a.resistance_ohm.std,
        "largest of the curve, sigmas": float(np.max(np.abs(ocv_V(one) - ocv_V(two)) / ocv_std_V(one.battery, soc))),
        "sigma of the capacity, logarithm": abs(float(np.log(b.capacity_Ah.std / a.capacity_Ah.std))),
    }
