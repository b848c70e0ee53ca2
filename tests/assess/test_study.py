"""The study: figures by hand, the same from the same seed, resumed where it stopped, and the rules of the table."""

import csv
import math

import numpy as np
import pytest

from ohmward.assess.cell import CellFigures, cell, figures
from ohmward.assess.conditions import BASE, CONDITIONS
from ohmward.assess.lives import CHEMISTRIES, identified, measured
from ohmward.assess.methods import METHODS
from ohmward.assess.recommendation import recommend
from ohmward.assess.study import assess, items
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.errors import InputError
from ohmward.logs import Log

BY_NAME = {method.name: method for method in METHODS}
ONLY = ("nca", "base", "laboratory", "coulomb", "textbook-ekf")


def without_time(found):
    return [row._replace(ns=0.0) for row in found]


def test_figures_by_hand():
    time_s = np.array([0.0, 3000.0, 3600.0, 7200.0])
    error = np.array([[0.2, 0.2], [0.1, 0.1], [0.03, 0.1], [-0.04, 0.2]])
    std = np.array([[0.1, 0.1], [0.1, 0.1], [0.02, 0.02], [0.01, np.nan]])
    rmse, largest, covered, found_min, lost = figures(time_s, error, std)
    assert rmse == pytest.approx(math.sqrt((0.03**2 + 0.04**2 + 0.1**2 + 0.2**2) / 4))
    assert largest == 0.2 and covered == pytest.approx(1 / 3) and lost == 0.5
    assert found_min == math.inf  # the median of 60 minutes and never
    assert figures(time_s, error[:, :1], std[:, :1])[3] == 60.0


def test_a_cell_is_what_the_estimator_gives():
    condition, runs = BASE._replace(factor="x"), 2
    samples, truth = measured("nca", condition, runs, 3)
    errors = []
    for run, sign in enumerate((-1.0, 1.0)):
        log = Log("shift", np.cumsum(samples.dt_s), *(values[:, run] for values in samples[1:]))
        start = min(float(truth[0, run]) + sign * 0.05, 1.0)
        errors.append(SocEstimator(BY_NAME["ekf"].make(identified("nca")), start).run(log).soc - truth[:, run])
    found = cell("nca", condition, BY_NAME["ekf"], runs, 3)
    late = np.cumsum(samples.dt_s) >= 3600.0
    assert found.rmse == pytest.approx(np.sqrt(np.mean(np.square(errors)[:, late])), rel=1e-6)


def test_the_same_seed_gives_the_same_table_also_in_parts(tmp_path):
    whole = assess(tmp_path / "whole", 2, 5, ONLY)
    assess(tmp_path / "parts", 2, 5, ("nca", "base", "coulomb", "textbook-ekf"))
    calls = []
    again = assess(tmp_path / "parts", 2, 5, ONLY, progress=lambda done, total: calls.append((done, total)))
    assert without_time(again) == without_time(whole) and calls == [(4, 4)]
    with (tmp_path / "whole" / "summary.csv").open(newline="", encoding="utf-8") as stream:
        assert [float(row["rmse"]) for row in csv.DictReader(stream)] == [row.rmse for row in sorted(whole, key=_item)]
    assert without_time(assess(tmp_path / "other", 2, 6, ONLY)) != without_time(whole)
    with pytest.raises(InputError, match="results of another"):
        assess(tmp_path / "whole", 2, 6, ONLY)


def _item(row):
    return f"{row.chemistry} | {row.condition} | {row.method}"


def test_words_choose_items():
    assert len(items()) == len(CHEMISTRIES) * len(CONDITIONS) * len(METHODS)
    assert items(("nca", "base", "ekf")) == ["nca | base: everyday sensors | ekf"]
    with pytest.raises(InputError, match="no 'nmc' to assess; there are lfp"):
        items(("nmc",))


def test_an_offset_of_the_sensor_misleads_counting_by_its_charge():
    offset = next(c for c in CONDITIONS if c.name == "current offset: 5 % of C")
    condition = offset._replace(start_error=0.0, gain=0.0)
    found = cell("nca", condition, BY_NAME["coulomb"], 2, 1)
    assert found.largest == pytest.approx(8 * 0.05, abs=0.02)  # the first voltage moves the start a little
    assert found.lost == 1.0 and found.found_min == math.inf


def row(method, condition, rmse, covered, operations):
    return CellFigures("lfp", condition, method, rmse, 0.0, covered, 0.0, 0.0, operations, 1.0)


def test_the_recommendation_takes_the_worst_condition_and_a_band_that_holds():
    found = [
        row("small", "temperature: 5 degC", 0.05, 1.0, 100),
        row("small", "temperature: 40 degC", 0.02, 1.0, 100),
        row("sure", "temperature: 5 degC", 0.01, 0.5, 1000),
        row("sure", "temperature: 40 degC", 0.01, 1.0, 1000),
        row("right", "temperature: 5 degC", 0.03, 0.95, 1000),
        row("right", "temperature: 40 degC", 0.03, 0.95, 1000),
        row("large", "temperature: 5 degC", 0.02, 0.95, 9000),
        row("large", "temperature: 40 degC", math.nan, 0.95, 9000),
    ]
    chosen = {r.processor: (r.method, r.worst_rmse, r.trusted) for r in recommend(found)}
    assert chosen == {
        "2 KB of flash": ("small", 0.05, True),
        "16 KB of flash": ("right", 0.03, True),
        "computer": ("right", 0.03, True),
    }
    (only, *_) = recommend(found[2:4])
    assert only.method == "sure" and not only.trusted
