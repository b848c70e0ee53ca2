"""The studies: the same from the same seed, resumed where they stopped, and the rules of the recommendation."""

import csv
import math

import pytest

from ohmward.errors import InputError
from ohmward_lab.assess.battery.cell import SocFigures
from ohmward_lab.assess.study import STUDIES, assess

BATTERY, TRACTION = STUDIES["battery"], STUDIES["traction"]
ONLY = ("nca", "base", "laboratory", "coulomb", "textbook-ekf")


def without_time(found):
    return [row._replace(ns=0.0) for row in found]


def test_the_same_seed_gives_the_same_table_also_in_parts(tmp_path):
    whole = assess(BATTERY, tmp_path / "whole", 2, 5, ONLY)
    assess(BATTERY, tmp_path / "parts", 2, 5, ("nca", "base", "coulomb", "textbook-ekf"))
    calls = []
    again = assess(BATTERY, tmp_path / "parts", 2, 5, ONLY, progress=lambda done, total: calls.append((done, total)))
    assert without_time(again) == without_time(whole) and calls == [(4, 4)]
    with (tmp_path / "whole" / "summary.csv").open(newline="", encoding="utf-8") as stream:
        assert [float(row["rmse"]) for row in csv.DictReader(stream)] == [row.rmse for row in sorted(whole, key=_item)]
    assert without_time(assess(BATTERY, tmp_path / "other", 2, 6, ONLY)) != without_time(whole)
    with pytest.raises(InputError, match="results of another"):
        assess(BATTERY, tmp_path / "whole", 2, 6, ONLY)


def test_drives_too_are_the_same_in_parts(tmp_path):
    only = ("rlma", "base", "mass", "wheels", "ekf")
    whole = assess(TRACTION, tmp_path / "whole", 2, 5, only)
    assess(TRACTION, tmp_path / "parts", 2, 5, ("rlma", "mass", "ekf"))
    again = assess(TRACTION, tmp_path / "parts", 2, 5, only)
    assert repr(without_time(again)) == repr(without_time(whole))  # nan is not nan
    assert [row.method for row in whole] == ["wheels", "ekf"] * 3
    with pytest.raises(InputError, match="results of another"):
        assess(BATTERY, tmp_path / "whole", 2, 5, ONLY)


@pytest.mark.parametrize("study", STUDIES.values(), ids=list(STUDIES))
def test_every_factor_is_in_one_situation_and_no_name_stands_twice(study):
    factors = [factor for situation in study.situations for factor in situation.factors]
    assert sorted(factors) == sorted({condition.factor for condition in study.conditions})
    names = [condition.name for condition in study.conditions]
    assert len(set(names)) == len(names) >= 25


def _item(row):
    return f"{row.chemistry} | {row.condition} | {row.method}"


def test_words_choose_items():
    assert len(BATTERY.items()) == len(BATTERY.subjects) * len(BATTERY.conditions) * len(BATTERY.methods)
    assert BATTERY.items(("nca", "base", "ekf")) == ["nca | base: everyday sensors | ekf"]
    with pytest.raises(InputError, match="no 'nmc' to assess; there are lfp"):
        BATTERY.items(("nmc",))


def row(method, condition, rmse, covered, operations):
    return SocFigures("lfp", condition, method, rmse, 0.0, covered, 0.0, 0.0, operations, 1.0)


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
    chosen = {r.processor: (r.method, r.worst_rmse, r.trusted) for r in BATTERY.recommended(found)}
    assert chosen == {
        "2 KB of flash": ("small", 0.05, True),
        "16 KB of flash": ("right", 0.03, True),
        "computer": ("right", 0.03, True),
    }
    (alone, *_) = BATTERY.recommended([row("bandless", "temperature: 5 degC", 0.05, math.nan, 100)])
    assert math.isnan(alone.least_covered) and not alone.trusted
    (only, *_) = BATTERY.recommended(found[2:4])
    assert only.method == "sure" and not only.trusted
