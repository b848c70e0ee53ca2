"""The studies: the same from the same seed, resumed where they stopped, and the rules of the recommendation."""

import csv
import math

import pytest

from ohmward.errors import InputError
from ohmward_lab.assess.battery import SocFigures
from ohmward_lab.assess.study import STUDIES, assess
from ohmward_lab.assess.traction import SlipFigures

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
    chosen = {r.processor: (r.method, r.worst_rmse) for r in BATTERY.recommended(found)}
    assert chosen == {"2 KB of flash": ("small", 0.05), "16 KB of flash": ("right", 0.03), "computer": ("right", 0.03)}


def helps(found, study=BATTERY, **bar):
    """What helps where none is recommended, by situation and processor; the name of the method elsewhere."""
    return {(r.situation, r.processor): r.method or r.helps for r in study.recommended(found, **bar)}


def test_a_band_that_does_not_hold_and_an_error_beyond_the_bar_are_not_recommended():
    found = [
        row("bandless", "temperature: 5 degC", 0.05, math.nan, 100),
        row("sure", "temperature: 5 degC", 0.02, 0.5, 100),
        row("far", "temperature: 5 degC", 0.081, 0.99, 100),
        row("larger", "temperature: 5 degC", 0.04, 0.99, 1000),
    ]
    (small, large, *_) = BATTERY.recommended(found)
    assert small.method is None and small.closest == "sure" and small.worst_rmse == 0.02
    assert small.helps == ("a larger processor",) and large.method == "larger"
    assert BATTERY.recommended(found, 0.09)[0].method == "far"
    assert {r.method for r in BATTERY.recommended(found, 0.03)} == {None}


def test_the_rows_tell_whether_a_sensor_or_a_processor_or_both_help():
    offset, sensor = "current sensor with offset and gain", "a better current sensor"
    bad, base = "current offset: 5 % of C", "base: everyday sensors"
    poor = row("small", bad, 0.2, 1.0, 100)
    by_sensor = [poor, row("small", base, 0.05, 1.0, 100)]
    assert helps(by_sensor)[offset, "2 KB of flash"] == (sensor,)
    assert helps([*by_sensor, row("large", bad, 0.05, 1.0, 1000)])[offset, "2 KB of flash"] == (
        sensor,
        "a larger processor",
    )
    by_both = [poor, row("small", base, 0.1, 1.0, 100), row("large", base, 0.05, 1.0, 1000)]
    assert helps(by_both)[offset, "2 KB of flash"] == (f"{sensor} and a larger processor",)
    assert helps([poor])[offset, "2 KB of flash"] == ()


def drive(method, condition, rmse, covered):
    return SlipFigures("rlma", condition, method, rmse, 0.0, covered, covered, 0.0, 0.0, 0.0, 0.0, 100, 1.0)


def test_a_band_that_holds_does_not_make_a_filter_better_than_plain_wheels():
    wheels = drive("wheels", "slope: 5 %", 0.010, math.nan)
    worse = drive("ekf", "slope: 5 %", 0.011, 1.0)
    assert {r.method for r in TRACTION.recommended([wheels, worse])} == {"wheels"}
    assert {r.method for r in TRACTION.recommended([wheels, worse._replace(rmse=0.0104)])} == {"ekf"}
    assert {r.method for r in TRACTION.recommended([wheels._replace(rmse=0.09), worse])} == {"ekf"}
    assert {r.method for r in TRACTION.recommended([wheels._replace(rmse=0.09)])} == {None}


def test_filters_that_are_worse_than_plain_wheels_are_named():
    found = [drive(name, "slope: 5 %", rmse, 1.0) for name, rmse in (("wheels", 0.01), ("ekf", 0.02), ("ukf", 0.01))]
    (row,) = TRACTION.worse(found)
    assert (row.where, row.methods, row.rmse, row.than_rmse) == ("slopes", ("ekf",), (0.02,), (0.01,)) and not row.every
    assert TRACTION.worse([found[0], found[1]])[0].every
    assert TRACTION.worse([found[0], found[2]]) == []


def test_a_filter_that_is_worse_for_being_told_the_right_ground_is_named():
    right, wrong = "ground told: ice", "ground: ice, told asphalt"
    found = [drive("ekf", right, 0.3, 1.0), drive("ekf", wrong, 0.1, 1.0)]
    (row,) = TRACTION.worse(found)
    assert (row.where, row.than, row.methods) == (right, wrong, ("ekf",))
    assert TRACTION.worse([found[0]]) == TRACTION.worse([found[0], found[1]._replace(rmse=0.4)]) == []


def test_the_pairs_of_grounds_differ_in_what_is_told_alone():
    by_name = {condition.name: condition for condition in TRACTION.conditions}
    for right, wrong in TRACTION.pairs:
        right, wrong = by_name[right], by_name[wrong]
        assert right.world == wrong.world and right.assumed == right.world.ground != wrong.assumed
    assert len(TRACTION.pairs) == sum(condition.factor == "ground" for condition in TRACTION.conditions)


@pytest.mark.parametrize("study", STUDIES.values(), ids=list(STUDIES))
def test_every_improvement_names_conditions_that_there_are(study):
    known = {name for condition in study.conditions for name in (condition.name, condition.factor)}
    improvements = [improvement for situation in study.situations for improvement in situation.improvements]
    assert improvements and all(set(improvement.conditions) <= known for improvement in improvements)
